// readout_light: part of `readout`, for a tick in which events hardly wait: none is lost, and none waits at either end of
// the interval to be served. Writes the outlet's packet at once. Where it finds that it cannot, it says so in the report, and
// the tick goes on with `readout` as if nothing had been done here.
//
// If no event is lost, an event's place in the packet differs from its place before the bus only among those that leave in
// the same tick of the sensor's clock or, by row, among those that wait together. And when the bus is free is a prefix
// maximum (bus_scan.glsl) over all events. `sort` has left it for each group of bins. So every workgroup serves the events of
// its own group: one by one, all events leave when the bus is free of them; by row, a thread serves a cluster as a queue
// does, between two instants at which a bus is idle that serves each event of a row alone.
//
// x over groups of bins, y over cameras. Reads the packet before the bus, in `gathered`. Events of the last tick that leave in
// this one come first.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "readout_constants.glsl"
#include "readouts.glsl"

layout(local_size_x = READOUT_THREADS, local_size_x_id = THREADS_ID) in;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_GATHERED, uvec2, gathered);
BUFFER(, SLOT_BUS, int64_t, bus);
BUFFER(writeonly, SLOT_EVENT_T, uint, event_t);
BUFFER(writeonly, SLOT_EVENT_X, uint16_t, event_x);
BUFFER(writeonly, SLOT_EVENT_Y, uint16_t, event_y);
BUFFER(writeonly, SLOT_EVENT_P, uint8_t, event_p);
BUFFER(writeonly, SLOT_REPORT, Counters, report);

const bool MAY_BIN_BY_SAMPLE = false;

Readout readout;
// The outlet.
Camera cam;

#include "udiv_native.glsl"
#include "bins.glsl"
#include "event_order.glsl"
#include "bus_layout.glsl"
#include "bus_scan.glsl"
#include "workgroup_max.glsl"

// A workgroup takes tiles of events, one a thread: its own, and some on either side. An event that waits longer than for those
// before, or a cluster with more events than those behind, is left to `readout`.
const uint AHEAD = gl_WorkGroupSize.x / 8u;
const uint BEHIND = gl_WorkGroupSize.x / 4u;
const uint OWN = gl_WorkGroupSize.x - AHEAD - BEHIND;

// The tile's events: when they come, their pixel and polarity, and when they leave at the latest.
shared uint times_ns[gl_WorkGroupSize.x];
shared uint tags[gl_WorkGroupSize.x];
shared int64_t latest_ps[gl_WorkGroupSize.x];

// When each leaves, and its time stamp; of those that leave later than the interval, LATE.
shared int64_t left_ps[gl_WorkGroupSize.x];
shared uint stamps[gl_WorkGroupSize.x];
const uint LATE = 0xffffffffu;

// Whether a cluster begins with the event: none before it leaves at or after its time stamp.
shared bool begins[gl_WorkGroupSize.x];

// By row: the event that has opened an event's service, and how many a service has.
shared uint openers[gl_WorkGroupSize.x];
shared uint members[gl_WorkGroupSize.x];

// The tile's packet, in order.
shared uvec2 ordered[gl_WorkGroupSize.x];

// What is carried over from the last tick: when it leaves, its time stamp and its tag.
shared uint carried_ns[MOST_CARRIED];
shared uvec2 carried_keys[MOST_CARRIED];

// The first cluster that begins in the tile's own part, and after it.
shared uint first_lane;
shared uint end_lane;

shared bool gives_up;
shared uint count_late;

const uint NONE = 0xffffffffu;

int64_t now_ps(uint lane) {
    return int64_t(times_ns[lane]) * 1000l;
}

// Whether `lane`'s event comes while one of its pixel that was carried over is on its way.
bool is_carried_at(uint lane, uint carried) {
    for (uint i = 0u; i < carried; ++i) {
        if (carried_ns[i] >= times_ns[lane] && carried_keys[i].y >> 1 == tags[lane] >> 1) {
            return true;
        }
    }
    return false;
}

// Whether `lane`'s event may be lost if events are served one by one. `base`: the event that the tile begins with.
bool may_be_lost(uint lane, uint base, uint carried) {
    const int64_t now = now_ps(lane);
    const uint none_before = max(AHEAD, base) - base;
    uint other = lane;
    while (other > none_before && latest_ps[other - 1u] >= now) {
        other -= 1u;
        if (tags[other] >> 1 == tags[lane] >> 1) {
            return true;
        }
    }
    return (other == 0u && base > AHEAD) || is_carried_at(lane, carried);
}

// Serves the cluster of lanes [first, last) by row, as a queue does. Returns false if an event is lost, or does not have its
// turn in the interval.
bool serve_cluster(uint first, uint last, int64_t free_ps, uint carried) {
    // The first service that has not begun.
    uint next = first;
    for (uint lane = first; lane <= last; ++lane) {
        const int64_t now = lane < last ? now_ps(lane) : NEVER;
        while (next < lane) {
            if (openers[next] == next) {
                const int64_t begin = max(free_ps, now_ps(next));
                if (lane < last ? begin >= now : begin > int64_t(cam.interval_ns) * 1000l) {
                    break;
                }
                free_ps = begin + int64_t(readout.row_ps + uint64_t(members[next]) * readout.event_ps);
                left_ps[next] = free_ps;
            }
            next += 1u;
        }
        if (lane == last) {
            break;
        }
        const uint pixel = tags[lane] >> 1;
        uint opener = lane;
        for (uint other = lane; other > first; --other) {
            const uint before = other - 1u;
            const bool waits = openers[before] >= next;
            if (tags[before] >> 1 == pixel && (waits || left_ps[openers[before]] >= now)) {
                return false;
            }
            if (waits && (tags[before] >> 1) / cam.width == pixel / cam.width) {
                opener = openers[before];
            }
        }
        if (is_carried_at(lane, carried)) {
            return false;
        }
        openers[lane] = opener;
        members[lane] = 0u;
        members[opener] += 1u;
    }
    if (next < last) {
        return false;
    }
    for (uint lane = first; lane < last; ++lane) {
        left_ps[lane] = left_ps[openers[lane]];
    }
    return true;
}

// Ranks event `lane` in its cluster, which ends before `end`, and puts it where it belongs.
void place_in_cluster(uint lane, uint end) {
    const uvec2 key = uvec2(stamps[lane], tags[lane]);
    uint cluster = lane;
    uint rank = 0u;
    while (!begins[cluster]) {
        cluster -= 1u;
        rank += uint(!before(key, uvec2(stamps[cluster], tags[cluster])));
    }
    for (uint other = lane + 1u; other < end && !begins[other]; ++other) {
        rank += uint(before(uvec2(stamps[other], tags[other]), key));
    }
    ordered[cluster + rank] = key;
}

// Writes what is carried over. It may leave with events of the first cluster, which ends before `end`.
void write_carried(uint carried, uint end) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane >= carried) {
        return;
    }
    const uvec2 key = carried_keys[lane];
    uint place = 0u;
    for (uint i = 0u; i < carried; ++i) {
        place += uint(before(carried_keys[i], key) || (carried_keys[i] == key && i < lane));
    }
    for (uint other = AHEAD; other < end && (other == AHEAD || !begins[other]); ++other) {
        place += uint(before(ordered[other], key));
    }
    write_out(cam, cam.event_base + place, key);
}

// Writes lanes [first, end) of the tile that begins with event `base`; a subgroup writes whole lines.
void write_tile(uint base, uint first, uint end, uint carried) {
    const uint from = cam.event_base + carried + base + first - AHEAD;
    const uint to = from + end - first;
    for (uint at = (from & ~31u) + gl_LocalInvocationID.x; at < to; at += gl_WorkGroupSize.x) {
        const uvec2 key = at >= from ? ordered[first + at - from] : uvec2(LATE);
        uint later = 0u;
        for (uint i = 0u; base == 0u && i < carried; ++i) {
            later += uint(before(key, carried_keys[i]));
        }
        if (key.x != LATE) {
            write_out(cam, at - later, key);
        }
    }
}

// Keeps the events of lanes [first, end) that leave after the interval, and what the next tick needs to know. Called by the whole
// workgroup. `free_ps`: when the bus is free.
void end_packet(uint first, uint end, uint packet, uint carried, int64_t free_ps) {
    const uint lane = gl_LocalInvocationID.x;
    // Not where those lie that were carried over: they may still be read.
    const uint place = uint(bus[at_head(HEAD_CARRIED_PLACE)]) < MOST_CARRIED ? 2u * MOST_CARRIED : 0u;
    if (lane >= first && lane < end && stamps[lane] == LATE) {
        const uint late = atomicAdd(count_late, 1u);
        if (late < MOST_CARRIED) {
            gathered[cam.event_base + place + late] = uvec2(uint(left_ps[lane] / 1000l), tags[lane] | DEFERRED);
        }
    }
    barrier();
    if (lane == 0u) {
        const uint counter = 2u * cam.slot + cam.frame_slot;
        bus[at_free(1u - cam.frame_slot)] = max(free_ps - int64_t(cam.interval_ns) * 1000l, 0l);
        counters[counter].packet = place;
        counters[counter].deferred = count_late;
        report[cam.slot].packet = carried + packet - count_late;
        report[cam.slot].deferred = count_late;
        if (count_late > MOST_CARRIED) {
            gives_up = true;
        }
    }
}

// Serves a tile: events [base, base + OWN) of the packet, as far as they come before `group_end`, and those of clusters that
// begin there. `before_ps`: when the bus is free before it. Returns that of the next tile.
int64_t serve_tile(Camera source, uint base, uint group_end, uint packet, uint carried, int64_t before_ps) {
    const uint lane = gl_LocalInvocationID.x;
    const bool by_row = readout.row_ps != 0ul;
    const int64_t service_ps = int64_t(readout.row_ps + readout.event_ps);
    const uint own_end = AHEAD + min(OWN, group_end - base);
    const uint packet_end = AHEAD + min(packet - base, OWN + BEHIND);
    const bool is_event = base + lane >= AHEAD && lane < packet_end;
    const bool is_packets_first = base + lane == AHEAD;
    const uvec2 event = is_event ? gathered[source.event_base + base + lane - AHEAD] : uvec2(0u);
    times_ns[lane] = event.x;
    tags[lane] = is_event ? event.y : LATE;
    left_ps[lane] = NEVER;
    openers[lane] = lane;
    if (lane == 0u) {
        first_lane = NONE;
        end_lane = NONE;
        count_late = 0u;
    }
    Step own = Step(0l, NEVER);
    if (lane + 1u == AHEAD) {
        own.latest = before_ps;
    } else if (is_event && lane >= AHEAD) {
        own = Step(service_ps, int64_t(event.x) * 1000l + service_ps);
    }
    own = scan(own);
    // Of an event before the tile's own this is a bound.
    latest_ps[lane] = lane >= AHEAD ? own.latest : before_ps - int64_t(AHEAD - 1u - lane) * service_ps;
    barrier();
    bool starts = lane == packet_end;
    if (is_event && lane >= AHEAD) {
        const int64_t now = now_ps(lane);
        const int64_t ahead_ps = latest_ps[lane - 1u];
        const int64_t leaves_ps = by_row ? now + service_ps : latest_ps[lane];
        starts = is_packets_first
            || ((!by_row || ahead_ps < now)
                && stamp_offset(cam, uint(ahead_ps / 1000l)) != stamp_offset(cam, uint(leaves_ps / 1000l)));
        if (!by_row) {
            left_ps[lane] = latest_ps[lane];
            if (lane < own_end && may_be_lost(lane, base, carried)) {
                gives_up = true;
            }
        }
    }
    begins[lane] = starts;
    if (starts && lane >= AHEAD && lane < own_end) {
        atomicMin(first_lane, lane);
    }
    if (starts && lane >= own_end) {
        atomicMin(end_lane, lane);
    }
    barrier();
    const int64_t next_ps = latest_ps[own_end - 1u];
    const uint end = end_lane;
    const uint first = min(first_lane, end);
    const bool is_last = end == packet_end && packet - base <= OWN + BEHIND;
    if (end == NONE && first != NONE) {
        gives_up = true;
    }
    if (end == NONE || (first == end && packet != 0u)) {
        barrier();
        return next_ps;
    }
    const bool is_owned = lane >= first && lane < end;
    if (is_owned && starts && by_row) {
        uint cluster_end = lane + 1u;
        while (cluster_end < end && !begins[cluster_end]) {
            cluster_end += 1u;
        }
        const int64_t free_ps = is_packets_first ? before_ps : 0l;
        if (cluster_end - lane > BEHIND
            || !serve_cluster(lane, cluster_end, free_ps, is_packets_first ? carried : 0u)) {
            gives_up = true;
        }
    }
    barrier();
    if (is_owned) {
        const int64_t left_ns = left_ps[lane] / 1000l;
        const bool is_late = left_ns > int64_t(cam.interval_ns);
        stamps[lane] = is_late ? LATE : stamp_offset(cam, uint(left_ns));
        if (is_late && !is_last) {
            gives_up = true;
        }
    }
    barrier();
    if (is_owned) {
        place_in_cluster(lane, end);
    }
    const int64_t last_ps = is_last ? workgroup_max(is_owned ? left_ps[lane] : NEVER) : NEVER;
    barrier();
    if (base == 0u) {
        write_carried(carried, end);
    }
    write_tile(base, first, end, carried);
    if (is_last) {
        end_packet(first, end, packet, carried, packet == 0u ? before_ps : last_ps);
    }
    barrier();
    return next_ps;
}

// When the bus is free before event `start`, with which group `group` begins. Called by the whole workgroup.
int64_t load_before(uint group, uint start) {
    const int64_t service_ps = int64_t(readout.row_ps + readout.event_ps);
    int64_t latest = bus[at_free(cam.frame_slot)] + int64_t(start) * service_ps;
    for (uint g = gl_LocalInvocationID.x; g < group; g += gl_WorkGroupSize.x) {
        const uint word = at_group(cam, g);
        latest = max(latest, bus[word] + int64_t(start - uint(bus[word + 1u])) * service_ps);
    }
    return workgroup_max(latest);
}

// Loads what is carried over, and tells `readout` that it takes the places of its pixels.
void load_carried(Camera source, uint carried) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane >= carried) {
        return;
    }
    const uvec2 event = gathered[cam.event_base + uint(bus[at_head(HEAD_CARRIED_PLACE)]) + lane];
    const uint left_ns = event.x - cam.previous_interval_ns;
    const uint tag = event.y & ~DEFERRED;
    carried_ns[lane] = left_ns;
    carried_keys[lane] = uvec2(stamp_offset(cam, left_ns), tag);
    if (left_ns > cam.interval_ns) {
        gives_up = true;
    }
    if (gl_WorkGroupID.x == 0u) {
        bus[at_pixel(tag >> 1)] = source.start_ns - source.epoch_ns + int64_t(left_ns);
    }
}

void main() {
    const Camera source = cameras[push.first_camera + gl_WorkGroupID.y];
    if (source.frame_kind != FRAME_INTERVAL || readouts[source.slot].has_bus == 0u) {
        return;
    }
    readout = readouts[source.slot];
    cam = cameras[readout.outlet_row];
    const uint group = gl_WorkGroupID.x;
    const uint lane = gl_LocalInvocationID.x;
    const Counters counted = counters[2u * source.slot + source.frame_slot];
    const bool is_sorted = counted.emitted_fit == 0xffffffffu && counted.queue_overflows == 0u && counted.heavy == 0u;
    if (!is_sorted || group * GROUP_BINS > cam.bin_count) {
        return;
    }
    const uint start = group == 0u ? 0u : uint(bus[at_group(cam, group - 1u) + 1u]);
    const uint end = uint(bus[at_group(cam, group) + 1u]);
    const uint carried = uint(bus[at_head(HEAD_CARRIED)]);
    if (lane == 0u) {
        gives_up = readout.cap_events != 0u || carried > MOST_CARRIED || bus[at_head(HEAD_SERVICES)] != 0l;
    }
    barrier();
    const bool is_light = !gives_up;
    barrier();
    if (is_light) {
        load_carried(source, carried);
        int64_t before_ps = load_before(group, start);
        uint base = start;
        if (start < end || (counted.packet == 0u && group == 0u)) {
            do {
                before_ps = serve_tile(source, base, end, counted.packet, carried, before_ps);
                base += OWN;
            } while (base < end && !gives_up);
        }
        barrier();
    }
    if (lane == 0u && gives_up) {
        report[cam.slot].progress = READOUT_UNDONE;
    }
}
