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
