// Reading frames between their pixels. Needs texels.glsl.

#extension GL_EXT_buffer_reference : require
#include "cell.glsl"
#include "frame_words.glsl"

// A row of a lattice by device address: neighbours are at constant offsets, which a load takes for nothing, while
// an index into a descriptor's buffer costs each load an address of its own. What is added to the address has 32 bits,
// which a load adds for nothing as well; a buffer has no more bytes than that.
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer LatticeRow { float v[]; };

// Twelve taps, of four rows: the inner two by Keys' kernel (Keys 1981), the outer two, which weigh little, straight
// from the second tap to the third. Within the range of the middle four: a reconstruction that rings would send events
// of its own. Keys' kernel is the straight line and f (1 - f) times what is itself linear in f.
float cubic(vec2 above, vec4 top, vec4 bottom, vec2 below, vec2 f, float a) {
    const vec2 g = 1.0 - f;
    const vec2 bend = f * g;
    const float outer = a * bend.x;
    const vec4 across = vec4(
        outer * g.x, fma(bend.x, fma(-(a + 2.0), f.x, 1.0), g.x),
        fma(bend.x, fma(-(a + 2.0), g.x, 1.0), f.x), outer * f.x);
    const float first = blend(above.x, above.y, f.x);
    const float second = fma(across.w, top.w, fma(across.z, top.z, fma(across.y, top.y, across.x * top.x)));
    const float third = fma(across.w, bottom.w, fma(across.z, bottom.z, fma(across.y, bottom.y, across.x * bottom.x)));
    const float last = blend(below.x, below.y, f.x);
    const float rise = third - second;
    const float bent = fma(f.y, fma(a, last - first, (a + 2.0) * rise), fma(a, first - third, -rise));
    const float sum = fma(bend.y, bent, fma(f.y, rise, second));
    const vec2 low = min(top.yz, bottom.yz);
    const vec2 high = max(top.yz, bottom.yz);
    return clamp(sum, min(low.x, low.y), max(high.x, high.y));
}

// A pixel position in half pixels, clamped to the image.
vec2 to_lattice(Camera cam, vec2 position) {
    return clamp(2.0 * position, vec2(0.0), vec2(2u * uvec2(cam.width, cam.height) - 1u));
}

// The lattice at `at`, half pixels inside the image.
float lattice_cubic(Camera cam, uint base, vec2 at) {
    const vec2 low = floor(at);
    const vec2 f = at - low;
    const uint first = base + uint(low.y) * cam.lattice_stride + uint(low.x) + 1u;
    if (BY_ADDRESS) {
        const uint row = 4u * cam.lattice_stride;
        const uint64_t above = cam.planes_address + 4u * first;
        const uint64_t top = cam.planes_address + (4u * first + row);
        const uint64_t bottom = cam.planes_address + (4u * first + 2u * row);
        const uint64_t below = cam.planes_address + (4u * first + 3u * row);
        return cubic(
            vec2(LatticeRow(above).v[1], LatticeRow(above).v[2]),
            vec4(LatticeRow(top).v[0], LatticeRow(top).v[1], LatticeRow(top).v[2], LatticeRow(top).v[3]),
            vec4(LatticeRow(bottom).v[0], LatticeRow(bottom).v[1], LatticeRow(bottom).v[2], LatticeRow(bottom).v[3]),
            vec2(LatticeRow(below).v[1], LatticeRow(below).v[2]), f, CUBIC_LATTICE);
    }
    const uint top = first + cam.lattice_stride;
    const uint bottom = top + cam.lattice_stride;
    const uint below = bottom + cam.lattice_stride;
    return cubic(
        vec2(plane_at(first + 1u), plane_at(first + 2u)),
        vec4(plane_at(top), plane_at(top + 1u), plane_at(top + 2u), plane_at(top + 3u)),
        vec4(plane_at(bottom), plane_at(bottom + 1u), plane_at(bottom + 2u), plane_at(bottom + 3u)),
        vec2(plane_at(below + 1u), plane_at(below + 2u)), f, CUBIC_LATTICE);
}

// Bilinear on a frame without a lattice.
float frame_bilinear(Camera cam, uint base, vec2 position) {
    const Cell cell = cell_at(cam, position);
    const uint top = base + uint(cell.low.y) * cam.width;
    const uint bottom = base + uint(cell.high.y) * cam.width;
    return blend(
        blend(plane_at(top + cell.low.x), plane_at(top + cell.high.x), cell.f.x),
        blend(plane_at(bottom + cell.low.x), plane_at(bottom + cell.high.x), cell.f.x), cell.f.y);
}
