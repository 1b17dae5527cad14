// Rest of the log-intensity pixel in still light: see resting.glsl.

// A level this near to a threshold may reach it without light's doing: a level that is synthesised between two equal
// frames is theirs up to rounding.
const int NEAR_THRESHOLD_Q24 = 4096;

// What floats may err in the time of an event; and what roundings of the hazard of MOST_INTERVALS intervals may add up to.
const float EARLIER = 0.9995;
const uint HAZARD_ROUNDING_Q27 = 256u;

// Leak until a time, modulo 2^32; intervals fall by differences of it.
uint leaked_q24(uint leak, uint64_t since_epoch_ns) {
    return uint(((uint64_t(leak) * since_epoch_ns) >> 32) & uint64_t(0xffffffffu));
}

void pass_intervals(Camera cam, uvec2 counts, uvec2 lengths_ns, int level, inout PixelState p) {
    if (EFFECT_LEAK) {
        const uint64_t end_ns = uint64_t(cam.start_ns - cam.epoch_ns);
        const uint64_t rest_ns =
            uint64_t(counts.x) * uint64_t(lengths_ns.x) + uint64_t(counts.y) * uint64_t(lengths_ns.y);
        p.reference -= int(leaked_q24(p.leak, end_ns) - leaked_q24(p.leak, end_ns - rest_ns));
    }
    if (EFFECT_SHOT) {
        const float hazard_per_ns = hazard_in(cam, ivec2(level));
        const uint spent = counts.x * hazard_of_interval(hazard_per_ns, lengths_ns.x)
            + counts.y * hazard_of_interval(hazard_per_ns, lengths_ns.y);
        p.shot_off -= spent;
        p.shot_on -= spent;
    }
}

uint rest_units(Camera cam, PixelState p, int level) {
    const int to_on = p.on_q24 - (level - p.reference);
    const int to_off = p.off_q24 - (p.reference - level);
    const bool held = EFFECT_REFRACTORY && p.held_until_ns != NOT_HELD;
    if (held || min(to_on, to_off) < NEAR_THRESHOLD_Q24) {
        return 0u;
    }
    float rest_ns = 1e30;
    if (EFFECT_LEAK && p.leak != 0u) {
        rest_ns = float(to_on - NEAR_THRESHOLD_Q24) * (4294967296.0 / float(p.leak));
    }
    if (EFFECT_SHOT) {
        const uint hazard = min(p.shot_off, p.shot_on);
        rest_ns = min(rest_ns, float(hazard - min(hazard, HAZARD_ROUNDING_Q27)) / hazard_in(cam, ivec2(level)));
    }
    return uint(min(rest_ns * (EARLIER / float(1 << REST_BITS)), LONGEST_REST));
}
