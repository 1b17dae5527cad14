// Where an event goes before it is sorted: bins that keep the order of (t, y, x, polarity). A bin is
// a stretch of time, or, where event times are few, one time and a range of pixels. Needs AT_SAMPLE, BRANCHES.

#include "quotient.glsl"

uint bin_of(Camera cam, uint offset_ns, uint pixel) {
    uint step_index;
    // A GPU keeps the branch whatever the sensor is: its compiler then gives `cross` registers for more taps at once.
    if ((BRANCHES || AT_SAMPLE) && cam.bin_samples != 0u) {
        // Times are floor(i T / N) plus a constant: recover i.
        const uint64_t since_start = uint64_t(offset_ns - cam.base_to_start_ns - cam.latency_ns);
        step_index = uint((since_start * cam.bin_samples + uint64_t(cam.interval_ns - 1u)) / cam.interval_ns);
    } else {
        step_index = quotient(offset_ns, cam.bin_width);
    }
    const uint bin = step_index * cam.bin_rows + (cam.bin_rows > 1u ? quotient(pixel, cam.bin_row_px) : 0u);
    return min(bin, cam.bin_count - 1u);
}

// Staged events that are due later carry this flag beside the pixel, and wait in the bin after the last.
const uint LATE = 0x80000000u;

// Output offset from the packet's base of an event `since_start_ns` after the interval's start.
uint stamp_offset(Camera cam, uint since_start_ns) {
    const uint offset_ns = since_start_ns + cam.base_to_start_ns;
    return quotient(offset_ns, cam.timestamp_quantum_ns) * cam.timestamp_quantum_ns;
}

// First of the camera's bins of this tick: there are two sets, of which `sort` clears the other.
uint bins_of(Camera cam, uint parity) {
    return cam.bin_base + parity * (cam.bin_count + 1u);
}
