// The blocks of a tile, and what passes them along exact paths. Needs tiles.glsl, surfaces.glsl and the buffer `passing`.

// First pixel of the tile or, where a workgroup takes a part of it, of that sub-tile.
uvec2 corner;

// Block of the tile's `b`th block.
uvec2 tile_block(uint b) {
    return corner / BLOCK_PX + uvec2(b, 0u);
}

// Whether the tile's `b`th block lies in the image.
bool has_block(Camera cam, uint b) {
    return tile_block(b).x < cam.blocks_x;
}

uint block_head(Camera cam, Geometry geo, uint b) {
    const uvec2 block = tile_block(b);
    return passing_head(cam, geo, block.y * cam.blocks_x + block.x);
}

// A word of the head of what passes a block; 0 beyond the image.
uint passing_word(Camera cam, uint b, uint word) {
    const Geometry geo = geometries[cam.slot];
    return has_block(cam, b) ? passing[block_head(cam, geo, b) + word] : 0u;
}

// Largest motion of what passes a block, as the bits of a float.
uint passing_motion(Camera cam, uint b) {
    return passing_word(cam, b, 1u);
}
