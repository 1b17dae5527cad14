// State of the physical pixel: where its words lie, what is drawn once per pixel, and how it starts. Its walk through an
// interval is in pixel_physical.glsl.

layout(set = 0, binding = SLOT_PHYSICALS, std140) uniform Buffer_physicals { Physical physicals[MAX_CAMERAS]; };

#include "photoreceptor.glsl"
#include "pixel_noise.glsl"

// Logarithms of the slowest and fastest rate of the first stage, per second; rates beyond are no different.
const float LEAST_RATE_LOG = -40.0;
const float MOST_RATE_LOG = 60.0;

float nepers(int q24) {
    return float(q24) * (1.0 / LOG_SCALE);
}

// Logarithms of the pixel's dark current and leak, relative to the nominal ones.
vec2 factors_log(Camera cam, uint pixel) {
    const int word = int(load_state(cam, pixel, STATE_FACTORS));
    return vec2(bitfieldExtract(word, 0, 16), bitfieldExtract(word, 16, 16)) / FACTOR_UNITS;
}

// The pixel's level: the planes have the nominal dark current in them, the pixel its own.
int own_level(Camera cam, int level_q24, float dark_factor_log) {
    if (dark_factor_log == 0.0) {
        return level_q24;
    }
    const float light = max(exp(nepers(level_q24)) - cam.log_offset, 0.0);
    return to_q24(log(light + cam.log_offset * exp(dark_factor_log)));
}

// Rate that light and dark current drive together, per second.
float drive_per_s(Camera cam, int level_q24) {
    const float rate_log = nepers(level_q24) + physicals[cam.slot].drive_log;
    return exp(clamp(rate_log, LEAST_RATE_LOG, MOST_RATE_LOG));
}

// All that leaks but for what light and dark current drive together, Q24 per second.
float dark_leak_q24_per_s(Camera cam, vec2 factors_log) {
    const Physical physical = physicals[cam.slot];
    return physical.dark_leak_q24_per_s * exp(factors_log.y) - physical.dark_light_q24_per_s * exp(factors_log.x);
}

// How far what an armed pixel watches is above its reference, nepers: its noise and what has leaked before, by the model's
// `armed_leak_log`. `per_s` is what drives it, `sigma` the standard deviation of its noise.
float armed_above_log(Camera cam, uint pixel, uint events, float per_s, float noise, float sigma) {
    const Physical physical = physicals[cam.slot];
    const float towards =
        sign(fma(physical.light_q24_per_charge, per_s, dark_leak_q24_per_s(cam, factors_log(cam, pixel))));
    if (towards == 0.0) {
        return 0.0;
    }
    const float on = nepers(int(load_state(cam, pixel, STATE_CONTRAST_ON)));
    const float off = nepers(int(load_state(cam, pixel, STATE_CONTRAST_OFF)));
    const float threshold = towards < 0.0 ? off : on;
    const float held_s = float(cam.refractory_ns) * 1e-9;
    const float kept = memory_after(per_s * held_s, physical.second_per_s * held_s).value;
    const float clearance = LEAK_CLEARANCE * sigma;
    const float beyond = kept * min(clearance, 0.5 * threshold);
    const float phase = leak_phase(draw(cam, pixel, STREAM_LEAK_PHASE, events).x);
    const float leaked = phase * (max(threshold - clearance, beyond) + beyond) - beyond;
    return clamp(noise + towards * leaked, -ARMED_WITHIN * off, ARMED_WITHIN * on);
}

// Arms a settled pixel that has sent `events`: its reference is its level with the noise of the moment and with what has leaked.
void arm_pixel_after(Camera cam, uint pixel, int log_q24, uint events) {
    const Physical physical = physicals[cam.slot];
    const int level = own_level(cam, log_q24, factors_log(cam, pixel).x);
    const float per_s = drive_per_s(cam, level);
    const float sigma = sigma_log(physical.variance, per_s, physical.second_per_s);
    const float noise = sigma * normal_from_words(draw(cam, pixel, STREAM_RELEASE, events));
    const float above = armed_above_log(cam, pixel, events, per_s, noise, sigma);
    store_state(cam, pixel, STATE_REFERENCE, uint(level + to_q24(noise - above)));
    store_state(cam, pixel, STATE_FRACTION, 0u);
    store_state(cam, pixel, STATE_EXCESS, 0u);
    store_state(cam, pixel, STATE_LAG, 0u);
    store_state(cam, pixel, STATE_NOISE, floatBitsToUint(noise));
    store_state(cam, pixel, STATE_PHASE, 0u);
    store_state(cam, pixel, STATE_RELEASE, 0u);
    store_state(cam, pixel, STATE_CLOCK, exponential_q27(draw(cam, pixel, STREAM_CLOCK, events).x));
    store_state(cam, pixel, STATE_EVENTS, events);
}

void arm_pixel(Camera cam, uint pixel, int log_q24) {
    arm_pixel_after(cam, pixel, log_q24, 0u);
}
