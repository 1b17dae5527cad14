// The photoreceptor over a part of a sub-step: twin of the model's `physical::photoreceptor`, in single precision.

// Least 1 + d. Below it single precision has no digits of it left.
const float LEAST_RATIO = 1.0 / 1048576.0;

// Largest lag, nepers: more than any light can be behind.
const float MOST_LAG_LOG = 100.0;

// (e^x - 1) / x. Near 0 a series keeps the digits that the difference loses.
float phi(float x) {
    if (abs(x) < 0.1) {
        return 1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0))));
    }
    return (exp(min(x, 80.0)) - 1.0) / x;
}

// ln(1 + d), with all digits for small d.
float log_1p(float d) {
    if (abs(d) < 0.25) {
        const float t = d / (2.0 + d);
        const float s = t * t;
        return 2.0 * t * (1.0 + s * (1.0 / 3.0 + s * (0.2 + s * (1.0 / 7.0 + s * (1.0 / 9.0)))));
    }
    return log(1.0 + d);
}

// What the second pole, which turns by `second` over the part, passes of a decay by `rate`.
float passed(float second, float rate) {
    return second * exp(-min(rate, second)) * phi(-abs(second - rate));
}

// Weights of 1, u and u^2 behind the second pole, where u falls from 1 to 0 linearly in e^(-decay s): the share that the
// pole keeps of its start, and the convolutions of u and u^2 with it.
vec3 moments(float second, float decay) {
    const float kept = exp(-second);
    const float fall = 1.0 - exp(-decay);
    if (abs(fall) < 0.03) {
        // Nearly linear in time: u = 1 - s.
        const float linear = phi(-second) - kept;
        const float square = second < 0.5
            ? second * (1.0 / 3.0 - second * (0.25 - second * (0.1 - second * (1.0 / 36.0))))
            : (2.0 - kept * (second * (second + 2.0) + 2.0)) / (second * second);
        return vec3(kept, linear, square);
    }
    const float left = 1.0 - fall;
    const float linear = (passed(second, decay) - left * (1.0 - kept)) / fall;
    // The square from the linear part: it loses fewer digits than the difference of three products.
    const float twice = passed(second, 2.0 * decay);
    const float square = ((twice - left * left * (1.0 - kept)) / fall - 2.0 * left * linear) / fall;
    return vec3(kept, linear, square);
}

// Takes the state over a part in which the light drives the charge `charge`, the level changes by `change` and the
// second pole turns by `second`. Returns the phase by which the first stage turns.
float advance_photoreceptor(float charge, float change, float second, inout float excess, inout float lag) {
    const float decay = charge - change;
    const float moved = excess * exp(min(-decay, 60.0)) + change * phi(-decay);
    const float next = clamp(moved, LEAST_RATIO - 1.0, 1e30);
    const float from = log_1p(excess);
    const float middle = log_1p(0.5 * (excess + next));
    const float to = log_1p(next);
    const vec3 weights = moments(second, decay);
    // The parabola through `to` at u = 0, `middle` at 1/2 and `from` at 1.
    const float bend = 2.0 * (from + to - 2.0 * middle);
    const float slope = 4.0 * middle - 3.0 * to - from;
    const float pulled = to * (1.0 - weights.x) + slope * weights.y + bend * weights.z;
    lag = clamp(lag * weights.x - change * phi(-second) - pulled, -MOST_LAG_LOG, MOST_LAG_LOG);
    excess = next;
    return max(charge - change + (to - from), 0.0);
}
