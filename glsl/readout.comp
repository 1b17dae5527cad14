// readout: serves events over a sensor's bus. An event that finds its pixel's place taken is lost; the others are stamped
// when they leave, and scattered into the bins of the camera's outlet, which are sorted next. Exactly what a queue does
// that serves one event after the other.
//
// One workgroup for a camera; y over cameras. It takes the packet, which is sorted by time, in chunks of an event a
// thread. When services end is a scan (bus_scan.glsl). Which events are lost, and which service each of the others has
// (bus_fates.glsl), depends on that, and that on it. So both are repeated until nothing changes: an event's fate depends
// on events before it only, so what results is the queue's answer, the only one. A chunk has few rounds, unless it has
// long chains of losses. After a chunk that has lost most of its events, the next one leaves out those that are lost for
// certain (bus_undecided.glsl).
//
// Chunks that `readout_apart` has served are passed over: the bus is idle before and after them.
//
// A tick that `sort` has served needs nothing of this.
//
// Reads the packet, where `sort` or `merge` has left it. `bus` keeps what waits from chunk to chunk and from tick to tick. A
// dispatch may end before the packet's end (MOST_ROUNDS); the next one goes on. `progress` of the outlet's counters says
// whether one is needed.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "readout_constants.glsl"

const bool SIDE_BY_SIDE = false;

#include "readout.glsl"
#include "bus_undecided.glsl"

shared uint nearest;

// First stretch from that of event `from` on whose first idle event is at or after `from`, and from which on the events
// to the next such event are served or (`is_served` false) not; NONE if there is none. Called by the whole workgroup; ends with a barrier.
uint find_stretch(uint from, uint count, bool is_served) {
    const uint all = (count + STRETCH - 1u) / STRETCH;
    nearest = NONE;
    barrier();
    for (uint first = from / STRETCH; first < all; first += gl_WorkGroupSize.x) {
        const uint stretch = first + gl_LocalInvocationID.x;
        if (stretch < all) {
            const int64_t idle = bus[at_idle(stretch)];
            if (idle != NOT_IDLE && uint(idle) >= from && ((idle & SERVED) != 0l) == is_served) {
                atomicMin(nearest, stretch);
            }
        }
        barrier();
        const bool found = nearest != NONE;
        barrier();
        if (found) {
            break;
        }
    }
    const uint found = nearest;
    barrier();
    return found;
}

void main() {
    const Camera source = cameras[push.first_camera + gl_WorkGroupID.y];
    if (source.frame_kind != FRAME_INTERVAL || readouts[source.slot].has_bus == 0u) {
        return;
    }
    readout = readouts[source.slot];
    cam = cameras[readout.outlet_row];
    const uint lane = gl_LocalInvocationID.x;
    const uint counter = 2u * cam.slot + cam.frame_slot;
    const Counters counted = counters[2u * source.slot + source.frame_slot];
    if (counters[counter].progress == READOUT_DONE) {
        return;
    }
    if (!is_ready(counted)) {
        if (lane == 0u) {
            counters[counter].progress = READOUT_UNDONE;
        }
        return;
    }
    count_lost = 0u;
    count_capped = 0u;
    count_waiting = 0u;
    most_loops = 0u;
    loops = 0u;
    free_ps = bus[at_free(cam.frame_slot)];
    uint services_waiting = uint(bus[at_head(HEAD_SERVICES)]);
    uint first = max(uint(bus[at_head(HEAD_NEXT)]), 1u) - 1u;
    const int64_t since_epoch_ns = source.start_ns - source.epoch_ns;
    const bool in_gathered = lies_in_gathered(counted);
    const bool passes_over = APART && readout.cap_events == 0u;
    bool is_last = false;
    bool again = true;
    bool is_overloaded = false;
    uint lost_before = 0u;
    while (again) {
        sync();
        uint limit = counted.packet;
        if (passes_over) {
            const uint stretch = find_stretch(first, counted.packet, true);
            if (stretch != NONE) {
                const uint served_from = uint(bus[at_idle(stretch)]);
                if (served_from == first && services_waiting == 0u) {
                    // All up to the next that are not served.
                    const uint after = find_stretch(first + 1u, counted.packet, false);
                    first = after == NONE ? counted.packet : uint(bus[at_idle(after)]);
                    is_last = first == counted.packet;
                    again = !is_last;
                    continue;
                }
                limit = served_from;
            }
        }
        uint end = min(first + gl_WorkGroupSize.x, limit);
        uint taken = end - first;
        uint e = first + lane;
        if (is_overloaded) {
            end = find_undecided(
                in_gathered, source.event_base, first, limit, services_waiting, since_epoch_ns, taken);
            if (lane == 0u) {
                count_lost += end - first - taken;
            }
            e = undecided[lane];
        }
        is_last = end == counted.packet;
        const bool is_event = lane < taken;
        const uvec2 event = is_event ? read_event(in_gathered, source.event_base + e) : uvec2(0u);
        const uint next_ns = is_last ? 0u : read_event(in_gathered, source.event_base + end).x;
        services_waiting = serve_chunk(event, is_event, services_waiting, since_epoch_ns, is_last, next_ns);
        atomicMax(most_loops, loops);
        barrier();
        again = !is_last && most_loops < MOST_ROUNDS;
        is_overloaded = 2u * (count_lost - lost_before) > end - first;
        lost_before = count_lost;
        first = end;
    }
    if (is_last) {
        // What waits counts from the next interval's start.
        for (uint service = lane; service < services_waiting; service += gl_WorkGroupSize.x) {
            bus[at_row(ROW_OPENER, service)] -= int64_t(cam.interval_ns);
            atomicAdd(count_waiting, uint(bus[at_row(ROW_EVENTS, service)] >> 32));
        }
        free_ps = max(free_ps - int64_t(cam.interval_ns) * 1000l, 0l);
    }
    sync();
    if (lane == 0u) {
        bus[at_free(is_last ? 1u - cam.frame_slot : cam.frame_slot)] = free_ps;
        bus[at_head(HEAD_SERVICES)] = int64_t(services_waiting);
        bus[at_head(HEAD_NEXT)] = is_last ? 0l : int64_t(first) + 1l;
        bus[at_head(HEAD_WAITING)] = int64_t(count_waiting);
        counters[counter].lost += count_lost;
        counters[counter].capped += count_capped;
        counters[counter].waiting = count_waiting;
        counters[counter].progress = is_last ? READOUT_DONE : READOUT_UNDONE;
    }
}
