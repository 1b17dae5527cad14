// Chunks of an overloaded bus. There most events find their pixel's place taken by an event that came before the chunk; they
// are lost, whatever else the chunk has. Without them a chunk reaches further. Needs bus_services.glsl, bus_fates.glsl.

// Events that a chunk takes: their numbers in the packet.
shared uint undecided[gl_WorkGroupSize.x];

// What a round of the search has found: events so far, and the number after the last one that was looked at.
shared uint chunk_found;
shared uint chunk_end;

// Rounds of the search, so that a chunk always ends.
const uint MOST_SEARCHES = 64u;

// Whether the event of this pixel `now_ns` after the epoch is lost because of what came before the chunk. More events that
// join a waiting service make its end later only.
bool is_lost_already(uint pixel, int64_t now_ns, int64_t since_epoch_ns) {
    int64_t left_ns = bus[at_pixel(pixel)];
    if (left_ns >= WAITS) {
        const uint service = uint(bus[at_row(ROW_SERVICE, pixel / cam.width)]) - 1u;
        left_ns = since_epoch_ns + bus[at_row(ROW_END, service)] / 1000l;
    }
    return left_ns >= now_ns;
}

// Finds the chunk's events from number `first` on, before number `end`. Returns the number after the last event that is either in
// the chunk or lost; `taken`: how many are in the chunk. Called by the whole workgroup.
uint find_undecided(
    bool in_gathered, uint event_base, uint first, uint end, uint services_waiting, int64_t since_epoch_ns, out uint taken
) {
    const uint lane = gl_LocalInvocationID.x;
    for (uint service = lane; service < services_waiting; service += gl_WorkGroupSize.x) {
        bus[at_row(ROW_JOINED, service)] = 0l;
        loops += 1u;
    }
    sync();
    serve_waiting(services_waiting);
    uint found = 0u;
    uint from = first;
    uint searches = 0u;
    bool goes_on;
    do {
        const uint e = from + lane;
        bool is_undecided = false;
        if (e < end) {
            const uvec2 event = read_event(in_gathered, event_base + e);
            is_undecided = !is_lost_already(event.y >> 1, since_epoch_ns + int64_t(event.x), since_epoch_ns);
        }
        const uint place = found + uint(scan(Step(is_undecided ? 1l : 0l, NEVER)).sum) - 1u;
        if (lane == gl_WorkGroupSize.x - 1u) {
            chunk_found = place + 1u;
            chunk_end = min(from + gl_WorkGroupSize.x, end);
        }
        barrier();
        if (is_undecided && place < gl_WorkGroupSize.x) {
            undecided[place] = e;
        }
        // The first one for which there is no room begins the next chunk.
        if (is_undecided && place == gl_WorkGroupSize.x) {
            chunk_end = e;
        }
        barrier();
        found = min(chunk_found, gl_WorkGroupSize.x);
        from = chunk_end;
        searches += 1u;
        loops += 12u;
        goes_on = found < gl_WorkGroupSize.x && from < end && searches < MOST_SEARCHES;
        barrier();
    } while (goes_on);
    taken = found;
    return from;
}
