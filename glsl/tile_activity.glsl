// A tile's blocks: what moves and changes in and around them, and how many sub-steps they have. For `cross` and the
// lists of `synthesize`. Called by whole workgroups, whose threads are the pixels of some rows of a tile.
//
// The including file provides, before this one: RIGID and LAYERED (whether surfaces are followed along exact paths, or
// told apart by motion vectors), SKIPS_STILL_TILES, LOOKS_FIRST (whether it is found out if a tile is still),
// FOLLOWS_MOTION, surfaces.glsl, block_pairs.glsl and the buffers `blocks`, `representatives`, `passing` and `meetings`; after it: the functions
// that are declared here without a body.

#include "tile_blocks.glsl"

// Rows of a sub-tile, and sub-tiles of a tile.
const uint SUB_TILE_ROWS = gl_WorkGroupSize.x / TILE_WIDTH_PX;
const uint SUB_TILES = uint(BLOCK_PX) / SUB_TILE_ROWS;

// Largest motion in each block of the tile and the blocks around it, and the block's own change. Along exact paths,
// vectors count there only where there is no path.
shared uint neighbourhood_motion[TILE_BLOCKS];
shared uint own_change[TILE_BLOCKS];
// Along exact paths: the largest motion of what passes each block; what of it the textures around need; and a bit for
// each block whose sub-steps are by speed, because it has a silhouette or one passes it.
shared uint longest_way[RIGID ? TILE_BLOCKS : 1u];
shared uint needed_way[RIGID ? TILE_BLOCKS : 1u];
shared uint by_speed;
// All bits of both together, gathered only where still tiles are looked for.
shared uint any_activity;

// Pixel that a thread takes, row by row from `corner`.
uint place_of(uint thread);

// Empties what the workgroup fills later; called by its first thread. Then every thread notes what it knows.
void begin_tile();
void note_own();

// Whether the sub-steps of a block of key frame `key` follow its texture: where it has no silhouette.
bool is_smooth_block(Camera cam, uint key, uvec2 block, uint of_texture) {
    const uint word = representative_word(cam, geometries[cam.slot], key, block.y * cam.blocks_x + block.x);
    return (of_texture & HAS_TEXTURE) != 0u && (representatives[word] & HAS_SILHOUETTE) == 0u;
}

// Notes what a block of a frame, around or at the tile's `b`th block (`is_own`), says about sub-steps along exact
// paths.
void note_texture_need(Camera cam, uint b, uint of_texture, bool is_smooth, bool is_own) {
    if (is_smooth) {
        const float way_px = uintBitsToFloat(passing_motion(cam, b));
        const float way_bend_px = uintBitsToFloat(passing_word(cam, b, 2u));
        atomicMax(needed_way[b], floatBitsToUint(needed_on_way(cam, of_texture, way_px, way_bend_px)));
    } else if (is_own) {
        atomicOr(by_speed, 1u << b);
    }
}

// Bits of the largest motion of what passes the tile's `b`th block where motions meet; 0 if nothing does.
uint meeting_motion(Camera cam, uint b) {
    const uvec2 block = corner / BLOCK_PX + uvec2(b, 0u);
    return block.x < cam.blocks_x ? meetings[meeting_of_block(cam, block)] : 0u;
}

// Whether motions meet in the tile.
bool motions_meet(Camera cam) {
    uint any = 0u;
    [[unroll]] for (uint b = 0u; b < TILE_BLOCKS; ++b) {
        any |= meeting_motion(cam, b);
    }
    return any != 0u;
}

// This thread's pixel.
uvec2 sub_tile_pixel() {
    const uint place = place_of(gl_LocalInvocationID.x);
    return corner + uvec2(place % TILE_WIDTH_PX, place / TILE_WIDTH_PX);
}

// Whether this thread does the counting for its block.
bool counts_block(Camera cam) {
    const uint lane = gl_LocalInvocationID.x;
    return lane < TILE_WIDTH_PX && lane % BLOCK_PX == 0u && corner.x + lane < cam.width;
}

// The tile's blocks, as this thread addresses them.
struct TileBlocks {
    // Number of the thread's own block in the tile, and its element of `blocks`.
    uint in_tile;
    uint own_block;
    // Element of the tile's first block, whose word z has a bit for each row of the tile that is done.
    uint first_block;
    uint rows_done;
};

TileBlocks find_blocks(Camera cam) {
    const uint in_tile = (gl_LocalInvocationID.x % TILE_WIDTH_PX) / BLOCK_PX;
    const uvec2 block_at = uvec2(min(corner.x / BLOCK_PX + in_tile, cam.blocks_x - 1u), corner.y / BLOCK_PX);
    const uint row_base = cam.block_base + cam.frame_slot * cam.blocks + block_at.y * cam.blocks_x;
    const uint first_block = row_base + corner.x / BLOCK_PX;
    return TileBlocks(in_tile, row_base + block_at.x, first_block, blocks[first_block].z);
}

// Loads into shared memory the largest motion in and around each block of the tile, and each block's own change. Called
// by the whole workgroup; ends with a barrier.
void load_activity(Camera cam, TileBlocks tile) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < TILE_BLOCKS) {
        neighbourhood_motion[lane] = 0u;
        own_change[lane] = 0u;
        if (RIGID) {
            longest_way[lane] = 0u;
            needed_way[lane] = 0u;
        }
    }
    if (lane == 0u) {
        begin_tile();
        any_activity = 0u;
        if (RIGID) {
            by_speed = 0u;
        }
    }
    barrier();
    note_own();
    // Nine blocks around each of four, in both frames.
    const uint loads = RIGID || FOLLOWS_MOTION ? 18u * TILE_BLOCKS : 0u;
    for (uint load = lane; load < loads; load += gl_WorkGroupSize.x) {
        const uint which_block = load / 18u;
        const uint neighbour = load % 18u;
        const ivec2 near = ivec2(corner / BLOCK_PX) + ivec2(which_block, 0)
            + ivec2(int(neighbour % 3u) - 1, int((neighbour / 3u) % 3u) - 1);
        const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
        if (all(greaterThanEqual(near, ivec2(0))) && all(lessThanEqual(near, last_block))) {
            const uint which = neighbour < 9u ? cam.frame_slot : 1u - cam.frame_slot;
            const uvec4 near_block =
                blocks[cam.block_base + which * cam.blocks + uint(near.y) * cam.blocks_x + uint(near.x)];
            atomicMax(neighbourhood_motion[which_block], near_block.x);
            if (LOOKS_FIRST) {
                atomicOr(any_activity, near_block.x);
            }
            if (RIGID) {
                const bool is_smooth = is_smooth_block(cam, neighbour < 9u ? 1u : 0u, uvec2(near), near_block.w);
                note_texture_need(cam, which_block, near_block.w, is_smooth, neighbour % 9u == 4u);
            }
        }
    }
    if (RIGID && lane < TILE_BLOCKS) {
        const uint passing_bits = passing_motion(cam, lane);
        longest_way[lane] = passing_bits;
        if (passing_word(cam, lane, 0u) != 0u) {
            atomicOr(by_speed, 1u << lane);
        }
        if (LOOKS_FIRST) {
            atomicOr(any_activity, passing_bits);
        }
    }
    if (LAYERED && lane < TILE_BLOCKS) {
        const uint meeting_bits = meeting_motion(cam, lane);
        atomicMax(neighbourhood_motion[lane], meeting_bits);
        if (LOOKS_FIRST) {
            atomicOr(any_activity, meeting_bits);
        }
    }
    if (counts_block(cam)) {
        const uint change_bits = blocks[tile.own_block].y;
        own_change[tile.in_tile] = change_bits;
        if (LOOKS_FIRST) {
            atomicOr(any_activity, change_bits);
        }
    }
    barrier();
}

// Sub-steps of this thread's block.
uint substeps_of_block(Camera cam, TileBlocks tile) {
    if (SYNTHESIS == SYNTHESIS_NONE) {
        return 1u;
    }
    float motion_px = uintBitsToFloat(neighbourhood_motion[tile.in_tile]);
    float change_log = uintBitsToFloat(own_change[tile.in_tile]);
    if (RIGID) {
        float way_px = uintBitsToFloat(longest_way[tile.in_tile]);
        if (((by_speed >> tile.in_tile) & 1u) == 0u) {
            way_px = motion_on_way(cam, way_px, uintBitsToFloat(needed_way[tile.in_tile]), change_log);
            change_log = 0.0;
        }
        motion_px = max(motion_px, way_px);
    }
    return substep_count(cam, motion_px, change_log);
}

// Whether nothing in and around the tile moves or changes, as far as that is looked for; and the thread's own block.
bool is_still_tile() {
    return LOOKS_FIRST && any_activity == 0u;
}

bool is_still_block(TileBlocks tile) {
    const uint way = RIGID ? longest_way[tile.in_tile] : 0u;
    return (neighbourhood_motion[tile.in_tile] | way | own_change[tile.in_tile]) == 0u;
}

// Whether a tile, if it is still, can be skipped.
bool skips_still(Camera cam) {
    return SKIPS_STILL_TILES && cam.no_skip == 0u;
}
