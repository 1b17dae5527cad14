// deferred: events of earlier intervals whose time stamps lay beyond their packets join this packet, or are deferred
// again. They lie in `gathered`, behind the previous packet.
//
// 256 threads per workgroup, striding over a camera's deferred events; y over cameras. Runs alongside `ingest` and
// before `cross`; scatters to the same bins.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = 256) in;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_BINS, uint, bins);
BUFFER(writeonly, SLOT_BIN_STORAGE, uvec2, bin_storage);
BUFFER(writeonly, SLOT_OVERFLOW, uvec2, overflow);
BUFFER(readonly, SLOT_GATHERED, uvec2, gathered);

const bool MAY_BIN_BY_SAMPLE = true;

#include "udiv_native.glsl"
#include "bins.glsl"
#include "subgroup_atomic.glsl"
#include "scatter.glsl"

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    if (cameras[index].frame_kind != FRAME_INTERVAL) {
        return;
    }
    const Camera cam = cameras[index];
    const uint before = 2u * cam.slot + 1u - cam.frame_slot;
    const uint now = 2u * cam.slot + cam.frame_slot;
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    const uint first = cam.event_base + counters[before].packet;
    const uint deferred = counters[before].deferred;
    for (uint e = gl_GlobalInvocationID.x; e < deferred; e += stride) {
        uvec2 event = gathered[first + e];
        event.x -= cam.previous_interval_ns;
        uint bin = cam.bin_count;
        if (event.x <= cam.interval_ns) {
            event = uvec2(stamp_offset(cam, event.x), event.y & ~DEFERRED);
            bin = bin_of(cam, event.x, event.y >> 1);
        }
        atomicAdd(counters[now].emitted, 1u);
        scatter(cam, bin, event);
    }
}
