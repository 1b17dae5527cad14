// Reserves buffer space for the events of a sub-tile. Needs `counters`, WALKS_AGAIN.
//
// The count of events must not wrap, or two sub-tiles would write to the same place. A rig has space for fewer than
// 2^29 events. Beyond 2^30 the exact count is of no use to the host: it only needs to know that there were too many.
const uint MOST_EMITTED = 1u << 30;

// Most events of a sub-tile that are added at once. Few sub-tiles run at once: together they add less than 2^30.
const uint FEW_EVENTS = 1u << 16;

// Adds `found` events to the emitted ones; returns how many were emitted before them.
uint reserve_events(uint counter, uint found) {
    if (WALKS_AGAIN && found > FEW_EVENTS) {
        // A sub-tile may have millions of events, so the sum saturates.
        uint before = counters[counter].emitted;
        uint expected;
        do {
            expected = before;
            const uint sum = min(expected + min(found, MOST_EMITTED), MOST_EMITTED + 1u);
            before = atomicCompSwap(counters[counter].emitted, expected, max(sum, expected));
        } while (before != expected);
        return before;
    }
    // Beyond the limit, each takes its events back.
    const uint before = atomicAdd(counters[counter].emitted, found);
    if (before > MOST_EMITTED) {
        atomicAdd(counters[counter].emitted, 0u - found);
    }
    return before;
}
