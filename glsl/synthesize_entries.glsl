// Entries of `level_entries`, as the kernels of `synthesize` that make levels take them; see levels.glsl. A workgroup takes
// one after the other. The including file provides, before this one: RIGID, LAYERED, the size of the workgroup; after it:
// `take_entry`.

#include "synthesize_bindings.glsl"
BUFFER(, SLOT_LEVELS, uint, levels);
BUFFER(readonly, SLOT_LEVEL_ENTRIES, uvec4, level_entries);

const bool FOLLOWS_MOTION = SYNTHESIS_FOLLOWS_MOTION(SYNTHESIS);
#define LIST_BLOCKS 1u

#include "frame_load_by_address.glsl"
#include "synthesize.glsl"
#include "surfaces.glsl"
#include "levels.glsl"
#include "paths.glsl"
#include "candidates.glsl"
#include "rigid.glsl"
#include "layers.glsl"
#include "source.glsl"

float blend_frames(Source s, float alpha) {
    return synthesize_linear(exp(s.log_previous), exp(s.log_current), alpha);
}

void prepare_blend(Source s) {}

// Loads a block's list into shared memory.
void load_list(Camera cam, uint row) {
    const uint lane = gl_LocalInvocationID.x;
    const uint count = levels[row * ROW_WORDS];
    if (RIGID) {
        if (lane == 0u) {
            listed_count[0] = count;
        }
        if (lane < count) {
            const Geometry geo = geometries[cam.slot];
            const uint word = levels[row * ROW_WORDS + 1u + lane];
            const uint pixel = word & ~PASSING_KEY;
            bool seen = true;
            const Surface surface =
                surface_of_pixel(cam, geo, word >> 31, ivec2(pixel % cam.width, pixel / cam.width), seen);
            listed_instance[lane] = surface.instance;
            listed_parallax[lane] = parallax_of(geo, surface.instance);
            listed_plane[2u * lane] = surface.planes[0];
            listed_plane[2u * lane + 1u] = surface.planes[1];
        }
    } else {
        if (lane == 0u) {
            layer_count[0] = count;
        }
        if (lane < count) {
            float words[LAYER_WORDS];
            [[unroll]] for (uint word = 0u; word < LAYER_WORDS; ++word) {
                words[word] = uintBitsToFloat(levels[row * ROW_WORDS + 1u + lane * LAYER_WORDS + word]);
            }
            found_place[lane] = vec4(words[0], words[1], words[2], words[3]);
            found_slopes[lane] = vec4(words[4], words[5], words[6], words[7]);
            found_before[lane] = vec2(words[8], words[9]);
            listed_layer[lane] = lane;
        }
    }
}

// What a pixel of an entry follows. The block's list is loaded.
Source source_of_entry(Camera cam, Geometry geo, uvec2 at, uint list) {
    Source s = read_source(cam, at);
    if (RIGID) {
        s.rigid = own_surfaces(cam, geo, at, ray_of(geo, vec2(at)));
        s.rigid.order = list;
    } else if (s.warps) {
        s.warp = warp_at(cam, at, s.leaves);
        s.layers = list;
        s.layer_block = 0u;
    }
    return s;
}

// First pixel of an entry's block.
uvec2 corner_of_entry(Camera cam, uvec4 entry) {
    return uvec2(entry.y % cam.blocks_x, entry.y / cam.blocks_x) * BLOCK_PX;
}

// Makes levels of an entry. Called by the whole workgroup, which has barriers between two entries.
void take_entry(Camera cam, uvec4 entry);

void take_entries() {
    const uint count = level_entries[push.level].x;
    for (uint number = gl_WorkGroupID.x; number < count; number += gl_NumWorkGroups.x) {
        const uvec4 entry = level_entries[MOST_PASSES + number];
        if (entry.x < push.first_camera || entry.x - push.first_camera >= push.cameras) {
            // Of cameras with another kernel.
            continue;
        }
        barrier();
        take_entry(cameras[entry.x], entry);
    }
}
