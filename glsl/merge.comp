// merge: sorts whole packets that are too heavy for `sort` (see `is_heavy` there), as when all pixels cross at once.
//
// 256 threads per workgroup, striding over tiles of RUN_EVENTS events; y over cameras. `gathered` holds the events in
// any order. Level 0 sorts each of its tiles in shared memory, into `overflow`, with which `sort` is done. Each further
// level is a dispatch that merges runs to twice the length, into the other buffer. A workgroup finds which part of
// either run its tile of the result consists of (where the merge path of the two runs crosses the tile's first and last
// diagonal: Green, McColl and Bader, GPU Merge Path, 2012) and merges these in shared memory. A camera's last level
// writes the struct of arrays, but leaves events with a bus before them where `readout` looks for them. Deferred events behind the packet stay as they are.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common.glsl"

layout(local_size_x = 256) in;

BUFFER(readonly, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_OVERFLOW, uvec2, overflow);
BUFFER(, SLOT_GATHERED, uvec2, gathered);
BUFFER(writeonly, SLOT_EVENT_T, uint, event_t);
BUFFER(writeonly, SLOT_EVENT_X, uint16_t, event_x);
BUFFER(writeonly, SLOT_EVENT_Y, uint16_t, event_y);
BUFFER(writeonly, SLOT_EVENT_P, uint8_t, event_p);

#include "readouts.glsl"
#include "udiv_native.glsl"
#include "event_order.glsl"

const uint EVENTS_PER_THREAD = RUN_EVENTS / gl_WorkGroupSize.x;

// Threads that search for one of a tile's two cuts.
const uint SEEKERS = gl_WorkGroupSize.x / 2u;

// Events of the tile.
shared uvec2 keys[RUN_EVENTS];

#include "bitonic_sort.glsl"

// The range that the cut lies in, for the tile's first diagonal and for its last.
shared uint cut_low[2];
shared uint cut_high[2];

uvec2 read_run(bool from_gathered, uint position) {
    return from_gathered ? gathered[position] : overflow[position];
}

void write_tile(Camera cam, bool to_packet, bool to_gathered, uint first, uint length) {
    for (uint e = gl_LocalInvocationID.x; e < length; e += gl_WorkGroupSize.x) {
        if (to_packet) {
            write_out(cam, first + e, keys[e]);
        } else if (to_gathered) {
            gathered[first + e] = keys[e];
        } else {
            overflow[first + e] = keys[e];
        }
    }
}

// Two sorted runs, one after the other in a buffer.
struct Pair {
    bool in_gathered;
    uint left;
    uint left_length;
    uint right;
    uint right_length;
};

// How many events of the left run are among the first `diagonal` of both merged, for two diagonals at once. Among
// equals, the left run comes first. Each half of the workgroup narrows one range by its number of threads a round.
uvec2 cuts(Pair runs, uvec2 diagonals) {
    const uint which = gl_LocalInvocationID.x / SEEKERS;
    const uint seeker = gl_LocalInvocationID.x % SEEKERS;
    const uint diagonal = diagonals[which];
    if (seeker == 0u) {
        cut_low[which] = diagonal - min(diagonal, runs.right_length);
        cut_high[which] = min(diagonal, runs.left_length);
    }
    barrier();
    while (cut_low[0] != cut_high[0] || cut_low[1] != cut_high[1]) {
        const uint low = cut_low[which];
        const uint room = cut_high[which] - low;
        barrier();
        if (room != 0u) {
            const uint at = low + (room / SEEKERS) * seeker + ((room % SEEKERS) * seeker) / SEEKERS;
            const uvec2 left = read_run(runs.in_gathered, runs.left + at);
            const uvec2 right = read_run(runs.in_gathered, runs.right + diagonal - 1u - at);
            if (before(right, left)) {
                atomicMin(cut_high[which], at);
            } else {
                atomicMax(cut_low[which], at + 1u);
            }
        }
        barrier();
    }
    return uvec2(cut_low[0], cut_low[1]);
}

// How many of keys [first, last), which are sorted, belong before `key`; those that equal it count if `equals_too`.
uint place(uint first, uint last, uvec2 key, bool equals_too) {
    uint low = first;
    uint high = last;
    while (low < high) {
        const uint middle = (low + high) / 2u;
        const uvec2 other = keys[middle];
        if (before(other, key) || (equals_too && other == key)) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low - first;
}

// Leaves events [begin, end) of the merged runs in `keys`.
void merge_tile(Pair runs, uint begin, uint end) {
    const uint lane = gl_LocalInvocationID.x;
    const uvec2 cut = cuts(runs, uvec2(begin, end));
    const uint of_left = cut.y - cut.x;
    const uint length = end - begin;
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        const uint from = e < of_left ? runs.left + cut.x + e : runs.right + (begin - cut.x) + (e - of_left);
        keys[e] = read_run(runs.in_gathered, from);
    }
    barrier();
    uvec2 own[EVENTS_PER_THREAD];
    uint at[EVENTS_PER_THREAD];
    [[unroll]] for (uint i = 0u; i < EVENTS_PER_THREAD; ++i) {
        const uint e = i * gl_WorkGroupSize.x + lane;
        if (e < length) {
            own[i] = keys[e];
            at[i] = e < of_left ? e + place(of_left, length, own[i], false)
                                : e - of_left + place(0u, of_left, own[i], true);
        }
    }
    barrier();
    [[unroll]] for (uint i = 0u; i < EVENTS_PER_THREAD; ++i) {
        if (i * gl_WorkGroupSize.x + lane < length) {
            keys[at[i]] = own[i];
        }
    }
    barrier();
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    if (cameras[index].frame_kind != FRAME_INTERVAL) {
        return;
    }
    const Camera cam = cameras[index];
    const Counters counted = counters[2u * cam.slot + cam.frame_slot];
    // Length of the sorted runs before this level. A run that holds the whole packet needs no merging.
    const uint width = push.level == 0u ? 0u : RUN_EVENTS << (push.level - 1u);
    if (counted.emitted_fit != 0xffffffffu || (counted.queue_overflows | counted.without_levels) != 0u || counted.heavy == 0u
        || width >= counted.packet) {
        return;
    }
    const bool in_gathered = push.level % 2u == 0u;
    const bool before_bus = push.outlets == 0u && readouts[cam.slot].has_bus != 0u;
    const bool to_packet = max(RUN_EVENTS, 2u * width) >= counted.packet && !before_bus;
    const uint stride = gl_NumWorkGroups.x * RUN_EVENTS;
    for (uint start = gl_WorkGroupID.x * RUN_EVENTS; start < counted.packet; start += stride) {
        const uint end = min(start + RUN_EVENTS, counted.packet);
        if (push.level == 0u) {
            for (uint e = start + gl_LocalInvocationID.x; e < end; e += gl_WorkGroupSize.x) {
                keys[e - start] = gathered[cam.event_base + e];
            }
            barrier();
            bitonic_sort(end - start);
        } else {
            const uint pair = start - start % (2u * width);
            const uint of_left = min(width, counted.packet - pair);
            const uint of_right = min(width, counted.packet - pair - of_left);
            const uint left = cam.event_base + pair;
            merge_tile(Pair(in_gathered, left, of_left, left + of_left, of_right), start - pair, end - pair);
        }
        write_tile(cam, to_packet, !in_gathered, cam.event_base + start, end - start);
        barrier();
    }
}
