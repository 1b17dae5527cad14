// The bins that events are sorted into. They keep the order of a packet, (t, y, x, polarity): a bin is a stretch of
// time or, where event times are few, one time and a range of pixels. Needs `fast_udiv` and MAY_BIN_BY_SAMPLE: whether
// all event times may be ends of sub-steps (`bin_samples`).

// Whether all event times are ends of sub-steps, each a time step of its own.
bool bin_samples(Camera cam) {
    return cam.bin_width == 0u;
}

uint bin_of(Camera cam, uint offset_ns, uint pixel) {
    uint step_index;
    if (MAY_BIN_BY_SAMPLE && bin_samples(cam)) {
        // Times are floor(i T / N) plus a constant: recover i.
        const uint64_t since_start = uint64_t(offset_ns - cam.base_to_start_ns - cam.latency_ns);
        step_index = uint((since_start * cam.substeps + uint64_t(cam.interval_ns - 1u)) / cam.interval_ns);
    } else {
        step_index = fast_udiv(offset_ns, cam.bin_width);
    }
    const uint bin = step_index * cam.bin_rows + (cam.bin_rows > 1u ? fast_udiv(pixel, cam.bin_row_px) : 0u);
    return min(bin, cam.bin_count - 1u);
}

// Flag beside an event's pixel: the event is due in a later packet. Such events are counted in the bin after the last.
const uint DEFERRED = 0x80000000u;

// Time stamp of an event `since_start_ns` after the interval's start, as an offset from the packet's base. Where the quantum
// has become coarser, floored time could lie at or before that up to which the packet before is complete.
uint stamp_offset(Camera cam, uint since_start_ns) {
    const uint offset_ns = since_start_ns + cam.base_to_start_ns;
    return max(fast_udiv(offset_ns, cam.timestamp_quantum_ns) * cam.timestamp_quantum_ns, cam.first_stamp_ns);
}

// For each of the camera's bins, where the next event of a heavy packet belongs: `sort` leaves room there for those of the
// overflow, and `merge` fills it.
uint room_of(Camera cam) {
    return cam.bin_base + 2u * (cam.bin_count + 1u);
}

// Chunks of SUMMED_BINS of the camera's bins, and where `bin_sums` writes their sums and largest bins, one after the other.
uint chunks_of(Camera cam) {
    return (cam.bin_count + SUMMED_BINS - 1u) / SUMMED_BINS;
}

uint sums_of(Camera cam) {
    return room_of(cam) + cam.bin_count;
}

// Where the list of crowded sub-tiles lies in `bins`: those that the second run of `cross` walks.
uint crowded_of(Camera cam) {
    return sums_of(cam) + 2u * chunks_of(cam);
}

// First of the camera's bins of a frame slot. There are two sets; `sort` clears the one of the next tick.
uint bins_of(Camera cam, uint frame_slot) {
    return cam.bin_base + frame_slot * (cam.bin_count + 1u);
}
