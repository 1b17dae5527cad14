// scatter: staged events to their bins, in any order within a bin, after an exclusive prefix sum over the
// bins; and the sizes of the packet and of its largest bin.
//
// 256 threads a workgroup; x workgroups stride over a camera's staged events, y over cameras. Each
// workgroup sums the bins for itself: they are few, and a dispatch of its own for them would cost more.
// Appends by `bin_cursors`, which `sort` clears with `bins`. The first workgroup writes the camera's
// `report` for the host, and makes the other set of counters ready for the next tick, whose late events
// `carry` has read by now.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "common.glsl"
#include "bins.glsl"

layout(local_size_x = 256) in;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(readonly, SLOT_BINS, uint, bins);
BUFFER(, SLOT_BIN_CURSORS, uint, bin_cursors);
BUFFER(writeonly, SLOT_BIN_STARTS, uint, bin_starts);
BUFFER(readonly, SLOT_STAGED, uvec2, staged);
BUFFER(writeonly, SLOT_BINNED, uvec2, binned);
BUFFER(writeonly, SLOT_REPORT, Counters, report);

shared uint subgroup_totals[64];
shared uint subgroup_largest[64];
shared uint run_starts[256];

// Sum (x) and largest (y) of the bins of this thread's run; runs are neighbours in order.
uvec2 run_sum(Camera cam, uint run) {
    const uint first = cam.bin_base + gl_LocalInvocationID.x * run;
    uvec2 sum = uvec2(0u);
    for (uint r = 0u; r < run; ++r) {
        const uint count = bins[first + r];
        sum = uvec2(sum.x + count, max(sum.y, count));
    }
    return sum;
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    if (cameras[index].phase == 0u) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    const uint counter = 2u * cam.slot + cam.parity;
    const Counters counted = counters[counter];
    const bool fitted = counted.staged_fit == 0xffffffffu && counted.crowded_strips == 0u;

    // bin_count is a multiple of 256, the late bin beside.
    const uint run = cam.bin_count / 256u;
    const uvec2 sum = run_sum(cam, run);
    const uint inclusive = subgroupInclusiveAdd(sum.x);
    const uint subgroup_max = subgroupMax(sum.y);
    if (gl_SubgroupInvocationID == gl_SubgroupSize - 1u) {
        subgroup_totals[gl_SubgroupID] = inclusive;
        subgroup_largest[gl_SubgroupID] = subgroup_max;
    }
    barrier();
    uint start = inclusive - sum.x;
    uint packet = 0u;
    uint largest_bin = 0u;
    for (uint s = 0u; s < gl_NumSubgroups; ++s) {
        const uint total = subgroup_totals[s];
        start += s < gl_SubgroupID ? total : 0u;
        packet += total;
        largest_bin = max(largest_bin, subgroup_largest[s]);
    }
    run_starts[lane] = start;
    const uint late = bins[cam.bin_base + cam.bin_count];
    barrier();

    if (gl_WorkGroupID.x == 0u && lane == 0u) {
        Counters result = counted;
        result.packet = packet;
        result.late = late;
        result.largest_bin = largest_bin;
        report[cam.slot] = result;
        if (fitted) {
            counters[counter].packet = packet;
            counters[counter].late = late;
            counters[counter].largest_bin = largest_bin;
            counters[2u * cam.slot + 1u - cam.parity] =
                Counters(0u, 0xffffffffu, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
        }
    }
    if (!fitted || cam.phase != PHASE_INTERVAL) {
        // Not all events fitted: the host makes room and `cross` goes on.
        return;
    }
    const uint events = packet + late;
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint e = gl_GlobalInvocationID.x; e < events; e += stride) {
        const uvec2 event = staged[cam.event_base + e];
        uint bin = cam.bin_count;
        uint bin_start = packet;
        if ((event.y & LATE) == 0u) {
            bin = bin_of(cam, event.x, event.y >> 1);
            const uint first = (bin / run) * run;
            bin_start = run_starts[bin / run];
            for (uint b = first; b < bin; ++b) {
                bin_start += bins[cam.bin_base + b];
            }
        }
        const uint place = atomicAdd(bin_cursors[cam.bin_base + bin], 1u);
        if (place == 0u) {
            // The first to come tells `sort` where the bin begins.
            bin_starts[cam.bin_base + bin] = bin_start;
        }
        binned[cam.event_base + bin_start + place] = event;
    }
}
