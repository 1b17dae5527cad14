// Events in a queue that all threads of the workgroup append to.

// Whether an event of the walk under way found the queue full, and which was the first.
bool is_refused;
uint refused_at_ns;
uint refused_tag;

void begin_events() {
    is_refused = false;
}

// The first walk of a sub-tile counts all events. A later one goes as far as the queue has room.
bool walks_on(uint ordinal) {
    return !WALKS_AGAIN || earlier_walks == 0u || !is_refused;
}

bool has_sent_all() {
    return !is_refused;
}

void enqueue(uint position, uint at_ns, uint tag) {
    queue_times_ns[position] = at_ns;
    queue_tags[position] = uint16_t(tag & 0xffffu);
    if (LONG_TAGS) {
        queue_tags_high[position] = uint16_t(tag >> 16);
    }
}

void emit(uint at_ns, bool on, uint ordinal) {
    const uint tag = event_tag(on, ordinal);
    if (!WALKS_AGAIN) {
        // An ordinal that does not fit a tag overflows the queue.
        const uint position = atomicAdd(queue_count, tag > 0xffffu ? QUEUE_EVENTS : 1u);
        if (position < QUEUE_EVENTS) {
            enqueue(position, at_ns, tag);
        }
    } else if (ordinal >= queued && !is_refused) {
        const uint position = atomicAdd(queue_count, 1u);
        if (position < QUEUE_EVENTS) {
            enqueue(position, at_ns, tag);
            queued = ordinal + 1u;
        } else {
            is_refused = true;
            refused_at_ns = at_ns;
            refused_tag = tag;
        }
    }
}

// Sends the event that the queue has refused in an earlier walk.
void emit_refused() {
    emit(refused_at_ns, ((refused_tag >> 7) & 1u) != 0u, refused_tag >> 8);
}

void end_events(uint count) {}

uint events_sent(uint found) {
    return WALKS_AGAIN ? min(queue_count, QUEUE_EVENTS) : found;
}

void begin_next_walk() {
    barrier();
    if (gl_LocalInvocationID.x == 0u) {
        queue_count = 0u;
    }
    barrier();
}

uint queued_time_ns(uint position, uint tag) {
    return queue_times_ns[position];
}
