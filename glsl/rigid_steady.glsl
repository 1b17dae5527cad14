// The level of a pixel that has nothing to do with a silhouette, for synthesis `rigid`: a part of `synthesize_rigid` that
// needs a few registers only, and gives the same bits where it gives any. Needs rigid.glsl.

// Log intensity of a pixel that has a path at the end of sub-step `i` of `n`, at `alpha`; `settled` becomes false where
// that takes more than the nearest surface.
float synthesize_steady(
    Camera cam, Geometry geo, Frames frames, uvec2 at, RigidPixel p, uint n, uint i, float alpha, out bool settled
) {
    const vec3 ray = ray_of(geo, vec2(at));
    settled = false;
    uint order = p.order;
    do {
        const Surface here = candidate_at(p, (order & ORDER_MASK) - 1u, alpha);
        order >>= ORDER_BITS;
        bool seen = true;
        const vec4 at_keys = find_sources(geo, pose_at_substep(geo, here.instance, n, i), here, ray, seen);
        if (!seen) {
            continue;
        }
        const float parallax = parallax_of(geo, here.instance);
        const Spot start = spot_at(cam, surface_base(cam, geo, 0u), at_keys.xy);
        const Spot end = spot_at(cam, surface_base(cam, geo, 1u), at_keys.zw);
        const uint lies_start =
            relation(geo, start.shown, vec2(start.nearest), Seen(here.instance, here.planes[0], parallax));
        const uint lies_end =
            relation(geo, end.shown, vec2(end.nearest), Seen(here.instance, here.planes[1], parallax));
        if (!is_within(start) || !is_within(end)) {
            return 0.0;
        }
        const vec2 belong = vec2(lies_start == BELONGS ? 1.0 : 0.0, lies_end == BELONGS ? 1.0 : 0.0);
        if (belong.x + belong.y == 0.0) {
            continue;
        }
        const vec2 hidden = vec2(lies_start == HIDES ? 1.0 : 0.0, lies_end == HIDES ? 1.0 : 0.0);
        const float say_start = (1.0 - alpha) * max(1.0 - outside_px(cam, at_keys.xy), EDGE_WEIGHT);
        const float say_end = alpha * max(1.0 - outside_px(cam, at_keys.zw), EDGE_WEIGHT);
        const float trust_end = say_end * (lies_end == BELONGS ? trust_within(end) : 0.0);
        const float trust = fma(say_start, lies_start == BELONGS ? trust_within(start) : 0.0, trust_end);
        const float weight_seen = fma(say_start, belong.x, say_end * belong.y);
        const vec2 open = vec2(say_start * (1.0 - hidden.x), say_end * (1.0 - hidden.y));
        const float coverage = min(weight_seen / (open.x + open.y), 1.0);
        if (trust <= 0.0 || coverage < 1.0) {
            return 0.0;
        }
        settled = true;
        return lerp(
            read_level(cam, frames.previous, start.position), read_level(cam, frames.current, end.position),
            trust_end / trust);
    } while (order != 0u);
    return 0.0;
}
