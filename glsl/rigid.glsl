// Synthesis `rigid`: what a pixel shows at a sub-step, from the surfaces of both key frames along their exact paths.
// Part of cross.glsl; twin of the oracle's `synthesize::rigid`. Needs candidates.glsl, paths.glsl and frame loads.

#include "own_surfaces.glsl"

// Sub-steps of this thread's pixel that show what neither key frame shows.
uint unseen_samples;

const uint ORDER_BITS = 4u;
const uint ORDER_MASK = (1u << ORDER_BITS) - 1u;

bool is_listed_one(uint c, Surface other, vec3 ray) {
    const vec2 depths = vec2(dot3(listed_plane[2u * c], ray), dot3(listed_plane[2u * c + 1u], ray));
    return listed_instance[c] == other.instance && are_one(depths, depths_along(other.planes, ray), listed_parallax[c]);
}

Surface listed_surface(uint c) {
    return Surface(listed_instance[c], vec3[2](listed_plane[2u * c], listed_plane[2u * c + 1u]));
}

// Candidate `c` of a pixel at `alpha`.
Surface candidate_at(RigidPixel p, uint c, float alpha) {
    if (c >= OWN_CANDIDATES) {
        return listed_surface(p.block + c - OWN_CANDIDATES);
    }
    return own_candidate_at(p, c, alpha);
}

// Inserts a candidate into a pixel's order, behind those that are as near. `depths` are the inverse depths of those in it,
// in order.
void insert(inout RigidPixel p, inout float depths[PIXEL_CANDIDATES], uint c, float inverse_depth) {
    uint place = 0u;
    [[unroll]] for (uint before = 0u; before < PIXEL_CANDIDATES; ++before) {
        place += uint(((p.order >> (ORDER_BITS * before)) & ORDER_MASK) != 0u && depths[before] >= inverse_depth);
    }
    [[unroll]] for (uint i = PIXEL_CANDIDATES - 1u; i > 0u; --i) {
        depths[i] = i > place ? depths[i - 1u] : i == place ? inverse_depth : depths[i];
    }
    depths[0] = place == 0u ? inverse_depth : depths[0];
    const uint nearer = (1u << (ORDER_BITS * place)) - 1u;
    p.order = (p.order & nearer) | ((c + 1u) << (ORDER_BITS * place)) | ((p.order & ~nearer) << ORDER_BITS);
}

// Inverse depth of a candidate along a ray in the middle of the interval; less than 0 if it is not before the camera.
float depth_in_middle(Geometry geo, Surface surface, vec3 ray) {
    float inverse_depth;
    bool seen = true;
    point_on_path(pose_at_instant(geo, surface.instance, POSE_INSTANTS / 2u), surface.planes[0], ray, inverse_depth, seen);
    return seen ? inverse_depth : -1.0;
}

// A pixel with its candidates, those of the `in_tile`th block of the lists among them.
RigidPixel read_rigid_pixel(Camera cam, Geometry geo, uvec2 at, uint in_tile) {
    const vec3 ray = ray_of(geo, vec2(at));
    RigidPixel p = own_surfaces(cam, geo, at, ray);
    p.block = in_tile * BLOCK_CANDIDATES;
    if (p.own == NO_SURFACE) {
        return p;
    }
    if (listed_count[in_tile] == 0u && p.own != TWO_SURFACES) {
        p.order = 1u;
        return p;
    }
    float depths[PIXEL_CANDIDATES];
    insert(p, depths, 0u, depth_in_middle(geo, candidate_at(p, 0u, 0.5), ray));
    uint room = PIXEL_CANDIDATES - 1u;
    if (p.own == TWO_SURFACES) {
        insert(p, depths, 1u, depth_in_middle(geo, p.end, ray));
        room -= 1u;
    }
    uint listed = 0u;
    for (uint number = 0u; number < listed_count[in_tile]; ++number) {
        const uint c = p.block + number;
        bool known = is_listed_one(c, p.start, ray) || (p.own == TWO_SURFACES && is_listed_one(c, p.end, ray));
        uint before = listed;
        while (before != 0u && !known) {
            const uint other = p.block + uint(findLSB(before));
            before &= before - 1u;
            known = is_listed_one(c, listed_surface(other), ray);
        }
        if (!known && room != 0u) {
            listed |= 1u << number;
            room -= 1u;
            insert(p, depths, OWN_CANDIDATES + number, depth_in_middle(geo, listed_surface(c), ray));
        }
    }
    return p;
}

// Where a candidate lies in key frame 0 (xy) and in key frame 1 (zw). `seen` becomes false if it is not before the
// camera.
vec4 find_sources(Geometry geo, Pose pose, Surface surface, vec3 ray, inout bool seen) {
    float inverse_depth;
    const vec3 point = point_on_path(pose, surface.planes[0], ray, inverse_depth, seen);
    const vec2 in_start = project(geo, point, seen);
    const Pose to_end = pose_between_keys(geo, surface.instance);
    return vec4(in_start, project(geo, moved(to_end, point, inverse_depth), seen));
}

// What a key frame knows of a surface at a position: shares of the pixels around, its level, and that of what is behind
// it with the share of that. `reach` counts those in its fringe too, and `thick` those of them where it is thick.
struct Known {
    float seen;
    float hidden;
    float trust;
    float reach;
    float thick;
    float level;
    float level_behind;
    float behind;
};

// Level at a position from a frame whose pixels around it are of one surface.
float read_level(Camera cam, uint frame, vec2 position, float parameter) {
    return TAPS == TAPS_CUBIC
        ? half_pel_cubic(cam, frame, to_half_pel(cam, position), parameter)
        : frame_bilinear(cam, frame, position);
}

// The pixel around `at` that a bit stands for.
ivec2 pixel_around(ivec2 at, uint bit) {
    const uint left = AROUND_ABOVE_LEFT | AROUND_LEFT | AROUND_BELOW_LEFT;
    const uint right = AROUND_ABOVE_RIGHT | AROUND_RIGHT | AROUND_BELOW_RIGHT;
    const uint above = AROUND_ABOVE_LEFT | AROUND_ABOVE | AROUND_ABOVE_RIGHT;
    const uint below = AROUND_BELOW_LEFT | AROUND_BELOW | AROUND_BELOW_RIGHT;
    return at
        + ivec2(int((bit & right) != 0u) - int((bit & left) != 0u), int((bit & below) != 0u) - int((bit & above) != 0u));
}

// What the four pixels around a position know of a surface; of its fringe only if one `asks`. All are farther than it if
// the nearest one said so for all (`is_farther`): then they are asked for the fringe alone, and levels are left out. All
// four are loaded before any branch, so that their loads overlap.
Known look_around(
    Camera cam, Geometry geo, uint frame, uint base, vec2 position, Seen surface, bool is_farther, bool asks
) {
    const Cell cell = cell_at(cam, position);
    const vec2 g = 1.0 - cell.f;
    const vec4 weights = vec4(g.x * g.y, cell.f.x * g.y, g.x * cell.f.y, cell.f.x * cell.f.y);
    const ivec2 at[4] = ivec2[4](
        cell.low, ivec2(cell.high.x, cell.low.y), ivec2(cell.low.x, cell.high.y), cell.high);
    uvec2 shown[4];
    [[unroll]] for (uint i = 0u; i < 4u; ++i) {
        shown[i] = load_surface(base, cam, at[i]);
    }
    uvec4 fronts;
    Known known = Known(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    if (!is_farther) {
        float levels[4];
        [[unroll]] for (uint i = 0u; i < 4u; ++i) {
            levels[i] = load_plane(frame + frame_word(cam, TAPS == TAPS_CUBIC, at[i]));
        }
        [[unroll]] for (uint i = 0u; i < 4u; ++i) {
            const uint lies = relation(geo, shown[i], vec2(at[i]), surface);
            if (lies == BELONGS) {
                known.seen += weights[i];
                known.trust = fma(is_pure(shown[i]) ? 1.0 : MIXED_WEIGHT, weights[i], known.trust);
                known.level = fma(weights[i], levels[i], known.level);
                known.thick = fma(thickness_of(shown[i]), weights[i], known.thick);
            } else if (lies == HIDES) {
                known.hidden += weights[i];
            } else {
                known.behind += weights[i];
                known.level_behind = fma(weights[i], levels[i], known.level_behind);
            }
            fronts[i] = asks && lies == FARTHER ? front_of(shown[i]) : 0u;
        }
        known.level /= known.seen > 0.0 ? known.seen : 1.0;
        known.level_behind /= known.behind > 0.0 ? known.behind : 1.0;
        known.reach = known.seen;
    } else {
        known.behind = 1.0;
        [[unroll]] for (uint i = 0u; i < 4u; ++i) {
            fronts[i] = front_of(shown[i]);
        }
    }
    // Pixels mostly share a front. It is looked at once for all of them.
    ivec2 beside[4];
    [[unroll]] for (uint i = 0u; i < 4u; ++i) {
        beside[i] = pixel_around(at[i], fronts[i]);
    }
    bvec4 asking = notEqual(fronts, uvec4(0u));
    bvec4 reaches = bvec4(false);
    vec4 thickness = vec4(0.0);
    while (any(asking)) {
        ivec2 front = at[0];
        [[unroll]] for (int i = 3; i >= 0; --i) {
            front = asking[i] ? beside[i] : front;
        }
        const uvec2 there = load_surface(base, cam, front);
        const bool reach = belongs(geo, there, vec2(front), surface);
        const float thick = thickness_of(there);
        [[unroll]] for (uint i = 0u; i < 4u; ++i) {
            if (asking[i] && beside[i] == front) {
                asking[i] = false;
                reaches[i] = reach;
                thickness[i] = reach ? thick : 0.0;
            }
        }
    }
    [[unroll]] for (uint i = 0u; i < 4u; ++i) {
        known.reach += reaches[i] ? weights[i] : 0.0;
        known.thick = fma(thickness[i], weights[i], known.thick);
    }
    return known;
}

// What a key frame knows of a surface at a spot. Where its nearest pixel speaks for all, levels are what is shown there,
// and left to the caller.
Known look(Camera cam, Geometry geo, uint frame, uint base, Spot spot, Seen surface, uint lies, bool asks) {
    const bool within = is_within(spot);
    if (!within || (asks && lies == FARTHER && !is_pure_within(spot))) {
        return look_around(cam, geo, frame, base, spot.position, surface, within, asks);
    }
    const float seen = lies == BELONGS ? 1.0 : 0.0;
    return Known(
        seen, lies == HIDES ? 1.0 : 0.0, lies == BELONGS ? trust_within(spot) : 0.0, seen,
        thickness_of(spot.shown) * seen, 0.0, 0.0, lies == FARTHER ? 1.0 : 0.0);
}

// Adds up the levels of the pixels `steps` beside a position that belong to a surface, and counts them.
vec2 levels_beside(Camera cam, Geometry geo, uint frame, uint base, vec2 position, Seen surface, int steps) {
    const vec2 nearest = floor(position + 0.5);
    vec2 sum = vec2(0.0);
    for (int side = 0; side < 4; ++side) {
        const int away = (side & 1) == 0 ? steps : -steps;
        const vec2 at = nearest + (side < 2 ? vec2(away, 0) : vec2(0, away));
        if (all(greaterThanEqual(at, vec2(0.0))) && all(lessThan(at, vec2(cam.width, cam.height)))
            && belongs(geo, load_surface(base, cam, ivec2(at)), at, surface)) {
            sum += vec2(load_plane(frame + frame_word(cam, TAPS == TAPS_CUBIC, ivec2(at))), 1.0);
        }
    }
    return sum;
}

// The silhouette of the nearest candidate that shows, if that covers the pixel in part.
struct Silhouette {
    float coverage;
    // How much of the pixel it reaches into; 0 if there is none. How thick it is there, 0 to 1.
    float reach;
    float thickness;
    // Light of the candidate; what the key frames show along its path, mixtures and all; and what they show behind it,
    // with the share of that.
    float light;
    float as_shown;
    float light_behind;
    float behind;
};

// Light of a pixel with a silhouette; `behind` is that of the other candidates.
float light_at_silhouette(Silhouette s, float behind) {
    const float there = lerp(behind, s.light_behind, s.behind);
    const float unlike = min(abs(log(behind / there)) * (1.0 / BACKGROUND_LOG), 1.0);
    const float composite = lerp(behind, s.light, s.coverage);
    return lerp(behind, lerp(s.as_shown, composite, s.thickness * unlike), s.reach);
}

// Whether a key frame says that a surface is hidden at a spot or not there, nor its fringe if one `asks` for that.
bool misses(Spot spot, uint lies, bool asks) {
    return lies != BELONGS && is_within(spot) && (lies == HIDES || !asks || is_pure_within(spot));
}

// Log intensity of a pixel that has a path at the end of sub-step `i` of `n`, at `alpha`; `lost` becomes true if
// there is none after all.
float synthesize_rigid(
    Camera cam, Geometry geo, Frames frames, uvec2 at, RigidPixel p, uint n, uint i, float alpha, out bool lost
) {
    const vec3 ray = ray_of(geo, vec2(at));
    const uint start_base = surface_base(cam, geo, 0u);
    const uint end_base = surface_base(cam, geo, 1u);
    float light = 0.0;
    float shown = 0.0;
    float level = 0.0;
    Surface surface;
    vec4 sources;
    bool any_seen = false;
    Silhouette silhouette;
    silhouette.reach = 0.0;
    uint order = p.order;
    do {
        const Surface here = candidate_at(p, (order & ORDER_MASK) - 1u, alpha);
        order >>= ORDER_BITS;
        bool seen = true;
        const vec4 at_keys = find_sources(geo, pose_at_substep(geo, here.instance, n, i), here, ray, seen);
        if (!seen) {
            continue;
        }
        any_seen = true;
        surface = here;
        sources = at_keys;
        const float parallax = parallax_of(geo, here.instance);
        const Spot start_spot = spot_at(cam, start_base, at_keys.xy);
        const Spot end_spot = spot_at(cam, end_base, at_keys.zw);
        const Seen in_start = Seen(here.instance, here.planes[0], parallax);
        const Seen in_end = Seen(here.instance, here.planes[1], parallax);
        const uint lies_start = relation(geo, start_spot.shown, vec2(start_spot.nearest), in_start);
        const uint lies_end = relation(geo, end_spot.shown, vec2(end_spot.nearest), in_end);
        // Only the nearest that shows has a silhouette.
        const bool asks = silhouette.reach == 0.0 && shown == 0.0;
        if (misses(start_spot, lies_start, asks) && misses(end_spot, lies_end, asks)) {
            continue;
        }
        Known start = look(cam, geo, frames.previous, start_base, start_spot, in_start, lies_start, asks);
        Known end = look(cam, geo, frames.current, end_base, end_spot, in_end, lies_end, asks);
        const float say_start = (1.0 - alpha) * max(1.0 - outside_px(cam, at_keys.xy), EDGE_WEIGHT);
        const float say_end = alpha * max(1.0 - outside_px(cam, at_keys.zw), EDGE_WEIGHT);
        const float weight_reach = fma(say_start, start.reach, say_end * end.reach);
        if (weight_reach <= 0.0) {
            continue;
        }
        // Both reads before any branch: their loads overlap.
        const float start_shown = read_level(cam, frames.previous, start_spot.position, frames.parameters.x);
        const float end_shown = read_level(cam, frames.current, end_spot.position, frames.parameters.y);
        if (is_within(start_spot)) {
            start.level = start_shown;
            start.level_behind = start_shown;
        }
        if (is_within(end_spot)) {
            end.level = end_shown;
            end.level_behind = end_shown;
        }
        const float trust_end = say_end * end.trust;
        const float trust = fma(say_start, start.trust, trust_end);
        const float weight_seen = fma(say_start, start.seen, say_end * end.seen);
        const vec2 open = vec2(say_start * (1.0 - start.hidden), say_end * (1.0 - end.hidden));
        level = lerp(start.level, end.level, trust > 0.0 ? trust_end / trust : 0.0);
        const float coverage = min(weight_seen / (open.x + open.y), 1.0);
        if (asks) {
            if (coverage >= 1.0) {
                lost = false;
                return level;
            } else if (coverage < 1.0 - SLIGHT_WEIGHT) {
                const float open_end = open.y / (open.x + open.y);
                const vec2 behind = vec2(
                    start.behind > 0.0 ? 1.0 - open_end : 0.0, end.behind > 0.0 ? open_end : 0.0);
                const float behind_sum = behind.x + behind.y;
                silhouette.coverage = coverage;
                silhouette.reach = min(weight_reach / (open.x + open.y), 1.0);
                silhouette.thickness = fma(say_start, start.thick, say_end * end.thick) / weight_reach;
                silhouette.light = exp(level);
                silhouette.as_shown = exp(lerp(start_shown, end_shown, open_end));
                silhouette.behind = behind_sum;
                silhouette.light_behind = behind_sum > 0.0
                    ? fma(behind.x, exp(start.level_behind), behind.y * exp(end.level_behind)) / behind_sum
                    : 0.0;
                continue;
            }
        }
        const float share = (1.0 - shown) * coverage;
        light = fma(share, exp(level), light);
        shown += share;
    } while (order != 0u && shown < 1.0);
    lost = !any_seen;
    if (silhouette.reach != 0.0) {
        return log(shown < UNSEEN_SHARE ? silhouette.as_shown : light_at_silhouette(silhouette, light / shown));
    }
    if (lost || shown >= UNSEEN_SHARE) {
        return log(light / shown);
    }
    unseen_samples += 1u;
    const float parallax = parallax_of(geo, surface.instance);
    const Seen in_start = Seen(surface.instance, surface.planes[0], parallax);
    const Seen in_end = Seen(surface.instance, surface.planes[1], parallax);
    vec2 sum = vec2(0.0);
    int steps = 1;
    do {
        sum = (1.0 - alpha) * levels_beside(cam, geo, frames.previous, start_base, sources.xy, in_start, steps)
            + alpha * levels_beside(cam, geo, frames.current, end_base, sources.zw, in_end, steps);
        steps += 1;
    } while (steps <= int(UNSEEN_REACH_PX) && sum.y == 0.0);
    lost = sum.y == 0.0;
    return sum.x / sum.y;
}
