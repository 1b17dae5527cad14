// Synthesis `rigid`: what a pixel shows at a sub-step, from the surfaces of both key frames along their exact paths.
// Part of cross.glsl; twin of the oracle's `synthesize::rigid`. Needs candidates.glsl, paths.glsl and frame loads.

// A pixel's own surfaces, those that it shows in the key frames.
const uint NO_SURFACE = 0u;
// One surface: `start`.
const uint ONE_SURFACE = 1u;
// Both key frames show one surface; its plane is the mean of `start` and `end`.
const uint SAME_SURFACE = 2u;
const uint TWO_SURFACES = 3u;

// A pixel's candidates: its own surfaces and, a bit each, those of its block's list.
struct RigidPixel {
    uint own;
    Surface start;
    Surface end;
    uint block;
    uint listed;
};

// Sub-steps of this thread's pixel that show what neither key frame shows.
uint unseen_samples;

// Bits of a pixel's candidates, in order: two of its own, then those of the list.
const uint OWN_CANDIDATES = 2u;

bool is_listed_one(uint c, Surface other, vec3 ray, float parallax) {
    const vec2 depths = vec2(dot3(listed_plane[2u * c], ray), dot3(listed_plane[2u * c + 1u], ray));
    return listed_instance[c] == other.instance && are_one(depths, depths_along(other.planes, ray), parallax);
}

RigidPixel read_rigid_pixel(Camera cam, uvec2 at, uint in_tile) {
    const Geometry geo = geometries[cam.slot];
    RigidPixel p;
    bool in_start = true;
    bool in_end = true;
    p.start = surface_of_pixel(cam, geo, 0u, ivec2(at), in_start);
    p.end = surface_of_pixel(cam, geo, 1u, ivec2(at), in_end);
    p.block = in_tile * BLOCK_CANDIDATES;
    p.listed = 0u;
    const vec3 ray = ray_of(geo, vec2(at));
    if (!in_start && !in_end) {
        p.own = NO_SURFACE;
        return p;
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
    uint room = PIXEL_CANDIDATES - (p.own == TWO_SURFACES ? 2u : 1u);
    for (uint number = 0u; number < listed_count[in_tile]; ++number) {
        const uint c = p.block + number;
        const float parallax = parallax_of(geo, listed_instance[c]);
        bool known = is_listed_one(c, p.start, ray, parallax)
            || (p.own == TWO_SURFACES && is_listed_one(c, p.end, ray, parallax));
        uint before = p.listed;
        while (before != 0u && !known) {
            const uint other = p.block + uint(findLSB(before));
            before &= before - 1u;
            const Surface surface =
                Surface(listed_instance[other], vec3[2](listed_plane[2u * other], listed_plane[2u * other + 1u]));
            known = is_listed_one(c, surface, ray, parallax);
        }
        if (!known && room != 0u) {
            p.listed |= 1u << number;
            room -= 1u;
        }
    }
    return p;
}

// Candidate `c` of a pixel at `alpha`.
Surface candidate_at(RigidPixel p, uint c, float alpha) {
    if (c >= OWN_CANDIDATES) {
        const uint listed = p.block + c - OWN_CANDIDATES;
        return Surface(listed_instance[listed], vec3[2](listed_plane[2u * listed], listed_plane[2u * listed + 1u]));
    } else if (p.own == SAME_SURFACE) {
        return Surface(
            p.start.instance,
            vec3[2](
                fma(vec3(alpha), p.end.planes[0] - p.start.planes[0], p.start.planes[0]),
                fma(vec3(alpha), p.end.planes[1] - p.start.planes[1], p.start.planes[1])));
    }
    return c == 0u ? p.start : p.end;
}

// Where a candidate lies in key frame 0 (xy) and in key frame 1 (zw). `seen` becomes false if it is not before the
// camera.
vec4 find_sources(
    Geometry geo, Pose pose, Surface surface, vec3 ray, out float inverse_depth, inout bool seen
) {
    const vec3 point = point_on_path(pose, surface.planes[0], ray, inverse_depth, seen);
    const vec2 in_start = project(geo, point, seen);
    const Pose to_end = pose_between_keys(geo, surface.instance);
    return vec4(in_start, project(geo, moved(to_end, point, inverse_depth), seen));
}

// What a key frame knows of a surface at a position: shares of the pixels around, and its level.
struct Known {
    float seen;
    float hidden;
    float trust;
    float level;
};

// Level at a position from a frame whose pixels around it are of one surface.
float read_level(Camera cam, uint frame, vec2 position) {
    return TAPS == TAPS_CUBIC
        ? half_pel_cubic(cam, frame, to_half_pel(cam, position))
        : frame_bilinear(cam, frame, position);
}

// What the four pixels around a position know of a surface, where not all is inside it.
Known look_around(Camera cam, Geometry geo, uint frame, uint base, vec2 position, Seen surface) {
    const Cell cell = cell_at(cam, position);
    const vec2 g = 1.0 - cell.f;
    const vec4 weights = vec4(g.x * g.y, cell.f.x * g.y, g.x * cell.f.y, cell.f.x * cell.f.y);
    Known known = Known(0.0, 0.0, 0.0, 0.0);
    // Whether each pixel belongs, and whether its half-pel samples are joined: four bits, the first of them the pixel.
    uint usable = 0u;
    [[unroll]] for (uint i = 0u; i < 4u; ++i) {
        const ivec2 at = ivec2((i & 1u) == 0u ? cell.low.x : cell.high.x, i < 2u ? cell.low.y : cell.high.y);
        const uvec2 shown = load_surface(base, cam, at);
        const uint lies = relation(geo, shown, vec2(at), surface);
        if (lies == BELONGS) {
            known.seen += weights[i];
            known.trust = fma(is_pure(shown) ? 1.0 : MIXED_WEIGHT, weights[i], known.trust);
            known.level = fma(weights[i], load_plane(frame + frame_word(cam, TAPS == TAPS_CUBIC, at)), known.level);
            usable |= (((shown.y / SURFACE_JOINED) & 14u) | 1u) << (4u * i);
        } else if (lies == HIDES) {
            known.hidden += weights[i];
        }
    }
    if (known.seen == 0.0) {
        return known;
    }
    known.level /= known.seen;
    if (TAPS == TAPS_CUBIC) {
        const vec2 at = to_half_pel(cam, position);
        const ivec2 low = ivec2(floor(at));
        const vec2 f = at - vec2(low);
        const ivec2 last = 2 * ivec2(cam.width, cam.height) - 1;
        bool joined = true;
        [[unroll]] for (uint i = 0u; i < 4u; ++i) {
            const uvec2 step_in = uvec2(i & 1u, i >> 1);
            const bool needed = (step_in.x == 0u ? f.x < 1.0 - SLIGHT_WEIGHT : f.x > SLIGHT_WEIGHT)
                && (step_in.y == 0u ? f.y < 1.0 - SLIGHT_WEIGHT : f.y > SLIGHT_WEIGHT);
            const ivec2 half_pel = min(low + ivec2(step_in), last);
            const uvec2 corner_of = uvec2(greaterThan(half_pel / 2, cell.low));
            const uint phase = uint(half_pel.x & 1) + 2u * uint(half_pel.y & 1);
            joined = joined
                && (!needed || ((usable >> (4u * (corner_of.x + 2u * corner_of.y) + phase)) & 1u) != 0u);
        }
        if (joined) {
            known.level = half_pel_cubic(cam, frame, at);
        }
    }
    return known;
}

Known look(Camera cam, Geometry geo, uint frame, uint base, vec2 given, Seen surface) {
    const vec2 position = 0.5 * snapped(2.0 * given);
    const ivec2 nearest = ivec2(clamp(position, vec2(0.0), vec2(cam.width - 1u, cam.height - 1u)) + 0.5);
    const uvec2 shown = load_surface(base, cam, nearest);
    if (is_inner(shown) && belongs(geo, shown, vec2(nearest), surface)) {
        return Known(1.0, 0.0, 1.0, read_level(cam, frame, position));
    }
    return look_around(cam, geo, frame, base, position, surface);
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
    // 0 if there is none.
    float coverage;
    // Light of the candidate, and what the key frames show along its path, mixtures and all.
    float light;
    float as_shown;
    // Where that is, and the weight of the key frame at the interval's end.
    vec4 sources;
    float say_end;
};

// Light of a pixel with a silhouette; `behind` is that of the other candidates, and `surface` the first among them.
float light_at_silhouette(Camera cam, Geometry geo, Frames frames, Silhouette s, float behind, Surface surface) {
    const float parallax = parallax_of(geo, surface.instance);
    const Known start = look(
        cam, geo, frames.previous, surface_base(cam, geo, 0u), s.sources.xy,
        Seen(surface.instance, surface.planes[0], parallax));
    const Known end = look(
        cam, geo, frames.current, surface_base(cam, geo, 1u), s.sources.zw,
        Seen(surface.instance, surface.planes[1], parallax));
    const float there = lerp(
        start.seen > 0.0 ? exp(start.level) : behind, end.seen > 0.0 ? exp(end.level) : behind, s.say_end);
    const float alike = max(1.0 - abs(log(behind / there)) * (1.0 / BACKGROUND_LOG), 0.0);
    return lerp(lerp(behind, s.light, s.coverage), s.as_shown, alike);
}

// Log intensity of a pixel that has a path at the end of sub-step `i` of `n`, at `alpha`; `lost` becomes true if
// there is none after all.
float synthesize_rigid(
    Camera cam, Frames frames, uvec2 at, RigidPixel p, uint n, uint i, float alpha, out bool lost
) {
    const Geometry geo = geometries[cam.slot];
    const vec3 ray = ray_of(geo, vec2(at));
    const uint start_base = surface_base(cam, geo, 0u);
    const uint end_base = surface_base(cam, geo, 1u);
    float light = 0.0;
    float shown = 0.0;
    float level = 0.0;
    // The candidates that are left, and the one that is looked at: the nearest of them.
    uint left = (p.own == TWO_SURFACES ? 3u : 1u) | (p.listed << OWN_CANDIDATES);
    Surface surface;
    vec4 sources;
    bool any_seen = false;
    Silhouette silhouette;
    silhouette.coverage = 0.0;
    Surface behind;
    float largest_share = 0.0;
    do {
        uint chosen = 32u;
        float nearest = -1.0;
        if ((left & (left - 1u)) == 0u) {
            chosen = uint(findLSB(left));
        } else {
            uint rest = left;
            do {
                const uint c = uint(findLSB(rest));
                rest &= rest - 1u;
                const Surface other = candidate_at(p, c, alpha);
                float inverse_depth;
                bool seen = true;
                point_on_path(pose_at_substep(geo, other.instance, n, i), other.planes[0], ray, inverse_depth, seen);
                if (!seen) {
                    left &= ~(1u << c);
                } else if (inverse_depth > nearest) {
                    nearest = inverse_depth;
                    chosen = c;
                }
            } while (rest != 0u);
            if (chosen == 32u) {
                break;
            }
        }
        left &= ~(1u << chosen);
        const Surface here = candidate_at(p, chosen, alpha);
        bool seen = true;
        float inverse_depth;
        const vec4 at_keys =
            find_sources(geo, pose_at_substep(geo, here.instance, n, i), here, ray, inverse_depth, seen);
        if (!seen) {
            continue;
        }
        any_seen = true;
        surface = here;
        sources = at_keys;
        const float parallax = parallax_of(geo, here.instance);
        const Known start =
            look(cam, geo, frames.previous, start_base, at_keys.xy, Seen(here.instance, here.planes[0], parallax));
        const Known end =
            look(cam, geo, frames.current, end_base, at_keys.zw, Seen(here.instance, here.planes[1], parallax));
        const float say_start = (1.0 - alpha) * max(1.0 - outside_px(cam, at_keys.xy), EDGE_WEIGHT);
        const float say_end = alpha * max(1.0 - outside_px(cam, at_keys.zw), EDGE_WEIGHT);
        const float trust_end = say_end * end.trust;
        const float trust = fma(say_start, start.trust, trust_end);
        if (trust <= 0.0) {
            continue;
        }
        const float weight_seen = fma(say_start, start.seen, say_end * end.seen);
        const float weight_known = fma(say_start, 1.0 - start.hidden, say_end * (1.0 - end.hidden));
        level = lerp(start.level, end.level, trust_end / trust);
        const float coverage = min(weight_seen / weight_known, 1.0);
        if (silhouette.coverage == 0.0 && shown == 0.0) {
            if (coverage >= 1.0) {
                lost = false;
                return level;
            } else if (coverage < 1.0 - SLIGHT_WEIGHT) {
                const vec2 open = vec2(say_start * (1.0 - start.hidden), say_end * (1.0 - end.hidden));
                const float open_end = open.y / (open.x + open.y);
                const float as_shown = lerp(
                    read_level(cam, frames.previous, 0.5 * snapped(2.0 * at_keys.xy)),
                    read_level(cam, frames.current, 0.5 * snapped(2.0 * at_keys.zw)), open_end);
                silhouette = Silhouette(coverage, exp(level), exp(as_shown), at_keys, open_end);
                continue;
            }
        }
        const float share = (1.0 - shown) * coverage;
        if (share > largest_share + SLIGHT_WEIGHT) {
            largest_share = share;
            behind = here;
        }
        light = fma(share, exp(level), light);
        shown += share;
    } while (left != 0u && shown < 1.0);
    lost = !any_seen;
    if (silhouette.coverage != 0.0) {
        return log(
            shown < UNSEEN_SHARE
                ? silhouette.as_shown
                : light_at_silhouette(cam, geo, frames, silhouette, light / shown, behind));
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
