// How images are cut into workgroups: strips of four blocks side by side, or parts of them.

// A strip's pixels in a row.
const uint STRIP_PX = STRIP_BLOCKS * BLOCK_PX;

// First pixel of this workgroup, each of which takes `rows_px` rows of a strip.
uvec2 strip_corner(uint blocks_x, uint rows_px) {
    const uint strips_x = (blocks_x + STRIP_BLOCKS - 1u) / STRIP_BLOCKS;
    return uvec2((gl_WorkGroupID.x % strips_x) * STRIP_PX, (gl_WorkGroupID.x / strips_x) * rows_px);
}
