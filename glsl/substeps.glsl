// Twin of the model crate's `substeps`. Needs optics.glsl.

// Sub-steps of a change, not rounded.
float for_change(Camera cam, float change_log) {
    return sqrt(change_log * float(cam.interval_ns) * (1.0 / (8.0 * SUBSTEP_TIME_ERROR_NS)));
}

uint substep_count(Camera cam, float motion_px, float change_log) {
    if (cam.substeps_fixed != 0u) {
        return cam.substeps;
    }
    const float for_motion = ceil(motion_px * (1.0 / SUBSTEP_MOTION_PX));
    const float least = EFFECT_FLICKER ? float(optics[cam.slot].least_substeps) : 1.0;
    return uint(clamp(max(for_motion, ceil(for_change(cam, change_log))), least, float(cam.substeps)));
}

// The length of each of `count` sub-steps: whole nanoseconds, and what is left, in units of 1 / count.
struct SubstepLength {
    uint count;
    uint whole_ns;
    uint rest;
};

SubstepLength substep_length(Camera cam, uint count) {
    const uint whole_ns = cam.interval_ns / count;
    return SubstepLength(count, whole_ns, cam.interval_ns - whole_ns * count);
}

// The end of the sub-step after the one that ends at `end_ns`: the i-th of n ends at floor(i T / n). `over` is what is left of
// a nanosecond there, in units of 1 / n. Both are sums, exact in 32 bits.
uint next_end(SubstepLength each, uint end_ns, inout uint over) {
    over += each.rest;
    const bool carries = over >= each.count;
    over -= carries ? each.count : 0u;
    return end_ns + each.whole_ns + (carries ? 1u : 0u);
}

// By error: how far a level may be off between two sub-steps that rises by `slope_log` in an interval.
float allowed_error(Camera cam, float slope_log) {
    const float level_error_log =
        (SUBSTEP_LEVEL_ERROR / LOG_SCALE) * float(min(cam.contrast_on_q24, cam.contrast_off_q24));
    return max(slope_log * optics[cam.slot].substep_error_share, level_error_log);
}

// The same as motion, pixels, for a level that bends by `bend_log`.
float needed_for_bend(Camera cam, float bend_log, float slope_log) {
    return SUBSTEP_MOTION_PX * sqrt(bend_log / (8.0 * allowed_error(cam, slope_log)));
}

// Most motion that speed and change give a block, pixels.
float most_needed(Camera cam, float motion_px, float change_log) {
    return max(motion_px, SUBSTEP_MOTION_PX * for_change(cam, change_log));
}

// ---- Along exact paths ----

// The texture of a block in `blocks`: of the largest slope and the largest bend the upper half of the bits, and
// HAS_TEXTURE in place of the sign. 0 where sub-steps are by speed.
const uint HAS_TEXTURE = 0x80000000u;

uint texture_word(float bend_log_px2, float slope_log_px) {
    return HAS_TEXTURE | (floatBitsToUint(slope_log_px) & 0xffff0000u) | (floatBitsToUint(bend_log_px2) >> 16);
}

// Motion as a texture needs it that moves on a way of `way_px` with a bend of `way_bend_px`.
float needed_on_way(Camera cam, uint of_texture, float way_px, float way_bend_px) {
    const float bend_log_px2 = uintBitsToFloat(of_texture << 16);
    const float slope_log_px = uintBitsToFloat(of_texture & 0x7fff0000u);
    return needed_for_bend(
        cam, fma(bend_log_px2 * way_px, way_px, slope_log_px * way_bend_px), slope_log_px * way_px);
}

// Motion of a block by error, of which its textures need `needed_px`.
float motion_on_way(Camera cam, float way_px, float needed_px, float change_log) {
    return way_px > 0.0 ? min(max(needed_px, LEAST_NEEDED_PX), most_needed(cam, way_px, change_log)) : way_px;
}
