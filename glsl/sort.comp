// sort: the events of each bin by (t, y, x, polarity), and out as struct of arrays, into memory that the host
// reads. Equal events are equal in every bit, so that the packet is the same whatever order they arrived in.
//
// One workgroup of 256 threads a group of GROUP_BINS bins; x over groups, y over cameras. Each workgroup sums the
// bins for itself, to know where its own begin: they are few, and a dispatch of its own for that would cost more.
// Events are ranked within their bins in shared memory, a group at once if it fits, else bin after bin, and leave as
// whole lines of the bus, which takes nothing smaller cheaply. Where a bin had no room for all of its events, the
// workgroup looks for them among the spilled ones. If any bin of the packet has more than SORTABLE_EVENTS, or there are
// more spilled ones than SEARCHED_EVENTS, all events only go to `gathered`, bin after bin, and `merge` sorts the packet.
// Late events go there too, behind the packet, where the next tick's `carry` finds them.
// The first workgroup writes the camera's `report` for the host, and makes the other set of counters ready for the
// next tick; all clear the other set of bins.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "common.glsl"
#include "bins.glsl"

layout(local_size_x = 256) in;

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

#include "runs.glsl"

// `keys` in order.
shared uvec2 ranked[SORTABLE_EVENTS];

// Events of each bin of the group, where they begin in it, and how many of the spilled ones have been found.
shared uint counts[GROUP_BINS];
shared uint offsets[GROUP_BINS];
shared uint found[GROUP_BINS];
shared uint late_found;

// Of each subgroup: events before the group, events in all, the largest bin.
shared uvec3 sums[64];

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
        sums[gl_SubgroupID] = together;
    }
    barrier();
    Sums all = Sums(0u, 0u, 0u);
    for (uint s = 0u; s < gl_NumSubgroups; ++s) {
        all = Sums(all.ahead + sums[s].x, all.packet + sums[s].y, max(all.largest_bin, sums[s].z));
    }
    return all;
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
            Counters(0u, 0xffffffffu, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
    }
}

// The bin of the group, and the place in it, of a spilled event that belongs to bins [first, last) of the group;
// else `last`.
uvec2 place_of_spilled(Camera cam, uvec2 event, uint first_bin, uint first, uint last) {
    const uint bin = (event.y & LATE) == 0u ? bin_of(cam, event.x, event.y >> 1) - first_bin : last;
    return bin >= first && bin < last ? uvec2(bin, cam.bin_room + atomicAdd(found[bin], 1u)) : uvec2(last, 0u);
}

// Events [first, first + length) of the sorted packet, from `ranked`; a subgroup writes whole lines.
void write_ranked(Camera cam, uint first, uint length) {
    const uint line = first & ~31u;
    for (uint position = line + gl_LocalInvocationID.x; position < first + length; position += gl_WorkGroupSize.x) {
        if (position >= first) {
            write_out(cam, position, ranked[position - first]);
        }
    }
}

// Bins [first, last) of the group, whose events fit shared memory and begin at `position` of the packet.
void sort_bins(Camera cam, uint first_bin, uint first, uint last, uint spills, uint position) {
    const uint lane = gl_LocalInvocationID.x;
    const uint start = offsets[first];
    bool spilled_some = false;
    for (uint b = first; b < last; ++b) {
        spilled_some = spilled_some || counts[b] > cam.bin_room;
    }
    for (uint i = first * cam.bin_room + lane; i < last * cam.bin_room; i += gl_WorkGroupSize.x) {
        const uint bin = i / cam.bin_room;
        const uint e = i - bin * cam.bin_room;
        if (e < counts[bin]) {
            keys[offsets[bin] - start + e] = rooms[cam.rooms_base + first_bin * cam.bin_room + i];
        }
    }
    if (spilled_some) {
        for (uint i = lane; i < spills; i += gl_WorkGroupSize.x) {
            const uvec2 event = spilled[cam.event_base + i];
            const uvec2 place = place_of_spilled(cam, event, first_bin, first, last);
            if (place.x < last) {
                keys[offsets[place.x] - start + place.y] = event;
            }
        }
    }
    barrier();
    const uint length = offsets[last - 1u] + counts[last - 1u] - start;
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        uint bin_first = 0u;
        uint bin_last = 0u;
        for (uint b = first; b < last && bin_last <= e; ++b) {
            bin_first = bin_last;
            bin_last += counts[b];
        }
        ranked[bin_first + rank_among(e, bin_first, bin_last)] = keys[e];
    }
    barrier();
    write_ranked(cam, position, length);
}

// The group's events to `gathered`, bin after bin.
void gather_bins(Camera cam, uint first_bin, uint spills, uint position) {
    const uint lane = gl_LocalInvocationID.x;
    for (uint i = lane; i < GROUP_BINS * cam.bin_room; i += gl_WorkGroupSize.x) {
        const uint bin = i / cam.bin_room;
        const uint e = i - bin * cam.bin_room;
        if (e < counts[bin]) {
            gathered[position + offsets[bin] + e] = rooms[cam.rooms_base + first_bin * cam.bin_room + i];
        }
    }
    for (uint i = lane; i < spills; i += gl_WorkGroupSize.x) {
        const uvec2 event = spilled[cam.event_base + i];
        const uvec2 place = place_of_spilled(cam, event, first_bin, 0u, GROUP_BINS);
        if (place.x < GROUP_BINS) {
            gathered[position + offsets[place.x] + place.y] = event;
        }
    }
}

// Late events to `gathered`, behind the packet.
void gather_late(Camera cam, uint spills, uint position) {
    for (uint i = gl_LocalInvocationID.x; i < spills; i += gl_WorkGroupSize.x) {
        const uvec2 event = spilled[cam.event_base + i];
        if ((event.y & LATE) != 0u) {
            gathered[position + atomicAdd(late_found, 1u)] = event;
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
        late_found = 0u;
    }
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
    if (late != 0u && first_bin + GROUP_BINS > cam.bin_count) {
        gather_late(cam, counted.spilled, cam.event_base + all.packet);
    }
    const uint position = cam.event_base + all.ahead;
    const uint events = offsets[GROUP_BINS - 1u] + counts[GROUP_BINS - 1u];
    if (events == 0u) {
        return;
    }
    if (is_heavy(all, counted.spilled)) {
        gather_bins(cam, first_bin, counted.spilled, position);
    } else if (events <= SORTABLE_EVENTS) {
        sort_bins(cam, first_bin, 0u, GROUP_BINS, counted.spilled, position);
    } else {
        for (uint b = 0u; b < GROUP_BINS; ++b) {
            sort_bins(cam, first_bin, b, b + 1u, counted.spilled, position + offsets[b]);
        }
    }
}
