// The parts of a sub-step, over which the photoreceptor is taken at once. Where both stages of a pixel without noise are near
// to where they settle, that is a closed form (physical_settling.glsl). Else it is the step of photoreceptor.glsl, and the
// output is a cubic through both ends with both slopes or, in a long part, a straight line. Needs PixelState.

// Most parts of a sub-step.
const uint MAX_PARTS = EFFECT_SHOT ? 256u : 1024u;
// Largest change of the level in a part, nepers.
const float MAX_CHANGE_LOG = EFFECT_SHOT ? 0.2 : 0.05;
// Most parts that a change is divided into.
const float MOST_SHARES = EFFECT_SHOT ? 48.0 : 768.0;
// Lag of the first stage, nepers, beyond which a part is no longer than half its time constant, or than this much of it
// where the output is above the light.
const float FAR_BEHIND_LOG = EFFECT_SHOT ? 0.5 : 0.2;
const float FALLING_TURN = EFFECT_SHOT ? 0.5 : 0.2;
// Distance of a stage from where it settles, nepers, up to which its bend is left out; error of the output within a part,
// nepers, that sets the part's length while it bends. With noise, whose deviation is far above that, they are larger.
const float BEND_LOG = EFFECT_SHOT ? 0.005 : 0.00005;
const float CUBIC_ERROR_LOG = EFFECT_SHOT ? 0.002 : 0.00002;
// Time constants of a stage in a part, up to which the output is a cubic; in a longer one it is a straight line.
const float STEEP_TURN = 4.0;
// Largest charge of a part.
const float MOST_CHARGE = 1e30;
// Stands for any number of time constants.
const float LONGEST_TURN = 1e30;
// Most of a leak in one part, nepers, so that levels stay within their bits.
const float MOST_LEAK_LOG = 32.0;

struct Part {
    uint start;
    uint end;
    // Shares of it in a nanosecond.
    float per_ns;
    // When the output turns; the part's end if it does not.
    uint turn;
    // Output with the leak at both ends, Q24.
    int from;
    int to;
    // Of a cubic: how much steeper it is at both ends than between them, nepers in the part. Of one that settles: how far
    // the exponentials of both stages are from the line at the start, nepers.
    vec2 bow;
    // Of one that settles: time constants of both stages in it, and how much of their ways they come. Else 0.
    vec2 turns;
    vec2 come;
    // Standard deviation of the noise at the start, nepers; phase by which the first stage turns.
    float from_sigma;
    float turned;
    // Fall of the reference, Q24.
    int leaked;
};

float share_of(Part part, uint t) {
    return float(t - part.start) * part.per_ns;
}

// Output above the straight line, nepers.
float bow_at(Part part, float share) {
    if (!EFFECT_SHOT && part.turns.y != 0.0) {
        return dot(part.bow, exp(-share * part.turns) - fma(vec2(-share), part.come, vec2(1.0)));
    }
    const float rest = 1.0 - share;
    return share * rest * (rest * part.bow.x - share * part.bow.y);
}

// Output with leak at time t.
int output_at(Part part, uint t) {
    return level_at(part.from, part.to, part.start, part.end, t) + to_q24(bow_at(part, share_of(part, t)));
}

// Output with leak above the reference at a share of the part, nepers.
float above_at(Part part, int reference, float share) {
    return fma(share, nepers(part.to - part.from), nepers(part.from - reference)) + bow_at(part, share);
}

// Slope of a cubic, the output with leak, at a share of the part, nepers in the part.
float slope_at(Part part, float share) {
    const float rest = 1.0 - share;
    const float bow = (rest - share) * (rest * part.bow.x - share * part.bow.y)
        - share * rest * (part.bow.x + part.bow.y);
    return nepers(part.to - part.from) + bow;
}

// What drives the photoreceptor, and how it stands: the rate that the light drives and that of the first stage, per second,
// ln(1 + excess), and the standard deviation of the noise, nepers.
struct Drive {
    float per_s;
    float first_per_s;
    float behind;
    float sigma;
};

// Sets what follows from the excess and the light's rate.
void update_drive(Camera cam, float excess, inout Drive drive) {
    drive.first_per_s = drive.per_s / (1.0 + excess);
    const Physical physical = physicals[cam.slot];
    drive.sigma = EFFECT_SHOT ? sigma_log(physical.variance, drive.first_per_s, physical.second_per_s) : 0.0;
}

#include "physical_settling.glsl"

// Time constants of a stage in a part, so that a cubic is near enough. `bend` is how far the stage is from where it
// settles, nepers.
float longest_turn(float bend) {
    return bend > BEND_LOG ? max(inversesqrt(sqrt(bend * (1.0 / (384.0 * CUBIC_ERROR_LOG)))), 0.5) : LONGEST_TURN;
}

// End of the part that begins at `start` and lasts `most_ns` at most, and one of `shares` of what is left up to `end`.
uint cut(uint start, uint end, float most_ns, float shares) {
    const float rest_ns = float(end - start);
    const float part_ns = ceil(min(most_ns, rest_ns / clamp(ceil(shares), 1.0, MOST_SHARES)));
    return part_ns < rest_ns ? start + max(uint(part_ns), 1u) : end;
}

// Parts in which the leak that light drives is near enough to a straight line: `charge` is about what the light drives.
float leak_parts(Camera cam, float charge, float change) {
    const float per_charge = physicals[cam.slot].light_q24_per_charge * (1.0 / LOG_SCALE);
    return !EFFECT_SHOT && EFFECT_LEAK && per_charge != 0.0
        ? sqrt(abs(per_charge * charge * change) * (1.0 / (8.0 * BEND_LOG)))
        : 0.0;
}

// Time in which the reference leaks no more than a part may, ns. `per_s` is the most that the light drives.
float longest_leak_ns(Camera cam, float per_s, float dark_leak) {
    const float fall_per_s = abs(fma(physicals[cam.slot].light_q24_per_charge, per_s, dark_leak));
    return EFFECT_LEAK ? (MOST_LEAK_LOG * LOG_SCALE * 1e9) / max(fall_per_s, 1.0) : LONGEST_TURN;
}

// End of the part that begins at `start`, so that it is short enough for its form and its leak, and whether it `settles`.
// `change` is that of the level up to `end`, `dark_leak` is Q24 a second.
uint part_end(
    Camera cam, uint start, uint end, float change, float dark_leak, PixelState p, Drive drive, out bool settles
) {
    const float rest_ns = float(end - start);
    const float rest_s = rest_ns * 1e-9;
    // Time constants of both stages up to `end`, the first one's at its present rate.
    const float first = drive.per_s * rest_s;
    const float second = physicals[cam.slot].second_per_s * rest_s;
    const float growth = exp(max(change, 0.0));
    const float leaks = leak_parts(cam, first * growth, change);
    const float leak_ns = longest_leak_ns(cam, drive.per_s * growth, dark_leak);
    settles = !EFFECT_SHOT && stages_settle(drive, change, first, second);
    if (settles) {
        return cut(start, end, leak_ns, max(settling_parts(change, first), leaks));
    }
    // How far the second stage is from where it settles.
    const float second_s = 1.0 / physicals[cam.slot].second_per_s;
    const float second_bend = abs(p.lag + fma(drive.first_per_s * p.excess, second_s, drive.behind));
    // With noise a part bends only where that shows. The first stage settles within twice the change over its time
    // constants. If it is faster than the second, it shows less of its bend.
    const float most_bend = fma(abs(drive.behind), first, 2.0 * abs(change)) * min(first, second);
    if (EFFECT_SHOT && max(abs(change) * (BEND_LOG / MAX_CHANGE_LOG), second_bend) <= BEND_LOG
        && abs(drive.behind) <= FAR_BEHIND_LOG && most_bend <= BEND_LOG * first * first) {
        return cut(start, end, leak_ns, 1.0);
    }
    const float per_first = 1.0 / first;
    // Where the first stage would settle in light that goes on changing like this, about.
    const float ramp = min(change * per_first, 0.9);
    const float first_settled = ramp / (1.0 - 0.5 * ramp);
    const float first_bend = abs(drive.behind - first_settled) * min(second * per_first, 1.0);
    // In time constants at the light's rate: where the output is above the light, the stage is faster.
    const float far_turn = p.excess < 0.0 ? FALLING_TURN * (1.0 + p.excess) : 0.5;
    const float first_turn = abs(drive.behind) > FAR_BEHIND_LOG ? far_turn : longest_turn(first_bend);
    const float second_turn = longest_turn(second_bend);
    const float turn_ns = min(first_turn * per_first * rest_ns, second_turn * second_s * 1e9);
    return cut(start, end, min(turn_ns, leak_ns), max(abs(change) * (1.0 / MAX_CHANGE_LOG), leaks));
}

// Lowers the reference by what leaks away in `duration_s` and by the charge that the light drives in it. Returns the
// whole units of Q24; the rest stays in the fraction.
int leak(Camera cam, float duration_s, float charge, float dark_leak, inout PixelState p) {
    const float most = MOST_LEAK_LOG * LOG_SCALE;
    const float fall =
        clamp(fma(dark_leak, duration_s, physicals[cam.slot].light_q24_per_charge * charge), -most, most);
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
float output_slope(Drive drive, float duration_s, float second, PixelState p) {
    return second < STEEP_TURN
        ? -second * (drive.behind + p.lag)
        : drive.first_per_s * p.excess * duration_s;
}

// The instant within a part at which a cubic turns; the part's end if it does not turn. `from_slope` and `to_slope` are the
// slopes at both ends, nepers in the part.
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

// The part from `start` to `end`, in which the level goes from `level` to `next_level` and which `settles` or not. Takes the
// photoreceptor to its end. `dark_leak` is Q24 a second.
Part next_part(
    Camera cam, uint start, uint end, int level, int next_level, bool settles, float dark_leak, inout PixelState p,
    inout Drive drive
) {
    const float span_ns = float(end - start);
    const float duration_s = span_ns * 1e-9;
    const float change = nepers(next_level - level);
    const float second = physicals[cam.slot].second_per_s * duration_s;
    const float charge = min(drive.per_s * duration_s * phi(change), MOST_CHARGE);
    Part part;
    part.start = start;
    part.end = end;
    part.per_ns = 1.0 / span_ns;
    part.from = level + to_q24(p.lag);
    part.from_sigma = drive.sigma;
    part.bow = vec2(0.0);
    part.turns = vec2(0.0);
    part.come = vec2(0.0);
    part.turn = end;
    // While both stages turn little, the output bends.
    const bool bends = !settles && min(second, charge) < STEEP_TURN;
    const float from_slope = bends ? output_slope(drive, duration_s, second, p) : 0.0;
    const float next_per_s = next_level == level ? drive.per_s : drive_per_s(cam, next_level);
    if (settles) {
        const float first = drive.per_s * duration_s;
        settle(change, first, second, p, drive, part);
        part.turned = advance_settling(charge, change, first, second, next_per_s, p, drive);
    } else {
        part.turned = advance_photoreceptor(charge, change, second, p.excess, drive.behind, p.lag);
    }
    drive.per_s = next_per_s;
    update_drive(cam, p.excess, drive);
    part.leaked = EFFECT_LEAK ? leak(cam, duration_s, charge, dark_leak, p) : 0;
    part.to = next_level + to_q24(p.lag) + part.leaked;
    if (settles && max(abs(part.bow.x), abs(part.bow.y)) <= BEND_LOG) {
        part.turns = vec2(0.0);
        part.bow = vec2(0.0);
    } else if (settles && may_turn_at_threshold(part, p)) {
        part.turn = settling_turn(part);
    }
    if (bends) {
        // The leak is a straight line.
        const float fall = nepers(part.leaked);
        const float to_slope = output_slope(drive, duration_s, second, p);
        const float rise = nepers(part.to - part.from);
        part.bow = vec2(from_slope, to_slope) + (fall - rise);
        part.turn = turning_point(part, from_slope + fall, to_slope + fall);
    }
    return part;
}
