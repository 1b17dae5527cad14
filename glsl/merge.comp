// merge: sorts whole packets that are too heavy for `sort` (see `is_heavy` there), as when all pixels cross at once.
//
// 256 threads per workgroup, striding over tiles of RUN_EVENTS events; y over cameras. push.level is the pass
// (merge_passes.glsl). `gathered` holds the events bin by bin, and `overflow` those that their bins had no room for. To
// merge two runs, a workgroup finds which part of either run its tile of the result consists of (where the merge path of
// the two runs crosses the tile's first and last diagonal: Green, McColl and Bader, GPU Merge Path, 2012) and merges these
// in shared memory. A camera's last pass writes the struct of arrays, but leaves events with a bus before them where
// `readout` looks for them. Deferred events behind the packet stay as they are.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "common.glsl"

layout(local_size_x = 256) in;

BUFFER(readonly, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_BINS, uint, bins);
BUFFER(, SLOT_OVERFLOW, uvec2, overflow);
BUFFER(, SLOT_GATHERED, uvec2, gathered);
BUFFER(writeonly, SLOT_EVENT_T, uint, event_t);
BUFFER(writeonly, SLOT_EVENT_X, uint16_t, event_x);
BUFFER(writeonly, SLOT_EVENT_Y, uint16_t, event_y);
BUFFER(writeonly, SLOT_EVENT_P, uint8_t, event_p);

const bool MAY_BIN_BY_SAMPLE = true;

#include "readouts.glsl"
#include "udiv_native.glsl"
#include "bins.glsl"
#include "event_order.glsl"
#include "merge_passes.glsl"

const uint EVENTS_PER_THREAD = RUN_EVENTS / gl_WorkGroupSize.x;

// Threads that search for one of a tile's two cuts.
const uint SEEKERS = gl_WorkGroupSize.x / 2u;

// Events of the tile.
shared uvec2 keys[RUN_EVENTS];

#include "bitonic_sort.glsl"
#include "split_sort.glsl"

// The range that the cut lies in, for the tile's first diagonal and for its last.
shared uint cut_low[2];
shared uint cut_high[2];

uvec2 read_run(bool from_gathered, uint position) {
    return from_gathered ? gathered[position] : overflow[position];
}

// Writes the tile's events from number `first` on. `split`: in the order that `split_sort` has found.
void write_tile(Camera cam, bool to_packet, bool to_gathered, uint first, uint length, bool split) {
    for (uint e = gl_LocalInvocationID.x; e < length; e += gl_WorkGroupSize.x) {
        const uvec2 key = keys[split ? uint(in_order[e]) : e];
        if (to_packet) {
            write_out(cam, first + e, key);
        } else if (to_gathered) {
            gathered[first + e] = key;
        } else {
            overflow[first + e] = key;
        }
    }
}

// Moves the events of the overflow to their bins' places.
void bring_overflow(Camera cam, Counters counted) {
    for (uint i = gl_GlobalInvocationID.x; i < counted.overflow; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        const uvec2 event = overflow[cam.event_base + i];
        if ((event.y & DEFERRED) == 0u) {
            const uint bin = bin_of(cam, event.x, event.y >> 1);
            gathered[cam.event_base + atomicAdd(bins[room_of(cam) + bin], 1u)] = event;
        }
    }
}

// Two sorted runs, or parts of them, one after the other in a buffer.
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

// The runs that the tile from number `start` of the packet on is merged of. Pairs of runs meet at every second multiple of
// `length`, or (`across`) pairs of halves at every multiple of twice that.
Pair runs_of(Camera cam, bool in_gathered, uint start, uint length, bool across, uint packet) {
    const uint pair = (across ? start + length : start) / (2u * length);
    const uint middle = min(2u * length * pair + (across ? 0u : length), packet);
    const uint left = middle - min(middle, length);
    return Pair(in_gathered, cam.event_base + left, middle - left, cam.event_base + middle, min(length, packet - middle));
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    if (cameras[index].frame_kind != FRAME_INTERVAL) {
        return;
    }
    const Camera cam = cameras[index];
    const Counters counted = counters[2u * cam.slot + cam.frame_slot];
    const uint passes = merge_passes(counted);
    if (counted.emitted_fit != 0xffffffffu || (counted.queue_overflows | counted.without_levels) != 0u || counted.heavy == 0u
        || push.level >= passes) {
        return;
    }
    if (push.level == 0u) {
        bring_overflow(cam, counted);
        return;
    }
    const bool in_gathered = push.level % 2u == 1u;
    const bool before_bus = push.outlets == 0u && readouts[cam.slot].has_bus != 0u;
    const bool to_packet = push.level + 1u == passes && !before_bus;
    // Runs that are merged in this pass, or their halves.
    const uint before_pass = RUN_EVENTS << (push.level - min(push.level, FIRST_MERGE));
    const bool across = before_pass == longest_run(counted);
    const uint length = across ? before_pass / 2u : before_pass;
    const uint stride = gl_NumWorkGroups.x * RUN_EVENTS;
    for (uint start = gl_WorkGroupID.x * RUN_EVENTS; start < counted.packet; start += stride) {
        const uint end = min(start + RUN_EVENTS, counted.packet);
        bool split = false;
        if (push.level < FIRST_MERGE) {
            for (uint e = start + gl_LocalInvocationID.x; e < end; e += gl_WorkGroupSize.x) {
                keys[e - start] = gathered[cam.event_base + e];
            }
            barrier();
            split = split_sort(end - start);
            if (!split) {
                bitonic_sort(end - start);
            }
        } else {
            const Pair runs = runs_of(cam, in_gathered, start, length, across, counted.packet);
            const uint pair = runs.left - cam.event_base;
            merge_tile(runs, start - pair, end - pair);
        }
        write_tile(cam, to_packet, !in_gathered, cam.event_base + start, end - start, split);
        barrier();
    }
}
