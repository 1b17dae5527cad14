// The queue of a sub-tile's events, and the scatter from it into bins. Needs bins.glsl and scatter.glsl.
//
// Events wait in shared memory, so that all threads stamp and scatter them together. Shared memory limits occupancy, so
// the queue is only as long as earlier intervals needed it. A sub-tile with more events is left to a permutation
// WALKS_AGAIN. That one walks it as often as it takes: each walk sends events that those before have not sent.

const uint QUEUE_EVENTS = QUEUE_PER_PX * CROSS_THREADS;

// Where a sub-tile may be walked again, a pixel may have more events than a tag of 16 bits can number. Numbers matter for
// delays only.
const bool LONG_TAGS = WALKS_AGAIN && EFFECT_DELAY;

// Time offset from the interval's start, and packed tag (see `event_tag`).
shared uint queue_times_ns[QUEUE_EVENTS];
shared uint16_t queue_tags[QUEUE_EVENTS];
shared uint16_t queue_tags_high[LONG_TAGS ? QUEUE_EVENTS : 1];
// Events that asked for a place; all events of the sub-tile, where it may be walked again.
shared uint queue_count;
shared uint queue_found;
shared uint queue_base;

// Events of this thread's pixel that were sent or wait in the queue: the first ones.
uint queued;

// Thread of the pixel, polarity << 7, ordinal in the interval << 8.
uint event_tag(bool on, uint ordinal) {
    return gl_LocalInvocationID.x | (uint(on) << 7) | (ordinal << 8);
}

// Stamps an event and scatters it to its bin.
void stamp_and_scatter(Camera cam, uint at_ns, uint tag) {
    const uint in_sub_tile = place_of(tag & 127u);
    const uint pixel = (corner.y + in_sub_tile / TILE_WIDTH_PX) * cam.width + corner.x + in_sub_tile % TILE_WIDTH_PX;
    uint since_start_ns = at_ns;
    if (EFFECT_DELAY) {
        int delay_ns = int(cam.latency_ns);
        if (cam.latency_jitter_ns != 0u) {
            // The state counts the events of earlier intervals only: it is stored after this interval's are scattered.
            const uint index = load_state(cam, pixel, STATE_EVENTS) + (tag >> 8);
            delay_ns += jitter_ns(draw(cam, pixel, STREAM_JITTER, index), cam.latency_jitter_ns);
        }
        since_start_ns += uint(max(delay_ns, 0));
    }
    uvec2 event = uvec2(since_start_ns, (pixel << 1) | ((tag >> 7) & 1u));
    uint bin = cam.bin_count;
    if (since_start_ns > cam.interval_ns) {
        event.y |= DEFERRED;
    } else {
        event.x = stamp_offset(cam, since_start_ns);
        bin = bin_of(cam, event.x, pixel);
    }
    scatter(cam, bin, event);
}

void begin_queue() {
    queue_count = 0u;
    queue_found = 0u;
}
