// synthesize: log intensity of a pixel at a fraction of the interval, from its two rendered frames.
// Twin of the oracle's `synthesize`. Needs texels.glsl, SYNTHESIS, TAPS, INTENSITY.

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
    return Frames(
        cam.plane_base + ((1u - cam.parity) * channels + channel) * cam.frame_words,
        cam.plane_base + (cam.parity * channels + channel) * cam.frame_words);
}

// `site` is a place on the grid that frames have, see `SITES_PER_PX`.
float read_warped(Camera cam, uint base, vec2 site) {
    return TAPS == TAPS_CUBIC ? lattice_cubic(cam, base, site) : frame_bilinear(cam, base, site);
}

// Courses are counted in what frames are read by: half pixels where they have lattices.
const float SITES_PER_PX = TAPS == TAPS_CUBIC ? 2.0 : 1.0;

// Where the surfaces seen at a pixel come from, as polynomials of alpha: on the path that goes from the one
// seen here at the interval's start to the one seen here at its end, m(alpha) = m + alpha dm and c alike,
//     in the current frame   at + (alpha - 1) (m + alpha (turn - alpha dc)),  turn = dm - c,
//     in the previous frame  that + m + alpha dm,
// which is position(t) = q + t ((c - m) + t c) solved for q, t = alpha - 1.
struct Course {
    vec2 m;
    vec2 dm;
    vec2 turn;
    vec2 dc;
};

Course course_between(Path start, Path end) {
    const vec2 dm = end.m - start.m;
    return Course(
        SITES_PER_PX * start.m, SITES_PER_PX * dm, SITES_PER_PX * (dm - start.c), SITES_PER_PX * (end.c - start.c));
}

// Whether the course may lead out of the image. It goes as far as its motion and, since |alpha (alpha - 1)| is a
// quarter at the most, a quarter of its curvature.
bool leaves_image(Camera cam, vec2 at, Path start, Path end) {
    const vec2 reach = max(abs(start.m), abs(end.m)) + 0.25 * max(abs(start.c), abs(end.c));
    const vec2 room = min(at, vec2(cam.width - 1u, cam.height - 1u) - at) - reach;
    // What a rounding may lead out of it is inside for all that matters.
    return min(room.x, room.y) < 0.01;
}

// Site in the current frame (xy) and in the previous one (zw).
vec4 sources_at(vec2 at, Course course, float alpha) {
    const vec2 t = vec2(alpha);
    const vec2 in_current = fma(t - 1.0, fma(t, fma(-t, course.dc, course.turn), course.m), at);
    return vec4(in_current, in_current + fma(t, course.dm, course.m));
}

// Both frames along the path, blended in the logarithm by time and, on a course that leaves the image, by how
// far inside it each is read.
float synthesize_motion(Camera cam, Frames frames, vec2 at, Course course, bool leaves, float alpha) {
    vec4 sources = sources_at(SITES_PER_PX * at, course, alpha);
    float say_current = alpha;
    if (leaves) {
        const vec4 positions = sources * (1.0 / SITES_PER_PX);
        const float current = alpha * max(1.0 - outside_px(cam, positions.xy) * (1.0 / EDGE_PX), EDGE_WEIGHT);
        const float previous = (1.0 - alpha) * max(1.0 - outside_px(cam, positions.zw) * (1.0 / EDGE_PX), EDGE_WEIGHT);
        say_current = current / (previous + current);
        if (TAPS == TAPS_CUBIC) {
            sources = vec4(to_lattice(cam, positions.xy), to_lattice(cam, positions.zw));
        }
    }
    return blend(
        read_warped(cam, frames.previous, sources.zw), read_warped(cam, frames.current, sources.xy), say_current);
}

// Blend of the frames in linear intensity; `light_*` are their exp(L).
float synthesize_linear(float light_previous, float light_current, float alpha) {
    return log(blend(light_previous, light_current, alpha));
}

// The paper's equation as printed, I_k(x - alpha v) with v the displacement from k-1 to k: bilinear in
// linear intensity, edges clamped.
float synthesize_paper(Camera cam, Frames frames, ivec2 at, float alpha) {
    const vec2 position = fma(vec2(alpha), motion_at(cam, motion_base(cam, true), at), vec2(at));
    const Cell cell = cell_at(cam, position);
    const uint top = frames.current + uint(cell.low.y) * cam.width;
    const uint bottom = frames.current + uint(cell.high.y) * cam.width;
    return log(blend(
        blend(exp(plane_at(top + cell.low.x)), exp(plane_at(top + cell.high.x)), cell.f.x),
        blend(exp(plane_at(bottom + cell.low.x)), exp(plane_at(bottom + cell.high.x)), cell.f.x), cell.f.y));
}
