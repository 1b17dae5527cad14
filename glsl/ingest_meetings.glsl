// Where motions meet, for synthesis `motion` with several layers. Part of ingest.glsl; twin of the oracle's
// `layers::candidates`. Needs block_pairs.glsl.

// For each block of the tile, the two neighbours whose vectors differ most: how much, in sixteenths of a pixel, and below
// it seven bits, the larger the earlier the pair is in the block. 0 if none differ by more than MEET_PX.
shared uint largest_pair[TILE_BLOCKS];

const uint PAIR_BITS = 7u;
const uint LAST_PAIR = (1u << PAIR_BITS) - 1u;
const float PAIR_UNITS = 16.0;
const float MOST_PAIR_UNITS = 16777215.0;

// The vector of a pixel of the tile or right or below of it. `known` becomes false if it has none.
vec2 vector_near(Camera cam, ivec2 at, inout bool known) {
    known = known && at.x < int(cam.width) && at.y < int(cam.height);
    if (!known) {
        return vec2(0.0);
    }
    if (HALF_PEL) {
        const vec2 m = cached_motion[cache_index(at)];
        known = m.x != NOWHERE_PX;
        return m;
    }
    return to_usable(read_motion(cam, uint(at.y) * cam.width + uint(at.x)), known);
}

// Compares a pixel of the tile with those right and below.
void compare_vectors(Camera cam, uint number) {
    const uvec2 in_tile = uvec2(number % TILE_WIDTH_PX, number / TILE_WIDTH_PX);
    const ivec2 at = tile_origin + ivec2(in_tile);
    bool has_own = true;
    const vec2 own = vector_near(cam, at, has_own);
    [[unroll]] for (uint way = 0u; way < 2u; ++way) {
        bool known = has_own;
        const vec2 apart = abs(vector_near(cam, at + (way == 0u ? ivec2(1, 0) : ivec2(0, 1)), known) - own);
        const uint units = uint(min(floor(max(apart.x, apart.y) * PAIR_UNITS), MOST_PAIR_UNITS));
        if (known && float(units) > MEET_PX * PAIR_UNITS) {
            const uint place = (in_tile.y * BLOCK_PX + in_tile.x % BLOCK_PX) * 2u + way;
            atomicMax(largest_pair[in_tile.x / BLOCK_PX], (units << PAIR_BITS) | (LAST_PAIR - place));
        }
    }
}

bool motions_meet_in_tile() {
    uint most = 0u;
    [[unroll]] for (uint block = 0u; block < TILE_BLOCKS; ++block) {
        most |= largest_pair[block];
    }
    return most != 0u;
}

// The word of a block of the tile for its pair.
uint pair_word(uint block) {
    return largest_pair[block] == 0u ? 0u : PAIR_MARK | (LAST_PAIR - (largest_pair[block] & LAST_PAIR));
}

// Tells every block that what meets in the tile's blocks passes it their largest motion, and counts those that hear of it
// first.
void mark_meetings(Camera cam) {
    const uint side = 1u + 2u * LAYER_REACH_BLOCKS;
    const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
    for (uint item = gl_LocalInvocationID.x; item < TILE_BLOCKS * side * side; item += gl_WorkGroupSize.x) {
        const uint in_tile = item % TILE_BLOCKS;
        const uint pair = pair_word(in_tile);
        if (pair == 0u) {
            continue;
        }
        const uint place = item / TILE_BLOCKS;
        const ivec2 block = tile_origin / int(BLOCK_PX) + ivec2(in_tile, 0);
        const ivec2 to = block + ivec2(place % side, place / side) - int(LAYER_REACH_BLOCKS);
        if (any(lessThan(to, ivec2(0))) || any(greaterThan(to, last_block))) {
            continue;
        }
        const ivec2 first = pixel_of_pair(block, pair);
        bool known = true;
        const vec2 motions[2] =
            vec2[2](vector_near(cam, first, known), vector_near(cam, first + way_of_pair(pair), known));
        if (passes_block(block, motions[0], to) || passes_block(block, motions[1], to)) {
            const float longest = max(length(motions[0]), length(motions[1]));
            if (atomicMax(meetings[meeting_of_block(cam, uvec2(to))], floatBitsToUint(longest)) == 0u) {
                atomicAdd(counters[2u * cam.slot + cam.frame_slot].meeting_blocks, 1u);
            }
        }
    }
}

// Clears what the frame before told, for the frame after this one. So a camera may change its layers at any time.
void clear_meetings(Camera cam, uint in_tile) {
    const uint block = (uint(tile_origin.y) / BLOCK_PX) * cam.blocks_x + uint(tile_origin.x) / BLOCK_PX + in_tile;
    meetings[cam.block_base + (1u - cam.frame_slot) * cam.blocks + block] = 0u;
}
