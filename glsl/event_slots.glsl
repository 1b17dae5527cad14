// Events in slots of their pixel, for the software driver. There each instruction costs every pixel, whether it has an
// event or not. So an event only puts its time and polarity in a slot, and the queue's tags are written when the walk is over.
// Where a sub-tile may be walked again, the queue stays empty: the first walk counts the events, a second one scatters them
// one by one.

// Slots per pixel. A pixel with more events overflows the queue, and its walk need not go on.
const uint PIXEL_SLOTS = QUEUE_EVENTS / gl_WorkGroupSize.x;

// In a slot, above the time: set for ON. An interval has less than 2^31 nanoseconds.
const uint ON = 0x80000000u;

bool walks_on(uint ordinal) {
    return WALKS_AGAIN || ordinal <= PIXEL_SLOTS;
}

// Slot of a pixel of the sub-tile.
uint slot_of(uint in_sub_tile, uint ordinal) {
    return min(ordinal, PIXEL_SLOTS - 1u) * gl_WorkGroupSize.x + in_sub_tile;
}

void emit(uint at_ns, bool on, uint ordinal) {
    if (WALKS_AGAIN) {
        if (earlier_walks != 0u) {
            stamp_and_scatter(cameras[push.first_camera + gl_WorkGroupID.y], at_ns, event_tag(on, ordinal));
        }
        return;
    }
    queue_times_ns[slot_of(gl_LocalInvocationID.x, ordinal)] = on ? at_ns | ON : at_ns;
}

void begin_events() {}

// Slots refuse no event: a pixel with more than it has slots for is walked again.
void emit_refused() {}

// Appends the `count` events in the pixel's slots to the queue.
void end_events(uint count) {
    if (WALKS_AGAIN) {
        return;
    }
    const uint position = atomicAdd(queue_count, count > PIXEL_SLOTS ? QUEUE_EVENTS + 1u : count);
    if (count == 0u || position >= QUEUE_EVENTS) {
        return;
    }
    const uint last = min(count, QUEUE_EVENTS - position);
    uint ordinal = 0u;
    do {
        const bool on = queue_times_ns[slot_of(gl_LocalInvocationID.x, ordinal)] >= ON;
        queue_tags[position + ordinal] = uint16_t(event_tag(on, ordinal));
        ordinal += 1u;
    } while (ordinal < last);
}

bool has_sent_all() {
    return earlier_walks != 0u;
}

uint events_sent(uint found) {
    return WALKS_AGAIN && earlier_walks == 0u ? 0u : found;
}

void begin_next_walk() {}

uint queued_time_ns(uint position, uint tag) {
    return queue_times_ns[slot_of(tag & 127u, tag >> 8)] & ~ON;
}
