// A sub-step, or a part of one, in which the level is a straight line in time.

// Time of the fraction num / den of the sub-step, in (start, end].
uint time_in_substep(uint start, uint end, float num, float den) {
    const uint span = end - start;
    const uint into = uint(clamp(ceil(float(span) * (num / den)), 1.0, float(span)));
    return start + min(into, span);
}

// Log intensity (with leak) at time t of the sub-step.
int level_at(int from, int to, uint start, uint end, uint t) {
    return from + int(roundEven(float(to - from) * (float(t - start) / float(end - start))));
}
