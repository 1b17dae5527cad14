// synthesize, third part: the levels along exact paths that the second part has left, those at silhouettes, of unseen
// surfaces and of pixels without a path. For GPUs; see levels.glsl.
//
// Few samples are such, but they take long and many registers. So a workgroup collects those of an entry, and its threads
// share them out.
//
// Reads what the second part reads. Updates `levels`, which `cross` reads after a barrier.
#version 460
#extension GL_GOOGLE_include_directive : require

#define RIGID true
#define LAYERED false

#include "common.glsl"
#include "synthesize_constants.glsl"
#include "tiles.glsl"

layout(local_size_x = SILHOUETTE_THREADS) in;

#include "synthesize_entries.glsl"

// Samples that are left: the pixel's place in its row, and above it the sub-step after the entry's first.
shared uint left_count;
shared uint left[ENTRY_SUBSTEPS * ROW_WORDS];

void take_entry(Camera cam, uvec4 entry) {
    const uint lane = gl_LocalInvocationID.x;
    const uint n = substeps_of_levels(entry.z);
    const uint row = entry.z >> ROW_SHIFT;
    const uvec2 corner = corner_of_entry(cam, entry);
    if (lane == 0u) {
        left_count = 0u;
    }
    barrier();
    const uint samples = min(ENTRY_SUBSTEPS, n - entry.w) * ROW_WORDS;
    for (uint sample_number = lane; sample_number < samples; sample_number += gl_WorkGroupSize.x) {
        const uint place = sample_number % ROW_WORDS;
        const uvec2 at = corner + uvec2(place % BLOCK_PX, place / BLOCK_PX);
        if (at.x < cam.width && at.y < cam.height && levels[(row + entry.w) * ROW_WORDS + sample_number] == UNSETTLED) {
            left[atomicAdd(left_count, 1u)] = sample_number;
        }
    }
    barrier();
    const uint count = left_count;
    if (count == 0u) {
        return;
    }
    load_list(cam, row + n);
    barrier();
    const Geometry geo = geometry_of(cam);
    const float inverse = 1.0 / float(n);
    for (uint number = lane; number < count; number += gl_WorkGroupSize.x) {
        const uint place = left[number] % ROW_WORDS;
        const uint i = entry.w + left[number] / ROW_WORDS;
        const uvec2 at = corner + uvec2(place % BLOCK_PX, place / BLOCK_PX);
        const uint first_level = row * ROW_WORDS + place;
        const Source s = source_of_entry(cam, geo, at, levels[first_level] & LIST_MASK);
        begin_count();
        const float level = synthesize_substep(cam, geo, s, n, i, float(i) * inverse);
        levels[first_level + i * ROW_WORDS] = floatBitsToUint(level);
        const uint unseen = count_unseen(s, n);
        if (unseen != 0u) {
            atomicAdd(levels[first_level], unseen << LIST_BITS);
        }
    }
}

void main() {
    take_entries();
}
