// Where a frame's words lie: as rows of pixels, or as the even entries of a lattice of half pixels.

// Words of a frame of one colour component, and the word of a pixel in it.
uint frame_words(Camera cam, bool lattice) {
    return lattice ? 4u * cam.pixels : cam.pixels;
}

uint frame_word(Camera cam, bool lattice, ivec2 at) {
    return lattice ? uint(2 * at.y) * (2u * cam.width) + uint(2 * at.x) : uint(at.y) * cam.width + uint(at.x);
}
