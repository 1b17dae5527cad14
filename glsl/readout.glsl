// Readout of a chunk of events, for kernels that take chunks one after the other (`readout`) or side by side
// (`readout_apart`). Needs SIDE_BY_SIDE: whether the bus is idle before and after the chunk, so that nothing is left of
// other chunks, and nothing of this one.
#include "subgroup_atomic.glsl"
#include "readouts.glsl"

layout(local_size_x = READOUT_THREADS, local_size_x_id = THREADS_ID) in;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_BINS, uint, bins);
BUFFER(writeonly, SLOT_BIN_STORAGE, uvec2, bin_storage);
BUFFER(, SLOT_OVERFLOW, uvec2, overflow);
BUFFER(readonly, SLOT_GATHERED, uvec2, gathered);
BUFFER(coherent, SLOT_BUS, int64_t, bus);

const bool MAY_BIN_BY_SAMPLE = false;

Readout readout;
// The outlet.
Camera cam;
// When the bus is free, picoseconds from the interval's start.
int64_t free_ps;
// Rounds of loops so far.
uint loops;

#include "udiv_native.glsl"
#include "bins.glsl"
#include "scatter.glsl"
#include "bus_scan.glsl"
#include "bus_services.glsl"
#include "bus_fates.glsl"
#include "rate_controller.glsl"
#include "merge_passes.glsl"

// Whether a later event of the same pixel has been served too.
shared bool superseded[gl_WorkGroupSize.x];

shared uint count_lost;
shared uint count_capped;
shared uint count_waiting;
shared uint most_loops;

// Services that have their turn: of those that waited before, and the last one of the chunk's, plus 1.
shared uint waited_served;
shared uint last_served;

// Sends an event that leaves at `left_ps`, or drops it.
void send(uint tag, int64_t left_ps, bool capped) {
    if (capped) {
        atomicAdd(count_capped, 1u);
        return;
    }
    const uint left_ns = uint(left_ps / 1000l);
    uvec2 event = uvec2(left_ns, tag | DEFERRED);
    uint bin = cam.bin_count;
    if (left_ns <= cam.interval_ns) {
        event = uvec2(stamp_offset(cam, left_ns), tag);
        bin = bin_of(cam, event.x, tag >> 1);
    }
    scatter(cam, bin, event);
}

// Sends the events of the first services of those that waited, and frees their pixels.
void send_waited(uint waited, int64_t since_epoch_ns) {
    for (uint service = 0u; service < waited; ++service) {
        const int64_t events = bus[at_row(ROW_EVENTS, service)];
        const uint row = uint(events);
        const int64_t end_ps = bus[at_row(ROW_END, service)];
        const uint before = service == 0u ? 0u : uint(bus[at_row(ROW_SERVED, service - 1u)]);
        const bool capped = is_capped(end_ps, before, waited);
        for (uint x = gl_LocalInvocationID.x; x < cam.width; x += gl_WorkGroupSize.x) {
            const uint pixel = row * cam.width + x;
            const int64_t waits = bus[at_pixel(pixel)];
            if (waits >= WAITS) {
                send((pixel << 1) | uint(waits - WAITS), end_ps, capped);
                bus[at_pixel(pixel)] = since_epoch_ns + end_ps / 1000l;
            }
            loops += 1u;
        }
        loops += 1u;
    }
}

// Counts the events of services that have their turn, for the rate controller.
void count_served(uint services_waiting, uint waited, bool opens_served) {
    uint base = 0u;
    for (uint first = 0u; first < waited; first += gl_WorkGroupSize.x) {
        const uint service = first + gl_LocalInvocationID.x;
        int64_t events = 0l;
        if (service < waited) {
            events = (bus[at_row(ROW_EVENTS, service)] >> 32) + bus[at_row(ROW_JOINED, service)];
        }
        const int64_t sum = scan(Step(events, NEVER)).sum + int64_t(base);
        if (service < waited) {
            bus[at_row(ROW_SERVED, service)] = sum;
        }
        if (gl_LocalInvocationID.x == gl_WorkGroupSize.x - 1u) {
            last_end = sum;
        }
        sync();
        base = uint(last_end);
        sync();
        loops += 12u;
    }
    const uint lane = gl_LocalInvocationID.x;
    served[lane] = base + uint(scan(Step(opens_served ? int64_t(members[lane]) : 0l, NEVER)).sum);
    sync();
}

// Keeps the services that have not had their turn: those that waited and the chunk's. Returns how many there are.
uint keep_waiting(uint services_waiting, uint waited, bool opens_waiting) {
    const uint lane = gl_LocalInvocationID.x;
    for (uint first = 0u; first < services_waiting; first += gl_WorkGroupSize.x) {
        const uint service = first + lane;
        int64_t opener = 0l;
        int64_t events = 0l;
        if (service < services_waiting) {
            opener = bus[at_row(ROW_OPENER, service)];
            events = bus[at_row(ROW_EVENTS, service)] + (bus[at_row(ROW_JOINED, service)] << 32);
        }
        sync();
        if (service < services_waiting) {
            const bool waits = service >= waited;
            bus[at_row(ROW_SERVICE, uint(events))] = waits ? int64_t(service - waited + 1u) : 0l;
            if (waits) {
                bus[at_row(ROW_OPENER, service - waited)] = opener;
                bus[at_row(ROW_EVENTS, service - waited)] = events;
            }
        }
        sync();
        loops += 1u;
    }
    const uint kept = services_waiting - waited;
    const int64_t rank = scan(Step(opens_waiting ? 1l : 0l, NEVER)).sum;
    if (opens_waiting) {
        const uint service = kept + uint(rank) - 1u;
        const uint row = pixels[lane] / cam.width;
        bus[at_row(ROW_OPENER, service)] = int64_t(times_ns[lane]);
        bus[at_row(ROW_EVENTS, service)] = int64_t(row) | (int64_t(members[lane]) << 32);
        bus[at_row(ROW_SERVICE, row)] = int64_t(service) + 1l;
    }
    if (lane == gl_WorkGroupSize.x - 1u) {
        last_end = rank;
    }
    sync();
    return kept + uint(last_end);
}

// Serves one chunk. `next_ns`: when the next one begins, if there is one. Returns how many services wait.
uint serve_chunk(uvec2 event, bool is_event, uint services_waiting, int64_t since_epoch_ns, bool is_last, uint next_ns) {
    const uint lane = gl_LocalInvocationID.x;
    const bool by_row = readout.row_ps != 0ul;
    const uint pixel = event.y >> 1;
    times_ns[lane] = event.x;
    pixels[lane] = pixel;
    told[lane] = is_event && !SIDE_BY_SIDE ? bus[at_pixel(pixel)] : 0l;
    superseded[lane] = false;
    ends[lane] = free_ps;
    members[lane] = 1u;
    after_in_row[lane] = NONE;
    barrier();
    const uint before = find_before(is_event, false);
    before_at_pixel[lane] = before;
    services[lane] = is_event ? lane : LOST;
    bool first_in_row = false;
    if (by_row) {
        const uint before_in_row = find_before(is_event, true);
        first_in_row = is_event && before_in_row == NONE;
        if (before_in_row != NONE) {
            after_in_row[before_in_row] = lane;
        }
        for (uint service = lane; service < services_waiting; service += gl_WorkGroupSize.x) {
            bus[at_row(ROW_JOINED, service)] = 0l;
            loops += 1u;
        }
    }
    bool again;
    int64_t end_ps;
    do {
        sync();
        const int64_t free = serve_waiting(services_waiting);
        const bool opens = services[lane] == lane;
        Step own = Step(0l, NEVER);
        if (opens) {
            own.sum = service_ps(members[lane]);
            own.latest = int64_t(event.x) * 1000l + own.sum;
        }
        own = scan(own);
        end_ps = max(free + own.sum, own.latest);
        ends[lane] = end_ps;
        changed = false;
        sync();
        if (by_row) {
            if (first_in_row) {
                decide_row(lane, since_epoch_ns, free);
            }
        } else {
            const uint service = is_event && !is_taken(lane, since_epoch_ns) ? lane : LOST;
            barrier();
            set_service(lane, service);
        }
        sync();
        again = changed;
        loops += 12u;
    } while (again);

    // A service has its turn if it begins before any further event can join it: in the next interval that is its first
    // nanosecond.
    const int64_t until_ps = SIDE_BY_SIDE ? -NEVER
        : is_last                         ? int64_t(cam.interval_ns) * 1000l + 999l
                                          : int64_t(next_ns) * 1000l - 1l;
    const uint own_service = services[lane];
    const bool opens = own_service == lane;
    const bool turn = opens && (!by_row || end_ps - service_ps(members[lane]) <= until_ps);
    waited_served = 0u;
    last_served = 0u;
    sync();
    for (uint service = lane; service < services_waiting; service += gl_WorkGroupSize.x) {
        if (bus[at_row(ROW_BEGIN, service)] <= until_ps) {
            atomicMax(waited_served, service + 1u);
        }
        loops += 1u;
    }
    if (turn) {
        atomicMax(last_served, lane + 1u);
    }
    if (own_service != LOST && before != NONE) {
        uint earlier = before;
        while (earlier != NONE && services[earlier] == LOST) {
            earlier = before_at_pixel[earlier];
            loops += 1u;
        }
        if (earlier != NONE) {
            superseded[earlier] = true;
        }
    }
    if (is_event && own_service == LOST) {
        atomicAdd(count_lost, 1u);
    }
    sync();
    const uint waited = waited_served;
    if (readout.cap_events != 0u && !SIDE_BY_SIDE) {
        count_served(services_waiting, waited, turn);
    }
    send_waited(waited, since_epoch_ns);
    sync();
    if (own_service != LOST) {
        int64_t left_ps = 0l;
        bool has_left;
        bool capped = false;
        if (own_service == WAITED) {
            const uint service = uint(bus[at_row(ROW_SERVICE, pixel / cam.width)]) - 1u;
            has_left = service < waited;
            if (has_left) {
                left_ps = bus[at_row(ROW_END, service)];
                const uint ahead = service == 0u ? 0u : uint(bus[at_row(ROW_SERVED, service - 1u)]);
                capped = is_capped(left_ps, ahead, waited);
            }
        } else {
            has_left = own_service < last_served;
            left_ps = ends[own_service];
            if (has_left && readout.cap_events != 0u) {
                capped = is_capped(left_ps, served[own_service] - members[own_service], waited);
            }
        }
        if (has_left) {
            send(event.y, left_ps, capped);
        }
        if (SIDE_BY_SIDE) {
            // The pixel is free when the next chunk begins.
        } else if (!has_left) {
            bus[at_pixel(pixel)] = WAITS + int64_t(event.y & 1u);
        } else if (!superseded[lane]) {
            bus[at_pixel(pixel)] = since_epoch_ns + left_ps / 1000l;
        }
    }
    // lavapipe reads what all threads read even where none is active, and then `last_served` holds anything.
    const uint last = clamp(last_served, 1u, gl_WorkGroupSize.x) - 1u;
    const int64_t last_ps = last_served != 0u ? ends[last]
        : waited != 0u                        ? bus[at_row(ROW_END, waited - 1u)]
                                              : NEVER;
    const bool any_served = last_served != 0u || waited != 0u;
    if (readout.cap_events != 0u && any_served && !SIDE_BY_SIDE) {
        // Every thread computes it before the first one writes.
        const int64_t period = period_at(last_ps);
        const int64_t in_period = int64_t(served[gl_WorkGroupSize.x - 1u]) - served_before_period(period, waited);
        sync();
        bus[at_head(HEAD_PERIOD)] = period;
        bus[at_head(HEAD_SERVED)] = in_period;
    }
    if (any_served) {
        free_ps = last_ps;
    }
    sync();
    return by_row && !SIDE_BY_SIDE ? keep_waiting(services_waiting, waited, opens && !turn) : 0u;
}

// Whether a packet is sorted, so that the bus can serve it. `merge` sorts heavy packets after the tick's first submission.
bool is_ready(Counters counted) {
    return counted.emitted_fit == 0xffffffffu && (counted.queue_overflows | counted.without_levels) == 0u
        && (counted.heavy == 0u || push.merged != 0u);
}

// Whether a packet lies in `gathered`, and not in `overflow`. The last pass of `merge` leaves it in the buffer that it
// does not read.
bool lies_in_gathered(Counters counted) {
    return counted.heavy == 0u || merge_passes(counted) % 2u == 1u;
}

uvec2 read_event(bool in_gathered, uint place) {
    return in_gathered ? gathered[place] : overflow[place];
}
