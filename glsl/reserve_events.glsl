// Reserves buffer space for the events of a sub-tile. Needs `counters`, QUEUE_OVERFLOWED.
//
// The count of events must not wrap, or two sub-tiles would write to the same place. A rig has space for fewer than
// 2^29 events. Beyond 2^30 the exact count is of no use to the host: it only needs to know that there were too many.
const uint MOST_EMITTED = 1u << 30;

// Adds `found` events to the emitted ones; returns how many were emitted before them.
uint reserve_events(uint counter, uint found) {
    if (QUEUE_OVERFLOWED) {
        // A sub-tile may have millions of events, so the sum saturates.
        uint before = counters[counter].emitted;
        uint expected;
        do {
            expected = before;
            const uint sum = found > ~expected ? ~0u : expected + found;
            before = atomicCompSwap(counters[counter].emitted, expected, sum);
        } while (before != expected);
        return before;
    }
    // A sub-tile has at most QUEUE_EVENTS events, and few sub-tiles run at once: beyond the limit, each takes its
    // events back before the sum can come near 2^32.
    const uint before = atomicAdd(counters[counter].emitted, found);
    if (before > MOST_EMITTED) {
        atomicAdd(counters[counter].emitted, 0u - found);
    }
    return before;
}
