// Twin of the model crate's `substeps`. Needs optics.glsl.

uint substep_count(Camera cam, float motion_px, float change_log) {
    if (cam.substeps_fixed != 0u) {
        return cam.substeps;
    }
    const float for_motion = ceil(motion_px * (1.0 / SUBSTEP_MOTION_PX));
    const float for_change =
        ceil(sqrt(change_log * float(cam.interval_ns) * (1.0 / (8.0 * SUBSTEP_TIME_ERROR_NS))));
    const float least = EFFECT_FLICKER ? float(optics[cam.slot].least_substeps) : 1.0;
    return uint(clamp(max(for_motion, for_change), least, float(cam.substeps)));
}
