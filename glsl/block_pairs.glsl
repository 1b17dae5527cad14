// The two neighbouring pixels of a block whose vectors differ most, and which blocks what moves like them passes.

// A block's word for its pair: this mark, the first pixel's place in the block times two, and 1 if the second pixel is
// below it, not right of it. 0 if motions do not meet in the block.
const uint PAIR_MARK = 0x100u;

ivec2 pixel_of_pair(ivec2 block, uint pair) {
    const uint place = (pair & 0xffu) >> 1;
    return block * int(BLOCK_PX) + ivec2(place % BLOCK_PX, place / BLOCK_PX);
}

ivec2 way_of_pair(uint pair) {
    return (pair & 1u) == 0u ? ivec2(1, 0) : ivec2(0, 1);
}

// Whether what moves by `motion` from a block passes another.
bool passes_block(ivec2 from, vec2 motion, ivec2 to) {
    const vec2 first = vec2(from * int(BLOCK_PX));
    const vec2 goal = vec2(to * int(BLOCK_PX));
    const float side = float(BLOCK_PX - 1u);
    const vec2 low = first + min(motion, vec2(0.0)) - LAYER_REACH_PX;
    const vec2 high = first + side + max(motion, vec2(0.0)) + LAYER_REACH_PX;
    return all(lessThanEqual(low, goal + side)) && all(greaterThanEqual(high, goal));
}

// Element of a block in `meetings` of this tick: the bits of the largest motion of what passes it where motions meet, 0
// if nothing does.
uint meeting_of_block(Camera cam, uvec2 block) {
    return cam.block_base + cam.frame_slot * cam.blocks + block.y * cam.blocks_x + block.x;
}
