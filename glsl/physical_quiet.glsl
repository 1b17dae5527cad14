// The stretches of a physical pixel without noise. All levels are in fixed point: without lag they are the log-intensity
// pixel's bits.

// Distance of a turn from a threshold, nepers, within which a part ends at the turn.
const float TURN_MARGIN_LOG = 0.003;

// Whether the output turns so near a threshold that the cubic cannot tell whether it reaches it. A part that begins at such
// a turn may turn again at once, by rounding: that decides nothing.
bool turn_decides(Part part, PixelState p) {
    if (part.turn == part.end || part.turn - part.start < (part.end - part.start) / 16u) {
        return false;
    }
    const int above = output_at(part, part.turn) - p.reference;
    return nepers(min(abs(above - p.on_q24), abs(above + p.off_q24))) < TURN_MARGIN_LOG;
}

// When a stretch crosses `level`, which it does if it `rises` or falls. The straight line's crossing is made better once, on
// the part's cubic.
uint quiet_crossing(Part part, uint start, uint end, int from, int to, int level, bool rises) {
    const int sign = rises ? 1 : -1;
    const int to_go = sign * (level - from);
    const uint at = time_in_substep(start, end, float(to_go), float(sign * (to - from)));
    if (part.from_bow == 0.0 && part.to_bow == 0.0) {
        return at;
    }
    const int there = output_at(part, at);
    const int rest = sign * (level - there);
    if (rest > 0) {
        return at == end ? at : time_in_substep(at, end, float(rest), max(float(sign * (to - there)), 1.0));
    }
    return time_in_substep(start, at, float(to_go), max(float(sign * (there - from)), 1.0));
}

// Watches the pixel over the next stretch of the part, up to an event if there is one. Returns whether the part is over.
bool watch_quiet(Camera cam, inout PixelState p, inout Walk w) {
    // The stretch is the part, up to its turn or from it, also where the pixel has been watched for some of it.
    const bool turns = w.now < w.part.turn;
    const uint start = turns || w.part.turn == w.part.end ? w.part.start : w.part.turn;
    const uint end = turns ? w.part.turn : w.part.end;
    const int from = output_at(w.part, start);
    const int to = output_at(w.part, end);
    // After a change of parameters the level may lie beyond a threshold from the start.
    const bool settles = cam.no_skip != 0u && w.now <= 1u && end != start;
    const int first = settles ? level_at(from, to, start, end, w.now) - p.reference : 0;
    const bool starts_above = first >= p.on_q24;
    const bool starts_beyond = starts_above || -first >= p.off_q24;
    const bool rises = starts_beyond ? starts_above : to - p.reference >= p.on_q24;
    const bool falls = starts_beyond ? !starts_above : p.reference - to >= p.off_q24;
    if (!rises && !falls) {
        w.now = end;
        return end == w.part.end;
    }
    const int level = rises ? p.reference + p.on_q24 : p.reference - p.off_q24;
    const int to_go = rises ? level - from : from - level;
    uint at = to_go > 0 && !starts_beyond && end != start
        ? quiet_crossing(w.part, start, end, from, to, level, rises)
        : w.now;
    // The first instant of a sub-step belongs to the one before.
    at = min(max(max(at, w.now), w.part.start + 1u), w.part.end);
    fire(cam, at, rises, 0.0, 0.0, p, w);
    return false;
}
