// Events in a queue that all threads of the workgroup append to.

bool walks_on(uint ordinal) {
    return true;
}

void emit(uint at_ns, bool on, uint ordinal) {
    const uint tag = event_tag(on, ordinal);
    if (QUEUE_OVERFLOWED) {
        count_or_scatter(at_ns, tag);
        return;
    }
    // A tag has 16 bits: an ordinal that does not fit overflows the queue.
    const uint position = atomicAdd(queue_count, tag > 0xffffu ? QUEUE_EVENTS : 1u);
    if (position < QUEUE_EVENTS) {
        queue_times_ns[position] = at_ns;
        queue_tags[position] = uint16_t(tag);
    }
}

void begin_events() {}

void end_events(uint count) {}

uint queued_time_ns(uint position, uint tag) {
    return queue_times_ns[position];
}
