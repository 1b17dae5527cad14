// What `bus` has for each camera: a head; for each pixel the time at which its last event leaves, nanoseconds since the epoch, or
// that it waits; seven arrays of a word for each row; two words for each group of bins; and two for each stretch of half as
// many events as a workgroup has threads. Needs `readout`.

const uint HEAD_FREE = 0u; // when the bus is free, picoseconds from the start of an interval of frame slot 0
const uint HEAD_PERIOD = 1u; // the rate controller's period
const uint HEAD_SERVED = 2u; // events served in it
const uint HEAD_SERVICES = 3u; // services that wait
const uint HEAD_NEXT = 4u; // the packet's next event
const uint HEAD_WAITING = 5u; // events that wait for their row
const uint HEAD_FREE_OTHER = 6u; // when the bus is free, of an interval of frame slot 1
const uint HEAD_CARRIED = 7u; // events of the last tick that leave later
const uint HEAD_CARRIED_PLACE = 8u; // where they lie, among the outlet's gathered events

uint at_head(uint word) {
    return readout.bus_base + word;
}

// When the bus is free before the intervals of a frame slot. A tick that has to begin again finds what it began with.
uint at_free(uint frame_slot) {
    return at_head(frame_slot == 0u ? HEAD_FREE : HEAD_FREE_OTHER);
}

uint at_pixel(uint pixel) {
    return readout.bus_base + BUS_HEAD + pixel;
}

// Of a group of bins: when a bus that loses nothing and reads no two events together is free after it, if it was idle before; and
// how many events of the packet come before the next group.
uint at_group(Camera cam, uint group) {
    return readout.bus_base + BUS_HEAD + cam.pixels + BUS_ROW * cam.height + 2u * group;
}

// Of a group without events.
const int64_t NO_LOAD = -(1l << 62);
