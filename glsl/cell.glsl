// The four pixels around a position, for bilinear reads.
#ifndef CELL_GLSL
#define CELL_GLSL

// Pixels up and left, and down and right, of the position; `f` is the position in between, 0 to 1.
struct Cell {
    ivec2 low;
    ivec2 high;
    vec2 f;
};

// The cell around a position, which is clamped to the image.
Cell cell_at(Camera cam, vec2 position) {
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const vec2 inside = clamp(position, vec2(0.0), vec2(last));
    const ivec2 low = ivec2(floor(inside));
    return Cell(low, min(low + 1, last), inside - vec2(low));
}

#endif
