// Trajectories of surfaces through the interval, from the motion of this frame (k-1 to k) and of the frame before. Twin
// of the oracle's `trajectory`. Needs frame loads (frame_load_by_*.glsl).

#include "cell.glsl"

// A pixel without a usable vector holds zero motion with this sign bit in x.
const uint INVALID_BIT = 0x80000000u;

uint motion_base(Camera cam, bool current) {
    return cam.motion_base + (current ? cam.frame_slot : 1u - cam.frame_slot) * cam.pixels;
}

vec2 motion_at(Camera cam, uint base, ivec2 at) {
    return load_motion(base + uint(at.y) * cam.width + uint(at.x));
}

bool has_vector(Camera cam, uint base, ivec2 at) {
    return floatBitsToUint(motion_at(cam, base, at).x) != INVALID_BIT;
}

// Bilinear, position clamped to the image.
vec2 motion_bilinear(Camera cam, uint base, vec2 position) {
    const Cell cell = cell_at(cam, position);
    const vec2 top =
        lerp(motion_at(cam, base, cell.low), motion_at(cam, base, ivec2(cell.high.x, cell.low.y)), cell.f.x);
    const vec2 bottom =
        lerp(motion_at(cam, base, ivec2(cell.low.x, cell.high.y)), motion_at(cam, base, cell.high), cell.f.x);
    return lerp(top, bottom, cell.f.y);
}

// Motion over the interval of the surface that the previous frame shows at pixel `at`: m(q) at the point q of this
// frame with q + m(q) = at, by fixed-point iteration.
vec2 motion_from_previous(Camera cam, ivec2 at) {
    const uint base = motion_base(cam, true);
    vec2 m = motion_at(cam, base, at);
    [[unroll]] for (int step_index = 1; step_index < TRAJECTORY_STEPS; ++step_index) {
        m = motion_bilinear(cam, base, vec2(at) - m);
    }
    return m;
}

// How far a position lies outside the image, pixels.
float outside_px(Camera cam, vec2 position) {
    const vec2 beyond = max(-position, position - vec2(cam.width - 1u, cam.height - 1u));
    return max(max(beyond.x, beyond.y), 0.0);
}

// Motion m and curvature c of a surface point: position(t) = q + t ((c - m) + t c), t = alpha - 1.
struct Trajectory {
    vec2 motion;
    vec2 curvature;
};

// Curvature of a trajectory with motion `m` over this interval and `u` over the interval before; `ratio` is the earlier
// interval's length over this one's.
vec2 curvature(vec2 m, vec2 u, float ratio) {
    return (u - ratio * m) / (ratio * (1.0 + ratio));
}

// Curvature of motion `m`, given the vector `u` of the frame before. With their first frame, renderers give no vectors
// or zeros; so a zero of that frame counts as no vector.
vec2 curvature_from(Camera cam, vec2 m, vec2 u) {
    if (cam.previous_interval_ns == 0u) {
        return u == vec2(0.0) ? vec2(0.0) : curvature(m, u, 1.0);
    }
    return curvature(m, u, float(cam.previous_interval_ns) / float(cam.interval_ns));
}

// The trajectory of the surface seen at pixel `at` at the interval's start.
Trajectory trajectory_at_start(Camera cam, ivec2 at) {
    const vec2 m = motion_from_previous(cam, at);
    if (cam.has_previous_motion == 0u) {
        return Trajectory(m, vec2(0.0));
    }
    return Trajectory(m, curvature_from(cam, m, motion_at(cam, motion_base(cam, false), at)));
}

// The trajectory of the surface seen at pixel `at` at the interval's end.
Trajectory trajectory_at_end(Camera cam, ivec2 at) {
    const vec2 m = motion_at(cam, motion_base(cam, true), at);
    if (cam.has_previous_motion == 0u) {
        return Trajectory(m, vec2(0.0));
    }
    return Trajectory(m, curvature_from(cam, m, motion_bilinear(cam, motion_base(cam, false), vec2(at) + m)));
}
