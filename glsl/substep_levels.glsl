// The levels of a pixel at the ends of all its sub-steps, synthesised before the walk. Included by cross.glsl.
//
// Where one pixel has an event, a walk that takes turns with the synthesis makes all pixels of its subgroup wait in that
// sub-step. With all levels at hand each goes at its own pace. Two loops also hold fewer registers than one that does
// both.

// Q7.24. Not in shared memory: there they would keep other workgroups out.
int substep_levels_q24[MAX_SUBSTEPS];

int level_of_substep(uint i) {
    return substep_levels_q24[i - 1u];
}

// Notes the level at the end of sub-step `i`, which is `end_ns`.
void note_level(Camera cam, uint pixel, uint n, uint i, uint end_ns, float steady) {
    float level = steady;
    if (EFFECT_FLICKER) {
        level = i == n ? lit_at_end(cam, level) : lit(cam, level, lamp_at(cam, end_ns));
    }
    const int level_q24 = to_q24(level);
    if (DUMP_SAMPLES) {
        samples_out[cam.samples_base + i * cam.pixels + pixel] = level_q24;
    }
    substep_levels_q24[i - 1u] = level_q24;
}

// Synthesises the levels at the ends of all `n` sub-steps.
void synthesize_all(Camera cam, Source s, uint n) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const float inverse = 1.0 / float(n);
    const Geometry geo = geometry_of(cam);
    const SubstepLength each = substep_length(cam, n);
    uint end_ns = 0u;
    uint over = 0u;
    uint i = 0u;
    if (n == 1u || shows_one(s)) {
        do {
            i += 1u;
            end_ns = next_end(each, end_ns, over);
            const float level = i == n ? s.log_current : level_of_one(cam, geo, s, n, i, float(i) * inverse);
            note_level(cam, pixel, n, i, end_ns, level);
        } while (i < n);
    } else {
        do {
            bool lost;
            do {
                i += 1u;
                end_ns = next_end(each, end_ns, over);
                const float level = level_of_many(cam, geo, s, n, i, float(i) * inverse, lost);
                note_level(cam, pixel, n, i, end_ns, level);
            } while (!lost && i + 1u < n);
            if (lost) {
                note_level(cam, pixel, n, i, end_ns, level_of_lost(cam, s, float(i) * inverse));
            }
        } while (i + 1u < n);
        note_level(cam, pixel, n, n, cam.interval_ns, s.log_current);
    }
}
