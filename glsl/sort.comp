// sort: the events of each bin by (t, y, x, polarity), and out as struct of arrays, into memory that the host
// reads. Equal events are equal in every bit, so that the packet is the same whatever order they arrived in.
//
// One workgroup a group of GROUP_BINS bins; x over groups, y over cameras. Each workgroup sums the
// bins for itself, to know where its own begin: they are few, and a dispatch of its own for that would cost more.
// Events are ranked within their bins in shared memory, a group or half of it at once if they fit, else bin after bin,
// and leave as whole lines of the bus, which takes nothing smaller cheaply. Where a bin had no room for all of its
// events, the workgroup looks for them among the spilled ones. If any bin of the packet has more than SORTABLE_EVENTS,
// or there are more spilled ones than SEARCHED_EVENTS, all events only go to `gathered`, and `merge` sorts the packet.
// Late events go there too, behind the packet, where the next tick's `carry` finds them.
// The first workgroup writes the camera's `report` for the host, and makes the other set of counters ready for the
// next tick; all clear the other set of bins.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "common.glsl"
#include "together.glsl"

layout(local_size_x = SORT_THREADS, local_size_x_id = 1) in;
layout(constant_id = 0) const uint GROUP_BINS = 8;
// See cross.comp.
layout(constant_id = 2) const bool BRANCHES = true;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_BINS, uint, bins);
BUFFER(readonly, SLOT_ROOMS, uvec2, rooms);
BUFFER(readonly, SLOT_SPILLED, uvec2, spilled);
BUFFER(writeonly, SLOT_GATHERED, uvec2, gathered);
BUFFER(writeonly, SLOT_EVENT_T, uint, event_t);
BUFFER(writeonly, SLOT_EVENT_X, uint16_t, event_x);
BUFFER(writeonly, SLOT_EVENT_Y, uint16_t, event_y);
BUFFER(writeonly, SLOT_EVENT_P, uint8_t, event_p);
BUFFER(writeonly, SLOT_REPORT, Counters, report);

const bool AT_SAMPLE = true;

#include "bins.glsl"
#include "event_order.glsl"

// Events that are ranked rather than sorted: their order has room behind them. Ranking takes as many steps as there are
// events in a bin; from RANKED_BIN_EVENTS on, a network takes fewer.
const uint RANKED_EVENTS = SORTABLE_EVENTS / 2u;
const uint RANKED_BIN_EVENTS = 256u;

// A group's events.
shared uvec2 keys[SORTABLE_EVENTS];

#include "network.glsl"

// Events of each bin of the group, where they begin in it, and how many of the spilled ones have been found.
shared uint counts[GROUP_BINS];
shared uint offsets[GROUP_BINS];
shared uint found[GROUP_BINS];

// Where those of a heavy packet go.
shared uint gathered_base;

// Events before the group, events in all, the largest bin.
shared uint sum_ahead;
shared uint sum_packet;
shared uint sum_largest;

struct Sums {
    uint ahead;
    uint packet;
    uint largest_bin;
};

bool is_heavy(Sums all, uint spills) {
    return all.largest_bin > SORTABLE_EVENTS || spills > SEARCHED_EVENTS;
}

// By the whole workgroup.
Sums sum_bins(Camera cam, uint first_bin) {
    const uint own = bins_of(cam, cam.parity);
    uvec3 sum = uvec3(0u);
    for (uint b = gl_LocalInvocationID.x; b < cam.bin_count; b += gl_WorkGroupSize.x) {
        const uint count = bins[own + b];
        sum = uvec3(sum.x + (b < first_bin ? count : 0u), sum.y + count, max(sum.z, count));
    }
    const uvec3 together = uvec3(subgroupAdd(sum.xy), subgroupMax(sum.z));
    if (subgroupElect()) {
        atomicAdd(sum_ahead, together.x);
        atomicAdd(sum_packet, together.y);
        atomicMax(sum_largest, together.z);
    }
    barrier();
    return Sums(sum_ahead, sum_packet, sum_largest);
}

void write_report(Camera cam, Counters counted, Sums sums_of_bins, uint late, bool fitted) {
    const uint counter = 2u * cam.slot + cam.parity;
    counted.packet = sums_of_bins.packet;
    counted.late = late;
    counted.largest_bin = sums_of_bins.largest_bin;
    counted.heavy = uint(is_heavy(sums_of_bins, counted.spilled));
    report[cam.slot] = counted;
    if (fitted) {
        counters[counter].packet = counted.packet;
        counters[counter].late = counted.late;
        counters[counter].heavy = counted.heavy;
        counters[2u * cam.slot + 1u - cam.parity] =
            Counters(0u, 0xffffffffu, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
    }
}

// The bin of the group, and the place in it, of a spilled event that belongs to bins [first, last) of the group;
// else `last`.
uvec2 place_of_spilled(Camera cam, uvec2 event, uint first_bin, uint first, uint last) {
    const uint bin = (event.y & LATE) == 0u ? bin_of(cam, event.x, event.y >> 1) - first_bin : last;
    return bin >= first && bin < last ? uvec2(bin, cam.bin_room + atomicAdd(found[bin], 1u)) : uvec2(last, 0u);
}

// The bin, of bins [first, last) of the group, that holds event `e` of theirs: the last one that begins at or before it.
// Their number is a power of two.
uint bin_with(uint e, uint first, uint last) {
    uint bin = first;
    for (uint further = (last - first) / 2u; further > 0u; further /= 2u) {
        bin += offsets[bin + further] - offsets[first] <= e ? further : 0u;
    }
    return bin;
}

// How many of keys [first, last) come before key `e` of them; among equals, the first.
uint rank_among(uint e, uint first, uint last) {
    const uvec2 key = keys[e];
    uint rank = 0u;
    for (uint other = first; other < last; ++other) {
        rank += uint(before(keys[other], key) || (keys[other] == key && other < e));
    }
    return rank;
}

// Events [first, first + length) of the sorted packet, from keys [from, from + length); a subgroup writes whole lines.
void write_keys(Camera cam, uint first, uint length, uint from) {
    const uint line = first & ~31u;
    for (uint position = line + gl_LocalInvocationID.x; position < first + length; position += gl_WorkGroupSize.x) {
        if (position >= first) {
            write_out(cam, position, keys[from + position - first]);
        }
    }
}

// Bins [first, last) of the group, whose events fit shared memory and begin at `position` of the packet.
void sort_bins(Camera cam, uint first_bin, uint first, uint last, uint spills, uint position) {
    const uint lane = gl_LocalInvocationID.x;
    const uint start = offsets[first];
    uint largest = 0u;
    for (uint b = first; b < last; ++b) {
        largest = max(largest, counts[b]);
    }
    const uint length = offsets[last - 1u] + counts[last - 1u] - start;
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        const uint bin = bin_with(e, first, last);
        const uint in_bin = e - (offsets[bin] - start);
        if (in_bin < cam.bin_room) {
            keys[e] = rooms[cam.rooms_base + (first_bin + bin) * cam.bin_room + in_bin];
        }
    }
    if (largest > cam.bin_room) {
        for (uint i = lane; i < spills; i += gl_WorkGroupSize.x) {
            const uvec2 event = spilled[cam.event_base + i];
            const uvec2 place = place_of_spilled(cam, event, first_bin, first, last);
            if (place.x < last) {
                keys[offsets[place.x] - start + place.y] = event;
            }
        }
    }
    barrier();
    if (length > RANKED_EVENTS || largest > RANKED_BIN_EVENTS) {
        sort_keys(length);
        write_keys(cam, position, length, 0u);
        return;
    }
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        const uint bin = bin_with(e, first, last);
        const uint bin_first = offsets[bin] - start;
        keys[RANKED_EVENTS + bin_first + rank_among(e, bin_first, bin_first + counts[bin])] = keys[e];
    }
    barrier();
    write_keys(cam, position, length, RANKED_EVENTS);
}

// The group's events to `gathered`, in whatever order: `merge` makes one.
void gather_bins(Camera cam, uint first_bin, uint events) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane == 0u) {
        gathered_base = cam.event_base + atomicAdd(counters[2u * cam.slot + cam.parity].gathered, events);
    }
    if (lane < GROUP_BINS) {
        uint offset = 0u;
        for (uint b = 0u; b < lane; ++b) {
            offset += min(counts[b], cam.bin_room);
        }
        offsets[lane] = offset;
    }
    barrier();
    for (uint i = lane; i < GROUP_BINS * cam.bin_room; i += gl_WorkGroupSize.x) {
        const uint bin = i / cam.bin_room;
        const uint e = i - bin * cam.bin_room;
        if (e < counts[bin]) {
            gathered[gathered_base + offsets[bin] + e] = rooms[cam.rooms_base + first_bin * cam.bin_room + i];
        }
    }
}

// The workgroup's share of the spilled events to `gathered`: late ones behind the packet, and, of a heavy packet, the
// others.
void gather_spilled(Camera cam, uint spills, uint packet, bool heavy) {
    const uint counter = 2u * cam.slot + cam.parity;
    const uint groups = cam.bin_count / GROUP_BINS + 1u;
    const uint stride = groups * gl_WorkGroupSize.x;
    for (uint i = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x; i < spills; i += stride) {
        const uvec2 event = spilled[cam.event_base + i];
        uint place;
        if ((event.y & LATE) != 0u) {
            COUNT_TOGETHER(counters[counter].gathered_late, place)
            gathered[cam.event_base + packet + place] = event;
        } else if (heavy) {
            COUNT_TOGETHER(counters[counter].gathered, place)
            gathered[cam.event_base + place] = event;
        }
    }
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint first_bin = gl_WorkGroupID.x * GROUP_BINS;
    if (cameras[index].phase == 0u || first_bin > cameras[index].bin_count) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    const uint own = bins_of(cam, cam.parity);
    const Counters counted = counters[2u * cam.slot + cam.parity];
    const bool fitted = counted.staged_fit == 0xffffffffu && counted.crowded_strips == 0u;
    if (lane < GROUP_BINS) {
        const uint bin = first_bin + lane;
        counts[lane] = bin < cam.bin_count ? bins[own + bin] : 0u;
        found[lane] = 0u;
        if (bin <= cam.bin_count) {
            bins[bins_of(cam, 1u - cam.parity) + bin] = 0u;
        }
    }
    if (lane == 0u) {
        sum_ahead = 0u;
        sum_packet = 0u;
        sum_largest = 0u;
    }
    barrier();
    const uint late = bins[own + cam.bin_count];
    const Sums all = sum_bins(cam, first_bin);
    if (lane < GROUP_BINS) {
        uint offset = 0u;
        for (uint b = 0u; b < lane; ++b) {
            offset += counts[b];
        }
        offsets[lane] = offset;
    }
    barrier();
    if (gl_WorkGroupID.x == 0u && lane == 0u) {
        write_report(cam, counted, all, late, fitted);
    }
    if (!fitted || cam.phase != PHASE_INTERVAL) {
        // Not all events fitted: the host makes room and `cross` goes on.
        return;
    }
    const bool heavy = is_heavy(all, counted.spilled);
    if (late != 0u || heavy) {
        gather_spilled(cam, counted.spilled, all.packet, heavy);
    }
    const uint events = offsets[GROUP_BINS - 1u] + counts[GROUP_BINS - 1u];
    if (events == 0u) {
        return;
    }
    if (heavy) {
        uint with_room = 0u;
        for (uint b = 0u; b < GROUP_BINS; ++b) {
            with_room += min(counts[b], cam.bin_room);
        }
        barrier();
        gather_bins(cam, first_bin, with_room);
        return;
    }
    const uint position = cam.event_base + all.ahead;
    const uint at_once = events <= RANKED_EVENTS ? GROUP_BINS : events <= SORTABLE_EVENTS ? GROUP_BINS / 2u : 1u;
    for (uint b = 0u; b < GROUP_BINS; b += at_once) {
        sort_bins(cam, first_bin, b, b + at_once, counted.spilled, position + offsets[b]);
        barrier();
    }
}
