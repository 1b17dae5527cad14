// merge: packets whose largest bin is too much for one workgroup of `sort`, sorted as a whole by many.
// Where all pixels cross at once nearly every event is in one bin.
//
// 256 threads a workgroup, striding over runs of 256 events; y over cameras. Level 0 ranks runs of
// `gathered` into `spilled`, which `sort` has no more use for; each level after it, a dispatch of its own, merges
// runs of twice the length into the other buffer, each event finding its place by binary search, and a camera's last
// one writes the struct of arrays. `gathered` holds all events in whatever order `sort` left them; late events, which
// lie behind the packet, stay as they are.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = 256) in;

BUFFER(readonly, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_SPILLED, uvec2, spilled);
BUFFER(, SLOT_GATHERED, uvec2, gathered);
BUFFER(writeonly, SLOT_EVENT_T, uint, event_t);
BUFFER(writeonly, SLOT_EVENT_X, uint16_t, event_x);
BUFFER(writeonly, SLOT_EVENT_Y, uint16_t, event_y);
BUFFER(writeonly, SLOT_EVENT_P, uint8_t, event_p);

#include "runs.glsl"

uvec2 read_run(bool from_gathered, uint position) {
    return from_gathered ? gathered[position] : spilled[position];
}

void write_run(bool to_gathered, uint position, uvec2 event) {
    if (to_gathered) {
        gathered[position] = event;
    } else {
        spilled[position] = event;
    }
}

// The `length` events of `gathered` from `first` on, in order, into `spilled`, by a whole workgroup. It may be called
// again at once: all have read their keys when any passes its second barrier.
void rank_run(uint first, uint length) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < length) {
        keys[lane] = gathered[first + lane];
    }
    barrier();
    if (lane < length) {
        spilled[first + rank_among(lane, 0u, length)] = keys[lane];
    }
    barrier();
}

// Elements of the sorted run [first, last) that belong before `key`; among equals, the left run first.
uint place(bool in_gathered, uint first, uint last, uvec2 key, bool equals_too) {
    uint low = first;
    uint high = last;
    while (low < high) {
        const uint middle = (low + high) / 2u;
        const uvec2 other = read_run(in_gathered, middle);
        if (before(other, key) || (equals_too && other == key)) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low - first;
}

// Where `key`, which is event `e` of [first, last) in runs of `width`, goes when they are merged two by two.
uint merged(bool in_gathered, uint first, uint last, uint width, uint e, uvec2 key) {
    const uint pair = first + ((e - first) / (2u * width)) * (2u * width);
    const uint middle = min(pair + width, last);
    const uint end = min(pair + 2u * width, last);
    return e < middle ? e + place(in_gathered, middle, end, key, false)
                      : pair + (e - middle) + place(in_gathered, pair, middle, key, true);
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    if (cameras[index].phase != PHASE_INTERVAL) {
        return;
    }
    const Camera cam = cameras[index];
    const Counters counted = counters[2u * cam.slot + cam.parity];
    if (counted.staged_fit != 0xffffffffu || counted.crowded_strips != 0u
        || counted.largest_bin <= SORTABLE_EVENTS) {
        return;
    }
    const uint lane = gl_LocalInvocationID.x;
    const uint first = cam.event_base;
    const uint last = first + counted.packet;
    const uint start = first + gl_WorkGroupID.x * RUN_EVENTS;
    const uint stride = gl_NumWorkGroups.x * RUN_EVENTS;
    if (push.level == 0u) {
        for (uint run = start; run < last; run += stride) {
            rank_run(run, min(RUN_EVENTS, last - run));
        }
        return;
    }
    const uint width = RUN_EVENTS << (push.level - 1u);
    if (width >= counted.packet) {
        // Another camera's packet is larger.
        return;
    }
    const bool in_gathered = push.level % 2u == 0u;
    const bool is_last = 2u * width >= counted.packet;
    for (uint e = start + lane; e < last; e += stride) {
        const uvec2 key = read_run(in_gathered, e);
        const uint position = merged(in_gathered, first, last, width, e, key);
        if (is_last) {
            write_out(cam, position, key);
        } else {
            write_run(!in_gathered, position, key);
        }
    }
}
