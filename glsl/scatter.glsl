// Puts an event into its bin or, where that is full or the event is deferred, into the overflow buffer. The caller
// makes sure that all events fit. Needs bins.glsl, `counters`, `bins`, `bin_storage`, `overflow` and INCREMENT(counter,
// previous), which adds one to a counter that many threads share.

void scatter(Camera cam, uint bin, uvec2 event) {
    const uint place = atomicAdd(bins[bins_of(cam, cam.frame_slot) + bin], 1u);
    if (bin < cam.bin_count && place < cam.bin_capacity) {
        bin_storage[cam.bin_storage_base + bin * cam.bin_capacity + place] = event;
    } else {
        uint overflow_index;
        INCREMENT(counters[2u * cam.slot + cam.frame_slot].overflow, overflow_index)
        overflow[cam.event_base + overflow_index] = event;
    }
}
