// synthesize, second part: the levels of pixels at the ends of sub-steps. For GPUs; see levels.glsl.
//
// An entry of `level_entries` is some sub-steps of a block. A workgroup takes one after the other, with threads for each
// of its pixels that are not unoccluded, whose sub-steps they share out. So many threads of one pixel wait for memory at
// once, and none carries the state of a walk.
//
// Reads frames, and surfaces, poses and lists, or vectors and lists. Writes `levels`, which `cross` reads after a barrier.
#include "common.glsl"
#include "synthesize_constants.glsl"
#include "tiles.glsl"

layout(local_size_x = SYNTHESIZE_THREADS) in;

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
#include "unoccluded.glsl"
#include "layers.glsl"
#include "source.glsl"

float blend_frames(Source s, float alpha) {
    return synthesize_linear(exp(s.log_previous), exp(s.log_current), alpha);
}

void prepare_blend(Source s) {}

// The pixels of the block whose levels are made here, and their number.
shared uint listed_place[LEVEL_ROW_WORDS];
shared uint listed_places;

// Notes the pixels whose levels are made here, of those that a block's list names.
void load_places(uint row) {
    const uint lane = gl_LocalInvocationID.x;
    const uint low = levels[row * LEVEL_ROW_WORDS + LIST_PIXELS_WORD];
    const uint high = levels[row * LEVEL_ROW_WORDS + LIST_PIXELS_WORD + 1u];
    if (lane == 0u) {
        listed_places = uint(bitCount(low) + bitCount(high));
    }
    if (lane < LEVEL_ROW_WORDS && (((lane < 32u ? low : high) >> (lane % 32u)) & 1u) != 0u) {
        const uint before = (1u << (lane % 32u)) - 1u;
        const uint place = lane < 32u ? uint(bitCount(low & before)) : uint(bitCount(low) + bitCount(high & before));
        listed_place[place] = lane;
    }
}

// Loads the list of the block with this first pixel into shared memory.
void load_list(Camera cam, uint row, vec2 first) {
    const uint lane = gl_LocalInvocationID.x;
    const uint count = levels[row * LEVEL_ROW_WORDS];
    if (RIGID) {
        if (lane == 0u) {
            listed_count[0] = count;
        }
        if (lane < count) {
            const Geometry geo = geometries[cam.slot];
            const uint word = levels[row * LEVEL_ROW_WORDS + 1u + lane];
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
                words[word] = uintBitsToFloat(levels[row * LEVEL_ROW_WORDS + 1u + lane * LAYER_WORDS + word]);
            }
            found_place[lane] = vec4(words[0], words[1], words[2], words[3]);
            found_slopes[lane] = vec4(words[4], words[5], words[6], words[7]);
            found_before[lane] = vec2(words[8], words[9]);
            listed_layer[lane] = lane;
            note_vectors(lane, first, interval_ratio(cam));
        }
    }
}

// Synthesises this thread's sub-steps of an entry: those of pixel `at` from its `turn`th on, each `turns`th.
void synthesize_entry(Camera cam, uvec2 at, uint turn, uint turns, uvec4 entry) {
    const uint n = substeps_of_levels(entry.z);
    const uint last = min(entry.w + entry_substeps(listed_places), n);
    uint i = entry.w + turn;
    if (i >= last) {
        return;
    }
    const uint first_level = first_level_word(entry.z, at);
    const uint list = levels[first_level] & LIST_MASK;
    Source s = read_source(cam, at);
    const Geometry geo = geometry_of(cam);
    if (RIGID) {
        s.rigid = own_surfaces(cam, geo, at, ray_of(geo, vec2(at)));
        s.rigid.order = list;
    } else if (s.warps) {
        s.warp = warp_at(cam, at, s.leaves);
        s.layers = list;
        s.layer_block = 0u;
    }
    begin_count();
    const float inverse = 1.0 / float(n);
    do {
        bool lost;
        float level = level_of_many(cam, geo, s, n, i, float(i) * inverse, lost);
        if (lost) {
            level = level_of_lost(cam, s, float(i) * inverse);
        }
        levels[first_level + i * LEVEL_ROW_WORDS] = floatBitsToUint(level);
        i += turns;
    } while (i < last);
    const uint unseen = RIGID ? count_unseen(s, n) : 0u;
    if (unseen != 0u) {
        atomicAdd(levels[first_level], unseen << LIST_BITS);
    }
}

void main() {
    const uint count = level_entries[push.level].x;
    for (uint number = gl_WorkGroupID.x; number < count; number += gl_NumWorkGroups.x) {
        const uvec4 entry = level_entries[MOST_PASSES + number];
        if (entry.x < push.first_camera || entry.x - push.first_camera >= push.cameras) {
            // Of cameras with another kernel.
            continue;
        }
        const Camera cam = cameras[entry.x];
        const uint row = row_of_levels(entry.z) + substeps_of_levels(entry.z);
        barrier();
        const uvec2 first = uvec2(entry.y % cam.blocks_x, entry.y / cam.blocks_x) * BLOCK_PX;
        load_list(cam, row, vec2(first));
        load_places(row);
        barrier();
        const uint places = listed_places;
        const uint turns = min(gl_WorkGroupSize.x / places, entry_substeps(places));
        const uint turn = gl_LocalInvocationID.x / places;
        if (turn < turns) {
            const uint place = listed_place[gl_LocalInvocationID.x % places];
            const uvec2 at = first + uvec2(place % BLOCK_PX, place / BLOCK_PX);
            synthesize_entry(cam, at, turn, turns, entry);
        }
    }
}
