// Noise before the comparators: twin of the model's `physical::noise`, in single precision. Needs photoreceptor.glsl and
// random.glsl.

// A phase beyond which nothing is remembered.
const float FORGOTTEN_PHASE = 20.0;

// Distance, in standard deviations, beyond which the hazard is left out.
const float FAR_DISTANCE = 7.0;

// Standard normal deviate from four random words, by additions and multiplications alone.
float normal_from_words(uvec4 words) {
    const uvec4 halves = (words & 0xffffu) + (words >> 16);
    const float s = float(int(halves.x + halves.y + halves.z + halves.w) - 262140) * 1.8688124e-5;
    const float square = s * s;
    return s * (0.980888271 + square * (6.144712e-3 + square * (2.7378e-5 + square * 1.4452e-5)));
}

float exponential_of(uint word) {
    return float(exponential_q27(word)) / float(1u << HAZARD_FRACTION_BITS);
}

// Standard deviation of the noise behind both poles, nepers. `variance` is that behind the first alone.
float sigma_log(float variance, float first, float second) {
    return sqrt(variance * (second / (first + second)));
}

// Correlation of the noise with itself after the phases p and q.
float correlation(float p, float q) {
    const float low = min(p, q);
    return exp(-low) * (1.0 + low * phi(low - max(p, q)));
}

// 1 - correlation(p, q), with all digits.
float forgotten(float p, float q) {
    const float low = min(p, q);
    const float high = max(p, q);
    if (high < 0.1) {
        const float second = high * high + low * (high + low);
        const float third = high * high * high + low * second;
        return low * high * (0.5 - (low + high) * (1.0 / 6.0) + second * (1.0 / 24.0) - third * (1.0 / 120.0));
    }
    return low * (phi(-low) - exp(-low) * phi(low - high));
}

// Correlation of the noise with its slope.
float slope_correlation(float p, float q) {
    const float low = min(p, q);
    return sqrt(p * q) * exp(-low) * phi(low - max(p, q));
}

// What is known of the noise: mean and standard deviation, nepers.
struct Law {
    float mean;
    float deviation;
};

// The noise `released` at a release, after the phases p and q; `sigma` is its standard deviation when nothing is known.
Law noise_law(float released, float sigma, float p, float q) {
    if (min(p, q) > FORGOTTEN_PHASE) {
        return Law(0.0, sigma);
    }
    const float lost = clamp(forgotten(p, q), 0.0, 1.0);
    return Law(correlation(p, q) * released, sigma * sqrt(lost * (2.0 - lost)));
}

// Rate, per second, at which noise comes to a level `distance` standard deviations away.
float hazard_per_s(float distance, float first, float second) {
    if (distance > FAR_DISTANCE) {
        return 0.0;
    }
    const float b = max(distance, 0.7);
    const float slow = min(first, second);
    const float passage = slow * (b + 1.5 * exp(-b)) * 0.39894228;
    const float crossing = sqrt(first) * sqrt(second) * 0.15915494;
    const float smaller = min(passage, crossing);
    const float joined = smaller * pow(1.0 + pow(smaller / max(max(passage, crossing), 1e-30), 1.2), -1.0 / 1.2);
    const float near = 0.6 * slow / (1.0 + slow / max(first, second));
    return max(joined * exp(-0.5 * b * b), near * clamp((1.0 - b) * (1.0 / 0.3), 0.0, 1.0));
}

// Hazards of OFF and ON noise, per second. `above` is the level without noise above the reference, nepers.
vec2 hazards_per_s(float above, Law law, vec2 thresholds_off_on, float first, float second) {
    if (law.deviation <= 0.0) {
        return vec2(0.0);
    }
    const float shown = above + law.mean;
    return vec2(
        hazard_per_s((thresholds_off_on.x + shown) / law.deviation, first, second),
        hazard_per_s((thresholds_off_on.y - shown) / law.deviation, first, second));
}
