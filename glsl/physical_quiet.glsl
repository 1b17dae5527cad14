// The stretches of a physical pixel without noise. All levels are in fixed point: without lag they are the log-intensity
// pixel's bits.

// Distance of a turn from a threshold, nepers, within which a part ends at the turn: of a cubic, and of a part that settles.
const float TURN_MARGIN_LOG = 0.003;
const float SETTLING_MARGIN_LOG = 0.0002;

// Times that a crossing is made better at most, and how near it is good enough, Q24.
const uint MOST_TRIES = 16u;
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

// Time until the output of a part that settles has gone `rest`, Q24, at the slope that it has at `at`, ns. Not finite where
// it stands still.
float time_by_slope(Part part, uint at, float rest) {
    const vec2 falls = part.turns * exp(-share_of(part, at) * part.turns);
    const float slope_log = nepers(part.to - part.from) + dot(part.bow, part.come - falls);
    return rest / (slope_log * LOG_SCALE * part.per_ns);
}

// When a stretch crosses `level` from `now` on, which it does if it `rises` or falls: where the straight line through its
// ends does, and on a bow nearer and nearer. A part that settles may be still for most of its length, where straight lines
// come nearer by too little each time. It is the slope that says how far the crossing is, as long as that lies between the
// instants found on both sides. What an instant is off moves the reference that a release sets, and with it all events that
// follow.
uint quiet_crossing(Part part, uint now, uint start, uint end, int from, int to, int level, bool rises) {
    const float sign = rises ? 1.0 : -1.0;
    float below = sign * float(level - from);
    float above = sign * float(to - level);
    if (part.bow == vec2(0.0)) {
        return time_in_substep(start, end, below, max(below + above, 1.0));
    }
    const bool settles = part.turns.y != 0.0;
    uint low = start;
    uint high = end;
    if (now > start) {
        low = now;
        below = sign * float(level - output_at(part, low));
    }
    bool was_low = false;
    float rest = below;
    uint at = low;
    for (uint i = 0u; i < MOST_TRIES; ++i) {
        const float by_slope_ns = settles ? time_by_slope(part, at, sign * rest) : -LONGEST_TURN;
        if (by_slope_ns > -float(at - low) && by_slope_ns < float(high - at)) {
            at = clamp(uint(int(at) + int(ceil(by_slope_ns))), low + 1u, high);
        } else {
            at = time_in_substep(low, high, below, max(below + above, 1.0));
        }
        if (at >= high) {
            break;
        }
        rest = sign * float(level - output_at(part, at));
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
        ? quiet_crossing(w.part, w.now, start, end, from, to, level, rises)
        : w.now;
    // The first instant of a sub-step belongs to the one before.
    at = min(max(max(at, w.now), w.part.start + 1u), w.part.end);
    fire(cam, at, rises, 0.0, 0.0, p, w);
    return false;
}
