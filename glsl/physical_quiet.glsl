// The stretches of a physical pixel without noise. All levels are in fixed point: without lag they are the log-intensity
// pixel's bits.

// Distance of a turn from a threshold, nepers, within which a part ends at the turn: of a cubic, and of a part that settles.
const float TURN_MARGIN_LOG = 0.003;
const float SETTLING_MARGIN_LOG = 0.0002;

// Times that a crossing is made better at most, and how near it is good enough, Q24.
const uint MOST_TRIES = 6u;
const float NEAR_Q24 = 4.0;

// Whether the output turns so near a threshold that the part's form cannot tell whether it reaches it. A part that begins at
// such a turn may turn again at once, by rounding: that decides nothing.
bool turn_decides(Part part, PixelState p) {
    if (part.turn == part.end || part.turn - part.start < (part.end - part.start) / 16u) {
        return false;
    }
    const int above = output_at(part, part.turn) - p.reference;
    const float margin = part.turns.y != 0.0 ? SETTLING_MARGIN_LOG : TURN_MARGIN_LOG;
    return nepers(min(abs(above - p.on_q24), abs(above + p.off_q24))) < margin;
}

// When a stretch crosses `level`, which it does if it `rises` or falls: where the straight line through its ends does, and
// on a bow nearer and nearer by straight lines between the instants found on both sides. What an instant is off moves the
// reference that a release sets, and with it all events that follow.
uint quiet_crossing(Part part, uint start, uint end, int from, int to, int level, bool rises) {
    const int sign = rises ? 1 : -1;
    uint low = start;
    uint high = end;
    float below = float(sign * (level - from));
    float above = float(sign * (to - level));
    const uint tries = part.bow == vec2(0.0) ? 0u : MOST_TRIES;
    uint at = time_in_substep(low, high, below, max(below + above, 1.0));
    bool was_low = false;
    for (uint i = 0u; i < tries && at < high; ++i) {
        const float rest = float(sign * (level - output_at(part, at)));
        if (abs(rest) <= NEAR_Q24) {
            break;
        }
        // A side that stays weighs half, so that the other one moves too.
        const bool is_low = rest > 0.0;
        if (is_low) {
            low = at;
            below = rest;
        } else {
            high = at;
            above = -rest;
        }
        if (i != 0u && is_low == was_low) {
            above *= is_low ? 0.5 : 1.0;
            below *= is_low ? 1.0 : 0.5;
        }
        was_low = is_low;
        at = time_in_substep(low, high, below, max(below + above, 1.0));
    }
    return at;
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
