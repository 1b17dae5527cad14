// What becomes of a chunk's events, given when services end: which are lost, and which service each of the others has.
// Needs bus_services.glsl.

// The chunk's events, in the packet's order.
shared uint times_ns[gl_WorkGroupSize.x];
shared uint pixels[gl_WorkGroupSize.x];

// When the bus is free after the services up to each event's.
shared int64_t ends[gl_WorkGroupSize.x];

// An event's service: the event that has opened it, one that waited before the chunk, or none since it is lost.
const uint WAITED = 0xfffffffeu;
const uint LOST = 0xffffffffu;
shared uint services[gl_WorkGroupSize.x];

// Events of a service, at the event that has opened it.
shared uint members[gl_WorkGroupSize.x];

// The event before of the same pixel; the event before and after of the same row.
const uint NONE = 0xffffffffu;
shared uint before_at_pixel[gl_WorkGroupSize.x];
shared uint after_in_row[gl_WorkGroupSize.x];

// What the bus told of each event's pixel before the chunk.
shared int64_t told[gl_WorkGroupSize.x];

// Hash table of events: heads of chains.
shared uint chain_heads[gl_WorkGroupSize.x];
shared uint chain_next[gl_WorkGroupSize.x];

shared bool changed;

// The last event before this thread's of the same pixel or (`by_row`) row; NONE if there is none. Called by the whole
// workgroup after a barrier; ends with one.
uint find_before(bool is_event, bool by_row) {
    const uint lane = gl_LocalInvocationID.x;
    chain_heads[lane] = NONE;
    barrier();
    const uint key = by_row ? pixels[lane] / cam.width : pixels[lane];
    const uint slot = ((key * 2654435761u) >> 8u) % gl_WorkGroupSize.x;
    if (is_event) {
        chain_next[lane] = atomicExchange(chain_heads[slot], lane);
    }
    barrier();
    uint found = NONE;
    if (is_event && by_row && lane > 0u && pixels[lane - 1u] / cam.width == key) {
        // Where many events have one time, those of a row are neighbours, and a chain of them would be long.
        found = lane - 1u;
    } else if (is_event) {
        for (uint other = chain_heads[slot]; other != NONE; other = chain_next[other]) {
            const bool same = by_row ? pixels[other] / cam.width == key : pixels[other] == key;
            if (same && other < lane && (found == NONE || other > found)) {
                found = other;
            }
            loops += 1u;
        }
    }
    barrier();
    return found;
}

// Whether the event's pixel has another on its way. `since_epoch_ns`: the interval's start.
bool is_taken(uint event, int64_t since_epoch_ns) {
    const int64_t now_ns = since_epoch_ns + int64_t(times_ns[event]);
    uint before = before_at_pixel[event];
    while (before != NONE && services[before] == LOST) {
        before = before_at_pixel[before];
        loops += 1u;
    }
    int64_t left_ps;
    if (before != NONE && services[before] != WAITED) {
        left_ps = ends[services[before]];
    } else if (before == NONE && told[event] < WAITS) {
        return told[event] >= now_ns;
    } else {
        const uint row = pixels[event] / cam.width;
        left_ps = bus[at_row(ROW_END, uint(bus[at_row(ROW_SERVICE, row)]) - 1u)];
    }
    return since_epoch_ns + left_ps / 1000l >= now_ns;
}

void set_service(uint event, uint service) {
    if (services[event] != service) {
        services[event] = service;
        changed = true;
    }
}

// Decides about the events of a row, from its first in the chunk on. An event joins the row's service that is the last
// so far if it comes no later than that begins; else it opens another. `free`: when the bus is free before the chunk's
// services.
void decide_row(uint first, int64_t since_epoch_ns, int64_t free) {
    const uint row = pixels[first] / cam.width;
    const uint waiting = SIDE_BY_SIDE ? 0u : uint(bus[at_row(ROW_SERVICE, row)]);
    uint service = NONE;
    int64_t begin_ps = 0l;
    uint joined = 0u;
    if (waiting != 0u) {
        service = WAITED;
        begin_ps = bus[at_row(ROW_BEGIN, waiting - 1u)];
    }
    for (uint event = first; event != NONE; event = after_in_row[event]) {
        loops += 1u;
        if (is_taken(event, since_epoch_ns)) {
            set_service(event, LOST);
            continue;
        }
        const int64_t now_ps = int64_t(times_ns[event]) * 1000l;
        if (service == NONE || now_ps > begin_ps) {
            if (service == WAITED) {
                bus[at_row(ROW_JOINED, waiting - 1u)] = int64_t(joined);
            } else if (service != NONE) {
                members[service] = joined;
            }
            service = event;
            begin_ps = max(now_ps, event == 0u ? free : ends[event - 1u]);
            joined = 0u;
        }
        joined += 1u;
        set_service(event, service);
    }
    if (service == WAITED) {
        bus[at_row(ROW_JOINED, waiting - 1u)] = int64_t(joined);
    } else if (service != NONE) {
        members[service] = joined;
    }
}
