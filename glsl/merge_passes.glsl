// The passes in which `merge` sorts a heavy packet: each is a dispatch, which reads the events from one of `gathered` and
// `overflow`, and writes them to the other. `sort` has left them bin by bin, in any order within a bin.
//
// Pass 0 brings events of the overflow to the places that `sort` has left free in their bins. If `sort` can sort all bins, it
// does so then. Else pass 1 sorts runs of RUN_EVENTS, and each further pass merges runs two by two, until runs are as long as
// the packet, or twice as long as its largest bin. Then a bin lies across the end of one run at most, with no more than half
// of each run. So the last pass merges the second half of each run with the first half of the next.
const uint FIRST_MERGE = 2u;

// Whether a heavy packet has bins that are too large for `sort`.
bool merge_sorts(Counters counted) {
    return counted.largest_bin > SORTABLE_EVENTS;
}

// Events of the longest runs that are merged two by two.
uint longest_run(Counters counted) {
    uint length = RUN_EVENTS;
    while (length < min(counted.packet, 2u * counted.largest_bin)) {
        length *= 2u;
    }
    return length;
}

// Passes that a heavy packet takes.
uint merge_passes(Counters counted) {
    if (!merge_sorts(counted)) {
        return 1u;
    }
    const uint longest = longest_run(counted);
    uint passes = FIRST_MERGE;
    for (uint length = RUN_EVENTS; length < longest; length *= 2u) {
        passes += 1u;
    }
    return passes + uint(longest < counted.packet);
}
