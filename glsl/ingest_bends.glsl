// How far the levels of a tile's blocks bend along their motion, where sub-steps follow that (SUBSTEPS_BY_ERROR); for
// synthesis `rigid` in any direction, since `cross` knows the way. Twin of the model crate's `needed_motion_px` and
// `BlockTexture`. Needs the tile cache of ingest.glsl, with its apron, and what it knows of blocks.

// Largest in each block, as the bits of floats.
shared uint block_bend[TILE_BLOCKS];
shared uint block_slope[TILE_BLOCKS];

void begin_bends(uint in_tile) {
    block_bend[in_tile] = 0u;
    block_slope[in_tile] = 0u;
}

// Bend and slope of the level in the cache at `centre` along `m`; for synthesis `rigid` the largest, for a pixel of motion.
vec2 bend_and_slope_at(uint centre, vec2 m) {
    const uint above = centre - CACHE_X;
    const uint below = centre + CACHE_X;
    const float left = cached_level[centre - 1u];
    const float right = cached_level[centre + 1u];
    const float twice = 2.0 * cached_level[centre];
    const vec2 second = vec2(left + right - twice, cached_level[above] + cached_level[below] - twice);
    const float mixed = 0.25
        * (cached_level[below + 1u] - cached_level[below - 1u] - cached_level[above + 1u] + cached_level[above - 1u]);
    const vec2 first = 0.5 * vec2(right - left, cached_level[below] - cached_level[above]);
    if (RIGID) {
        const float largest = abs(second.x + second.y) + length(vec2(second.x - second.y, 2.0 * mixed));
        return vec2(0.5 * largest, length(first));
    }
    return abs(vec2(dot(second, m * m) + 2.0 * mixed * m.x * m.y, dot(first, m)));
}

// The same of the level at `in_tile` along its vector: the largest of all colour components, as what is there may pass
// pixels of every colour.
vec2 bend_and_slope(ivec2 in_tile) {
    const uint centre = cache_index(tile_origin + in_tile);
    const vec2 m = RIGID ? vec2(0.0) : cached_motion[centre];
    if (m.x == NOWHERE_PX) {
        return vec2(0.0);
    }
    vec2 largest = vec2(0.0);
    [[unroll]] for (uint k = 0u; k < CACHED_COMPONENTS; ++k) {
        largest = max(largest, bend_and_slope_at(k * CACHE_PIXELS + centre, m));
    }
    return largest;
}

// Notes a bend and a slope of a block.
void note_bend(uint in_tile, vec2 largest) {
    atomicMax(block_bend[in_tile], floatBitsToUint(largest.x));
    atomicMax(block_slope[in_tile], floatBitsToUint(largest.y));
}

// Bits of the motion of a block as its number of sub-steps needs it.
uint needed_motion(Camera cam, uint in_tile) {
    const uint bits = block_motion[in_tile];
    if (RIGID || !SUBSTEPS_BY_ERROR || bits == 0u) {
        return bits;
    }
    const float needed_px =
        needed_for_bend(cam, uintBitsToFloat(block_bend[in_tile]), uintBitsToFloat(block_slope[in_tile]));
    const float most_px = most_needed(cam, uintBitsToFloat(bits), uintBitsToFloat(block_change[in_tile]));
    return floatBitsToUint(min(max(needed_px, LEAST_NEEDED_PX), most_px));
}

// The texture of a block, for synthesis `rigid`.
uint block_texture(uint in_tile) {
    return texture_word(uintBitsToFloat(block_bend[in_tile]), uintBitsToFloat(block_slope[in_tile]));
}

// Bits of the change of a block as its number of sub-steps needs it. Where each pixel follows a vector, a change does not
// bend the level, but the block is not still.
uint needed_change(uint in_tile) {
    const uint bits = block_change[in_tile];
    const bool follows = !RIGID && SUBSTEPS_BY_ERROR && block_invalid_motion[in_tile] == 0u;
    return follows ? min(bits, floatBitsToUint(1e-12)) : bits;
}
