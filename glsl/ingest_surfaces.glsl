// The surface of each pixel of a frame, from depth and instance ids, for synthesis `rigid`. Part of ingest.glsl; the
// equations are in the model crate's `synthesis::rigid`.

#include "surfaces.glsl"

layout(buffer_reference, std430) readonly buffer Halves1 { uint16_t v[]; };
layout(buffer_reference, std430) readonly buffer Floats1 { float v[]; };

// The surface cache: the tile and two pixels around it. Beyond the image it repeats the border pixels.
const uint SURFACE_APRON_PX = 2u;
const uint SURFACE_X = TILE_WIDTH_PX + 2u * SURFACE_APRON_PX;
const uint SURFACE_PIXELS = RIGID ? SURFACE_X * (BLOCK_PX + 2u * SURFACE_APRON_PX) : 1u;
shared float cached_depth[SURFACE_PIXELS];
shared float cached_inverse_depth[SURFACE_PIXELS];
shared uint cached_instance[SURFACE_PIXELS];

// A bit for each block of the tile: whether it has a silhouette, pixels that are not inner.
shared uint silhouettes;

// Which of the 5x5 pixels around continue a pixel's surface, row by row.
const uint ALL_CONTINUE = (1u << 25) - 1u;
// Three rows of three of them, from the first on.
const uint PURE_BITS = 7u | 7u << 5 | 7u << 10;

// Bit of the pixel `offset` away.
uint continuing_bit(ivec2 offset) {
    return 1u << uint(5 * (offset.y + 2) + offset.x + 2);
}

uint surface_index(ivec2 at) {
    const uvec2 in_cache = uvec2(at - tile_origin + int(SURFACE_APRON_PX));
    return in_cache.y * SURFACE_X + in_cache.x;
}

bool shows_surface(ivec2 at) {
    return cached_instance[surface_index(at)] != NO_INSTANCE;
}

// The row of an instance, NO_INSTANCE if it has no poses.
uint row_of(Geometry geo, uint id) {
    uint first = 0u;
    uint count = geo.known_ids;
    while (count > 1u) {
        const uint half_count = count / 2u;
        const bool after = instances[geo.instance_base + first + half_count].x <= id;
        first = after ? first + half_count : first;
        count = after ? count - half_count : half_count;
    }
    const uvec2 known = instances[geo.instance_base + first];
    return known.x == id ? known.y : NO_INSTANCE;
}

uint read_id(Geometry geo, uint pixel) {
    if (geo.id_address == 0ul) {
        return 0u;
    }
    return ID_FORMAT == ID_U16 ? uint(Halves1(geo.id_address).v[pixel]) : Words1(geo.id_address).v[pixel];
}

// Whether the frame before shows this surface at a pixel.
bool was_shown(Camera cam, Geometry geo, ivec2 at, uint instance, float inverse_depth) {
    const uvec2 before = load_surface(surface_base(cam, geo, 0u), cam, at);
    return instance_of(before) == instance && before.x == floatBitsToUint(inverse_depth);
}

// Loads depth and instance of a pixel into the cache, and counts those of the tile without a path. Notes what makes the
// surfaces and the half-pel samples of the frame before out of date.
void load_geometry(Camera cam, Geometry geo, uint number, bool counts) {
    const ivec2 at = tile_origin - int(SURFACE_APRON_PX) + ivec2(number % SURFACE_X, number / SURFACE_X);
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const ivec2 clamped_at = clamp(at, ivec2(0), last);
    const uint pixel = uint(clamped_at.y) * cam.width + uint(clamped_at.x);
    const float depth = Floats1(geo.depth_address).v[pixel];
    const uint id = read_id(geo, pixel);
    // A depth of 0 is background at infinity, as infinity is.
    const uint bits = floatBitsToUint(depth);
    const bool nan = (bits & 0x7fffffffu) > 0x7f800000u;
    const bool nought = (bits & 0x7fffffffu) == 0u;
    const float far_depth = nought ? uintBitsToFloat(0x7f800000u) : depth;
    const bool infinite = floatBitsToUint(far_depth) == 0x7f800000u;
    const float inverse_depth = infinite ? 0.0 : 1.0 / far_depth;
    uint instance = row_of(geo, id);
    const bool poses_missing = instance == NO_INSTANCE;
    // One so small that its inverse is infinite has no place either.
    const bool depth_missing = nan || (!nought && (bits & 0x80000000u) != 0u) || not_finite(inverse_depth);
    const bool lens_missing = !lens_shows(geo, vec2(clamped_at));
    if (counts && clamped_at == at && all(lessThan(uvec2(at - tile_origin), uvec2(TILE_WIDTH_PX, BLOCK_PX)))) {
        const uint counter = 2u * cam.slot + cam.frame_slot;
        if (poses_missing) {
            atomicAdd(counters[counter].without_poses, 1u);
        } else if (depth_missing) {
            atomicAdd(counters[counter].without_depth, 1u);
        } else if (lens_missing) {
            atomicAdd(counters[counter].without_lens, 1u);
        }
    }
    if (depth_missing || lens_missing) {
        instance = NO_INSTANCE;
    }
    const float shown_inverse = instance == NO_INSTANCE ? 0.0 : inverse_depth;
    cached_depth[number] = far_depth;
    cached_inverse_depth[number] = shown_inverse;
    cached_instance[number] = instance;
    const bool moves = instance != NO_INSTANCE && instance_moves(geo, instance);
    if (moves || (!is_first(cam) && !was_shown(cam, geo, clamped_at, instance, shown_inverse))) {
        any_change = 1u;
    }
}

// The fraction by which inverse depth changes from one depth to another.
float inverse_depth_rise(float depth, float other) {
    return not_finite(other) ? -1.0 : (depth - other) / other;
}

// Slope of inverse depth along one axis, as a fraction of it: the smaller of the differences to both neighbours, or 0
// where they disagree in sign, or where a neighbour is of another instance. A pixel at the border has those of the pixel
// beside it.
float slope_along(Camera cam, ivec2 at, ivec2 axis) {
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const ivec2 centre = clamp(at, axis, max(last - axis, axis));
    const uint own = surface_index(at);
    const uint middle = surface_index(centre);
    const uint before = surface_index(centre - axis);
    const uint after = surface_index(centre + axis);
    const uint instance = cached_instance[own];
    const float depth = cached_depth[middle];
    const bool is_one = cached_instance[before] == instance && cached_instance[middle] == instance
        && cached_instance[after] == instance;
    if (!is_one || any(greaterThan(2 * axis, last)) || not_finite(depth) || not_finite(cached_depth[own])) {
        return 0.0;
    }
    const float fall = -inverse_depth_rise(depth, cached_depth[before]);
    const float rise = inverse_depth_rise(depth, cached_depth[after]);
    const float slope = abs(fall) < abs(rise) ? fall : rise;
    return fall * rise <= 0.0 ? 0.0 : centre == at ? slope : slope * (cached_depth[own] / depth);
}

// A pixel's surface, from the cache.
struct Own {
    uint instance;
    float inverse_depth;
    // Packed slopes.
    uint slopes;
    vec3 plane;
};

Own own_surface(Camera cam, Geometry geo, ivec2 at) {
    const uint cached = surface_index(at);
    Own own;
    own.instance = cached_instance[cached];
    own.inverse_depth = cached_inverse_depth[cached];
    own.slopes = 0u;
    own.plane = vec3(0.0);
    if (own.instance != NO_INSTANCE) {
        own.slopes = packHalf2x16(vec2(slope_along(cam, at, ivec2(1, 0)), slope_along(cam, at, ivec2(0, 1))));
        own.plane = plane_of(geo, vec2(at), own.inverse_depth, unpackHalf2x16(own.slopes) * own.inverse_depth);
    }
    return own;
}

// Whether the pixel `offset` away continues a pixel's surface: its inverse depth is that of the surface there, to what
// LEAST_MOTION_PX of motion would tell apart. A pixel at infinity, where that is nothing, continues only others there.
bool continues_at(Camera cam, Geometry geo, ivec2 at, Own own, ivec2 offset) {
    const ivec2 near = clamp(at + offset, ivec2(0), ivec2(cam.width, cam.height) - 1);
    const uint cached = surface_index(near);
    const vec2 slopes_px = unpackHalf2x16(own.slopes) * own.inverse_depth;
    const vec2 away = vec2(near - at);
    // Through a pinhole, a plane's inverse depth is linear in the image.
    const float expected = !FISHEYE
        ? fma(slopes_px.x, away.x, fma(slopes_px.y, away.y, own.inverse_depth))
        : dot3(own.plane, ray_of(geo, vec2(near)));
    const float inverse_depth = cached_inverse_depth[cached];
    const bool continues = abs(inverse_depth - expected) * LEAST_MOTION_PX <= BELONG_PX * inverse_depth;
    const bool ends_before = inverse_depth == 0.0 && own.inverse_depth != 0.0;
    return cached_instance[cached] == own.instance && continues && !ends_before;
}

// Which of the 5x5 pixels around do.
uint continuing_around(Camera cam, Geometry geo, ivec2 at, Own own) {
    uint bits = 0u;
    for (int y = -2; y <= 2; ++y) {
        for (int x = -2; x <= 2; ++x) {
            if (continues_at(cam, geo, at, own, ivec2(x, y))) {
                bits |= continuing_bit(ivec2(x, y));
            }
        }
    }
    return own.instance == NO_INSTANCE ? 0u : bits;
}

// Whether all of some pixels do.
bool all_continue(uint bits, uint wanted) {
    return (bits & wanted) == wanted;
}

// A bit for each phase of a pixel's half-pel samples, 1 right, 2 below, 3 both: whether that lies between pixels that
// continue the pixel's surface.
uint joined_phases(Camera cam, Geometry geo, ivec2 at, Own own) {
    const bool right = continues_at(cam, geo, at, own, ivec2(1, 0));
    const bool below = continues_at(cam, geo, at, own, ivec2(0, 1));
    const bool both = right && below && continues_at(cam, geo, at, own, ivec2(1, 1));
    return (right ? 1u << 1 : 0u) | (below ? 1u << 2 : 0u) | (both ? 1u << 3 : 0u);
}

// The front of a pixel, a bit among those of the pixels around: of those that do not continue its surface, the nearest to
// the camera, if that is nearer than the pixel. One without a surface counts as nearest of all. 0 if there is none.
uint front_around(Camera cam, ivec2 at, uint bits) {
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    float nearest = cached_depth[surface_index(at)];
    uint front = 0u;
    uint around = 1u;
    for (int y = -1; y <= 1; ++y) {
        for (int x = -1; x <= 1; ++x) {
            const ivec2 near = at + ivec2(x, y);
            if (x == 0 && y == 0) {
                continue;
            }
            if ((bits & continuing_bit(ivec2(x, y))) == 0u && near == clamp(near, ivec2(0), last)) {
                const float depth = shows_surface(near) ? cached_depth[surface_index(near)] : -1.0;
                front = depth < nearest ? around : front;
                nearest = min(depth, nearest);
            }
            around <<= 1u;
        }
    }
    return front;
}

// Finds and writes the surface of a pixel of the tile.
void find_surface(Camera cam, Geometry geo, uint number) {
    const ivec2 at = tile_origin + ivec2(number % TILE_WIDTH_PX, number / TILE_WIDTH_PX);
    if (at.x >= int(cam.width) || at.y >= int(cam.height)) {
        return;
    }
    const Own own = own_surface(cam, geo, at);
    const uint bits = continuing_around(cam, geo, at, own);
    if (bits != ALL_CONTINUE) {
        atomicOr(silhouettes, 1u << ((number % TILE_WIDTH_PX) / BLOCK_PX));
    }
    uint word = own.instance;
    uint around = 0u;
    for (uint pixel = 0u; pixel < 9u; ++pixel) {
        const uint first = 5u * (pixel / 3u) + pixel % 3u;
        if (pixel != 4u) {
            word |= ((bits >> (first + 6u)) & 1u) << (SURFACE_CONTINUES_SHIFT + around);
            word |= all_continue(bits >> first, PURE_BITS) ? 1u << (SURFACE_PURE_SHIFT + around) : 0u;
            around += 1u;
        }
    }
    if (own.instance != NO_INSTANCE && !all_continue(bits >> 6u, PURE_BITS)) {
        word |= front_around(cam, at, bits) << SURFACE_PURE_SHIFT;
    }
    const uint element = surface_base(cam, geo, 1u) + uint(at.y) * cam.width + uint(at.x);
    surfaces[element] = uvec2(floatBitsToUint(own.inverse_depth), word);
    slopes[element] = own.slopes;
}

void find_surfaces(Camera cam, Geometry geo) {
    for (uint number = gl_LocalInvocationID.x; number < TILE_ANCHORS; number += gl_WorkGroupSize.x) {
        find_surface(cam, geo, number);
    }
}

// Takes over the surfaces of the frame before, where each pixel of the cache shows what it did and nothing moves.
void keep_surfaces(Camera cam, Geometry geo) {
    for (uint number = gl_LocalInvocationID.x; number < TILE_ANCHORS; number += gl_WorkGroupSize.x) {
        const uvec2 at = uvec2(tile_origin) + uvec2(number % TILE_WIDTH_PX, number / TILE_WIDTH_PX);
        if (at.x < cam.width && at.y < cam.height) {
            const uint pixel = at.y * cam.width + at.x;
            const uint before = surface_base(cam, geo, 0u) + pixel;
            const uint element = surface_base(cam, geo, 1u) + pixel;
            surfaces[element] = surfaces[before];
            slopes[element] = slopes[before];
        }
    }
}
