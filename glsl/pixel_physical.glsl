// The physical pixel's walk through one interval: photoreceptor, noise before the comparators, crossings, leak and
// refractory period. Its equations are in the model's `physical`; the oracle's `physical` solves them without
// approximation.
//
// The including kernel calls `begin_walk`, then `walk_substep` for each sub-step in turn, then `end_walk`. It provides
// `emit(at_ns, on, ordinal)` and `walks_on(ordinal)` (whether a walk goes on after `ordinal` events).
//
// A sub-step is cut into parts, in which the photoreceptor's output is a cubic through both ends with both slopes. A part
// is cut into stretches: at the output's turn, and where noise moves fast. In a stretch the watched level (output, leak
// and noise) only rises or only falls. An event or a release begins a new stretch.

const uint NEVER = 0xffffffffu;

// Most parts of a sub-step.
const uint MAX_PARTS = 256u;
// Largest change of the level in a part, nepers.
const float MAX_CHANGE_LOG = 0.2;
// Lag of the first stage, nepers, beyond which a part is no longer than half its time constant.
const float FAR_BEHIND_LOG = 0.5;
// Distance of a stage from where it settles, nepers, up to which its bend is left out; error of the output within a part,
// nepers, that sets the part's length while it bends. With noise, whose deviation is ten times that, they are larger.
const float BEND_LOG = EFFECT_SHOT ? 0.005 : 0.001;
const float CUBIC_ERROR_LOG = EFFECT_SHOT ? 0.002 : 0.0005;
// Distance of a turn from a threshold, nepers, within which a part ends at the turn.
const float TURN_MARGIN_LOG = 0.003;
// Time constants of a stage in a part, up to which the output is a cubic; in a longer one it is a straight line.
const float STEEP_TURN = 4.0;
// Phase of the slower pole since a release beyond which the noise moves slowly.
const float SETTLED_PHASE = 2.5;
// Largest charge of a part.
const float MOST_CHARGE = 1e30;
// Largest phase that is kept.
const float MOST_PHASE = 40.0;
// Longest time since a release that is kept, nanoseconds.
const int LONGEST_NS = 1 << 30;
// Stands for any number of time constants.
const float LONGEST_TURN = 1e30;
// Largest exponent by which a hazard grows or falls within a stretch.
const float MOST_HAZARD_GROWTH = 6.0;
// Most of a leak in one part, nepers.
const float MOST_LEAK_LOG = 32.0;

struct PixelState {
    int reference;
    // What the reference has above `reference`, in units of 2^-32 of its last bit.
    uint fraction;
    int on_q24;
    int off_q24;
    float dark_factor_log;
    float leak_factor_log;
    float excess;
    float lag;
    // Noise at the last release or, while the pixel is held, at its event; nepers.
    float noise;
    // Phase of the first stage since then.
    float phase;
    // Time of a release to come (above 0) or of the last one, from the interval's start.
    int release_ns;
    // Hazard left, Q27; while the pixel is held, the slope of the noise at its event, 0 for a signal's.
    uint clock;
    uint events;
    // Whether it never had a valid colour.
    bool silent;
};

PixelState load_pixel(Camera cam, uint pixel) {
    PixelState p;
    p.reference = int(load_state(cam, pixel, STATE_REFERENCE));
    p.fraction = EFFECT_LEAK ? load_state(cam, pixel, STATE_FRACTION) : 0u;
    p.on_q24 = EFFECT_MISMATCH ? int(load_state(cam, pixel, STATE_CONTRAST_ON)) : cam.contrast_on_q24;
    p.off_q24 = EFFECT_MISMATCH ? int(load_state(cam, pixel, STATE_CONTRAST_OFF)) : cam.contrast_off_q24;
    const vec2 factors = factors_log(cam, pixel);
    p.dark_factor_log = factors.x;
    p.leak_factor_log = factors.y;
    p.excess = uintBitsToFloat(load_state(cam, pixel, STATE_EXCESS));
    p.lag = uintBitsToFloat(load_state(cam, pixel, STATE_LAG));
    p.noise = uintBitsToFloat(load_state(cam, pixel, STATE_NOISE));
    p.phase = uintBitsToFloat(load_state(cam, pixel, STATE_PHASE));
    p.release_ns = int(load_state(cam, pixel, STATE_RELEASE));
    p.clock = load_state(cam, pixel, STATE_CLOCK);
    p.events = load_state(cam, pixel, STATE_EVENTS);
    p.silent = false;
    return p;
}

// Makes an unarmed pixel emit nothing.
void silence(inout PixelState p, int level) {
    p.silent = true;
    p.release_ns = 0;
}

void store_pixel(Camera cam, uint pixel, PixelState p) {
    store_state(cam, pixel, STATE_REFERENCE, uint(p.reference));
    if (EFFECT_LEAK) {
        store_state(cam, pixel, STATE_FRACTION, p.fraction);
    }
    store_state(cam, pixel, STATE_EXCESS, floatBitsToUint(p.excess));
    store_state(cam, pixel, STATE_LAG, floatBitsToUint(p.lag));
    store_state(cam, pixel, STATE_NOISE, floatBitsToUint(p.noise));
    store_state(cam, pixel, STATE_PHASE, floatBitsToUint(p.phase));
    store_state(cam, pixel, STATE_RELEASE, uint(p.release_ns));
    if (EFFECT_SHOT) {
        store_state(cam, pixel, STATE_CLOCK, p.clock);
    }
    store_state(cam, pixel, STATE_EVENTS, p.events);
}

// Each walk makes the draws of its first renewal in advance, when all threads of a subgroup make them together. For
// another one it makes them where it needs them or, where WALKS_SUSPEND, is suspended until the kernel has called
// `make_draw`: the software driver makes draws that stand in a loop in each round.
bool draws_missing;
bool suspended;

bool needs_draw() {
    return WALKS_SUSPEND && draws_missing;
}

bool is_suspended() {
    return WALKS_SUSPEND && suspended;
}

#include "chord.glsl"

float nepers(int q24) {
    return float(q24) * (1.0 / LOG_SCALE);
}

// A part of a sub-step.
struct Part {
    uint start;
    uint end;
    // When the output turns; the part's end if it does not.
    uint turn;
    // Output with the leak within the part, Q24; how much steeper it is at both ends than between them, nepers in the part.
    int from;
    int to;
    float from_bow;
    float to_bow;
    // Rate of the first stage, per second; phase by which it turns.
    float from_first;
    float to_first;
    float turned;
    // Fall of the reference, Q24.
    int leaked;
};

// What a renewal draws when it begins, and at the release before it.
struct Draws {
    float fresh;
    float deviate;
    uint clock;
    // For a noise event's polarity and slope.
    uvec2 words;
};

// The state of a pixel's walk through an interval.
struct Walk {
    // At the end of the last sub-step: time after the interval's start, level as it is in the planes, the pixel's own level.
    uint start;
    int from_raw;
    int from_level;
    // End of the sub-step.
    uint end;
    uint ordinal;
    // When the pixel is released, 0 if it is not held; time of the last event (while it is held) or release.
    uint held_until;
    int since_ns;
    // At the end of the last part: rate that the light drives, per second, and ln(1 + excess).
    float drive;
    float behind;
    // Leak in the dark, Q24 per second.
    float dark_leak;
    // Noise of the moment that a signal meets and its mean, nepers; its deviate; slope of the noise at the event that holds
    // the pixel.
    float noise;
    float mean;
    // Whether an event has ended the renewal and the next one has not begun; draws of the present one and, if they are
    // made, of the next one.
    bool renews;
    uvec2 words;
    Draws next;
    bool has_next;
    // The sub-step: its level at the end, parts so far, the present part, the level at its end, whether it is over, and how
    // far the pixel has been watched.
    int to_level;
    uint parts;
    Part part;
    int part_level;
    bool is_over;
    uint now;
    float deviate;
    float slope;
    // APS: integral of the intensity.
    float exposed;
};

float share_of(Part part, uint t) {
    return float(t - part.start) / float(part.end - part.start);
}

// Output above the straight line, nepers.
float bow_at(Part part, float share) {
    const float rest = 1.0 - share;
    return share * rest * (rest * part.from_bow - share * part.to_bow);
}

// Output with leak at time t.
int output_at(Part part, uint t) {
    return level_at(part.from, part.to, part.start, part.end, t) + to_q24(bow_at(part, share_of(part, t)));
}

// Standard deviation of the noise when nothing is known of it.
float sigma_at(Camera cam, float first) {
    return sigma_log(physicals[cam.slot].variance, first, physicals[cam.slot].second_per_s);
}

// Phase of the second stage from `since_ns` to the time t, which need not be whole.
float second_phase(Camera cam, Walk w, float t) {
    return physicals[cam.slot].second_per_s * ((t - float(w.since_ns)) * 1e-9);
}

// What is known of the noise at a share of the part.
Law law_at(Camera cam, PixelState p, Walk w, Part part, float share) {
    const float t = float(part.start) + share * float(part.end - part.start);
    const float first = lerp(part.from_first, part.to_first, share);
    const float phase = max(p.phase + share * part.turned, 0.0);
    return noise_law(p.noise, sigma_at(cam, first), phase, max(second_phase(cam, w, t), 0.0));
}

// Noise that a signal meets at time t, nepers.
float noise_at(Camera cam, PixelState p, Walk w, Part part, uint t) {
    const Law law = law_at(cam, p, w, part, share_of(part, t));
    return law.mean + law.deviation * w.deviate;
}

// Makes the draws of the next renewal, which begins after `events` events.
Draws draw_renewal(Camera cam, uint pixel, uint events) {
    const uvec4 words = draw(cam, pixel, STREAM_CLOCK, events);
    return Draws(
        EFFECT_REFRACTORY ? normal_from_words(draw(cam, pixel, STREAM_RELEASE, events)) : 0.0,
        normal_from_words(draw(cam, pixel, STREAM_THRESHOLD, events)), exponential_q27(words.x), words.yz);
}

void make_draw(Camera cam, uint pixel, inout PixelState p, inout Walk w) {
    w.next = draw_renewal(cam, pixel, p.events + w.ordinal);
    w.has_next = true;
    draws_missing = false;
}

// Begins a renewal, whose draws are made.
void begin_renewal(inout PixelState p, inout Walk w) {
    p.clock = w.next.clock;
    w.deviate = w.next.deviate;
    w.words = w.next.words;
    w.has_next = false;
    w.renews = false;
}

// Ends the hold at time t: the reference is what the pixel shows, with the noise of the moment. A renewal begins.
void release(Camera cam, uint t, Part part, inout PixelState p, inout Walk w) {
    float noise = 0.0;
    const float share = share_of(part, t);
    if (EFFECT_SHOT) {
        const float phase = max(p.phase + share * part.turned, 0.0);
        const float second = max(second_phase(cam, w, float(t)), 0.0);
        const float sigma = sigma_at(cam, lerp(part.from_first, part.to_first, share));
        const float kept = min(correlation(phase, second), 1.0);
        const float turned = w.slope == 0.0 ? 0.0 : slope_correlation(phase, second);
        const float unknown = sqrt(max(1.0 - kept * kept - turned * turned, 0.0));
        noise = kept * p.noise + sigma * (turned * w.slope + unknown * w.next.fresh);
    }
    p.noise = noise;
    w.noise = noise;
    w.mean = noise;
    p.reference = output_at(part, t) + to_q24(noise);
    w.held_until = 0u;
    w.since_ns = int(t);
    p.phase = -share * part.turned;
}

// Books an event at time t, at which the noise is `noise`: begins the hold or, without a refractory period, the next
// renewal. `slope` is 0 for a signal.
void fire(
    Camera cam, uint t, bool on, float noise, float slope, Part part, inout PixelState p, inout Walk w
) {
    const uint at = AT_SAMPLE ? w.end : t;
    emit(at, on, w.ordinal);
    w.ordinal += 1u;
    p.noise = noise;
    w.noise = noise;
    w.mean = noise;
    w.since_ns = int(t);
    p.phase = -share_of(part, t) * part.turned;
    if (EFFECT_REFRACTORY && cam.refractory_ns != 0u) {
        w.held_until = at + cam.refractory_ns;
        w.slope = slope;
    } else {
        p.reference += on ? p.on_q24 : -p.off_q24;
    }
}

// A stretch of a part: the watched level at both ends.
struct Stretch {
    uint start;
    uint end;
    int from;
    int to;
};

// The stretch of a quiet pixel: a part, up to its turn or from it.
Stretch quiet_stretch(uint now, Part part) {
    const bool turns = now < part.turn;
    const uint start = turns || part.turn == part.end ? part.start : part.turn;
    const uint end = turns ? part.turn : part.end;
    return Stretch(start, end, output_at(part, start), output_at(part, end));
}

// The stretch of a noisy pixel that begins now, and the law of the noise at its end. Noise moves fast after a release: until
// the slower pole has turned some times, a stretch is no longer than that.
Stretch noisy_stretch(Camera cam, uint now, Part part, PixelState p, Walk w, out Law law) {
    uint end = now < part.turn ? part.turn : part.end;
    const float phase = p.phase + share_of(part, now) * part.turned;
    if (min(phase, second_phase(cam, w, float(now))) < SETTLED_PHASE) {
        const float slower = min(max(part.from_first, part.to_first), physicals[cam.slot].second_per_s);
        const float longest_ns = SETTLED_PHASE * 1e9 / slower;
        end = longest_ns < float(end - now) ? now + max(uint(longest_ns), 1u) : end;
    }
    law = law_at(cam, p, w, part, share_of(part, end));
    return Stretch(
        now, end, output_at(part, now) + to_q24(w.noise),
        output_at(part, end) + to_q24(law.mean + law.deviation * w.deviate));
}

// When a stretch crosses `level`, which it does if it `rises` or falls. The straight line's crossing is made better once, on
// the part's cubic and with the law of the noise.
uint crossing_time(Camera cam, Stretch stretch, Part part, int level, bool rises, PixelState p, Walk w) {
    const int sign = rises ? 1 : -1;
    const int to_go = sign * (level - stretch.from);
    const uint at = time_in_substep(
        stretch.start, stretch.end, float(to_go), float(sign * (stretch.to - stretch.from)));
    if (!EFFECT_SHOT && part.from_bow == 0.0 && part.to_bow == 0.0) {
        return at;
    }
    const int there = output_at(part, at) + (EFFECT_SHOT ? to_q24(noise_at(cam, p, w, part, at)) : 0);
    const int rest = sign * (level - there);
    if (rest > 0) {
        return at == stretch.end
            ? at
            : time_in_substep(at, stretch.end, float(rest), max(float(sign * (stretch.to - there)), 1.0));
    }
    return time_in_substep(stretch.start, at, float(to_go), max(float(sign * (there - stretch.from)), 1.0));
}

// Hazards in a stretch of a part, and the exponent by which that of the nearer threshold grows over it.
struct Hazard {
    float off;
    float on;
    float growth;
};

// Hazards from `start` to `end`, where the mean of the noise is `mean`. They are those at the middle; the nearer
// threshold's grows or falls exponentially from there.
Hazard stretch_hazard(Camera cam, uint start, uint end, float mean, Part part, PixelState p, Walk w) {
    Hazard hazard = Hazard(0.0, 0.0, 0.0);
    const vec2 ends = vec2(share_of(part, start), share_of(part, end));
    const float middle = 0.5 * (ends.x + ends.y);
    const Law law = law_at(cam, p, w, part, middle);
    if (end == start || law.deviation <= 0.0) {
        return hazard;
    }
    const float per_deviation = 1.0 / law.deviation;
    const float above = lerp(nepers(part.from - p.reference), nepers(part.to - p.reference), middle)
        + bow_at(part, middle) + law.mean;
    const float off = (nepers(p.off_q24) + above) * per_deviation;
    const float on = (nepers(p.on_q24) - above) * per_deviation;
    const float nearer = min(off, on);
    if (nearer > FAR_DISTANCE + 1.0) {
        return hazard;
    }
    const float bowed = bow_at(part, ends.y) - bow_at(part, ends.x);
    const float rise = (nepers(part.to - part.from) * (ends.y - ends.x) + bowed + (mean - w.mean)) * per_deviation;
    const float nearing = on < off ? rise : -rise;
    // e^(-b^2/2) where b falls by `nearing`, over its value in the middle.
    hazard.growth = clamp(max(nearer, 0.7) * nearing, -MOST_HAZARD_GROWTH, MOST_HAZARD_GROWTH);
    const float half_squared = 0.25 * hazard.growth * hazard.growth;
    const float grown = 1.0
        + half_squared * (1.0 / 6.0 + half_squared * (1.0 / 120.0 + half_squared * (1.0 / 5040.0)));
    const float duration_s = 1e-9 * float(end - start);
    const Rates rates =
        noise_rates(lerp(part.from_first, part.to_first, middle), physicals[cam.slot].second_per_s);
    const float near = duration_s * grown * hazard_per_s(nearer, rates);
    const float further = max(off, on);
    const float far = further < FAR_DISTANCE ? duration_s * hazard_per_s(further, rates) : 0.0;
    hazard.off = on < off ? far : near;
    hazard.on = on < off ? near : far;
    return hazard;
}

// Time at which the clock has run out, which it does from `start` to `end`.
uint noise_time(uint start, uint end, Hazard hazard, float clock) {
    const float spent = clock / (hazard.off + hazard.on);
    const float share = abs(hazard.growth) < 0.01
        ? spent
        : log(1.0 + spent * (exp(hazard.growth) - 1.0)) / hazard.growth;
    return time_in_substep(start, end, clamp(share, 0.0, 1.0), 1.0);
}

// Spends hazard that the clock has.
uint spend(uint clock, float hazard) {
    return clock - min(clock, uint(roundEven(hazard * float(1u << HAZARD_FRACTION_BITS))));
}

// Walks the pixel over the next stretch of the part, up to an event if there is one. Returns whether the part is over.
bool watch_stretch(Camera cam, uint pixel, inout PixelState p, inout Walk w) {
    const Part part = w.part;
    uint now = w.now;
    const bool is_held = EFFECT_REFRACTORY && w.held_until != 0u;
    if (is_held && w.held_until > part.end) {
        return true;
    }
    if (EFFECT_SHOT && (is_held || w.renews) && !w.has_next) {
        if (WALKS_SUSPEND) {
            draws_missing = true;
            return false;
        }
        make_draw(cam, pixel, p, w);
    }
    if (is_held) {
        now = max(w.held_until, part.start);
        release(cam, now, part, p, w);
    }
    if (EFFECT_SHOT && (is_held || w.renews)) {
        begin_renewal(p, w);
    }
    Law law = Law(0.0, 0.0);
    Stretch stretch;
    if (EFFECT_SHOT) {
        stretch = noisy_stretch(cam, now, part, p, w, law);
    } else {
        stretch = quiet_stretch(now, part);
    }
    const float noise = law.mean + law.deviation * w.deviate;
    // After a change of parameters the level may lie beyond a threshold from the start.
    const bool settles = cam.no_skip != 0u && now <= 1u && stretch.end != stretch.start;
    const int from = settles ? level_at(stretch.from, stretch.to, stretch.start, stretch.end, now) : p.reference;
    const bool starts_above = from - p.reference >= p.on_q24;
    const bool starts_beyond = starts_above || p.reference - from >= p.off_q24;
    const bool rises = starts_beyond ? starts_above : stretch.to - p.reference >= p.on_q24;
    const bool falls = starts_beyond ? !starts_above : p.reference - stretch.to >= p.off_q24;
    uint signal_at = NEVER;
    if (rises || falls) {
        const int level = rises ? p.reference + p.on_q24 : p.reference - p.off_q24;
        const int to_go = rises ? level - stretch.from : stretch.from - level;
        signal_at = to_go > 0 && !starts_beyond && stretch.end != stretch.start
            ? crossing_time(cam, stretch, part, level, rises, p, w)
            : now;
        // The first instant of a sub-step belongs to the one before.
        signal_at = min(max(max(signal_at, now), w.start + 1u), part.end);
    }
    const uint until = min(signal_at, stretch.end);
    const float share = stretch.end == stretch.start || until <= stretch.start
        ? 0.0
        : float(until - stretch.start) / float(stretch.end - stretch.start);
    uint shot_at = NEVER;
    Hazard hazard = Hazard(0.0, 0.0, 0.0);
    if (EFFECT_SHOT) {
        const float clock = float(p.clock) / float(1u << HAZARD_FRACTION_BITS);
        hazard = stretch_hazard(cam, now, max(until, now), lerp(w.mean, law.mean, share), part, p, w);
        if (clock < hazard.off + hazard.on) {
            shot_at = noise_time(now, until, hazard, clock);
        } else if (signal_at == NEVER) {
            p.clock = spend(p.clock, hazard.off + hazard.on);
        }
    }
    if (signal_at == NEVER && shot_at == NEVER) {
        w.now = stretch.end;
        w.noise = noise;
        w.mean = law.mean;
        return stretch.end == part.end;
    }
    const bool is_signal = signal_at <= shot_at;
    bool on = rises;
    float slope = 0.0;
    now = is_signal ? signal_at : shot_at;
    float met = EFFECT_SHOT && is_signal ? noise_at(cam, p, w, part, now) : 0.0;
    if (EFFECT_SHOT && !is_signal) {
        const uvec2 words = WALKS_SUSPEND ? w.words : draw(cam, pixel, STREAM_CLOCK, p.events + w.ordinal).yz;
        on = float(words.x) * (1.0 / 4294967296.0) * (hazard.off + hazard.on) < hazard.on;
        slope = sqrt(2.0 * exponential_of(words.y));
        slope = on ? slope : -slope;
        // The noise lifts the output to the threshold.
        met = nepers(p.reference + (on ? p.on_q24 : -p.off_q24) - output_at(part, now));
    }
    w.now = now;
    fire(cam, now, on, met, slope, part, p, w);
    w.renews = w.held_until == 0u;
    return false;
}

// Lowers the reference by what leaks away in `duration_s` and by the charge that the light drives in it. Returns the
// whole units of Q24; the rest stays in the fraction.
int leak(Camera cam, float duration_s, float charge, Walk w, inout PixelState p) {
    const Physical physical = physicals[cam.slot];
    const float most = MOST_LEAK_LOG * LOG_SCALE;
    const float fall = clamp(w.dark_leak * duration_s + physical.light_q24_per_charge * charge, -most, most);
    const float whole = floor(abs(fall));
    const uint rest = uint(min((abs(fall) - whole) * 4294967296.0, 4294967040.0));
    uint over;
    if (fall > 0.0) {
        p.fraction = usubBorrow(p.fraction, rest, over);
        return int(whole) + int(over);
    }
    p.fraction = uaddCarry(p.fraction, rest, over);
    return -int(whole) - int(over);
}

// Slope of the output, nepers in a part of `duration_s` in which the second stage turns by `second`: that of the slower
// stage, whose output the other follows.
float output_slope(float drive, float duration_s, float second, float behind, PixelState p) {
    return second < STEEP_TURN
        ? -second * (behind + p.lag)
        : drive * duration_s * (p.excess / (1.0 + p.excess));
}

// The instant within a part at which the output turns; the part's end if it does not turn. `from_slope` and `to_slope` are
// the slopes at both ends, nepers in the part.
uint turning_point(Part part, float from_slope, float to_slope) {
    const uint span = part.end - part.start;
    if (from_slope * to_slope >= 0.0 || span < 2u) {
        return part.end;
    }
    // The root of the cubic's slope, which changes sign once.
    const float change = nepers(part.to - part.from);
    const float bend = 3.0 * (from_slope + to_slope) - 6.0 * change;
    const float half_fall = 3.0 * change - 2.0 * from_slope - to_slope;
    const float root = sqrt(max(half_fall * half_fall - bend * from_slope, 0.0));
    const float share = from_slope / (from_slope > 0.0 ? root - half_fall : -root - half_fall);
    return part.start + clamp(uint(clamp(share, 0.0, 1.0) * float(span)), 1u, span - 1u);
}

// Whether the output turns so near a threshold that the cubic cannot tell whether it reaches it. A part that begins at such
// a turn may turn again at once, by rounding: that decides nothing.
bool turn_decides(Part part, PixelState p) {
    if (part.turn == part.end || part.turn - part.start < (part.end - part.start) / 16u) {
        return false;
    }
    const int above = output_at(part, part.turn) - p.reference;
    return nepers(min(abs(above - p.on_q24), abs(above + p.off_q24))) < TURN_MARGIN_LOG;
}

// The next part, up to `end`, in which the level goes from `level` to `next_level`. Takes the photoreceptor to its end.
Part next_part(Camera cam, uint start, uint end, int level, int next_level, inout PixelState p, inout Walk w) {
    const float drive = w.drive;
    const float duration_s = float(end - start) * 1e-9;
    const float change = nepers(next_level - level);
    const float next_drive = next_level == level ? drive : drive_per_s(cam, next_level);
    const float charge = min(drive * duration_s * phi(change), MOST_CHARGE);
    const float second = physicals[cam.slot].second_per_s * duration_s;
    Part part;
    part.start = start;
    part.end = end;
    part.from = level + to_q24(p.lag);
    part.from_first = drive / (1.0 + p.excess);
    const float from_slope = output_slope(drive, duration_s, second, w.behind, p);
    part.turned = advance_photoreceptor(charge, change, second, p.excess, w.behind, p.lag);
    w.drive = next_drive;
    const float to_slope = output_slope(next_drive, duration_s, second, w.behind, p);
    part.leaked = EFFECT_LEAK ? leak(cam, duration_s, charge, w, p) : 0;
    part.to = next_level + to_q24(p.lag) + part.leaked;
    part.to_first = next_drive / (1.0 + p.excess);
    part.from_bow = 0.0;
    part.to_bow = 0.0;
    part.turn = end;
    if (min(second, charge) < STEEP_TURN) {
        const float rise = nepers(part.to - part.from);
        part.from_bow = from_slope - rise;
        part.to_bow = to_slope - rise;
        part.turn = turning_point(part, from_slope, to_slope);
    }
    return part;
}

// Time constants of a stage in a part, so that a cubic is near enough. `bend` is how far the stage is from where it
// settles, nepers.
float longest_turn(float bend) {
    return bend > BEND_LOG ? max(sqrt(sqrt(384.0 * CUBIC_ERROR_LOG / bend)), 0.5) : LONGEST_TURN;
}

// End of the part that begins at `start`, so that it is short enough for straight lines. `change` is that of the level
// up to `end`, `most_change` that of a part.
uint part_end(Camera cam, uint start, uint end, float change, float most_change, PixelState p, Walk w) {
    const float rest_ns = float(end - start);
    // Time constants of both stages up to `end`, the first one's at its present rate.
    const float first = w.drive * (rest_ns * 1e-9);
    const float second = physicals[cam.slot].second_per_s * (rest_ns * 1e-9);
    const float shares = max(ceil(abs(change) / most_change), 1.0);
    // Where the first stage would settle in light that goes on changing like this, about, and the second one behind it.
    const float ramp = min(change / first, 0.9);
    const float first_settled = ramp / (1.0 - 0.5 * ramp);
    const float second_settled = -(w.behind + first * (p.excess / (1.0 + p.excess)) / second);
    // A first stage faster than the second shows less of its bend.
    const float first_bend = abs(w.behind - first_settled) * min(second / first, 1.0);
    const float first_turn = abs(w.behind) > FAR_BEHIND_LOG ? 0.5 : longest_turn(first_bend);
    const float second_turn = longest_turn(abs(p.lag - second_settled));
    const float share = min(min(first_turn / first, second_turn / second), 1.0 / shares);
    const float part_ns = ceil(share * rest_ns);
    return part_ns < rest_ns ? start + max(uint(part_ns), 1u) : end;
}

// Begins a walk. `level` is that at the interval's start.
Walk begin_walk(Camera cam, uint pixel, int level, int last_level, uint first_end, inout PixelState p) {
    Walk w;
    w.start = 0u;
    w.from_raw = level;
    w.from_level = own_level(cam, level, p.dark_factor_log);
    w.end = 0u;
    w.ordinal = 0u;
    w.held_until = 0u;
    w.since_ns = p.release_ns;
    w.drive = drive_per_s(cam, w.from_level);
    w.behind = log_1p(p.excess);
    w.dark_leak = 0.0;
    if (EFFECT_LEAK) {
        w.dark_leak = physicals[cam.slot].dark_leak_q24_per_s * exp(p.leak_factor_log)
            - physicals[cam.slot].dark_light_q24_per_s * exp(p.dark_factor_log);
    }
    w.noise = 0.0;
    w.mean = 0.0;
    w.renews = false;
    w.words = uvec2(0u);
    w.has_next = EFFECT_SHOT && !p.silent;
    w.deviate = 0.0;
    w.slope = 0.0;
    w.exposed = 0.0;
    if (EFFECT_REFRACTORY && p.release_ns > 0) {
        w.held_until = uint(p.release_ns);
        w.since_ns = p.release_ns - int(cam.refractory_ns);
        w.slope = EFFECT_SHOT ? uintBitsToFloat(p.clock) : 0.0;
    } else if (EFFECT_SHOT && !p.silent) {
        w.words = WALKS_SUSPEND ? draw(cam, pixel, STREAM_CLOCK, p.events).yz : uvec2(0u);
        w.deviate = normal_from_words(draw(cam, pixel, STREAM_THRESHOLD, p.events));
        const float first = w.drive / (1.0 + p.excess);
        const Law law = noise_law(p.noise, sigma_at(cam, first), p.phase, second_phase(cam, w, 0.0));
        w.noise = law.mean + law.deviation * w.deviate;
        w.mean = law.mean;
    }
    draws_missing = false;
    suspended = false;
    if (w.has_next) {
        // A pixel that is not held has an event to come before its next renewal.
        w.next = draw_renewal(cam, pixel, p.events + (w.held_until != 0u ? 0u : 1u));
    }
    return w;
}

// Adds the exposure of a sub-step.
void expose(Camera cam, uint end, int to_raw, inout Walk w) {
    const uint first = max(w.start, cam.aps_start_ns);
    const uint last = min(end, cam.aps_end_ns);
    if (first < last) {
        const float mid = (0.5 * (float(first - w.start) + float(last - w.start))) / float(end - w.start);
        const vec2 seen = exp(vec2(nepers(w.from_raw), nepers(to_raw))) - cam.log_offset;
        w.exposed += lerp(seen.x, seen.y, mid) * float(last - first);
    }
}

// Walks one sub-step, from the end of the last one to `end`, where the log intensity is `to_raw`.
void walk_substep(Camera cam, uint pixel, uint end, int to_raw, inout PixelState p, inout Walk w) {
    if (end == w.start) {
        // A sub-step shorter than a nanosecond joins the next one.
        return;
    }
    if (!is_suspended()) {
        if (EFFECT_APS) {
            expose(cam, end, to_raw, w);
        }
        w.end = end;
        w.to_level = own_level(cam, to_raw, p.dark_factor_log);
        w.parts = 0u;
        w.part.end = w.start;
        w.part_level = w.from_level;
        w.is_over = true;
    }
    if (!p.silent) {
        const float most_change = max(MAX_CHANGE_LOG, abs(nepers(w.to_level - w.from_level)) * (1.0 / 48.0));
        do {
            if (w.is_over) {
                const uint start = w.part.end;
                const int level = w.part_level;
                w.parts += 1u;
                const uint until = w.parts < MAX_PARTS
                    ? part_end(cam, start, end, nepers(w.to_level - level), most_change, p, w)
                    : end;
                const PixelState p_before = p;
                const float drive_before = w.drive;
                const float behind_before = w.behind;
                w.part_level =
                    until == end ? w.to_level : level_at(w.from_level, w.to_level, w.start, end, until);
                w.part = next_part(cam, start, until, level, w.part_level, p, w);
                if (!EFFECT_SHOT && turn_decides(w.part, p)) {
                    // The part ends there instead.
                    p = p_before;
                    w.drive = drive_before;
                    w.behind = behind_before;
                    const uint turn = w.part.turn;
                    w.part_level = level_at(w.from_level, w.to_level, w.start, end, turn);
                    w.part = next_part(cam, start, turn, level, w.part_level, p, w);
                }
                w.now = start;
            }
            w.is_over = watch_stretch(cam, pixel, p, w);
            if (w.is_over) {
                p.phase = clamp(p.phase + w.part.turned, 0.0, MOST_PHASE);
                p.reference -= w.part.leaked;
            }
        } while (!(w.is_over && w.part.end == end) && walks_on(w.ordinal) && !needs_draw());
    }
    suspended = needs_draw();
    if (suspended) {
        return;
    }
    w.from_raw = to_raw;
    w.from_level = w.to_level;
    w.start = end;
}

void end_walk(Camera cam, Walk w, inout PixelState p) {
    p.events += w.ordinal;
    if (EFFECT_REFRACTORY && w.held_until > w.start) {
        p.release_ns = int(w.held_until - w.start);
        p.clock = floatBitsToUint(w.slope);
    } else {
        p.release_ns = max(w.since_ns - int(w.start), -LONGEST_NS);
    }
}
