// A physical pixel's interval: the levels at the ends of all sub-steps first, then the walk over them. Included by
// cross.glsl; needs substep_levels.glsl.

// A walk that the queue has stopped, to be gone on with.
Walk stopped_walk;
bool is_stopped;

void begin_interval() {
    is_stopped = false;
}

bool is_midway() {
    return WALKS_AGAIN && is_stopped;
}

// Synthesises and walks a pixel's interval, or goes on with the walk; returns its exposure.
float cross_interval(Camera cam, Source s, bool active_pixel, uint n, inout PixelState p) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const int first_q24 = to_q24(lit_at_start(cam, s.log_previous));
    Walk w;
    if (is_midway()) {
        w = stopped_walk;
        emit_refused();
    } else {
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
        w = begin_walk(cam, pixel, n, first_q24, p);
    }
    if (!is_midway() || walk_goes_on(n, w)) {
        do {
            walk(cam, pixel, n, p, w);
            if (needs_draw()) {
                make_draw(cam, pixel, p, w);
            }
        } while (WALKS_SUSPEND && walk_goes_on(n, w));
    }
    is_stopped = !walks_on(w.ordinal);
    if (is_midway()) {
        stopped_walk = w;
        return w.exposed;
    }
    end_walk(cam, w, p);
    if (n == 1u && level_of_substep(1u) == first_q24) {
        settle(p);
    }
    return w.exposed;
}
