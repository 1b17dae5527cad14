// A pixel's interval, sub-step by sub-step: each is synthesised and walked at once. Included by cross.glsl.

// Synthesises and walks a pixel's interval; returns its exposure.
float cross_interval(Camera cam, Source s, bool active_pixel, uint n, inout PixelState p) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const int first_q24 = to_q24(lit_at_start(cam, s.log_previous));
    if (!active_pixel) {
        silence(p, first_q24);
    }
    // Sub-step i ends at floor(i T / n): whole nanoseconds, and a remainder. Both are summed, exact in 32 bits.
    const uint whole_ns = cam.interval_ns / n;
    const uint rest_ns = cam.interval_ns - whole_ns * n;
    const float inverse = 1.0 / float(n);
    uint end_ns = 0u;
    uint over = 0u;
    float done = 0.0;
    const Geometry geo = geometry_of(cam);
    // Shot noise follows the steady light.
    const ivec2 frames_q24 = ivec2(to_q24(s.log_previous), to_q24(s.log_current));
    Walk w = begin_walk(cam, pixel, first_q24, frames_q24, whole_ns, p);
    if (DUMP_SAMPLES) {
        samples_out[cam.samples_base + pixel] = first_q24;
    }
    uint i = 1u;
    do {
        while (i <= n && !needs_draw()) {
            if (!is_suspended()) {
                end_ns += whole_ns;
                over += rest_ns;
                if (over >= n) {
                    over -= n;
                    end_ns += 1u;
                }
                done += 1.0;
            }
            float level = i == n ? s.log_current : synthesize_substep(cam, geo, s, n, i, done * inverse);
            if (EFFECT_FLICKER) {
                level = i == n ? lit_at_end(cam, level) : lit(cam, level, lamp_at(cam, end_ns));
            }
            const int level_q24 = to_q24(level);
            if (DUMP_SAMPLES) {
                samples_out[cam.samples_base + i * cam.pixels + pixel] = level_q24;
            }
            walk_substep(cam, pixel, end_ns, level_q24, p, w);
            if (!is_suspended()) {
                i += 1u;
            }
        }
        if (needs_draw()) {
            make_draw(cam, pixel, p, w);
        }
    } while (WALKS_SUSPEND && i <= n);
    end_walk(cam, w, p);
    return w.exposed;
}
