// Where a frame's words lie. Frames that are warped by cubic taps are lattices of half pixels: entry (X, Y) lies
// at pixel position (X/2, Y/2), so that entries with even X and Y are the frame itself. Around a lattice lies a
// margin of copies of its outermost entries, a row before and two after, so that no tap needs clamping; and two
// columns on either side, so that a pixel and its right half site are a pair that is written at once. Other frames are
// rows of pixels.

// Word of a pixel.
uint frame_word(Camera cam, bool lattice, ivec2 at) {
    return lattice ? uint(2 * at.y + 1) * cam.lattice_stride + uint(2 * at.x + 2) : uint(at.y) * cam.width + uint(at.x);
}
