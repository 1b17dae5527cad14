// The surfaces that a pixel itself shows in the key frames, for synthesis `rigid`. Needs candidates.glsl.

// A pixel's own surfaces, those that it shows in the key frames.
const uint NO_SURFACE = 0u;
// One surface: `start`.
const uint ONE_SURFACE = 1u;
// Both key frames show one surface; its plane is the mean of `start` and `end`.
const uint SAME_SURFACE = 2u;
const uint TWO_SURFACES = 3u;

// A pixel's candidates: its own surfaces and those of its block's list. `order` has four bits for each, from near to far
// in the middle of the interval: its number plus one.
struct RigidPixel {
    uint own;
    Surface start;
    Surface end;
    uint block;
    uint order;
};

// Numbers of a pixel's candidates: two of its own, then those of the list.
const uint OWN_CANDIDATES = 2u;

// Candidate `c` of a pixel at `alpha`, one of its own.
Surface own_candidate_at(RigidPixel p, uint c, float alpha) {
    if (p.own == SAME_SURFACE) {
        return Surface(
            p.start.instance,
            vec3[2](
                fma(vec3(alpha), p.end.planes[0] - p.start.planes[0], p.start.planes[0]),
                fma(vec3(alpha), p.end.planes[1] - p.start.planes[1], p.start.planes[1])));
    }
    return c == 0u ? p.start : p.end;
}

// A pixel's own surfaces, without an order.
RigidPixel own_surfaces(Camera cam, Geometry geo, uvec2 at, vec3 ray) {
    RigidPixel p;
    bool in_start = true;
    bool in_end = true;
    p.start = surface_of_pixel(cam, geo, 0u, ivec2(at), in_start);
    p.end = surface_of_pixel(cam, geo, 1u, ivec2(at), in_end);
    p.block = 0u;
    p.order = 0u;
    if (!in_start && !in_end) {
        p.own = NO_SURFACE;
    } else if (!in_start || !in_end) {
        p.own = ONE_SURFACE;
        if (!in_start) {
            p.start = p.end;
        }
    } else {
        const bool same = p.start.instance == p.end.instance
            && are_one(
                depths_along(p.start.planes, ray), depths_along(p.end.planes, ray), parallax_of(geo, p.start.instance));
        p.own = same ? SAME_SURFACE : TWO_SURFACES;
    }
    return p;
}
