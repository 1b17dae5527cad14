// synthesize: log intensity of a pixel at a fraction of the interval, from its two rendered frames.
// Twin of the oracle's `synthesize`. Needs frame loads (frame_load_by_*.glsl), SYNTHESIS, TAPS, INTENSITY.

#include "trajectory.glsl"
#include "half_pel.glsl"

// First elements of the two frames of one colour component, and the parameters with which a pixel reads them, if they are
// half-pel frames.
struct Frames {
    uint previous;
    uint current;
    vec2 parameters;
};

// Whether frames are half-pel frames.
bool has_half_pel_frames() {
    return (RIGID || SYNTHESIS == SYNTHESIS_MOTION) && TAPS == TAPS_CUBIC;
}

// The frames of pixel `at`, in the colour component that it has.
Frames frames_of(Camera cam, uvec2 at) {
    const bool mosaic = INTENSITY == INTENSITY_BAYER_RGGB;
    const uint channels = mosaic ? 3u : 1u;
    const uint channel = mosaic ? (at.x & 1u) + (at.y & 1u) : 0u;
    Frames frames;
    frames.previous = cam.plane_base + ((1u - cam.frame_slot) * channels + channel) * cam.frame_words;
    frames.current = cam.plane_base + (cam.frame_slot * channels + channel) * cam.frame_words;
    if (has_half_pel_frames()) {
        frames.parameters = vec2(
            cubic_parameter(cam, frames.previous, ivec2(at)), cubic_parameter(cam, frames.current, ivec2(at)));
    }
    return frames;
}

// Samples a frame at `position`, in samples (see `SAMPLES_PER_PX`).
float read_warped(Camera cam, uint base, vec2 position, float parameter) {
    return TAPS == TAPS_CUBIC ? half_pel_cubic(cam, base, position, parameter) : frame_bilinear(cam, base, position);
}

// Warps are in samples: half pixels in half-pel frames.
const float SAMPLES_PER_PX = TAPS == TAPS_CUBIC ? 2.0 : 1.0;

// A pixel's warp: where the surface that it shows at alpha comes from. Its trajectory is blended from the one seen at
// the interval's start to the one seen at its end, m(alpha) = m + alpha dm and c likewise:
//     in the current frame   at + (alpha - 1) (m + alpha (turn - alpha dc)),  turn = dm - c,
//     in the previous frame  the above + m + alpha dm,
// which is position(t) = q + t ((c - m) + t c) solved for q, t = alpha - 1.
struct Warp {
    vec2 m;
    vec2 dm;
    vec2 turn;
    vec2 dc;
};

Warp warp_between(Trajectory start, Trajectory end) {
    const vec2 dm = end.motion - start.motion;
    return Warp(
        SAMPLES_PER_PX * start.motion, SAMPLES_PER_PX * dm, SAMPLES_PER_PX * (dm - start.curvature),
        SAMPLES_PER_PX * (end.curvature - start.curvature));
}

// Whether the warp may leave the image. It reaches as far as its motion plus a quarter of its curvature, since |alpha
// (alpha - 1)| is at most a quarter.
bool leaves_image(Camera cam, vec2 at, Trajectory start, Trajectory end) {
    const vec2 reach = max(abs(start.motion), abs(end.motion)) + 0.25 * max(abs(start.curvature), abs(end.curvature));
    const vec2 room = min(at, vec2(cam.width - 1u, cam.height - 1u) - at) - reach;
    // A rounding's width outside does not matter.
    return min(room.x, room.y) < 0.01;
}

// The warp of a pixel, and whether it may leave the image.
Warp warp_at(Camera cam, uvec2 at, out bool leaves) {
    const Trajectory start = trajectory_at_start(cam, ivec2(at));
    const Trajectory end = trajectory_at_end(cam, ivec2(at));
    leaves = leaves_image(cam, vec2(at), start, end);
    return warp_between(start, end);
}

// Position in the current frame (xy) and in the previous one (zw).
vec4 sources_at(vec2 at, Warp warp, float alpha) {
    const vec2 t = vec2(alpha);
    const vec2 in_current = fma(t - 1.0, fma(t, fma(-t, warp.dc, warp.turn), warp.m), at);
    return vec4(in_current, in_current + fma(t, warp.dm, warp.m));
}

// Blends both frames along the warp, in the logarithm. A frame's weight follows from the time and, if the warp leaves
// the image, from how far outside the image the frame is read.
float synthesize_motion(Camera cam, Frames frames, vec2 at, Warp warp, bool leaves, float alpha) {
    vec4 sources = sources_at(SAMPLES_PER_PX * at, warp, alpha);
    float say_current = alpha;
    if (leaves) {
        const vec4 positions = sources * (1.0 / SAMPLES_PER_PX);
        const float current = alpha * max(1.0 - outside_px(cam, positions.xy) * (1.0 / EDGE_PX), EDGE_WEIGHT);
        const float previous = (1.0 - alpha) * max(1.0 - outside_px(cam, positions.zw) * (1.0 / EDGE_PX), EDGE_WEIGHT);
        say_current = current / (previous + current);
        if (TAPS == TAPS_CUBIC) {
            sources = vec4(to_half_pel(cam, positions.xy), to_half_pel(cam, positions.zw));
        }
    }
    return lerp(
        read_warped(cam, frames.previous, sources.zw, frames.parameters.x),
        read_warped(cam, frames.current, sources.xy, frames.parameters.y), say_current);
}

// Blend of the frames in linear intensity; `light_*` are their exp(L).
float synthesize_linear(float light_previous, float light_current, float alpha) {
    return log(lerp(light_previous, light_current, alpha));
}

// The paper's equation as printed, I_k(x - alpha v) with v the displacement from k-1 to k: bilinear in linear
// intensity, edges clamped.
float synthesize_paper(Camera cam, Frames frames, ivec2 at, float alpha) {
    const vec2 position = fma(vec2(alpha), motion_at(cam, motion_base(cam, true), at), vec2(at));
    const Cell cell = cell_at(cam, position);
    const uint top = frames.current + uint(cell.low.y) * cam.width;
    const uint bottom = frames.current + uint(cell.high.y) * cam.width;
    return log(lerp(
        lerp(exp(load_plane(top + cell.low.x)), exp(load_plane(top + cell.high.x)), cell.f.x),
        lerp(exp(load_plane(bottom + cell.low.x)), exp(load_plane(bottom + cell.high.x)), cell.f.x), cell.f.y));
}
