// The log-intensity pixel's walk through one interval: crossings, refractory period, leak, shot noise. Twin of the
// oracle's `cross`.
//
// The including kernel calls `begin_walk`; then for each sub-step in turn `begin_substep`, and `take_next` as long as
// `comes_next`; then `end_walk`. It provides `emit(at_ns, on, ordinal)`, `walks_on(ordinal)` (whether a walk goes on after
// `ordinal` events), and shot_draws_gpu.glsl or shot_draws_cpu.glsl: how a walk gets the random number after a shot event.

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

// Moves thresholds and clocks of an unarmed pixel out of reach, so that it emits nothing.
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

uint hazard_of_interval(float hazard_per_ns, uint interval_ns) {
    return uint(roundEven(hazard_per_ns * float(interval_ns)));
}

#include "chord.glsl"

// floor(leak * (t - epoch)) in Q24 at t = base + since_start, modulo 2^32; `base` is the full product at the start. The
// reference falls by differences of it.
int leak_fall_q24(uint leak, uvec2 base, uint since_start) {
    uint high, low, carry;
    umulExtended(leak, since_start, high, low);
    uaddCarry(low, base.x, carry);
    return int(high + base.y + carry);
}

// The state of a pixel's walk through an interval.
struct Walk {
    // At the end of the last sub-step: time after the interval's start, level with leak, fall so far.
    uint start;
    int from_level;
    int fall;
    uvec2 leak_base;
    uint held_until;
    uint ordinal;
    // Shot noise: hazard of the interval (Q27), nanoseconds a unit of hazard, when the next shot is due (NEVER if not
    // in the interval), and the draws that follow the present ones.
    uint interval_hazard;
    float ns_per_hazard;
    uint shot_at;
    uint after_off;
    uint after_on;
    // APS: integral of the intensity.
    float exposed;
};

// When the earlier of the pixel's two shots is due.
uint next_shot(Camera cam, PixelState p, Walk w) {
    const uint due = min(p.shot_off, p.shot_on);
    if (due > w.interval_hazard) {
        return NEVER;
    }
    return min(uint(max(ceil(float(due) * w.ns_per_hazard), 1.0)), cam.interval_ns);
}

// Draws how long the shot after the next one of a stream will take.
void draw_shot(Camera cam, uint pixel, uint stream, PixelState p, inout Walk w) {
    const bool is_on = stream == STREAM_SHOT_ON;
    const uint after = shot_hazard(
        cam, pixel, stream, is_on ? p.shot_on_draws : p.shot_off_draws, is_on ? p.on_q24 : p.off_q24,
        is_on ? cam.contrast_on_q24 : cam.contrast_off_q24);
    if (is_on) {
        w.after_on = after;
    } else {
        w.after_off = after;
    }
}

// From shot_draws_*.glsl. A walk requests draws; it may have to be suspended within a sub-step until one is made.
void begin_draws();
void request_draw(Camera cam, uint pixel, uint stream, PixelState p, inout Walk w);
bool needs_draw();

// Replaces the earlier of the pixel's two shots, which was emitted or suppressed, by the one after it.
void pass_shot(Camera cam, uint pixel, inout PixelState p, inout Walk w) {
    const bool is_on = p.shot_on < p.shot_off;
    uint carry;
    const uint sum = is_on ? uaddCarry(p.shot_on, w.after_on, carry) : uaddCarry(p.shot_off, w.after_off, carry);
    const uint left = carry != 0u ? 0xffffffffu : sum;
    if (is_on) {
        p.shot_on = left;
        p.shot_on_draws += 1u;
    } else {
        p.shot_off = left;
        p.shot_off_draws += 1u;
    }
    if (left <= w.interval_hazard) {
        request_draw(cam, pixel, is_on ? STREAM_SHOT_ON : STREAM_SHOT_OFF, p, w);
    }
    w.shot_at = next_shot(cam, p, w);
}

// Passes the shots within a refractory period: they are drawn but not emitted.
void suppress_shots(Camera cam, uint pixel, inout PixelState p, inout Walk w) {
    while (EFFECT_REFRACTORY && !needs_draw() && w.shot_at < w.held_until) {
        pass_shot(cam, pixel, p, w);
    }
}

// Begins a walk. `level` is that at the interval's start, `frame_levels` are those of both frames.
Walk begin_walk(Camera cam, uint pixel, int level, ivec2 frame_levels, inout PixelState p) {
    Walk w;
    w.start = 0u;
    w.from_level = level;
    w.fall = 0;
    w.leak_base = uvec2(0u);
    w.held_until = 0u;
    w.ordinal = 0u;
    w.interval_hazard = 0u;
    w.ns_per_hazard = 0.0;
    w.shot_at = NEVER;
    w.after_off = 0u;
    w.after_on = 0u;
    w.exposed = 0.0;
    begin_draws();
    if (EFFECT_REFRACTORY && p.held_until_ns != NOT_HELD) {
        if (p.held_until_ns <= cam.start_ns) {
            // The period ended while the block was skipped, and skipped blocks do not change.
            p.reference = level;
        } else {
            w.held_until = uint(min(p.held_until_ns - cam.start_ns, int64_t(0xfffffffeu)));
        }
    }
    // After a change of parameters the level may lie beyond a threshold from the start. A pixel that is looked at in samples
    // sees it in the next one.
    bool settles = !AT_SAMPLE && cam.no_skip != 0u && w.held_until == 0u;
    while (settles && walks_on(w.ordinal)) {
        const bool rises = level - p.reference >= p.on_q24;
        settles = rises || p.reference - level >= p.off_q24;
        if (settles) {
            p.reference += rises ? p.on_q24 : -p.off_q24;
            emit(1u, rises, w.ordinal);
            w.ordinal += 1u;
            // Without a period the kernel may still be one that ends holds of before.
            if (EFFECT_REFRACTORY && cam.refractory_ns != 0u) {
                w.held_until = 1u + cam.refractory_ns;
                settles = false;
            }
        }
    }
    if (EFFECT_LEAK) {
        const uint64_t base = uint64_t(p.leak) * uint64_t(cam.start_ns - cam.epoch_ns);
        w.leak_base = uvec2(uint(base & uint64_t(0xffffffffu)), uint(base >> 32));
    }
    if (EFFECT_SHOT) {
        const float hazard_per_ns = hazard_in(cam, frame_levels);
        w.interval_hazard = hazard_of_interval(hazard_per_ns, cam.interval_ns);
        w.ns_per_hazard = 1.0 / hazard_per_ns;
        // Drawn before the walk, so that all threads of a subgroup that need a draw make it together.
        if (p.shot_off <= w.interval_hazard) {
            w.after_off = shot_hazard(cam, pixel, STREAM_SHOT_OFF, p.shot_off_draws, p.off_q24, cam.contrast_off_q24);
        }
        if (p.shot_on <= w.interval_hazard) {
            w.after_on = shot_hazard(cam, pixel, STREAM_SHOT_ON, p.shot_on_draws, p.on_q24, cam.contrast_on_q24);
        }
        w.shot_at = next_shot(cam, p, w);
        suppress_shots(cam, pixel, p, w);
    }
    return w;
}

// Adds the exposure of a sub-step that ends at `end`, where the log intensity is `to_raw`.
void expose(Camera cam, uint end, int to_raw, inout Walk w) {
    const uint start = w.start;
    const uint first = max(start, cam.aps_start_ns);
    const uint last = min(end, cam.aps_end_ns);
    if (first < last) {
        const float mid = (0.5 * (float(first - start) + float(last - start))) / float(end - start);
        const float from_intensity = intensity_of(cam, w.from_level - w.fall);
        w.exposed += lerp(from_intensity, intensity_of(cam, to_raw), mid) * float(last - first);
    }
}

// The level with leak at `end`, the end of a sub-step, where the log intensity is `to_raw`.
int level_with_leak(uint end, int to_raw, PixelState p, inout Walk w) {
    if (!EFFECT_LEAK) {
        return to_raw;
    }
    w.fall = leak_fall_q24(p.leak, w.leak_base, end) - int(w.leak_base.y);
    return to_raw + w.fall;
}

// Begins the sub-step from the end of the last one to `end`, where the log intensity is `to_raw`. Returns the level with
// leak there.
int begin_substep(Camera cam, uint end, int to_raw, PixelState p, inout Walk w) {
    if (EFFECT_APS) {
        expose(cam, end, to_raw, w);
    }
    return level_with_leak(end, to_raw, p, w);
}

// Whether a level has come to the threshold above, or below.
bool is_above_on(PixelState p, int level) {
    return level - p.reference >= p.on_q24;
}

bool is_below_off(PixelState p, int level) {
    return p.reference - level >= p.off_q24;
}

// Whether anything comes in the rest of the sub-step, from `now` on. Ends a refractory period that is over in it.
bool comes_next(uint end, int to_level, inout PixelState p, inout uint now, inout Walk w) {
    bool is_held = false;
    if (EFFECT_REFRACTORY && w.held_until > now) {
        is_held = w.held_until > end;
        if (!is_held) {
            now = w.held_until;
            w.held_until = 0u;
            p.reference = level_at(w.from_level, to_level, w.start, end, now);
        }
    }
    const bool rises = is_above_on(p, to_level);
    const bool falls = is_below_off(p, to_level);
    return !is_held && (rises || falls || (EFFECT_SHOT && w.shot_at <= end));
}

// Sends the event that comes next.
void take_next(
    Camera cam, uint pixel, uint end, int to_level, inout PixelState p, inout uint now, inout Walk w
) {
    const uint start = w.start;
    const bool rises = is_above_on(p, to_level);
    const bool falls = is_below_off(p, to_level);
    uint signal_at = NEVER;
    const int level = rises ? p.reference + p.on_q24 : p.reference - p.off_q24;
    if (rises || falls) {
        const int to_go = rises ? level - w.from_level : w.from_level - level;
        const int slope = abs(to_level - w.from_level);
        signal_at = AT_SAMPLE ? end
            : to_go > 0 ? time_in_substep(start, end, float(to_go), float(slope)) : start + 1u;
        signal_at = max(signal_at, now);
    }
    // A shot due beyond the sub-step is later than any crossing in it.
    bool is_on = rises;
    if (!EFFECT_SHOT || signal_at <= w.shot_at) {
        now = signal_at;
        p.reference = level;
    } else {
        now = w.shot_at;
        is_on = p.shot_on < p.shot_off;
        p.reference = level_at(w.from_level, to_level, start, end, now);
        pass_shot(cam, pixel, p, w);
    }
    emit(now, is_on, w.ordinal);
    w.ordinal += 1u;
    if (EFFECT_REFRACTORY) {
        w.held_until = now + cam.refractory_ns;
        if (EFFECT_SHOT) {
            suppress_shots(cam, pixel, p, w);
        }
    }
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
        p.shot_off -= w.interval_hazard;
        p.shot_on -= w.interval_hazard;
    }
}
