// A log pixel's interval in two loops: the levels at the ends of all sub-steps first, then the walk over them. Included by
// cross.glsl for rigs with many events; needs substep_levels.glsl.

// Walks the pixel over its `n` sub-steps. A sub-step in which nothing happens costs little, so the pixels of a subgroup
// meet at their next events.
void walk(Camera cam, uint pixel, uint n, inout PixelState p, inout Walk w) {
    const SubstepLength each = substep_length(cam, n);
    uint i = 0u;
    uint end = 0u;
    uint over = 0u;
    uint now = 0u;
    int to_level = w.from_level;
    bool goes_on = false;
    bool happens;
    do {
        do {
            if (!goes_on) {
                i += 1u;
                end = next_end(each, end, over);
                now = w.start;
                // A sub-step shorter than a nanosecond joins the next one.
                to_level = end == w.start ? w.from_level : begin_substep(cam, end, level_of_substep(i), p, w);
            }
            happens = end != w.start && comes_next(end, to_level, p, now, w);
            goes_on = happens;
            if (!happens) {
                w.from_level = to_level;
                w.start = end;
            }
        } while (!happens && i < n);
        if (happens) {
            take_next(cam, pixel, end, to_level, p, now, w);
        }
    } while (happens);
}

// Synthesises and walks a pixel's interval; returns its exposure.
float cross_interval(Camera cam, Source s, bool active_pixel, uint n, inout PixelState p) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const int first_q24 = to_q24(lit_at_start(cam, s.log_previous));
    if (!active_pixel) {
        silence(p, first_q24);
    }
    if (DUMP_SAMPLES) {
        samples_out[cam.samples_base + pixel] = first_q24;
    }
    synthesize_all(cam, s, n);
    // Shot noise follows the steady light.
    const ivec2 frames_q24 = ivec2(to_q24(s.log_previous), to_q24(s.log_current));
    Walk w = begin_walk(cam, pixel, first_q24, frames_q24, cam.interval_ns / n, p);
    walk(cam, pixel, n, p, w);
    end_walk(cam, w, p);
    return w.exposed;
}
