// Twin of the model crate's `substeps`.

uint substep_count(Camera cam, float motion_px, float change_log) {
    if (cam.substeps_fixed != 0u) {
        return cam.substeps;
    }
    const float for_motion = ceil(motion_px * (1.0 / SUBSTEP_MOTION_PX));
    const float for_change =
        ceil(sqrt(change_log * float(cam.interval_ns) * (1.0 / (8.0 * SUBSTEP_TIME_ERROR_NS))));
    return uint(clamp(max(for_motion, for_change), 1.0, float(cam.substeps)));
}

// An interval cut into n.
struct Substeps {
    uint n;
    float inverse;
    uint quotient;
    uint rest;
};

Substeps cut_interval(uint interval_ns, uint n) {
    const uint quotient = interval_ns / n;
    return Substeps(n, 1.0 / float(n), quotient, interval_ns - quotient * n);
}

// floor(i T / n) without leaving 32 bits. rest * i is below 2^12, where (k + 1/2) / n floors as k / n does.
uint substep_end_ns(Substeps cut, uint i) {
    return cut.quotient * i + uint((float(cut.rest * i) + 0.5) * cut.inverse);
}
