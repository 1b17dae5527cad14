// Noise before the comparators: twin of the model's `physical::noise` and `physical::crossing`, in single precision. Needs
// photoreceptor.glsl and random.glsl.

// A phase beyond which nothing is remembered: less than a hundredth of a standard deviation.
const float FORGOTTEN_PHASE = 8.0;

// Distance, in standard deviations, beyond which the hazard is left out.
const float FAR_DISTANCE = 6.0;

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
    return sqrt(variance * second) * inversesqrt(first + second);
}

// Correlations of the noise after the phases p and q: with itself, and with its slope; what 1 has above the first.
struct Memory {
    float value;
    float slope;
    float forgotten;
};

Memory memory_after(float p, float q) {
    const float low = min(p, q);
    const float apart = max(p, q) - low;
    const float kept = exp(-low);
    const float passed_on = kept * mix((1.0 - exp(-apart)) / apart, phi_series(-apart), apart < 0.1);
    return Memory(
        min(fma(low, passed_on, kept), 1.0), sqrt(p * q) * passed_on, low * (phi_falling(low, kept) - passed_on));
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
    const float kept = memory_after(p, q).value;
    return Law(kept * released, sigma * sqrt(1.0 - kept * kept));
}

// What is known of the noise's slope, in standard deviations of a slope of which nothing is known.
struct SlopeLaw {
    float mean;
    float deviation;
};

// The law, given the noise when it was `released` and `now`, in its standard deviations, the phases p and q later.
SlopeLaw slope_law(float released, float now, float p, float q) {
    const Memory memory = memory_after(p, q);
    const float explained = memory.slope * memory.slope;
    // Variance of the noise now, of which its slope explains a part.
    const float new = max(max(memory.forgotten * (2.0 - memory.forgotten), explained), 1e-30);
    const float mean = memory.slope * fma(memory.value, now, -released) / new;
    return SlopeLaw(clamp(mean, -6.0, 6.0), sqrt(max(1.0 - explained / new, 1e-6)));
}

// Slope of the noise at an event, all slopes outwards: that of a path that crosses the threshold, in light of the slope
// `light`. `rayleigh` is the renewal's draw.
float slope_at_event(SlopeLaw law, float light, float rayleigh) {
    // How fast paths are, in standard deviations of their speeds; the share of the normal distribution below it.
    const float z = clamp((light + law.mean) / law.deviation, -2.0, 100.0);
    const float t = 1.0 / fma(0.2316419, abs(z), 1.0);
    const float density = 0.39894228 * exp(-0.5 * z * z);
    const float series = fma(t, fma(t, fma(t, fma(t, 1.330274429, -1.821255978), 1.781477937), -0.356563782), 0.31938153);
    const float tail = density * t * series;
    const float below = z < 0.0 ? tail : 1.0 - tail;
    // Speeds of those that cross: their mean is so much ahead, and this is their deviation.
    const float ahead = below / fma(z, below, density);
    const float spread = sqrt(2.0 - ahead * (ahead + z));
    // The draw without its mean, in its deviations.
    const float drawn = (rayleigh - 1.2533141) * 1.5263994;
    return fma(law.deviation, fma(spread, drawn, ahead), law.mean);
}

// What the hazard of a pixel depends on besides distances: logarithms to base 2 of Rice's rate (per second) and of what
// a first passage's rate at the distance 1 is of it if it is small, and the rate at which the noise moves at all.
struct Rates {
    float crossing_log2;
    float passage_log2;
    float near;
};

Rates noise_rates(float first, float second) {
    const float both = first + second;
    const float mean_log2 = 0.5 * (log2(first) + log2(second));
    return Rates(
        mean_log2 - 2.6514961, mean_log2 - log2(both) + 1.3257481, 0.6 * first * (second / both));
}

// Rate, per second, at which noise comes to a level `distance` standard deviations away.
float hazard_per_s(float distance, Rates rates) {
    const float b = max(distance, 0.7);
    // The share of crossings that are the first of their cluster.
    const float passage_log2 = rates.passage_log2 + log2(b + 1.5 * exp2(-1.442695 * b));
    const float passage = exp2(0.8 * passage_log2);
    const float first = passage < 0.01 ? fma(-0.5 * passage, passage, passage) : 1.0 - exp2(-1.442695 * passage);
    const float far = exp2(fma(1.25, log2(first), rates.crossing_log2 - 0.7213475 * b * b));
    return max(far, rates.near * clamp((1.0 - distance) * (1.0 / 0.3), 0.0, 1.0));
}
