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

// Synthesises the levels at the ends of all `n` sub-steps.
void synthesize_all(Camera cam, Source s, uint n) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const float inverse = 1.0 / float(n);
    const Geometry geo = geometry_of(cam);
    const SubstepLength each = substep_length(cam, n);
    uint end_ns = 0u;
    uint over = 0u;
    uint i = 0u;
    do {
        i += 1u;
        float level = i == n ? s.log_current : synthesize_substep(cam, geo, s, n, i, float(i) * inverse);
        if (EFFECT_FLICKER) {
            end_ns = next_end(each, end_ns, over);
            level = i == n ? lit_at_end(cam, level) : lit(cam, level, lamp_at(cam, end_ns));
        }
        const int level_q24 = to_q24(level);
        if (DUMP_SAMPLES) {
            samples_out[cam.samples_base + i * cam.pixels + pixel] = level_q24;
        }
        substep_levels_q24[i - 1u] = level_q24;
    } while (i < n);
}
