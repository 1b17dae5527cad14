// A log pixel's interval in two loops: the levels at the ends of all sub-steps first, then the walk over them. Included by
// cross.glsl for the software driver, and on GPUs for rigs with many events; needs substep_levels.glsl.

// Where a walk is, between two events: in which sub-step, where that ends, whether it goes on in it, from when on, and to
// which level.
struct Place {
    uint substep;
    uint end;
    uint over;
    bool goes_on;
    uint now;
    int to_level;
};

// A walk that the queue has stopped, to be gone on with.
Walk stopped_walk;
Place stopped_at;
bool is_stopped;

void begin_interval() {
    is_stopped = false;
}

bool is_midway() {
    return WALKS_AGAIN && is_stopped;
}

// From shot_draws_*.glsl.
void make_requested_draw(Camera cam, uint pixel, PixelState p, inout Walk w);

// Makes the draw that the walk waits for.
void make_draw(Camera cam, uint pixel, inout PixelState p, inout Walk w) {
    make_requested_draw(cam, pixel, p, w);
    suppress_shots(cam, pixel, p, w);
}

// Sends another event of the sub-step, if one comes.
void take_another(Camera cam, uint pixel, inout PixelState p, inout Walk w, inout Place at) {
    if (!needs_draw() && walks_on(w.ordinal) && comes_next(at.end, at.to_level, p, at.now, w)) {
        take_next(cam, pixel, at.end, at.to_level, p, at.now, w);
    }
}

// Walks the pixel over its `n` sub-steps. A sub-step in which nothing happens costs little, so the pixels of a subgroup
// meet at their next events.
void walk(Camera cam, uint pixel, uint n, inout PixelState p, inout Walk w, inout Place at) {
    const SubstepLength each = substep_length(cam, n);
    bool happens;
    do {
        if (needs_draw()) {
            make_draw(cam, pixel, p, w);
        }
        happens = false;
        if (!needs_draw()) {
            do {
                if (!at.goes_on) {
                    at.substep += 1u;
                    at.end = next_end(each, at.end, at.over);
                    at.now = w.start;
                    // A sub-step shorter than a nanosecond joins the next one.
                    at.to_level = at.end == w.start
                        ? w.from_level
                        : begin_substep(cam, at.end, level_of_substep(at.substep), p, w);
                }
                happens = at.end != w.start && comes_next(at.end, at.to_level, p, at.now, w);
                at.goes_on = happens;
                if (!happens) {
                    w.from_level = at.to_level;
                    w.start = at.end;
                }
            } while (!happens && at.substep < n);
            if (happens) {
                take_next(cam, pixel, at.end, at.to_level, p, at.now, w);
                if (SAVES_ROUNDS) {
                    take_another(cam, pixel, p, w, at);
                    take_another(cam, pixel, p, w, at);
                    take_another(cam, pixel, p, w, at);
                }
            }
        }
    } while ((happens || needs_draw()) && walks_on(w.ordinal));
}

// Synthesises and walks a pixel's interval, or goes on with the walk; returns its exposure.
float cross_interval(Camera cam, Source s, bool active_pixel, uint n, inout PixelState p) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    Walk w;
    Place at;
    if (is_midway()) {
        w = stopped_walk;
        at = stopped_at;
        emit_refused();
    } else {
        const int first_q24 = to_q24(lit_at_start(cam, s.log_previous));
        if (!active_pixel) {
            silence(p, first_q24);
        }
        if (DUMP_SAMPLES) {
            samples_out[cam.samples_base + pixel] = first_q24;
        }
        if (!WALKS_AGAIN || earlier_walks == 0u) {
            begin_count();
            synthesize_all(cam, s, n);
        }
        // Shot noise follows the steady light.
        const ivec2 frames_q24 = ivec2(to_q24(s.log_previous), to_q24(s.log_current));
        w = begin_walk(cam, pixel, first_q24, frames_q24, p);
        at = Place(0u, 0u, 0u, false, 0u, w.from_level);
    }
    if (walks_on(w.ordinal)) {
        walk(cam, pixel, n, p, w, at);
        is_stopped = !walks_on(w.ordinal);
    }
    if (is_midway()) {
        stopped_walk = w;
        stopped_at = at;
    } else {
        end_walk(cam, w, p);
    }
    return w.exposed;
}
