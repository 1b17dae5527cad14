// carry: events of earlier intervals whose time stamps lie beyond their packets join this packet, or
// wait on. They lie in `gathered`, behind the previous packet.
//
// 256 threads a workgroup over the late events of a camera, y over cameras. Runs beside `ingest`,
// before `cross`; puts them where `cross` puts its own.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = 256) in;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_BINS, uint, bins);
BUFFER(writeonly, SLOT_ROOMS, uvec2, rooms);
BUFFER(writeonly, SLOT_SPILLED, uvec2, spilled);
BUFFER(readonly, SLOT_GATHERED, uvec2, gathered);

const bool BRANCHES = true;
const bool AT_SAMPLE = true;

#include "bins.glsl"
#include "put.glsl"

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    if (cameras[index].phase != PHASE_INTERVAL) {
        return;
    }
    const Camera cam = cameras[index];
    const uint before = 2u * cam.slot + 1u - cam.parity;
    const uint now = 2u * cam.slot + cam.parity;
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    const uint first = cam.event_base + counters[before].packet;
    const uint late = counters[before].late;
    for (uint e = gl_GlobalInvocationID.x; e < late; e += stride) {
        uvec2 event = gathered[first + e];
        event.x -= cam.previous_interval_ns;
        uint bin = cam.bin_count;
        if (event.x <= cam.interval_ns) {
            event = uvec2(stamp_offset(cam, event.x), event.y & ~LATE);
            bin = bin_of(cam, event.x, event.y >> 1);
        }
        atomicAdd(counters[now].staged, 1u);
        put(cam, bin, event);
    }
}
