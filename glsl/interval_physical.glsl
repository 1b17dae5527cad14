// A physical pixel's interval: the levels at the ends of all sub-steps first, then the walk over them. Included by
// cross.glsl; needs substep_levels.glsl.

// Every walk begins at the interval's start.
void begin_interval() {}

bool is_midway() {
    return false;
}

// Synthesises and walks a pixel's interval; returns its exposure.
float cross_interval(Camera cam, Source s, bool active_pixel, uint n, inout PixelState p) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const int first_q24 = to_q24(lit_at_start(cam, s.log_previous));
    if (!WALKS_AGAIN || earlier_walks == 0u) {
        begin_count();
    }
    if (DUMP_SAMPLES) {
        samples_out[cam.samples_base + pixel] = first_q24;
    }
    if (PASSES_STILL && PASSES_IN_WALK && n == 1u && active_pixel && to_q24(s.log_current) == first_q24
        && pass_interval(cam, pixel, first_q24, p)) {
        return 0.0;
    }
    if (!WALKS_AGAIN || earlier_walks == 0u) {
        synthesize_all(cam, s, n);
    }
    if (!active_pixel) {
        silence(p, first_q24);
    }
    Walk w = begin_walk(cam, pixel, n, first_q24, p);
    do {
        walk(cam, pixel, n, p, w);
        if (needs_draw()) {
            make_draw(cam, pixel, p, w);
        }
    } while (WALKS_SUSPEND && walk_goes_on(n, w));
    end_walk(cam, w, p);
    if (n == 1u && level_of_substep(1u) == first_q24) {
        settle(p);
    }
    return w.exposed;
}
