// The log-intensity pixel's walk through one interval: crossings, refractory period, leak, shot
// noise. Twin of the oracle's `cross`. The including kernel calls `begin_walk`, then `walk_substep` for
// each sub-step in turn, then `end_walk`, and provides `emit(at_ns, on, ordinal)`.

layout(constant_id = 1) const bool EFFECT_MISMATCH = false;
layout(constant_id = 2) const bool EFFECT_REFRACTORY = false;
layout(constant_id = 3) const bool EFFECT_LEAK = false;
layout(constant_id = 4) const bool EFFECT_SHOT = false;
layout(constant_id = 5) const bool EFFECT_DELAY = false;
layout(constant_id = 6) const bool AT_SAMPLE = false;
layout(constant_id = 7) const bool EFFECT_APS = false;

const uint NEVER = 0xffffffffu;

struct PixelState {
    int reference;
    int on_q24;
    int off_q24;
    uint leak;
    int64_t held_until_ns;
    uint shot_off;
    uint shot_on;
    uint shot_off_draws;
    uint shot_on_draws;
    uint events;
};

PixelState load_pixel(Camera cam, uint pixel) {
    PixelState p;
    p.reference = int(load_state(cam, pixel, STATE_REFERENCE));
    p.on_q24 = EFFECT_MISMATCH ? int(load_state(cam, pixel, STATE_CONTRAST_ON)) : cam.contrast_on_q24;
    p.off_q24 = EFFECT_MISMATCH ? int(load_state(cam, pixel, STATE_CONTRAST_OFF)) : cam.contrast_off_q24;
    p.leak = EFFECT_LEAK ? load_state(cam, pixel, STATE_LEAK) : 0u;
    p.held_until_ns = NOT_HELD;
    if (EFFECT_REFRACTORY) {
        p.held_until_ns = (int64_t(int(load_state(cam, pixel, STATE_HELD_HIGH))) << 32)
            | int64_t(load_state(cam, pixel, STATE_HELD_LOW));
    }
    p.shot_off = EFFECT_SHOT ? load_state(cam, pixel, STATE_SHOT_OFF_HAZARD) : 0u;
    p.shot_on = EFFECT_SHOT ? load_state(cam, pixel, STATE_SHOT_ON_HAZARD) : 0u;
    p.shot_off_draws = EFFECT_SHOT ? load_state(cam, pixel, STATE_SHOT_OFF_DRAWS) : 0u;
    p.shot_on_draws = EFFECT_SHOT ? load_state(cam, pixel, STATE_SHOT_ON_DRAWS) : 0u;
    p.events = load_state(cam, pixel, STATE_EVENTS);
    return p;
}

// What an unarmed pixel walks with: nothing can happen to it.
void silence(inout PixelState p, int level) {
    p.reference = level;
    p.on_q24 = 0x7fffffff;
    p.off_q24 = 0x7fffffff;
    p.leak = 0u;
    p.held_until_ns = NOT_HELD;
    p.shot_off = 0xffffffffu;
    p.shot_on = 0xffffffffu;
}

void store_pixel(Camera cam, uint pixel, PixelState p) {
    store_state(cam, pixel, STATE_REFERENCE, uint(p.reference));
    if (EFFECT_REFRACTORY) {
        store_state(cam, pixel, STATE_HELD_LOW, uint(p.held_until_ns & int64_t(0xffffffffu)));
        store_state(cam, pixel, STATE_HELD_HIGH, uint(p.held_until_ns >> 32));
    }
    if (EFFECT_SHOT) {
        store_state(cam, pixel, STATE_SHOT_OFF_HAZARD, p.shot_off);
        store_state(cam, pixel, STATE_SHOT_ON_HAZARD, p.shot_on);
        store_state(cam, pixel, STATE_SHOT_OFF_DRAWS, p.shot_off_draws);
        store_state(cam, pixel, STATE_SHOT_ON_DRAWS, p.shot_on_draws);
    }
    store_state(cam, pixel, STATE_EVENTS, p.events);
}

float intensity_of(Camera cam, int log_q24) {
    return exp(float(log_q24) * (1.0 / LOG_SCALE)) - cam.log_offset;
}

// Shot-noise hazard relative to the dark.
float shot_share(Camera cam, int log_q24) {
    return 1.0 - 0.75 * clamp(intensity_of(cam, log_q24) * cam.inverse_white, 0.0, 1.0);
}

// Time of the fraction num / den of the sub-step that ends at `end`, in (start, end].
uint time_in_substep(uint start, uint end, float num, float den) {
    const uint span = end - start;
    const uint into = uint(clamp(ceil(float(span) * (num / den)), 1.0, float(span)));
    return start + min(into, span);
}

// Log intensity (with leak) at time t of the sub-step.
int level_at(int from, int to, uint start, uint end, uint t) {
    return from + int(roundEven(float(to - from) * (float(t - start) / float(end - start))));
}

// floor(leak * (t - epoch)) in Q24 at t = base + since_start, modulo 2^32; `base` is leak * (start -
// epoch) in full. Differences of it are the fall of the reference.
int leak_fall_q24(uint leak, uvec2 base, uint since_start) {
    uint high, low, carry;
    umulExtended(leak, since_start, high, low);
    uaddCarry(low, base.x, carry);
    return int(high + base.y + carry);
}

// A pixel on its way through an interval.
struct Walk {
    // End of the last sub-step: time after the interval's start, level with leak, how far it fell.
    uint start;
    int from_level;
    int fall;
    uvec2 leak_base;
    uint held_until;
    uint ordinal;
    // Shot noise: hazard since the interval's start, also rounded, and how long the draws after the present ones
    // last.
    float hazard;
    uint hazard_q27;
    float from_share;
    uint after_off;
    uint after_on;
    // APS.
    float from_intensity;
    float exposed;
};

// Hazard of the whole interval at the most: a draw that outlasts it cannot fire.
uint most_hazard(Camera cam) {
    return uint(ceil(cam.hazard_q27_per_ns * float(cam.interval_ns))) + 1u;
}

// `first_end` is the end of the first sub-step.
Walk begin_walk(Camera cam, uint pixel, int level, uint first_end, inout PixelState p) {
    Walk w;
    w.start = 0u;
    w.from_level = level;
    w.fall = 0;
    w.leak_base = uvec2(0u);
    w.held_until = 0u;
    w.ordinal = 0u;
    w.hazard = 0.0;
    w.hazard_q27 = 0u;
    w.from_share = EFFECT_SHOT ? shot_share(cam, level) : 0.0;
    w.after_off = 0u;
    w.after_on = 0u;
    w.from_intensity = EFFECT_APS ? intensity_of(cam, level) : 0.0;
    w.exposed = 0.0;
    if (EFFECT_REFRACTORY && p.held_until_ns != NOT_HELD) {
        if (p.held_until_ns <= cam.start_ns) {
            // It ended while the block was skipped, and skipped blocks do not change.
            p.reference = level;
        } else {
            w.held_until = uint(min(p.held_until_ns - cam.start_ns, int64_t(0xfffffffeu)));
        }
    }
    // Parameters have changed: the level may lie beyond a threshold from the start.
    bool settles = cam.no_skip != 0u && w.held_until == 0u;
    while (settles) {
        const bool rises = level - p.reference >= p.on_q24;
        settles = rises || p.reference - level >= p.off_q24;
        if (settles) {
            p.reference += rises ? p.on_q24 : -p.off_q24;
            const uint now = AT_SAMPLE ? first_end : 1u;
            emit(now, rises, w.ordinal);
            w.ordinal += 1u;
            if (EFFECT_REFRACTORY) {
                w.held_until = now + cam.refractory_ns;
                settles = false;
            }
        }
    }
    if (EFFECT_LEAK) {
        const uint64_t base = uint64_t(p.leak) * uint64_t(cam.start_ns - cam.epoch_ns);
        w.leak_base = uvec2(uint(base & uint64_t(0xffffffffu)), uint(base >> 32));
    }
    if (EFFECT_SHOT) {
        // Drawn before the walk, all threads together, by those who may need it.
        const uint most = most_hazard(cam);
        if (p.shot_off <= most) {
            w.after_off = shot_hazard(cam, pixel, STREAM_SHOT_OFF, p.shot_off_draws, p.off_q24, cam.contrast_off_q24);
        }
        if (p.shot_on <= most) {
            w.after_on = shot_hazard(cam, pixel, STREAM_SHOT_ON, p.shot_on_draws, p.on_q24, cam.contrast_on_q24);
        }
    }
    return w;
}

// The sooner of the pixel's two shots is over, sent or not: on to the one after it.
void pass_shot(Camera cam, uint pixel, inout PixelState p, inout Walk w) {
    const bool is_on = p.shot_on < p.shot_off;
    uint carry;
    const uint sum = is_on ? uaddCarry(p.shot_on, w.after_on, carry) : uaddCarry(p.shot_off, w.after_off, carry);
    const uint left = carry != 0u ? 0xffffffffu : sum;
    const uint draws = (is_on ? p.shot_on_draws : p.shot_off_draws) + 1u;
    uint after = 0u;
    if (left <= most_hazard(cam)) {
        after = shot_hazard(
            cam, pixel, is_on ? STREAM_SHOT_ON : STREAM_SHOT_OFF, draws, is_on ? p.on_q24 : p.off_q24,
            is_on ? cam.contrast_on_q24 : cam.contrast_off_q24);
    }
    if (is_on) {
        p.shot_on = left;
        p.shot_on_draws = draws;
        w.after_on = after;
    } else {
        p.shot_off = left;
        p.shot_off_draws = draws;
        w.after_off = after;
    }
}

// One sub-step, from the last one's end to `end`, where the log intensity is `to_raw`.
void walk_substep(Camera cam, uint pixel, uint end, int to_raw, inout PixelState p, inout Walk w) {
    const uint start = w.start;
    if (end == start) {
        // Shorter than a nanosecond: it joins the next one.
        return;
    }
    int to_level = to_raw;
    if (EFFECT_LEAK) {
        w.fall = leak_fall_q24(p.leak, w.leak_base, end) - int(w.leak_base.y);
        to_level += w.fall;
    }
    const uint from_hazard = w.hazard_q27;
    uint to_hazard = from_hazard;
    if (EFFECT_SHOT) {
        const float to_share = shot_share(cam, to_raw);
        w.hazard += cam.hazard_q27_per_ns * float(end - start) * 0.5 * (w.from_share + to_share);
        to_hazard = uint(roundEven(w.hazard));
        w.hazard_q27 = to_hazard;
        w.from_share = to_share;
    }
    if (EFFECT_APS) {
        const float to_intensity = intensity_of(cam, to_raw);
        const uint first = max(start, cam.aps_start_ns);
        const uint last = min(end, cam.aps_end_ns);
        if (first < last) {
            const float mid = (0.5 * (float(first - start) + float(last - start))) / float(end - start);
            w.exposed += blend(w.from_intensity, to_intensity, mid) * float(last - first);
        }
        w.from_intensity = to_intensity;
    }

    uint now = start;
    for (;;) {
        if (EFFECT_REFRACTORY && w.held_until > now) {
            const uint until = min(w.held_until, end);
            if (EFFECT_SHOT) {
                const uint until_hazard = from_hazard
                    + uint(roundEven(float(to_hazard - from_hazard) * (float(until - start) / float(end - start))));
                while (min(p.shot_off, p.shot_on) <= until_hazard) {
                    // Drawn, and not sent.
                    pass_shot(cam, pixel, p, w);
                }
            }
            if (w.held_until > end) {
                break;
            }
            now = w.held_until;
            w.held_until = 0u;
            p.reference = level_at(w.from_level, to_level, start, end, now);
        }
        const bool rises = to_level - p.reference >= p.on_q24;
        const bool falls = p.reference - to_level >= p.off_q24;
        const uint due = min(p.shot_off, p.shot_on);
        if (!(rises || falls || (EFFECT_SHOT && due <= to_hazard))) {
            break;
        }
        uint signal_at = NEVER;
        const int level = rises ? p.reference + p.on_q24 : p.reference - p.off_q24;
        if (rises || falls) {
            const int to_go = rises ? level - w.from_level : w.from_level - level;
            const int slope = abs(to_level - w.from_level);
            signal_at = AT_SAMPLE ? end
                : to_go > 0 ? time_in_substep(start, end, float(to_go), float(slope)) : start + 1u;
            signal_at = max(signal_at, now);
        }
        uint shot_at = NEVER;
        if (EFFECT_SHOT && due <= to_hazard) {
            const float into = float(due - min(due, from_hazard));
            shot_at = max(now, time_in_substep(start, end, into, float(max(to_hazard - from_hazard, 1u))));
        }
        bool is_on = rises;
        if (signal_at <= shot_at) {
            now = signal_at;
            p.reference = level;
        } else {
            now = shot_at;
            is_on = p.shot_on < p.shot_off;
            p.reference = level_at(w.from_level, to_level, start, end, now);
            pass_shot(cam, pixel, p, w);
        }
        emit(now, is_on, w.ordinal);
        w.ordinal += 1u;
        if (EFFECT_REFRACTORY) {
            w.held_until = now + cam.refractory_ns;
        }
    }
    w.from_level = to_level;
    w.start = end;
}

void end_walk(Camera cam, Walk w, inout PixelState p) {
    p.events += w.ordinal;
    if (EFFECT_REFRACTORY) {
        p.held_until_ns = w.held_until > w.start ? cam.start_ns + int64_t(w.held_until) : NOT_HELD;
    }
    if (EFFECT_LEAK) {
        p.reference -= w.fall;
    }
    if (EFFECT_SHOT) {
        p.shot_off -= w.hazard_q27;
        p.shot_on -= w.hazard_q27;
    }
}
