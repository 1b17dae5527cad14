// event_frame: counts of OFF and ON events of each pixel, `[camera][2][row][column]`.
//
// 256 threads per workgroup, striding over a camera's events; y over cameras. The target must hold zeros. Sums are of
// integers, so the order of the atomics does not matter.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "slices.glsl"

layout(local_size_x = 256) in;

void main() {
    const Slice slice = slice_of_workgroup();
    Ints counts = Ints(push.target);
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint e = gl_GlobalInvocationID.x; e < slice.events; e += stride) {
        const uint from = slice.event_base + e;
        const uint pixel = uint(event_y[from]) * slice.width + uint(event_x[from]);
        atomicAdd(counts.v[slice.first + uint(event_p[from]) * slice.pixels + pixel], 1);
    }
}
