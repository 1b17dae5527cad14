// A half-pel frame by device address.
#extension GL_EXT_buffer_reference : require

// The twelve samples that `cubic` reads, row by row.
struct CubicTaps {
    vec2 above;
    vec4 top;
    vec4 bottom;
    vec2 below;
};

// A row of a half-pel frame. Neighbours are at constant offsets, which are free in a load; an index into a
// descriptor's buffer costs each load an address computation. The offset added to the address has 32 bits, which is
// free as well; no buffer of a rig is larger than that.
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer HalfPelRow { float v[]; };

CubicTaps load_taps_by_address(Camera cam, uint first) {
    const uint row = 4u * cam.half_pel_stride;
    const uint64_t above = cam.planes_address + 4u * first;
    const uint64_t top = cam.planes_address + (4u * first + row);
    const uint64_t bottom = cam.planes_address + (4u * first + 2u * row);
    const uint64_t below = cam.planes_address + (4u * first + 3u * row);
    return CubicTaps(
        vec2(HalfPelRow(above).v[1], HalfPelRow(above).v[2]),
        vec4(HalfPelRow(top).v[0], HalfPelRow(top).v[1], HalfPelRow(top).v[2], HalfPelRow(top).v[3]),
        vec4(HalfPelRow(bottom).v[0], HalfPelRow(bottom).v[1], HalfPelRow(bottom).v[2], HalfPelRow(bottom).v[3]),
        vec2(HalfPelRow(below).v[1], HalfPelRow(below).v[2]));
}
