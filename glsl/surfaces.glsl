// Surfaces of key frames and their exact paths, for synthesis `rigid`. Twin of the oracle's `synthesize::rigid`; the
// equations are in the model crate's `synthesis::rigid`.
//
// Key frame 0 is the frame at the interval's start, key frame 1 the one at its end. Positions in an image are in
// pixels. Points are homogeneous: a direction and an inverse depth. An instance is a row of the camera's tables; row 0
// is the static world.
//
// Needs FISHEYE, the buffers `surfaces`, `slopes` and `poses`, declared by the including file, and half_pel.glsl. Kernels that
// define READS_SURFACE_TEXELS read them by texel fetch.

#ifdef READS_SURFACE_TEXELS
#include "surface_load_by_texel.glsl"
#else
#include "surface_load_by_element.glsl"
#endif

// ---- Surfaces of pixels ----

// What a pixel shows, as `surfaces` has it: x is the inverse depth, y the instance (NO_INSTANCE if there is none) and two
// sets of bits, one for each of the eight pixels around, row by row: whether that continues the pixel's surface, and
// whether it is pure as far as the pixel can tell. None that does not continue the surface is pure: there the second bit
// says that it is the front.
const uint SURFACE_CONTINUES_SHIFT = 16u;
const uint SURFACE_PURE_SHIFT = 24u;
// Bits of pixels around: left, right, above, below, and the four corners.
const uint AROUND_LEFT = 1u << 3;
const uint AROUND_RIGHT = 1u << 4;
const uint AROUND_ABOVE = 1u << 1;
const uint AROUND_BELOW = 1u << 6;
const uint AROUND_ABOVE_LEFT = 1u << 0;
const uint AROUND_ABOVE_RIGHT = 1u << 2;
const uint AROUND_BELOW_LEFT = 1u << 5;
const uint AROUND_BELOW_RIGHT = 1u << 7;
const uint ALL_AROUND = 0xffu;

uint instance_of(uvec2 surface) {
    return surface.y & 0xffffu;
}

bool has_surface(uvec2 surface) {
    return instance_of(surface) != NO_INSTANCE;
}

float inverse_depth_of(uvec2 surface) {
    return uintBitsToFloat(surface.x);
}

uint continuing_of(uvec2 surface) {
    return (surface.y >> SURFACE_CONTINUES_SHIFT) & ALL_AROUND;
}

bool is_pure(uvec2 surface) {
    return continuing_of(surface) == ALL_AROUND;
}

// How thick a pixel's surface is there: 1 if some 3x3 pixels that hold the pixel continue it, HALF_THICK if some 2x2 do.
float thickness_of(uvec2 surface) {
    const uint continuing = continuing_of(surface);
    if (continuing == ALL_AROUND || (continuing & (surface.y >> SURFACE_PURE_SHIFT)) != 0u) {
        return 1.0;
    }
    // The three others of each.
    const uvec4 others = uvec4(
        AROUND_LEFT | AROUND_ABOVE_LEFT | AROUND_ABOVE, AROUND_ABOVE | AROUND_ABOVE_RIGHT | AROUND_RIGHT,
        AROUND_RIGHT | AROUND_BELOW_RIGHT | AROUND_BELOW, AROUND_BELOW | AROUND_BELOW_LEFT | AROUND_LEFT);
    return any(equal(continuing & others, others)) ? HALF_THICK : 0.0;
}

// The bit of a pixel's front; 0 if it has none.
uint front_of(uvec2 surface) {
    return ~continuing_of(surface) & (surface.y >> SURFACE_PURE_SHIFT);
}

// Whether the 5x5 pixels around continue a pixel's surface.
bool is_inner(uvec2 surface) {
    return surface.y >> SURFACE_CONTINUES_SHIFT == 0xffffu;
}

// Whether the half-pel sample of a phase (1 right, 2 below, 3 both) lies between pixels that continue a pixel's surface.
bool is_joined(uvec2 surface, uint phase) {
    const uint parents = phase == 1u ? AROUND_RIGHT
        : phase == 2u                ? AROUND_BELOW
                                     : AROUND_RIGHT | AROUND_BELOW | AROUND_BELOW_RIGHT;
    return (continuing_of(surface) & parents) == parents;
}

// First element of key frame `key` (0 or 1) in `surfaces` and `slopes`.
uint surface_base(Camera cam, Geometry geo, uint key) {
    return geo.surface_base + (key == 1u ? cam.frame_slot : 1u - cam.frame_slot) * cam.pixels;
}

uvec2 load_surface(uint base, Camera cam, ivec2 at) {
    return SURFACE_WORDS(base + uint(at.y) * cam.width + uint(at.x));
}

// Change of a pixel's inverse depth from pixel to pixel, along x and y.
vec2 load_slopes(uint base, Camera cam, ivec2 at, float inverse_depth) {
    return unpackHalf2x16(SLOPE_WORD(base + uint(at.y) * cam.width + uint(at.x))) * inverse_depth;
}

// ---- Lens ----

const float PI = 3.14159265358979;

// Whether the lens shows anything at a position.
bool lens_shows(Geometry geo, vec2 at) {
    const vec2 a = (at - vec2(geo.centre_x_px, geo.centre_y_px)) * vec2(geo.inverse_focal_x, geo.inverse_focal_y);
    return !FISHEYE || length(a) < PI;
}

// The point of depth 1 that a position shows, camera axes.
vec3 ray_of(Geometry geo, vec2 at) {
    const vec2 a = (at - vec2(geo.centre_x_px, geo.centre_y_px)) * vec2(geo.inverse_focal_x, geo.inverse_focal_y);
    if (!FISHEYE) {
        return vec3(a.x, -a.y, -1.0);
    }
    const float angle = length(a);
    const float sine = angle > 0.0 ? sin(angle) / angle : 1.0;
    return vec3(a.x * sine, -a.y * sine, -cos(angle));
}

// Where a point is in the image. `seen` becomes false if it has no image.
vec2 project(Geometry geo, vec3 point, inout bool seen) {
    const float forward = -point.z;
    const vec2 across = vec2(point.x, -point.y);
    vec2 a;
    if (!FISHEYE) {
        seen = seen && forward > 0.0;
        a = across / (forward > 0.0 ? forward : 1.0);
    } else {
        const float radius = length(across);
        seen = seen && (radius > 0.0 || forward > 0.0);
        a = radius > 0.0 ? across * (atan(radius, forward) / radius) : vec2(0.0);
    }
    return fma(a, vec2(geo.focal_x_px, geo.focal_y_px), vec2(geo.centre_x_px, geo.centre_y_px));
}

// ---- Poses ----

// A rigid motion: each row has a row of the rotation and the translation along one axis.
struct Pose {
    vec4 x;
    vec4 y;
    vec4 z;
};

float turned_axis(vec4 row, vec3 direction) {
    return fma(row.x, direction.x, fma(row.y, direction.y, row.z * direction.z));
}

vec3 turned(Pose pose, vec3 direction) {
    return vec3(
        turned_axis(pose.x, direction), turned_axis(pose.y, direction), turned_axis(pose.z, direction));
}

vec3 shift_of(Pose pose) {
    return vec3(pose.x.w, pose.y.w, pose.z.w);
}

// A homogeneous point after a motion.
vec3 moved(Pose pose, vec3 point, float inverse_depth) {
    return fma(shift_of(pose), vec3(inverse_depth), turned(pose, point));
}

Pose inverse_of(Pose pose) {
    const vec3 shift = shift_of(pose);
    const vec3 column_x = vec3(pose.x.x, pose.y.x, pose.z.x);
    const vec3 column_y = vec3(pose.x.y, pose.y.y, pose.z.y);
    const vec3 column_z = vec3(pose.x.z, pose.y.z, pose.z.z);
    return Pose(
        vec4(column_x, -turned_axis(vec4(column_x, 0.0), shift)),
        vec4(column_y, -turned_axis(vec4(column_y, 0.0), shift)),
        vec4(column_z, -turned_axis(vec4(column_z, 0.0), shift)));
}

Pose load_pose(uint row) {
    return Pose(POSE_ROW(row), POSE_ROW(row + 1u), POSE_ROW(row + 2u));
}

// The motion of an instance from camera axes at instant `i` of POSE_INSTANTS to those of key frame 0.
Pose pose_at_instant(Geometry geo, uint instance, uint i) {
    return load_pose(geo.pose_base + instance * POSE_ROWS + 3u * i);
}

// The same at a knot.
Pose pose_at_knot(Geometry geo, uint instance, uint knot) {
    return pose_at_instant(geo, instance, knot * ((POSE_INSTANTS - 1u) / (KNOTS - 1u)));
}

// The motion of an instance from camera axes at key frame 0 to those of key frame 1.
Pose pose_between_keys(Geometry geo, uint instance) {
    return pose_at_instant(geo, instance, POSE_INSTANTS);
}

// An instance's parallax, pixels for each unit of inverse depth; 0 if it has no poses any more.
float parallax_of(Geometry geo, uint instance) {
    return POSE_ROW(geo.pose_base + instance * POSE_ROWS + POSE_ROWS - 1u).x;
}

// Whether an instance moves before the camera during the interval.
bool instance_moves(Geometry geo, uint instance) {
    return POSE_ROW(geo.pose_base + instance * POSE_ROWS + POSE_ROWS - 1u).y != 0.0;
}

// ---- Planes ----

// The plane that a pixel shows, in its key frame's axes: m with m . X = 1.
vec3 plane_of(Geometry geo, vec2 at, float inverse_depth, vec2 slopes_px) {
    const vec3 ray = ray_of(geo, at);
    // Change of inverse depth with the tangents, or the angles, that the lens maps to pixels.
    const vec2 g = slopes_px * vec2(geo.focal_x_px, geo.focal_y_px);
    if (!FISHEYE) {
        const vec2 m = vec2(g.x, -g.y);
        return vec3(m, fma(m.x, ray.x, fma(m.y, ray.y, -inverse_depth)));
    }
    const vec2 a = (at - vec2(geo.centre_x_px, geo.centre_y_px)) * vec2(geo.inverse_focal_x, geo.inverse_focal_y);
    const float angle = length(a);
    const float sine = length(ray.xy);
    const vec3 facing = ray * inverse_depth;
    if (angle == 0.0) {
        return facing + vec3(g.x, -g.y, 0.0);
    }
    // Away from the axis, and around it.
    const vec2 out_px = a / angle;
    const vec3 outwards = vec3(-ray.z * out_px.x, ray.z * out_px.y, sine);
    const vec3 around = vec3(-out_px.y, -out_px.x, 0.0);
    const float m_out = fma(out_px.x, g.x, out_px.y * g.y);
    const float m_around = sine > 1e-3 ? (out_px.x * g.y - out_px.y * g.x) * (angle / sine) : 0.0;
    return fma(outwards, vec3(m_out), fma(around, vec3(m_around), facing));
}

float dot3(vec3 a, vec3 b) {
    return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

// A plane after a rigid motion. `seen` becomes false if the camera then is behind it.
vec3 moved_plane(vec3 plane, Pose motion, inout bool seen) {
    const vec3 m = turned(motion, plane);
    const float scale = 1.0 + dot3(m, shift_of(motion));
    seen = seen && scale > 0.0;
    return m / (scale > 0.0 ? scale : 1.0);
}

// ---- What a key frame knows of a surface ----

// A surface as a key frame sees it: its plane is in that key frame's axes.
struct Seen {
    uint instance;
    vec3 plane;
    float parallax;
};

// How a pixel of a key frame lies to a surface: it shows it, it shows something nearer or unknown, or something farther.
const uint BELONGS = 0u;
const uint HIDES = 1u;
const uint FARTHER = 2u;

uint relation(Geometry geo, uvec2 shown, vec2 at, Seen surface) {
    if (!has_surface(shown)) {
        return HIDES;
    }
    const float behind = inverse_depth_of(shown) - dot3(surface.plane, ray_of(geo, at));
    if (instance_of(shown) == surface.instance && abs(behind) * surface.parallax < BELONG_PX) {
        return BELONGS;
    }
    return behind > 0.0 ? HIDES : FARTHER;
}

bool belongs(Geometry geo, uvec2 shown, vec2 at, Seen surface) {
    return relation(geo, shown, at, surface) == BELONGS;
}

// ---- Lists ----

// Word of a block in `representatives` of key frame `key`: their number, with HAS_SILHOUETTE if the block has one, then
// their pixels from near to far.
uint representative_word(Camera cam, Geometry geo, uint key, uint block) {
    const uint slot = key == 1u ? cam.frame_slot : 1u - cam.frame_slot;
    return geo.representative_base + (slot * cam.blocks + block) * REPRESENTATIVE_WORDS;
}

// Word of a block's head in `passing` of this tick: the number of surfaces that pass it (it may exceed
// PASSING_ENTRIES), the bits of the largest motion of them, pixels, and where sub-steps are by error those of the
// largest bend of their ways, pixels for the square of an interval.
uint passing_head(Camera cam, Geometry geo, uint block) {
    return geo.passing_base + (cam.frame_slot * cam.blocks + block) * PASSING_HEAD_WORDS;
}

// Word of the first of a block's entries in `passing`, in any order: places in `representatives`, counted from those of
// the key frame's first block, with PASSING_KEY for those of key frame 1. So their order as numbers is that by key
// frame, block, and from near to far.
uint passing_entries(Camera cam, Geometry geo, uint block) {
    return geo.passing_base + 2u * cam.blocks * PASSING_HEAD_WORDS + block * PASSING_ENTRIES;
}

const uint PASSING_KEY = 0x80000000u;
const uint HAS_SILHOUETTE = 0x80000000u;

// The entry of a place in a block's list of representatives.
uint passing_entry(uint key, uint block, uint place) {
    return (block * REPRESENTATIVE_WORDS + 1u + place) | (key == 1u ? PASSING_KEY : 0u);
}

// ---- Reading a half-pel frame within a surface ----

// A position in half pixels, on a row or column of half-pel samples if it is near one: the range that a level is clamped
// to changes there, and rounding would decide on which side a position falls that does not move across.
vec2 snapped(vec2 at) {
    const vec2 nearest = roundEven(at);
    return mix(at, nearest, lessThanEqual(abs(at - nearest), vec2(SNAP_SAMPLES)));
}

// A position in a key frame.
struct Spot {
    // Snapped, pixels.
    vec2 position;
    // The pixel nearest to it, and the way from there.
    ivec2 nearest;
    vec2 off;
    // Bits of the pixels beside that one that the position lies between: beside it in its row, in its column, and both.
    uvec3 between;
    // What that pixel shows.
    uvec2 shown;
};

// The bits of the pixels that a position `off` the nearest one lies between.
uvec3 bits_between(vec2 off) {
    const bool right = off.x > 0.0;
    const bool below = off.y > 0.0;
    return uvec3(
        off.x == 0.0 ? 0u : right ? AROUND_RIGHT : AROUND_LEFT,
        off.y == 0.0 ? 0u : below ? AROUND_BELOW : AROUND_ABOVE,
        off.x == 0.0 || off.y == 0.0 ? 0u
            : below                  ? (right ? AROUND_BELOW_RIGHT : AROUND_BELOW_LEFT)
                                     : (right ? AROUND_ABOVE_RIGHT : AROUND_ABOVE_LEFT));
}

Spot spot_at(Camera cam, uint base, vec2 position) {
    Spot spot;
    spot.position = 0.5 * snapped(2.0 * position);
    const vec2 inside = clamp(spot.position, vec2(0.0), vec2(cam.width - 1u, cam.height - 1u));
    spot.nearest = ivec2(inside + 0.5);
    spot.off = inside - vec2(spot.nearest);
    spot.between = bits_between(spot.off);
    spot.shown = load_surface(base, cam, spot.nearest);
    return spot;
}

// Whether the pixels that a position lies between continue the surface of the nearest, so that this speaks for all.
bool is_within(Spot spot) {
    const uint needed = spot.between.x | spot.between.y | spot.between.z;
    return (continuing_of(spot.shown) & needed) == needed;
}

// Whether the pixels that a position within a surface lies between are pure.
bool is_pure_within(Spot spot) {
    const uint needed = spot.between.x | spot.between.y | spot.between.z;
    return is_pure(spot.shown) && ((spot.shown.y >> SURFACE_PURE_SHIFT) & needed) == needed;
}

// Confidence in the light at a position within a surface: pixels that are not pure may be mixtures.
float trust_within(Spot spot) {
    if (is_inner(spot.shown)) {
        return 1.0;
    }
    const uint pure = spot.shown.y >> SURFACE_PURE_SHIFT;
    const vec2 w = abs(spot.off);
    const vec3 beside = mix(vec3(MIXED_WEIGHT), vec3(1.0), notEqual(spot.between & pure, uvec3(0u)));
    const float own = is_pure(spot.shown) ? 1.0 : MIXED_WEIGHT;
    return lerp(lerp(own, beside.x, w.x), lerp(beside.y, beside.z, w.x), w.y);
}

// Whether the half-pel frame shows a surface at a snapped position, in half pixels inside the image; if `pure`, between
// pure pixels.
bool half_pel_shows(Camera cam, Geometry geo, uint base, vec2 at, Seen surface, bool pure) {
    const Spot spot = spot_at(cam, base, 0.5 * at);
    return is_within(spot) && (!pure || is_pure_within(spot)) && belongs(geo, spot.shown, vec2(spot.nearest), surface);
}
