// The texture of a tile's blocks in a half-pel frame: how far it bends, for the number of sub-steps, and how rough it is,
// which gives the parameter with which the block's pixels read the frame. The equations are in the model crate's
// `synthesis`. Part of ingest.glsl, whose tile cache it reads; needs ingest_bends.glsl.

// Sums of the squared differences of each block's pixels to their neighbours, and of their squared second differences, of
// each component that the workgroup takes.
const uint ROUGH_BLOCKS = HALF_PEL ? COMPONENTS * TILE_BLOCKS : 1u;
shared uint rough_first[ROUGH_BLOCKS];
shared uint rough_second[ROUGH_BLOCKS];

void begin_roughness(uint lane) {
    if (lane < ROUGH_BLOCKS) {
        rough_first[lane] = 0u;
        rough_second[lane] = 0u;
    }
}

// A pixel's part of its block's sums; `cached` is its place in the cache.
uvec2 roughness_of(uint cached) {
    const float level = cached_level[cached];
    const vec4 near = vec4(
        cached_level[cached - 1u], cached_level[cached + 1u], cached_level[cached - CACHE_X],
        cached_level[cached + CACHE_X]);
    const vec4 first = near - level;
    const vec2 second = near.xz + near.yw - 2.0 * level;
    return uvec2(min(vec2(0.5 * dot(first, first), dot(second, second)), MOST_ROUGH) * ROUGHNESS_STEPS);
}

// Notes the largest bend and slope of each block, if `bends`, and adds up its roughness. Called by the whole workgroup, whose
// threads each stay in one block.
void sum_texture(Camera cam, bool bends) {
    const uint lane = gl_LocalInvocationID.x;
    vec2 largest = vec2(0.0);
    uvec2 sums[COMPONENTS];
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        sums[k] = uvec2(0u);
    }
    uint number = lane;
    do {
        const ivec2 in_tile = ivec2(number % TILE_WIDTH_PX, number / TILE_WIDTH_PX);
        if (all(lessThan(tile_origin + in_tile, ivec2(cam.width, cam.height)))) {
            if (bends) {
                largest = max(largest, bend_and_slope(in_tile));
            }
            [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
                sums[k] += roughness_of(k * CACHE_PIXELS + cache_index(tile_origin + in_tile));
            }
        }
        number += gl_WorkGroupSize.x;
    } while (number < TILE_ANCHORS);
    const uint block = (lane % TILE_WIDTH_PX) / BLOCK_PX;
    if (bends) {
        note_bend(block, largest);
    }
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        atomicAdd(rough_first[k * TILE_BLOCKS + block], sums[k].x);
        atomicAdd(rough_second[k * TILE_BLOCKS + block], sums[k].y);
    }
}

// Writes the parameters of the tile's blocks; `channel` is the first component that the workgroup takes.
void write_parameters(Camera cam, uint channel) {
    const uint lane = gl_LocalInvocationID.x;
    const uint block = lane % TILE_BLOCKS;
    if (lane < ROUGH_BLOCKS && uint(tile_origin.x) + block * BLOCK_PX < cam.width) {
        const float roughness = float(rough_second[lane]) / float(max(rough_first[lane], 1u));
        const float fine = clamp((roughness - SMOOTH_ROUGHNESS) / (FINE_ROUGHNESS - SMOOTH_ROUGHNESS), 0.0, 1.0);
        const uint frame = frame_of(cam, cam.frame_slot, channel + lane / TILE_BLOCKS);
        planes[frame + parameter_word(cam, uvec2(tile_origin) / BLOCK_PX + uvec2(block, 0u))] =
            lerp(CUBIC_SMOOTH, CUBIC_SHARP, fine);
    }
}
