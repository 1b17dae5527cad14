// A log pixel's interval, sub-step by sub-step: each is synthesised and walked at once. Included by cross.glsl, for GPUs.

// Walks one sub-step, from the end of the last one to `end`, where the log intensity is `to_raw`.
void walk_substep(Camera cam, uint pixel, uint end, int to_raw, inout PixelState p, inout Walk w) {
    if (end == w.start) {
        // A sub-step shorter than a nanosecond joins the next one.
        return;
    }
    const int to_level = begin_substep(cam, end, to_raw, p, w);
    uint now = w.start;
    while (walks_on(w.ordinal) && comes_next(end, to_level, p, now, w)) {
        take_next(cam, pixel, end, to_level, p, now, w);
    }
    w.from_level = to_level;
    w.start = end;
}

// Every walk begins at the interval's start.
void begin_interval() {}

bool is_midway() {
    return false;
}

// Synthesises and walks a pixel's interval; returns its exposure.
float cross_interval(Camera cam, Source s, bool active_pixel, uint n, inout PixelState p) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const int first_q24 = to_q24(lit_at_start(cam, s.log_previous));
    if (!active_pixel) {
        silence(p, first_q24);
    }
    begin_count();
    const SubstepLength each = substep_length(cam, n);
    const float inverse = 1.0 / float(n);
    uint end_ns = 0u;
    uint over = 0u;
    float done = 0.0;
    const Geometry geo = geometry_of(cam);
    // Shot noise follows the steady light.
    const ivec2 frames_q24 = ivec2(to_q24(s.log_previous), to_q24(s.log_current));
    Walk w = begin_walk(cam, pixel, first_q24, frames_q24, p);
    if (DUMP_SAMPLES) {
        samples_out[cam.samples_base + pixel] = first_q24;
    }
    for (uint i = 1u; i <= n; ++i) {
        end_ns = next_end(each, end_ns, over);
        done += 1.0;
        float level = i == n ? s.log_current : level_of_one(cam, geo, s, n, i, done * inverse);
        if (EFFECT_FLICKER) {
            level = i == n ? lit_at_end(cam, level) : lit(cam, level, lamp_at(cam, end_ns));
        }
        const int level_q24 = to_q24(level);
        if (DUMP_SAMPLES) {
            samples_out[cam.samples_base + i * cam.pixels + pixel] = level_q24;
        }
        walk_substep(cam, pixel, end_ns, level_q24, p, w);
    }
    end_walk(cam, w, p);
    return w.exposed;
}
