// voxel_grid: votes of +1 or -1 that each event splits between the two time bins next to it,
// `[camera][bin][row][column]` (Zhu et al., Unsupervised Event-based Learning of Optical Flow, Depth and Egomotion,
// CVPR 2019, equations 1 to 3). Bin b stands for the instant b / (bins - 1) of the interval.
//
// 256 threads per workgroup, striding over events or, at level 1, voxels; y over cameras. The target must hold zeros.
// Level 0 sums votes in fixed point, so the order of the atomics does not matter; level 1 turns the sums into floats,
// in place.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "slices.glsl"

layout(local_size_x = 256) in;

layout(buffer_reference, std430) writeonly buffer Floats { float v[]; };

const int VOTE = 1 << VOTE_FRACTION_BITS;

void main() {
    const Slice slice = slice_of_workgroup();
    Ints votes = Ints(push.target);
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    if (push.level == 1u) {
        Floats values = Floats(push.target);
        for (uint v = gl_GlobalInvocationID.x; v < push.bins * slice.pixels; v += stride) {
            const int sum = votes.v[slice.first + v];
            values.v[slice.first + v] = float(sum) / float(VOTE);
        }
        return;
    }
    for (uint e = gl_GlobalInvocationID.x; e < slice.events; e += stride) {
        const uint from = slice.event_base + e;
        const uint64_t scaled = uint64_t(since_start_ns(slice, event_t[from])) * uint64_t(push.bins - 1u) << VOTE_FRACTION_BITS;
        const uint place = uint(scaled / uint64_t(slice.interval_ns));
        const uint bin = place >> VOTE_FRACTION_BITS;
        const int second = int(place & uint(VOTE - 1));
        const int sign = event_p[from] == uint8_t(1) ? 1 : -1;
        const uint pixel = uint(event_y[from]) * slice.width + uint(event_x[from]);
        const uint voxel = slice.first + bin * slice.pixels + pixel;
        atomicAdd(votes.v[voxel], sign * (VOTE - second));
        if (second != 0) {
            atomicAdd(votes.v[voxel + slice.pixels], sign * second);
        }
    }
}
