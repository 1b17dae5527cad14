// bin_sums: sums the bins of cameras in chunks of SUMMED_BINS, for `sort` of rigs with so many bins that each of its
// workgroups would take long to sum them all.
//
// 256 threads per workgroup, one workgroup per chunk; x over chunks, y over cameras. Runs between `cross` and `sort`. Reads
// the counts of the tick's bins; writes the sum and the largest of each chunk behind them.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "common.glsl"

layout(local_size_x = 256) in;

BUFFER(, SLOT_BINS, uint, bins);

const bool MAY_BIN_BY_SAMPLE = true;

#include "udiv_native.glsl"
#include "bins.glsl"

shared uint sum_of_chunk;
shared uint largest_of_chunk;

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint first = gl_WorkGroupID.x * SUMMED_BINS;
    if (cameras[index].frame_kind == FRAME_NONE || first >= cameras[index].bin_count) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    if (lane == 0u) {
        sum_of_chunk = 0u;
        largest_of_chunk = 0u;
    }
    barrier();
    const uint own = bins_of(cam, cam.frame_slot);
    uint sum = 0u;
    uint largest = 0u;
    for (uint b = first + lane; b < min(first + SUMMED_BINS, cam.bin_count); b += gl_WorkGroupSize.x) {
        const uint count = bins[own + b];
        sum += count;
        largest = max(largest, count);
    }
    sum = subgroupAdd(sum);
    largest = subgroupMax(largest);
    if (subgroupElect()) {
        atomicAdd(sum_of_chunk, sum);
        atomicMax(largest_of_chunk, largest);
    }
    barrier();
    if (lane == 0u) {
        bins[sums_of(cam) + 2u * gl_WorkGroupID.x] = sum_of_chunk;
        bins[sums_of(cam) + 2u * gl_WorkGroupID.x + 1u] = largest_of_chunk;
    }
}
