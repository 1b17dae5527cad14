// How images are cut into workgroups: strips of four blocks side by side, or parts of them.

// A strip's pixels in a row.
const uint STRIP_PX = STRIP_BLOCKS * BLOCK_PX;

uint strips_across(uint blocks_x) {
    return (blocks_x + STRIP_BLOCKS - 1u) / STRIP_BLOCKS;
}

// First pixel of a strip.
uvec2 strip_corner(uint blocks_x, uint strip) {
    const uint across = strips_across(blocks_x);
    return uvec2((strip % across) * STRIP_PX, (strip / across) * BLOCK_PX);
}

uint strip_count(Camera cam) {
    return strips_across(cam.blocks_x) * (cam.blocks / cam.blocks_x);
}
