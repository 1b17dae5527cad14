// Where a frame's words lie. A half-pel frame has its sample (X, Y) at pixel position (X/2, Y/2), so samples with even
// X and Y are the rendered frame. Its border holds copies of its outermost samples, so that taps need no clamping: one
// row before and two after, and two columns on either side, so that a pixel and its right half-pel sample are an
// aligned pair. At the end it has a word for each 8x8 block: the parameter with which the block's pixels read it. Other
// frames are rows of pixels.

// Word of a pixel.
uint frame_word(Camera cam, bool half_pel, ivec2 at) {
    return half_pel
        ? uint(2 * at.y + 1) * cam.half_pel_stride + uint(2 * at.x + 2)
        : uint(at.y) * cam.width + uint(at.x);
}

// Word of a block's parameter in a half-pel frame.
uint parameter_word(Camera cam, uvec2 block) {
    return cam.frame_words - cam.blocks + block.y * cam.blocks_x + block.x;
}
