// Half-pel samples from a frame alone. Twin of the oracle's `HalfPelFrame`; the equations are in the model crate's
// `synthesis`. Part of ingest.glsl, whose tile cache it reads.

// The weighted sum of six cached levels in a line: `step` words apart, the third of them at `third`.
float sum_of_six(uint third, uint step) {
    const float inner = cached_level[third] + cached_level[third + step];
    const float middle = cached_level[third - step] + cached_level[third + 2u * step];
    const float outer = cached_level[third - 2u * step] + cached_level[third + 3u * step];
    return fma(HALF_PEL_WEIGHTS.x, inner, fma(HALF_PEL_WEIGHTS.y, middle, HALF_PEL_WEIGHTS.z * outer));
}

// The half-pel samples right, below, and right and below of pixel `at`, of the `k`th component that the workgroup takes.
vec3 interpolate_frame(Camera cam, uint k, ivec2 at) {
    const uint own = k * CACHE_PIXELS + cache_index(at);
    const vec4 around = vec4(
        cached_level[own], cached_level[own + 1u], cached_level[own + CACHE_X], cached_level[own + CACHE_X + 1u]);
    const vec2 rows = vec2(sum_of_six(own, 1u), sum_of_six(own + CACHE_X, 1u));
    const vec2 columns = vec2(sum_of_six(own, CACHE_X), sum_of_six(own + 1u, CACHE_X));
    const float diagonal = fma(0.5, rows.x + rows.y + columns.x + columns.y, -0.25 * dot(around, vec4(1.0)));
    const vec2 low = min(around.xy, around.zw);
    const vec2 high = max(around.xy, around.zw);
    const float right = clamp(rows.x, min(around.x, around.y), max(around.x, around.y));
    const float below = clamp(columns.x, low.x, high.x);
    // Beyond the image the frame repeats its last pixels.
    const bvec2 inside = lessThan(at, ivec2(cam.width, cam.height) - 1);
    return vec3(
        right, below,
        inside.x && inside.y ? clamp(diagonal, min(low.x, low.y), max(high.x, high.y)) : inside.x ? right : below);
}
