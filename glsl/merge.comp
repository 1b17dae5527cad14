// merge: packets whose largest bin is too much for one workgroup of `sort`, sorted as a whole by many.
// Where all pixels cross at once nearly every event is in one bin.
//
// 256 threads a workgroup, striding over runs of 256 events; y over cameras. Level 0 ranks runs of
// `binned` into `staged`; each level after it, a dispatch of its own, merges runs of twice the length into
// the other buffer, and a camera's last one writes the struct of arrays. `binned` holds all events of each
// bin, in whatever order `sort` left them; late events, which lie behind the packet, stay as they are.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = 256) in;

BUFFER(readonly, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_STAGED, uvec2, staged);
BUFFER(, SLOT_BINNED, uvec2, binned);
BUFFER(writeonly, SLOT_EVENT_T, uint, event_t);
BUFFER(writeonly, SLOT_EVENT_X, uint16_t, event_x);
BUFFER(writeonly, SLOT_EVENT_Y, uint16_t, event_y);
BUFFER(writeonly, SLOT_EVENT_P, uint8_t, event_p);

#include "runs.glsl"

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
            const uint length = min(RUN_EVENTS, last - run);
            rank_run(run, length);
            if (lane < length) {
                staged[run + lane] = ranked[lane];
            }
        }
        return;
    }
    const uint width = RUN_EVENTS << (push.level - 1u);
    if (width >= counted.packet) {
        // Another camera's packet is larger.
        return;
    }
    const bool in_binned = push.level % 2u == 0u;
    const bool is_last = 2u * width >= counted.packet;
    for (uint e = start + lane; e < last; e += stride) {
        const uvec2 key = read_run(in_binned, e);
        const uint position = merged(in_binned, first, last, width, e, key);
        if (is_last) {
            write_out(cam, position, key);
        } else {
            write_run(!in_binned, position, key);
        }
    }
}
