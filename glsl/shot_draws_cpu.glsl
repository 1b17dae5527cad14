// Shot draws for the software driver, which runs a branch for all lanes of a vector even if none takes it. A draw is
// long and rarely needed, so it is deferred: the walk is suspended, the kernel draws, the sub-step resumes.

const uint NO_STREAM = 0xffffffffu;

// The stream whose next draw is missing, or NO_STREAM.
uint missing_stream;

void request_draw(Camera cam, uint pixel, uint stream, PixelState p, inout Walk w) {
    missing_stream = stream;
}

void begin_draws() {
    missing_stream = NO_STREAM;
}

bool needs_draw() {
    return EFFECT_SHOT && missing_stream != NO_STREAM;
}

void make_requested_draw(Camera cam, uint pixel, PixelState p, inout Walk w) {
    draw_shot(cam, pixel, missing_stream, p, w);
    missing_stream = NO_STREAM;
}
