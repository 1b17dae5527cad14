// synthesize: log intensity of a pixel at a fraction of the interval, from its two rendered frames.
// Twin of the oracle's `synthesize`. Needs `planes`, `motion`, SYNTHESIS, TAPS, INTENSITY.

#include "trajectory.glsl"
#include "lattice.glsl"

// First elements of the two frames of one colour component.
struct Frames {
    uint previous;
    uint current;
};

// Whether frames have lattices.
bool has_lattice() {
    return SYNTHESIS == SYNTHESIS_MOTION && TAPS == TAPS_CUBIC;
}

Frames frames_of(Camera cam, uint channel) {
    const uint channels = INTENSITY == INTENSITY_BAYER_RGGB ? 3u : 1u;
    const uint words = frame_words(cam, has_lattice());
    return Frames(
        cam.plane_base + ((1u - cam.parity) * channels + channel) * words,
        cam.plane_base + (cam.parity * channels + channel) * words);
}

float read_warped(Camera cam, uint base, vec2 position) {
    return TAPS == TAPS_CUBIC ? lattice_cubic(cam, base, position) : frame_bilinear(cam, base, position);
}

// Where the surface seen at pixel `at` is in the current frame (xy) and in the previous one (zw): on the
// path that goes from the one seen here at the interval's start to the one seen here at its end.
vec4 sources_at(ivec2 at, Path start, Path end, float alpha) {
    const vec2 m = mix(start.m, end.m, alpha);
    const vec2 c = mix(start.c, end.c, alpha);
    const float t = alpha - 1.0;
    const vec2 in_current = vec2(at) - t * ((c - m) + t * c);
    return vec4(in_current, in_current + m);
}

// Both frames along the path, blended in the logarithm by time and by how far inside the image each is
// read.
float synthesize_motion(Camera cam, Frames frames, ivec2 at, Path start, Path end, float alpha) {
    const vec4 sources = sources_at(at, start, end, alpha);
    // Away from the edges, which is nearly everywhere, no tap and no say need looking after.
    if (LATENCY_BOUND && TAPS == TAPS_CUBIC && lattice_is_interior(cam, sources.xy)
        && lattice_is_interior(cam, sources.zw)) {
        return mix(
            lattice_interior(cam, frames.previous, sources.zw),
            lattice_interior(cam, frames.current, sources.xy), alpha);
    }
    const float say_current = alpha * max(1.0 - outside_px(cam, sources.xy) / EDGE_PX, EDGE_WEIGHT);
    const float say_previous = (1.0 - alpha) * max(1.0 - outside_px(cam, sources.zw) / EDGE_PX, EDGE_WEIGHT);
    const float seen_current = read_warped(cam, frames.current, sources.xy);
    const float seen_previous = read_warped(cam, frames.previous, sources.zw);
    return (say_previous * seen_previous + say_current * seen_current) / (say_previous + say_current);
}

// Blend of the frames in linear intensity; `light_*` are their exp(L).
float synthesize_linear(float light_previous, float light_current, float alpha) {
    return log(mix(light_previous, light_current, alpha));
}

// The paper's equation as printed, I_k(x - alpha v) with v the displacement from k-1 to k: bilinear in
// linear intensity, edges clamped.
float synthesize_paper(Camera cam, Frames frames, ivec2 at, float alpha) {
    const vec2 position = vec2(at) + alpha * motion_at(cam, motion_base(cam, true), at);
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const vec2 inside = clamp(position, vec2(0.0), vec2(last));
    const ivec2 low = ivec2(floor(inside));
    const ivec2 high = min(low + 1, last);
    const vec2 f = inside - vec2(low);
    const uint top = frames.current + uint(low.y) * cam.width;
    const uint bottom = frames.current + uint(high.y) * cam.width;
    return log(mix(
        mix(exp(planes[top + low.x]), exp(planes[top + high.x]), f.x),
        mix(exp(planes[bottom + low.x]), exp(planes[bottom + high.x]), f.x), f.y));
}
