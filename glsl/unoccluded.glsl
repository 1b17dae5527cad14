// Pixels that show one surface during the whole interval, for synthesis `rigid`: nothing passes before it, and both key
// frames show it all along its path. Twin of the oracle's `synthesize::rigid::unoccluded`. Needs rigid.glsl.

// In place of an order of candidates: the pixel is unoccluded.
const uint UNOCCLUDED = 0xffffffu;

// Legs into which an interval is cut whose surfaces move `motion_px`: none is longer than LEG_PX; 0 if there are too many.
uint legs_of(float motion_px) {
    uint legs = 1u;
    while (legs < MOST_LEGS && float(legs) * LEG_PX < motion_px) {
        legs *= 2u;
    }
    return float(legs) * LEG_PX < motion_px ? 0u : legs;
}

// How a key frame shows a surface at a position: the nearest pixel is inner and belongs, or is inner and does not.
const uint SHOWN = 0u;
const uint NOT_SHOWN = 1u;
const uint NOT_INNER = 2u;

uint shown_at(Camera cam, Geometry geo, uint key, vec2 position, Surface surface, float parallax) {
    const uint base = surface_base(cam, geo, key);
    const vec2 last = vec2(cam.width - 1u, cam.height - 1u);
    const ivec2 nearest = ivec2(clamp(0.5 * snapped(2.0 * position), vec2(0.0), last) + 0.5);
    const uvec2 shown = load_surface(base, cam, nearest);
    if (!is_inner(shown)) {
        return NOT_INNER;
    }
    return belongs(geo, shown, vec2(nearest), Seen(surface.instance, surface.planes[key], parallax)) ? SHOWN : NOT_SHOWN;
}

// Whether candidate `c` of a pixel lies inside what both key frames show in the middle of a leg, of it (`own`) or of
// something else.
bool lies_inside(Camera cam, Geometry geo, RigidPixel p, vec3 ray, uint c, bool own, uint instant) {
    const Surface here = candidate_at(p, c, float(instant) * (1.0 / float(POSE_INSTANTS - 1u)));
    bool seen = true;
    const vec4 at_keys = find_sources(geo, pose_at_instant(geo, here.instance, instant), here, ray, seen);
    const float parallax = parallax_of(geo, here.instance);
    const uint start = shown_at(cam, geo, 0u, at_keys.xy, here, parallax);
    const uint end = shown_at(cam, geo, 1u, at_keys.zw, here, parallax);
    const uint wanted = own ? SHOWN : NOT_SHOWN;
    return seen ? start == wanted && end == wanted : !own;
}

// Whether a pixel of the `in_tile`th block of the lists, with its candidates in order, is unoccluded.
bool is_unoccluded(Camera cam, Geometry geo, vec2 at, RigidPixel p, uint in_tile) {
    const bool one = p.own == ONE_SURFACE || p.own == SAME_SURFACE;
    if (listed_count[in_tile] == 0u) {
        return one;
    }
    const uint legs = one ? legs_of(listed_motion[in_tile]) : 0u;
    const uint step_instants = legs == 0u ? 0u : (POSE_INSTANTS - 1u) / legs;
    const vec3 ray = ray_of(geo, at);
    bool unoccluded = legs != 0u;
    uint order = p.order;
    while (order != 0u && unoccluded) {
        const uint c = (order & ORDER_MASK) - 1u;
        const bool own = c == 0u;
        uint leg = 0u;
        do {
            // Two legs at once: their loads overlap.
            const uint instant = (2u * leg + 1u) * step_instants / 2u;
            const bool first = lies_inside(cam, geo, p, ray, c, own, instant);
            const bool second = lies_inside(cam, geo, p, ray, c, own, legs == 1u ? instant : instant + step_instants);
            unoccluded = first && second;
            leg += 2u;
        } while (leg < legs && unoccluded);
        order = own ? 0u : order >> ORDER_BITS;
    }
    return unoccluded;
}

// The surface of an unoccluded pixel, in the axes of key frame 0: its plane at the interval's start, and what that changes
// by.
struct OwnPath {
    uint instance;
    vec3 plane;
    vec3 change;
};

OwnPath own_path(RigidPixel p) {
    const vec3 change = p.own == SAME_SURFACE ? p.end.planes[0] - p.start.planes[0] : vec3(0.0);
    return OwnPath(p.start.instance, p.start.planes[0], change);
}

// Log intensity of an unoccluded pixel at the end of sub-step `i` of `n`, at `alpha`.
float level_on_path(Camera cam, Geometry geo, Frames frames, vec2 at, OwnPath path, uint n, uint i, float alpha) {
    const vec3 plane = fma(vec3(alpha), path.change, path.plane);
    bool seen = true;
    const vec4 at_keys = find_sources(
        geo, pose_at_substep(geo, path.instance, n, i), Surface(path.instance, vec3[2](plane, plane)), ray_of(geo, at), seen);
    const float say_start = (1.0 - alpha) * max(1.0 - outside_px(cam, at_keys.xy), EDGE_WEIGHT);
    const float say_end = alpha * max(1.0 - outside_px(cam, at_keys.zw), EDGE_WEIGHT);
    return lerp(
        read_level(cam, frames.previous, 0.5 * snapped(2.0 * at_keys.xy), frames.parameters.x),
        read_level(cam, frames.current, 0.5 * snapped(2.0 * at_keys.zw), frames.parameters.y),
        say_end / (say_start + say_end));
}

// The camera's geometry, if it has one.
Geometry geometry_of(Camera cam) {
    Geometry geo;
    if (RIGID) {
        geo = geometries[cam.slot];
    }
    return geo;
}
