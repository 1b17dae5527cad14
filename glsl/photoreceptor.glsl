// The photoreceptor over a part of a sub-step: twin of the model's `physical::photoreceptor`, in single precision.

// Least 1 + d. Below it single precision has no digits of it left.
const float LEAST_RATIO = 1.0 / 1048576.0;

// Largest lag, nepers: more than any light can be behind.
const float MOST_LAG_LOG = 100.0;

// Most that an excess grows by in a part, as a logarithm.
const float MOST_GROWTH = 40.0;

// Excess up to which its logarithm is a straight line over a part.
const float STRAIGHT_EXCESS = 0.02;

// (e^x - 1) / x for small x.
float phi_series(float x) {
    return fma(x, fma(x, fma(x, fma(x, 1.0 / 120.0, 1.0 / 24.0), 1.0 / 6.0), 0.5), 1.0);
}

// (e^x - 1) / x. Near 0 a series keeps the digits that the difference loses.
float phi(float x) {
    const float near = fma(x * x, x * x * (x * (1.0 / 720.0)), phi_series(x));
    return mix((exp(min(x, 80.0)) - 1.0) / x, near, abs(x) < 0.2);
}

// ln(1 + d), with all digits for small d.
float log_1p(float d) {
    const float t = d / (2.0 + d);
    const float s = t * t;
    const float near = 2.0 * t * fma(s, fma(s, fma(s, fma(s, 1.0 / 9.0, 1.0 / 7.0), 0.2), 1.0 / 3.0), 1.0);
    return mix(log(1.0 + d), near, abs(d) < 0.25);
}

// (e^-x - 1) / -x, given e^-x.
float phi_falling(float x, float kept) {
    return mix((1.0 - kept) / x, phi_series(-x), abs(x) < 0.1);
}

// What the second pole, which turns by `second` over the part, passes of a decay by `rate`. `kept` is e^-second, `left`
// e^-rate.
float passed(float second, float rate, float kept, float left) {
    const float apart = abs(second - rate);
    return second * mix(abs(kept - left) / apart, max(kept, left) * phi_series(-apart), apart < 0.1);
}

// Convolution with the second pole of u, which falls from 1 to 0 linearly in e^(-decay s). `kept` is e^-second, `left`
// e^-decay.
float linear_moment(float second, float decay, float kept, float left) {
    const float fall = 1.0 - left;
    if (abs(fall) < 0.03) {
        // Nearly linear in time: u = 1 - s.
        return phi_falling(second, kept) - kept;
    }
    return (passed(second, decay, kept, left) - left * (1.0 - kept)) / fall;
}

// The same of u^2, given that of u.
float square_moment(float second, float decay, float kept, float left, float linear) {
    const float fall = 1.0 - left;
    if (abs(fall) < 0.03) {
        return second < 0.5
            ? second * (1.0 / 3.0 - second * (0.25 - second * (0.1 - second * (1.0 / 36.0))))
            : (2.0 - kept * (second * (second + 2.0) + 2.0)) / (second * second);
    }
    // From the linear one: it loses fewer digits than the difference of three products.
    const float twice = passed(second, 2.0 * decay, kept, left * left);
    return ((twice - left * left * (1.0 - kept)) / fall - 2.0 * left * linear) / fall;
}

// Takes the state over a part in which the light drives the charge `charge`, the level changes by `change` and the
// second pole turns by `second`. `behind` is ln(1 + excess). Returns the phase by which the first stage turns.
float advance_photoreceptor(
    float charge, float change, float second, inout float excess, inout float behind, inout float lag
) {
    const float decay = max(charge - change, -MOST_GROWTH);
    const float left = exp(-decay);
    const float kept = exp(-second);
    const float moved = excess * left + change * phi_falling(decay, left);
    const float next = clamp(moved, LEAST_RATIO - 1.0, 1e30);
    const float from = behind;
    const float to = log_1p(next);
    const float linear = linear_moment(second, decay, kept, left);
    // ln(1 + d) is the parabola through `to` at u = 0, its middle at 1/2 and `from` at 1; near 0 it is a line.
    float pulled = to * (1.0 - kept) + (from - to) * linear;
    if (max(abs(excess), abs(next)) > STRAIGHT_EXCESS) {
        const float bend = 2.0 * (from + to - 2.0 * log_1p(0.5 * (excess + next)));
        pulled += bend * (square_moment(second, decay, kept, left, linear) - linear);
    }
    lag = clamp(lag * kept - change * phi_falling(second, kept) - pulled, -MOST_LAG_LOG, MOST_LAG_LOG);
    excess = next;
    behind = to;
    return max(charge - change + (to - from), 0.0);
}
