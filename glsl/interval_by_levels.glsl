// A pixel's interval in two loops: the levels at the ends of all sub-steps first, then the walk over them. Included by
// cross.glsl.
//
// Where one pixel has an event, a walk that takes turns with the synthesis makes all pixels of its subgroup wait in that
// sub-step. Here each goes at its own pace. Two loops also hold fewer registers than one that does both.

// Levels at the ends of the sub-steps, Q7.24. Not in shared memory: there they would keep other workgroups out.
int substep_levels_q24[MAX_SUBSTEPS];

int level_of_substep(uint i) {
    return substep_levels_q24[i - 1u];
}

// Synthesises the levels at the ends of all `n` sub-steps.
void synthesize_all(Camera cam, Source s, uint n) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const float inverse = 1.0 / float(n);
    const Geometry geo = geometry_of(cam);
    uint end_ns = 0u;
    uint over = 0u;
    uint i = 0u;
    do {
        i += 1u;
        float level = i == n ? s.log_current : synthesize_substep(cam, geo, s, n, i, float(i) * inverse);
        if (EFFECT_FLICKER) {
            end_ns = next_end(cam, n, end_ns, over);
            level = i == n ? lit_at_end(cam, level) : lit(cam, level, lamp_at(cam, end_ns));
        }
        const int level_q24 = to_q24(level);
        if (DUMP_SAMPLES) {
            samples_out[cam.samples_base + i * cam.pixels + pixel] = level_q24;
        }
        substep_levels_q24[i - 1u] = level_q24;
    } while (i < n);
}

// Synthesises and walks a pixel's interval; returns its exposure.
float cross_interval(Camera cam, Source s, bool active_pixel, uint n, inout PixelState p) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const int first_q24 = to_q24(lit_at_start(cam, s.log_previous));
    if (DUMP_SAMPLES) {
        samples_out[cam.samples_base + pixel] = first_q24;
    }
    if (PASSES_STILL && PASSES_IN_WALK && n == 1u && active_pixel && to_q24(s.log_current) == first_q24
        && pass_interval(cam, pixel, first_q24, p)) {
        return 0.0;
    }
    synthesize_all(cam, s, n);
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
