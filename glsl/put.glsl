// Where an event goes: into its bin, or where that has no more room, and if it is late, among the spilled ones. The
// caller has seen to it that all events fit. Needs bins.glsl, BRANCHES, `counters`, `bins`, `rooms`, `spilled`.

#include "together.glsl"

void put(Camera cam, uint bin, uvec2 event) {
    const uint place = atomicAdd(bins[bins_of(cam, cam.parity) + bin], 1u);
    if (bin < cam.bin_count && place < cam.bin_room) {
        rooms[cam.rooms_base + bin * cam.bin_room + place] = event;
    } else {
        uint spill;
        if (BRANCHES) {
            COUNT_TOGETHER(counters[2u * cam.slot + cam.parity].spilled, spill)
        } else {
            spill = atomicAdd(counters[2u * cam.slot + cam.parity].spilled, 1u);
        }
        spilled[cam.event_base + spill] = event;
    }
}
