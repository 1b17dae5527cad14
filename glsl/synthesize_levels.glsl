// synthesize, second part: the levels of pixels at the ends of sub-steps. For GPUs; see levels.glsl.
//
// An entry of `level_entries` is some sub-steps of a block. A workgroup has threads for each of its pixels, whose sub-steps
// they share out. So many threads of one pixel wait for memory at once, and none carries the state of a walk.
//
// Along exact paths this makes the levels away from silhouettes, and leaves the others to the third part.
//
// Reads frames, and surfaces, poses and lists, or vectors and lists. Writes `levels`, which `cross` reads after a barrier.
#include "common.glsl"
#include "synthesize_constants.glsl"
#include "tiles.glsl"

layout(local_size_x = SYNTHESIZE_THREADS) in;

#include "synthesize_entries.glsl"
#include "rigid_steady.glsl"

// Sub-steps of a pixel that are synthesised at once.
const uint LANES_A_PIXEL = gl_WorkGroupSize.x / ROW_WORDS;

void take_entry(Camera cam, uvec4 entry) {
    const uint n = substeps_of_levels(entry.z);
    load_list(cam, (entry.z >> ROW_SHIFT) + n);
    barrier();
    const uint place = gl_LocalInvocationID.x % ROW_WORDS;
    const uvec2 at = corner_of_entry(cam, entry) + uvec2(place % BLOCK_PX, place / BLOCK_PX);
    const uint last = min(entry.w + ENTRY_SUBSTEPS, n);
    uint i = entry.w + gl_LocalInvocationID.x / ROW_WORDS;
    if (at.x >= cam.width || at.y >= cam.height || i >= last) {
        return;
    }
    const uint first_level = first_level_word(entry.z, at);
    const Geometry geo = geometry_of(cam);
    const Source s = source_of_entry(cam, geo, at, levels[first_level] & LIST_MASK);
    const float inverse = 1.0 / float(n);
    do {
        const float alpha = float(i) * inverse;
        uint word = UNSETTLED;
        if (RIGID) {
            bool settled = false;
            if (s.rigid.own != NO_SURFACE) {
                const float level = synthesize_steady(cam, geo, s.frames, at, s.rigid, n, i, alpha, settled);
                word = settled ? floatBitsToUint(max(level, cam.log_dark)) : UNSETTLED;
            }
        } else {
            word = floatBitsToUint(synthesize_substep(cam, geo, s, n, i, alpha));
        }
        levels[first_level + i * ROW_WORDS] = word;
        i += LANES_A_PIXEL;
    } while (i < last);
}

void main() {
    take_entries();
}
