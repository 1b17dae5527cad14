// Parts in which both stages come to where they settle, for pixels without noise: a closed form that is exact to the cube of
// the light's change in a time constant of the first stage. The output is a straight line and an exponential of each stage.
// Needs PixelState, Part and Drive.

// Up to here a part is one of these: change of the level in a time constant of the first stage, nepers, and the square of
// that stage's distance from where it settles, of which a slower second stage shows its share.
const float SETTLES_CHANGE_LOG = 0.05;
const float SETTLES_SQUARED = 0.0002;
// Largest change of the level in such a part, nepers, and its square over the part's time constants of the first stage.
const float SETTLES_MOST_LOG = 0.5;
const float SETTLES_CURVE_LOG = 0.0005;
// Least difference of the stages' time constants, as a share of the second one's, for which the exponentials are worked out.
const float LEAST_APART = 0.01;
// Largest sum of the exponentials that is told, nepers.
const float MOST_REACH_LOG = 32.0;
// Times that a turn is made better.
const uint TURN_TRIES = 6u;

// Where the first stage settles in light that changes by `ramp` nepers in one of its time constants, which that makes
// shorter: the excess, and its ln(1 + d).
float settled_excess(float ramp) {
    return ramp * fma(ramp, fma(ramp, 6.0, 2.0), 1.0);
}

float settled_behind(float ramp) {
    return ramp * fma(ramp, fma(ramp, 13.0 / 3.0, 1.5), 1.0);
}

// Whether both stages settle so while the level changes by `change` and they have `first` and `second` time constants.
bool stages_settle(Drive drive, float change, float first, float second) {
    const float off = drive.behind - settled_behind(change / first);
    return abs(change) <= SETTLES_CHANGE_LOG * first && off * off * min(first, second) <= SETTLES_SQUARED * first;
}

// Parts that such a change takes.
float settling_parts(float change, float first) {
    return min(abs(change) * (1.0 / MAX_CHANGE_LOG),
        max(abs(change) * (1.0 / SETTLES_MOST_LOG), change * change / (SETTLES_CURVE_LOG * first)));
}

// Sets the exponentials of a part from the state at its start.
void settle(float change, float first, float second, PixelState p, Drive drive, inout Part part) {
    const float ramp = change / first;
    const float off = drive.behind - settled_behind(ramp);
    // Most of its way the first stage comes at the start, at the rate that it has there.
    const float fast = first - change;
    part.turns = vec2(abs(second - fast) < LEAST_APART * second ? (1.0 - LEAST_APART) * second : fast, second);
    const float of_first = second * off / (part.turns.x - second);
    // What the slope of the output, which the second stage tells, has beside the line's and the first stage's.
    const float of_second = p.lag + drive.behind + (fma(change, ramp, change) - of_first * part.turns.x) / second;
    part.bow = vec2(of_first, of_second);
    part.come = 1.0 - exp(-part.turns);
}

// Takes the photoreceptor over a part in which the light drives the charge `charge` and has the rate `next_per_s` at the
// end. Returns the phase by which the first stage turns.
float advance_settling(
    float charge, float change, float first, float second, float next_per_s, inout PixelState p, inout Drive drive
) {
    const float decay = charge - change;
    const float left = exp(-decay);
    const float kept = exp(-second);
    const float ramp = change / first;
    const float next_ramp = next_per_s > 0.0 ? ramp * (drive.per_s / next_per_s) : 0.0;
    const float settled = settled_behind(ramp);
    const float next_settled = settled_behind(next_ramp);
    const float from = drive.behind;
    p.excess = settled_excess(next_ramp) + (p.excess - settled_excess(ramp)) * left;
    drive.behind = log_1p(p.excess);
    // Where the first stage settles moves along a straight line, which the second one follows.
    const float moved = (next_settled - settled - change) * phi_falling(second, kept);
    p.lag = kept * (p.lag + settled) - next_settled + moved - (from - settled) * passed(second, decay, kept, left);
    return max(decay + (drive.behind - from), 0.0);
}

// Whether the output may come to a threshold within the part although its ends do not.
bool may_turn_at_threshold(Part part, PixelState p) {
    const int reach = to_q24(min(abs(part.bow.x) + abs(part.bow.y), MOST_REACH_LOG));
    const int above = max(part.from, part.to) - p.reference;
    const int below = p.reference - min(part.from, part.to);
    // A hold that ends in the part sets the reference to the output then.
    return p.release_ns > int(part.start)
        ? abs(part.to - part.from) + 2 * reach >= min(p.on_q24, p.off_q24)
        : above + reach >= p.on_q24 || below + reach >= p.off_q24;
}

// The instant at which the output turns; the part's end if it does not turn.
uint settling_turn(Part part) {
    const uint span = part.end - part.start;
    const float line = nepers(part.to - part.from) + dot(part.bow, part.come);
    const vec2 steep = part.bow * part.turns;
    float from_slope = line - (steep.x + steep.y);
    float to_slope = line - dot(steep, 1.0 - part.come);
    if (from_slope * to_slope >= 0.0 || span < 2u) {
        return part.end;
    }
    // By straight lines between instants on both sides, measured by how far the slower stage has come.
    const bool is_first = part.turns.x < part.turns.y;
    const vec2 slow_fast = is_first ? part.turns : part.turns.yx;
    const vec2 slopes = is_first ? steep : steep.yx;
    const float way = is_first ? part.come.x : part.come.y;
    float low = 0.0;
    float high = 1.0;
    float left = 1.0;
    for (uint i = 0u; i < TURN_TRIES; ++i) {
        const float at = lerp(low, high, from_slope / (from_slope - to_slope));
        left = fma(-at, way, 1.0);
        const float slope = line - slopes.x * left - slopes.y * pow(left, slow_fast.y / slow_fast.x);
        const bool is_low = slope * from_slope > 0.0;
        // A side that stays weighs half, so that the other one moves too.
        low = is_low ? at : low;
        high = is_low ? high : at;
        to_slope = is_low ? 0.5 * to_slope : slope;
        from_slope = is_low ? slope : 0.5 * from_slope;
    }
    const float share = clamp(-log(left) / slow_fast.x, 0.0, 1.0);
    return part.start + clamp(uint(share * float(span)), 1u, span - 1u);
}
