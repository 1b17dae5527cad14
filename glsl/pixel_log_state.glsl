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

// Arms a pixel: its reference is its level, it is not held, its first shots are drawn.
void arm_pixel(Camera cam, uint pixel, int log_q24) {
    store_state(cam, pixel, STATE_REFERENCE, uint(log_q24));
    store_state(cam, pixel, STATE_HELD_LOW, uint(NOT_HELD & int64_t(0xffffffffu)));
    store_state(cam, pixel, STATE_HELD_HIGH, uint(NOT_HELD >> 32));
    const int on_q24 = int(load_state(cam, pixel, STATE_CONTRAST_ON));
    const int off_q24 = int(load_state(cam, pixel, STATE_CONTRAST_OFF));
    const uint shot_off = shot_hazard(cam, pixel, STREAM_SHOT_OFF, 0u, off_q24, cam.contrast_off_q24);
    const uint shot_on = shot_hazard(cam, pixel, STREAM_SHOT_ON, 0u, on_q24, cam.contrast_on_q24);
    store_state(cam, pixel, STATE_SHOT_OFF_HAZARD, shot_off);
    store_state(cam, pixel, STATE_SHOT_ON_HAZARD, shot_on);
    store_state(cam, pixel, STATE_SHOT_OFF_DRAWS, 1u);
    store_state(cam, pixel, STATE_SHOT_ON_DRAWS, 1u);
    store_state(cam, pixel, STATE_EVENTS, 0u);
}
