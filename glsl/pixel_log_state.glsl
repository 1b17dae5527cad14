// State of the log-intensity pixel: where its words lie, and how it starts. Its walk through an interval is in
// pixel_log.glsl; another pixel model brings both files of its own.

const int64_t NOT_HELD = int64_t(0x8000000000000000ul);

// Hazard until a shot: Exp(1), scaled by the pixel's own threshold, since a pixel with a smaller threshold fires more
// often.
uint shot_hazard(Camera cam, uint pixel, uint stream, uint index, int threshold_q24, int nominal_q24) {
    const uint exponential = exponential_q27(draw(cam, pixel, stream, index).x);
    if (threshold_q24 == nominal_q24) {
        return exponential;
    }
    const float scaled = float(exponential) * (float(threshold_q24) / float(nominal_q24));
    return uint(min(scaled, 4294967040.0));
}

float intensity_of(Camera cam, int log_q24) {
    return exp(float(log_q24) * (1.0 / LOG_SCALE)) - cam.log_offset;
}

// Rate of shot noise relative to that in the dark.
float shot_share(Camera cam, int log_q24) {
    return 1.0 - SHOT_NOISE_FALL * clamp(intensity_of(cam, log_q24) * cam.inverse_white, 0.0, 1.0);
}

// Hazard a nanosecond, Q27, between two frames with these levels.
float hazard_in(Camera cam, ivec2 frame_levels) {
    const float share = 0.5 * (shot_share(cam, frame_levels.x) + shot_share(cam, frame_levels.y));
    return cam.hazard_q27_per_ns * share;
}

// How far the leak has lowered the reference of a pixel that is armed at this level: twin of the model's
// `leak_phase_among_shots`, times the threshold.
int armed_leak_q24(Camera cam, uint pixel, int level, int on_q24, int off_q24) {
    const uint leak = load_state(cam, pixel, STATE_LEAK);
    if (leak == 0u) {
        return 0;
    }
    const uvec4 words = draw(cam, pixel, STREAM_LEAK_PHASE, 0u);
    float phase = leak_phase(words.x);
    if (cam.hazard_q27_per_ns > 0.0) {
        const vec2 shares = vec2(cam.contrast_on_q24, cam.contrast_off_q24) / vec2(on_q24, off_q24);
        const float shots_q27_per_ns = hazard_in(cam, ivec2(level)) * (shares.x + shares.y);
        const float shots_q27 = shots_q27_per_ns * (float(on_q24) * (4294967296.0 / float(leak)));
        // The first of the last three words that counts.
        for (uint i = 3u; i > 0u; --i) {
            const float since_shot_q27 = float(exponential_q27(words[i]));
            phase = since_shot_q27 < shots_q27 ? since_shot_q27 / shots_q27 : phase;
        }
    }
    return min(int(roundEven(phase * float(on_q24))), on_q24 - 1);
}

// Arms a pixel: its reference is its level with what has leaked, it is not held, its first shots are drawn.
void arm_pixel(Camera cam, uint pixel, int log_q24) {
    store_state(cam, pixel, STATE_HELD_LOW, uint(NOT_HELD & int64_t(0xffffffffu)));
    store_state(cam, pixel, STATE_HELD_HIGH, uint(NOT_HELD >> 32));
    const int on_q24 = int(load_state(cam, pixel, STATE_CONTRAST_ON));
    const int off_q24 = int(load_state(cam, pixel, STATE_CONTRAST_OFF));
    store_state(cam, pixel, STATE_REFERENCE, uint(log_q24 - armed_leak_q24(cam, pixel, log_q24, on_q24, off_q24)));
    const uint shot_off = shot_hazard(cam, pixel, STREAM_SHOT_OFF, 0u, off_q24, cam.contrast_off_q24);
    const uint shot_on = shot_hazard(cam, pixel, STREAM_SHOT_ON, 0u, on_q24, cam.contrast_on_q24);
    store_state(cam, pixel, STATE_SHOT_OFF_HAZARD, shot_off);
    store_state(cam, pixel, STATE_SHOT_ON_HAZARD, shot_on);
    store_state(cam, pixel, STATE_SHOT_OFF_DRAWS, 1u);
    store_state(cam, pixel, STATE_SHOT_ON_DRAWS, 1u);
    store_state(cam, pixel, STATE_EVENTS, 0u);
}
