// sort: the events of each bin by (t, y, x, polarity), and out as struct of arrays, into memory that the host
// reads. Equal events are equal in every bit, so that the packet is the same whatever order they arrived in.
//
// One workgroup of 256 threads a group of GROUP_BINS bins; x over groups, y over cameras. Where a group fits
// shared memory every event is ranked within its bin there, and the group leaves as whole lines of the bus,
// which takes nothing smaller cheaply. Else bin after bin is ranked in runs, and runs are merged in place of
// `staged` and `binned`. A bin of more than SORTABLE_EVENTS would keep its workgroup busy for long, and one
// thread with more iterations than a driver may allow it: it stays in `binned`, and `merge` sorts the packet.
// Clears `bins` and `bin_cursors` for the next tick.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = 256) in;

BUFFER(readonly, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_BINS, uint, bins);
BUFFER(writeonly, SLOT_BIN_CURSORS, uint, bin_cursors);
BUFFER(readonly, SLOT_BIN_STARTS, uint, bin_starts);
BUFFER(coherent, SLOT_STAGED, uvec2, staged);
BUFFER(coherent, SLOT_BINNED, uvec2, binned);
BUFFER(writeonly, SLOT_EVENT_T, uint, event_t);
BUFFER(writeonly, SLOT_EVENT_X, uint16_t, event_x);
BUFFER(writeonly, SLOT_EVENT_Y, uint16_t, event_y);
BUFFER(writeonly, SLOT_EVENT_P, uint8_t, event_p);

#include "runs.glsl"

// Events of each bin of the group, and where each begins.
shared uint counts[GROUP_BINS];
shared uint starts[GROUP_BINS];

// Events [first, first + length) of the sorted packet, from `ranked`; a subgroup writes whole lines.
void write_ranked(Camera cam, uint first, uint length) {
    const uint line = first & ~31u;
    for (uint position = line + gl_LocalInvocationID.x; position < first + length; position += gl_WorkGroupSize.x) {
        if (position >= first) {
            write_out(cam, position, ranked[position - first]);
        }
    }
}

// The whole group, `events` from `first` on.
void sort_group(Camera cam, uint first, uint events) {
    const uint lane = gl_LocalInvocationID.x;
    for (uint e = lane; e < events; e += gl_WorkGroupSize.x) {
        keys[e] = binned[first + e];
    }
    barrier();
    for (uint e = lane; e < events; e += gl_WorkGroupSize.x) {
        uint bin_first = 0u;
        uint bin_last = 0u;
        for (uint b = 0u; b < GROUP_BINS && bin_last <= e; ++b) {
            bin_first = bin_last;
            bin_last += counts[b];
        }
        ranked[bin_first + rank_among(e, bin_first, bin_last)] = keys[e];
    }
    barrier();
    write_ranked(cam, first, events);
}

// One bin of the group.
void sort_bin(Camera cam, uint first, uint count) {
    const uint last = first + count;
    for (uint run = first; run < last; run += RUN_EVENTS) {
        const uint length = min(RUN_EVENTS, last - run);
        rank_run(run, length);
        if (count <= RUN_EVENTS) {
            write_ranked(cam, run, length);
        } else {
            for (uint e = gl_LocalInvocationID.x; e < length; e += gl_WorkGroupSize.x) {
                staged[run + e] = ranked[e];
            }
        }
    }
    bool in_binned = false;
    for (uint width = RUN_EVENTS; width < count; width *= 2u) {
        memoryBarrierBuffer();
        barrier();
        const bool is_last = 2u * width >= count;
        for (uint e = first + gl_LocalInvocationID.x; e < last; e += gl_WorkGroupSize.x) {
            const uvec2 key = read_run(in_binned, e);
            const uint position = merged(in_binned, first, last, width, e, key);
            if (is_last) {
                write_out(cam, position, key);
            } else {
                write_run(!in_binned, position, key);
            }
        }
        in_binned = !in_binned;
    }
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint first_bin = gl_WorkGroupID.x * GROUP_BINS;
    if (cameras[index].phase != PHASE_INTERVAL || first_bin > cameras[index].bin_count) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    const uint counter = 2u * cam.slot + cam.parity;
    if (counters[counter].staged_fit != 0xffffffffu || counters[counter].crowded_strips != 0u) {
        return;
    }
    if (lane < GROUP_BINS) {
        // The bin after the last holds what is late: it is cleared, and stays where it is.
        const uint bin = cam.bin_base + first_bin + lane;
        const uint count = first_bin + lane <= cam.bin_count ? bins[bin] : 0u;
        if (count != 0u) {
            starts[lane] = cam.event_base + bin_starts[bin];
            bins[bin] = 0u;
            bin_cursors[bin] = 0u;
        }
        counts[lane] = first_bin + lane < cam.bin_count ? count : 0u;
    }
    barrier();
    uint events = 0u;
    uint first = 0u;
    for (uint b = 0u; b < GROUP_BINS; ++b) {
        first = events == 0u ? starts[b] : first;
        events += counts[b];
    }
    if (events == 0u) {
        return;
    }
    if (events <= GROUP_EVENTS) {
        sort_group(cam, first, events);
        return;
    }
    for (uint b = 0u; b < GROUP_BINS; ++b) {
        if (counts[b] <= SORTABLE_EVENTS) {
            sort_bin(cam, starts[b], counts[b]);
        }
    }
}
