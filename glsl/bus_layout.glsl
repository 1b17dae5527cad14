// What `bus` has for each camera: a head; for each pixel the time at which its last event leaves, nanoseconds since the
// epoch, or that it waits; BUS_ROW arrays of a word for each row; and BUS_STRETCH words for each stretch of half as many
// events as a workgroup has threads. Needs `readout`.

const uint HEAD_FREE = 0u; // when the bus is free, picoseconds from the start of an interval of frame slot 0
const uint HEAD_PERIOD = 1u; // the rate controller's period
const uint HEAD_SERVED = 2u; // events served in it
const uint HEAD_SERVICES = 3u; // services that wait
const uint HEAD_NEXT = 4u; // once `readout` has begun with a packet, its next event plus 1; else 0
const uint HEAD_WAITING = 5u; // events that wait for their row
const uint HEAD_FREE_OTHER = 6u; // when the bus is free, of an interval of frame slot 1

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
