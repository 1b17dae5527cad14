// Loads of `planes` and `motion` through texel buffers, unless BY_ADDRESS. Only for words that this kernel does not
// write. The software driver reads a storage buffer one lane after the other, but fetches eight texels at once. Larger
// buffers than a texel buffer may be are read by address.
#include "half_pel_row.glsl"

layout(set = 0, binding = SLOT_PLANE_TEXELS) uniform textureBuffer plane_texels;
layout(set = 0, binding = SLOT_MOTION_TEXELS) uniform textureBuffer motion_texels;

float load_plane(uint word) {
    return BY_ADDRESS ? planes[word] : texelFetch(plane_texels, int(word)).x;
}

vec2 load_motion(uint element) {
    return BY_ADDRESS ? motion[element] : texelFetch(motion_texels, int(element)).xy;
}

// Entry `i` of a row of a half-pel frame whose first entry is word `row`.
float load_in_row(Camera cam, uint row, uint i) {
    return BY_ADDRESS ? HalfPelRow(cam.planes_address + 4u * row).v[i] : load_plane(row + i);
}

// The twelve taps of a cell; word `first` is the entry up and left of the cell.
CubicTaps load_taps(Camera cam, uint first) {
    if (BY_ADDRESS) {
        return load_taps_by_address(cam, first);
    }
    const uint top = first + cam.half_pel_stride;
    const uint bottom = top + cam.half_pel_stride;
    const uint below = bottom + cam.half_pel_stride;
    return CubicTaps(
        vec2(load_plane(first + 1u), load_plane(first + 2u)),
        vec4(load_plane(top), load_plane(top + 1u), load_plane(top + 2u), load_plane(top + 3u)),
        vec4(load_plane(bottom), load_plane(bottom + 1u), load_plane(bottom + 2u), load_plane(bottom + 3u)),
        vec2(load_plane(below + 1u), load_plane(below + 2u)));
}
