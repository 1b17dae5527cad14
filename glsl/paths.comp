// paths: poses at the ends of sub-steps, from those at POSE_INSTANTS instants of the interval, by Lagrange's
// interpolation over six of them. Only for cameras with synthesis `rigid`.
//
// Threads stride over instances and instants; y over cameras. Reads `poses`, which the host writes; writes `paths`,
// which `cross` reads after a barrier. Runs alongside `ingest`.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = PATHS_THREADS) in;

BUFFER(readonly, SLOT_POSES, vec4, poses);
BUFFER(writeonly, SLOT_PATHS, vec4, paths);

// Weights of six instants at a position between them, 0 to 5.
float[6] lagrange(float x) {
    const float x1 = x - 1.0;
    const float x2 = x - 2.0;
    const float x3 = x - 3.0;
    const float x4 = x - 4.0;
    const float x5 = x - 5.0;
    return float[6](
        x1 * x2 * x3 * x4 * x5 * (-1.0 / 120.0), x * x2 * x3 * x4 * x5 * (1.0 / 24.0),
        x * x1 * x3 * x4 * x5 * (-1.0 / 12.0), x * x1 * x2 * x4 * x5 * (1.0 / 12.0),
        x * x1 * x2 * x3 * x5 * (-1.0 / 24.0), x * x1 * x2 * x3 * x4 * (1.0 / 120.0));
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    if (cameras[index].frame_kind != FRAME_INTERVAL) {
        return;
    }
    const Camera cam = cameras[index];
    const Geometry geo = geometries[cam.slot];
    // Where every block has as many sub-steps, there are no others.
    const uint first_instant =
        cam.substeps_fixed != 0u && cam.substeps > 1u ? (cam.substeps - 1u) * (cam.substeps - 2u) / 2u : 0u;
    const uint instants = cam.substeps * (cam.substeps - 1u) / 2u - first_instant;
    const uint all = geo.instances * instants;
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint t = gl_GlobalInvocationID.x; t < all; t += stride) {
        const uint instance = t / instants;
        const uint instant = first_instant + t % instants;
        // The number of sub-steps whose instants hold this one: (n - 1)(n - 2) / 2 <= instant.
        uint n = uint(1.5 + sqrt(2.0 * float(instant) + 0.25));
        n -= uint((n - 1u) * (n - 2u) / 2u > instant);
        n += uint(n * (n - 1u) / 2u <= instant);
        const uint i = instant - (n - 1u) * (n - 2u) / 2u + 1u;
        const float place = float((POSE_INSTANTS - 1u) * i) / float(n);
        const uint base = uint(clamp(int(place) - 2, 0, int(POSE_INSTANTS) - 6));
        const float weights[6] = lagrange(place - float(base));
        const uint from = geo.pose_base + instance * POSE_ROWS + 3u * base;
        const uint to = geo.path_base + 3u * (instance * geo.path_instants + instant);
        for (uint axis = 0u; axis < 3u; ++axis) {
            // Differences to one of them, so that what rests stays exactly where it is.
            const vec4 centre = poses[from + 6u + axis];
            vec4 sum = vec4(0.0);
            [[unroll]] for (uint k = 0u; k < 6u; ++k) {
                sum = fma(vec4(weights[k]), poses[from + 3u * k + axis] - centre, sum);
            }
            paths[to + axis] = centre + sum;
        }
    }
}
