// Images are cut into tiles for workgroups: four blocks side by side.

// Pixels of a tile in a row.
const uint TILE_WIDTH_PX = TILE_BLOCKS * BLOCK_PX;

uint tiles_across(uint blocks_x) {
    return (blocks_x + TILE_BLOCKS - 1u) / TILE_BLOCKS;
}

// First pixel of a tile.
uvec2 tile_corner(uint blocks_x, uint tile) {
    const uint across = tiles_across(blocks_x);
    return uvec2((tile % across) * TILE_WIDTH_PX, (tile / across) * BLOCK_PX);
}

uint tile_count(Camera cam) {
    return tiles_across(cam.blocks_x) * (cam.blocks / cam.blocks_x);
}
