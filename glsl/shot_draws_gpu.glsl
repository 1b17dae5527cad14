// Shot draws for GPUs, which skip a branch that no thread takes: the walk draws a random number where it needs one, and
// is never suspended.

void request_draw(Camera cam, uint pixel, uint stream, PixelState p, inout Walk w) {
    draw_shot(cam, pixel, stream, p, w);
}

void begin_draws() {}

bool needs_draw() {
    return false;
}

void make_requested_draw(Camera cam, uint pixel, PixelState p, inout Walk w) {}
