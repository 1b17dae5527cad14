// Reading frames between their pixels. Needs frame_load_by_address.glsl or frame_load_by_texel.glsl.

#include "cell.glsl"
#include "frame_words.glsl"

// Cubic interpolation by twelve taps in four rows: the inner two rows by Keys' kernel (Keys 1981), the outer two, which
// weigh little, linearly. Clamped to the range of the middle four taps: ringing would cause false events. Keys' kernel
// is the straight line plus f (1 - f) times a term that is linear in f.
float cubic(CubicTaps taps, vec2 f, float a) {
    const vec2 g = 1.0 - f;
    const vec2 bend = f * g;
    const float outer = a * bend.x;
    const vec4 across = vec4(
        outer * g.x, fma(bend.x, fma(-(a + 2.0), f.x, 1.0), g.x),
        fma(bend.x, fma(-(a + 2.0), g.x, 1.0), f.x), outer * f.x);
    const float first = lerp(taps.above.x, taps.above.y, f.x);
    const float second =
        fma(across.w, taps.top.w, fma(across.z, taps.top.z, fma(across.y, taps.top.y, across.x * taps.top.x)));
    const float third = fma(
        across.w, taps.bottom.w,
        fma(across.z, taps.bottom.z, fma(across.y, taps.bottom.y, across.x * taps.bottom.x)));
    const float last = lerp(taps.below.x, taps.below.y, f.x);
    const float rise = third - second;
    const float bent = fma(f.y, fma(a, last - first, (a + 2.0) * rise), fma(a, first - third, -rise));
    const float sum = fma(bend.y, bent, fma(f.y, rise, second));
    const vec2 low = min(taps.top.yz, taps.bottom.yz);
    const vec2 high = max(taps.top.yz, taps.bottom.yz);
    return clamp(sum, min(low.x, low.y), max(high.x, high.y));
}

// A pixel position in half pixels, clamped to the image.
vec2 to_half_pel(Camera cam, vec2 position) {
    return clamp(2.0 * position, vec2(0.0), vec2(2u * uvec2(cam.width, cam.height) - 1u));
}

// Keys' parameter with which pixel `at` reads the half-pel frame at `base`.
float cubic_parameter(Camera cam, uint base, ivec2 at) {
    return load_plane(base + parameter_word(cam, uvec2(at) / BLOCK_PX));
}

// Interpolates a half-pel frame at `at`, in half pixels inside the image.
float half_pel_cubic(Camera cam, uint base, vec2 at, float parameter) {
    const vec2 low = floor(at);
    const vec2 f = at - low;
    const uint first = base + uint(low.y) * cam.half_pel_stride + uint(low.x) + 1u;
    return cubic(load_taps(cam, first), f, parameter);
}

// Bilinear interpolation of a frame that is not a half-pel frame.
float frame_bilinear(Camera cam, uint base, vec2 position) {
    const Cell cell = cell_at(cam, position);
    const uint top = base + uint(cell.low.y) * cam.width;
    const uint bottom = base + uint(cell.high.y) * cam.width;
    return lerp(
        lerp(load_plane(top + cell.low.x), load_plane(top + cell.high.x), cell.f.x),
        lerp(load_plane(bottom + cell.low.x), load_plane(bottom + cell.high.x), cell.f.x), cell.f.y);
}
