// readback: packets and APS frames into host memory, exactly as many bytes as there are events, in whole
// lines of the bus. Only on devices whose own memory the host reads slowly.
//
// 256 threads a workgroup, striding; y over cameras. A camera's part of `host` is its events' t, x, y and
// polarity and its APS frame, as planes sized by its capacity.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = 256) in;

BUFFER(readonly, SLOT_COUNTERS, Counters, counters);
BUFFER(readonly, SLOT_EVENT_T, uvec4, event_t);
BUFFER(readonly, SLOT_EVENT_X, uvec4, event_x);
BUFFER(readonly, SLOT_EVENT_Y, uvec4, event_y);
BUFFER(readonly, SLOT_EVENT_P, uvec4, event_p);
BUFFER(readonly, SLOT_APS, uvec4, aps);
BUFFER(writeonly, SLOT_HOST, uvec4, host);

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    if (cameras[index].phase != PHASE_INTERVAL) {
        return;
    }
    const Camera cam = cameras[index];
    const Counters counted = counters[2u * cam.slot + cam.parity];
    if (counted.staged_fit != 0xffffffffu || counted.crowded_strips != 0u) {
        return;
    }
    const uint events = cam.max_events == 0u ? counted.packet : min(counted.packet, cam.max_events);
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    const uint me = gl_GlobalInvocationID.x;
    // Planes begin on whole lines: capacities are multiples of 64 events.
    const uint x_base = cam.host_base + cam.event_capacity / 4u;
    const uint y_base = x_base + cam.event_capacity / 8u;
    const uint p_base = y_base + cam.event_capacity / 8u;
    const uint aps_base = p_base + cam.event_capacity / 16u;
    const uint quads = (events + 3u) / 4u;
    for (uint w = me; w < quads; w += stride) {
        host[cam.host_base + w] = event_t[cam.event_base / 4u + w];
    }
    const uint eights = (events + 7u) / 8u;
    for (uint w = me; w < eights; w += stride) {
        host[x_base + w] = event_x[cam.event_base / 8u + w];
        host[y_base + w] = event_y[cam.event_base / 8u + w];
    }
    const uint sixteens = (events + 15u) / 16u;
    for (uint w = me; w < sixteens; w += stride) {
        host[p_base + w] = event_p[cam.event_base / 16u + w];
    }
    const uint aps_lines = cam.aps_end_ns > cam.aps_start_ns ? (cam.pixels + 7u) / 8u : 0u;
    for (uint w = me; w < aps_lines; w += stride) {
        host[aps_base + w] = aps[cam.aps_base / 8u + w];
    }
}
