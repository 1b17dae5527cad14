// sort: the events of each bin by (t, y, x, polarity), and out as struct of arrays. Equal events are
// equal in every bit, so that the packet is the same whatever order they arrived in.
//
// One workgroup of 64 threads a bin; x over bins, y over cameras. A small bin is ranked in shared
// memory; a larger one is ranked in runs, and runs are merged in place of `staged` and `binned`, each
// element finding its place by binary search. Writes in order, so that neighbours in a
// subgroup are neighbours in memory. Clears `bins` and `bin_cursors` for the next tick.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = 64) in;

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

const uint RUN = 256;

shared uvec2 keys[RUN];
shared uvec2 ranked[RUN];

bool before(uvec2 a, uvec2 b) {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

void write_out(Camera cam, uint position, uvec2 event) {
    const uint pixel = event.y >> 1;
    const uint y = pixel / cam.width;
    event_t[position] = event.x;
    event_x[position] = uint16_t(pixel - y * cam.width);
    event_y[position] = uint16_t(y);
    event_p[position] = uint8_t(event.y & 1u);
}

uvec2 read_run(bool from_binned, uint position) {
    return from_binned ? binned[position] : staged[position];
}

void write_run(bool to_binned, uint position, uvec2 event) {
    if (to_binned) {
        binned[position] = event;
    } else {
        staged[position] = event;
    }
}

// Elements of the sorted run [first, last) that belong before `key`; among equals, the left run first.
uint place(bool in_binned, uint first, uint last, uvec2 key, bool equals_too) {
    uint low = first;
    uint high = last;
    while (low < high) {
        const uint middle = (low + high) / 2u;
        const uvec2 other = read_run(in_binned, middle);
        if (before(other, key) || (equals_too && other == key)) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low - first;
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint bin = gl_WorkGroupID.x;
    if (cameras[index].phase != PHASE_INTERVAL || bin > cameras[index].bin_count) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    const uint count = bins[cam.bin_base + bin];
    const uint counter = 2u * cam.slot + cam.parity;
    if (count == 0u || counters[counter].staged_fit != 0xffffffffu || counters[counter].crowded_strips != 0u) {
        return;
    }
    barrier();
    if (lane == 0u) {
        bins[cam.bin_base + bin] = 0u;
        bin_cursors[cam.bin_base + bin] = 0u;
    }
    if (bin == cam.bin_count) {
        return;
    }
    const uint first = cam.event_base + bin_starts[cam.bin_base + bin];
    const uint last = first + count;

    for (uint run = first; run < last; run += RUN) {
        const uint length = min(RUN, last - run);
        for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
            keys[e] = binned[run + e];
        }
        barrier();
        for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
            const uvec2 key = keys[e];
            uint rank = 0u;
            for (uint other = 0u; other < length; ++other) {
                rank += uint(before(keys[other], key) || (keys[other] == key && other < e));
            }
            ranked[rank] = key;
        }
        barrier();
        for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
            if (count <= RUN) {
                write_out(cam, run + e, ranked[e]);
            } else {
                staged[run + e] = ranked[e];
            }
        }
        barrier();
    }
    if (count <= RUN) {
        return;
    }

    bool in_binned = false;
    for (uint width = RUN; width < count; width *= 2u) {
        memoryBarrierBuffer();
        barrier();
        const bool is_last = 2u * width >= count;
        for (uint e = first + lane; e < last; e += gl_WorkGroupSize.x) {
            const uint pair = first + ((e - first) / (2u * width)) * (2u * width);
            const uint middle = min(pair + width, last);
            const uint end = min(pair + 2u * width, last);
            const uvec2 key = read_run(in_binned, e);
            const bool left = e < middle;
            const uint rank = left ? (e - pair) + place(in_binned, middle, end, key, false)
                                   : (e - middle) + place(in_binned, pair, middle, key, true);
            if (is_last) {
                write_out(cam, pair + rank, key);
            } else {
                write_run(!in_binned, pair + rank, key);
            }
        }
        in_binned = !in_binned;
    }
}
