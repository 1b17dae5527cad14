// Reading frames between their pixels. Needs `planes` and BY_ADDRESS: whether the device reads faster by address
// than by a descriptor's index, as GPUs do and the software driver does not.

#extension GL_EXT_buffer_reference : require
#include "cell.glsl"
#include "frame_words.glsl"

// A row of a lattice by device address: neighbours are at constant offsets, which a load takes for nothing, while
// an index into a descriptor's buffer costs each load an address of its own.
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer LatticeRow { float v[]; };

// Weights of taps -1, 0, 1, 2 at fraction f (Keys 1981).
vec4 keys(float f, float a) {
    const float g = 1.0 - f;
    const float outer = a * f * g;
    const float first = outer * g;
    const float last = outer * f;
    const float inner = fma(fma(a + 2.0, f, -(a + 3.0)) * f, f, 1.0);
    return vec4(first, inner, 1.0 - first - inner - last, last);
}

// Sum of 4x4 taps, `rows` of them, within the range of the middle four: a reconstruction that rings would send
// events of its own.
float cubic(vec4 rows[4], vec4 wy, vec4 wx) {
    float sum = 0.0;
    [[unroll]] for (int j = 0; j < 4; ++j) {
        const float row = fma(wx.w, rows[j].w, fma(wx.z, rows[j].z, fma(wx.y, rows[j].y, wx.x * rows[j].x)));
        sum = fma(wy[j], row, sum);
    }
    const vec2 low = min(rows[1].yz, rows[2].yz);
    const vec2 high = max(rows[1].yz, rows[2].yz);
    return clamp(sum, min(low.x, low.y), max(high.x, high.y));
}

// The lattice at pixel position `position`, clamped to the image.
float lattice_cubic(Camera cam, uint base, vec2 position) {
    const vec2 at = clamp(2.0 * position, vec2(0.0), vec2(2u * uvec2(cam.width, cam.height) - 1u));
    const vec2 low = floor(at);
    const vec2 f = at - low;
    const uint first = base + uint(low.y) * cam.lattice_stride + uint(low.x);
    vec4 rows[4];
    if (BY_ADDRESS) {
        uint64_t row = cam.planes_address + 4ul * first;
        [[unroll]] for (int j = 0; j < 4; ++j) {
            LatticeRow taps = LatticeRow(row);
            rows[j] = vec4(taps.v[0], taps.v[1], taps.v[2], taps.v[3]);
            row += 4u * cam.lattice_stride;
        }
    } else {
        [[unroll]] for (uint j = 0u; j < 4u; ++j) {
            const uint row = first + j * cam.lattice_stride;
            rows[j] = vec4(planes[row], planes[row + 1u], planes[row + 2u], planes[row + 3u]);
        }
    }
    return cubic(rows, keys(f.y, CUBIC_LATTICE), keys(f.x, CUBIC_LATTICE));
}

// Bilinear on a frame without a lattice.
float frame_bilinear(Camera cam, uint base, vec2 position) {
    const Cell cell = cell_at(cam, position);
    const uint top = base + uint(cell.low.y) * cam.width;
    const uint bottom = base + uint(cell.high.y) * cam.width;
    return blend(
        blend(planes[top + cell.low.x], planes[top + cell.high.x], cell.f.x),
        blend(planes[bottom + cell.low.x], planes[bottom + cell.high.x], cell.f.x), cell.f.y);
}
