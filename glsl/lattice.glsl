// A frame's log intensity on a lattice of half pixels: entry (X, Y) lies at pixel position (X/2, Y/2), so
// that entries with even X and Y are the frame itself. Row-major, two words a pixel and row. Frames without
// a lattice are rows of pixels. Needs `planes`.

#include "frame_words.glsl"

// Weights of taps -1, 0, 1, 2 at fraction f (Keys 1981).
vec4 keys(float f, float a) {
    const float g = 1.0 - f;
    const float outer = a * f * g;
    const float first = outer * g;
    const float last = outer * f;
    const float inner = ((a + 2.0) * f - (a + 3.0)) * f * f + 1.0;
    return vec4(first, inner, 1.0 - first - inner - last, last);
}

// Cubic through 4x4 taps at the given offsets of rows and columns, clamped to the middle four's range:
// a reconstruction that rings would send events of its own.
float cubic_taps(uint base, uvec4 rows, uvec4 columns, vec4 wy, vec4 wx) {
    float sum = 0.0;
    float low = 3.0e38;
    float high = -3.0e38;
    [[unroll]] for (int j = 0; j < 4; ++j) {
        const uint row = base + rows[j];
        const vec4 taps = vec4(
            planes[row + columns.x], planes[row + columns.y], planes[row + columns.z], planes[row + columns.w]);
        sum += wy[j] * dot(wx, taps);
        if (j == 1 || j == 2) {
            low = min(low, min(taps.y, taps.z));
            high = max(high, max(taps.y, taps.z));
        }
    }
    return clamp(sum, low, high);
}

// Whether all taps of `lattice_interior` at this position are in the image.
bool lattice_is_interior(Camera cam, vec2 position) {
    return all(greaterThanEqual(position, vec2(0.5)))
        && all(lessThan(position, vec2(cam.width, cam.height) - 1.5));
}

// As `lattice_cubic`, where all taps are in the image: one address a row.
float lattice_interior(Camera cam, uint base, vec2 position) {
    const vec2 at = 2.0 * position;
    const vec2 low = floor(at);
    const vec2 f = at - low;
    const uint row_words = 2u * cam.width;
    const uint corner = base + (uint(low.y) - 1u) * row_words + uint(low.x) - 1u;
    const vec4 wx = keys(f.x, CUBIC_LATTICE);
    const vec4 wy = keys(f.y, CUBIC_LATTICE);
    float sum = 0.0;
    float lowest = 3.0e38;
    float highest = -3.0e38;
    [[unroll]] for (uint j = 0u; j < 4u; ++j) {
        const uint row = corner + j * row_words;
        const vec4 taps = vec4(planes[row], planes[row + 1u], planes[row + 2u], planes[row + 3u]);
        sum += wy[j] * dot(wx, taps);
        if (j == 1u || j == 2u) {
            lowest = min(lowest, min(taps.y, taps.z));
            highest = max(highest, max(taps.y, taps.z));
        }
    }
    return clamp(sum, lowest, highest);
}

// The lattice at pixel position `position`, clamped to the image.
float lattice_cubic(Camera cam, uint base, vec2 position) {
    const ivec2 last = ivec2(2u * cam.width - 1u, 2u * cam.height - 1u);
    const vec2 at = clamp(2.0 * position, vec2(0.0), vec2(last));
    const vec2 low = floor(at);
    const vec2 f = at - low;
    const uvec4 columns = uvec4(clamp(int(low.x) + ivec4(-1, 0, 1, 2), 0, last.x));
    const uvec4 rows = uvec4(clamp(int(low.y) + ivec4(-1, 0, 1, 2), 0, last.y)) * (2u * cam.width);
    return cubic_taps(base, rows, columns, keys(f.y, CUBIC_LATTICE), keys(f.x, CUBIC_LATTICE));
}

// A half site (`half_step` 0 or 1 a coordinate) right and below pixel `at`, from the frame alone.
float frame_cubic(Camera cam, uint base, ivec2 at, ivec2 half_step) {
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    // Beyond the last pixel there is only that pixel.
    const vec2 f = vec2(at.x < last.x ? 0.5 * float(half_step.x) : 0.0, at.y < last.y ? 0.5 * float(half_step.y) : 0.0);
    const uvec4 columns = uvec4(2 * clamp(at.x + ivec4(-1, 0, 1, 2), 0, last.x));
    const uvec4 rows = uvec4(2 * clamp(at.y + ivec4(-1, 0, 1, 2), 0, last.y)) * (2u * cam.width);
    return cubic_taps(base, rows, columns, keys(f.y, CUBIC_FRAME), keys(f.x, CUBIC_FRAME));
}

// Bilinear on a frame without a lattice.
float frame_bilinear(Camera cam, uint base, vec2 position) {
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const vec2 inside = clamp(position, vec2(0.0), vec2(last));
    const ivec2 low = ivec2(floor(inside));
    const ivec2 high = min(low + 1, last);
    const vec2 f = inside - vec2(low);
    const uint top = base + uint(low.y) * cam.width;
    const uint bottom = base + uint(high.y) * cam.width;
    return mix(
        mix(planes[top + low.x], planes[top + high.x], f.x),
        mix(planes[bottom + low.x], planes[bottom + high.x], f.x), f.y);
}
