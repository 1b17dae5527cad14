// event_ids, second part: the instance that each event's pixel shows at the event's time, camera by camera, as int64_t;
// -1 where no path tells it. The rule is in the model crate's `synthesis::rigid`; twin of the oracle's `event_ids`.
//
// 256 threads per workgroup, striding over a camera's events; y over cameras. Reads the lists of the first part.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "slices.glsl"
#include "tiles.glsl"

layout(local_size_x = 256) in;

#define RIGID true
#define LIST_BLOCKS 1u

#include "event_ids_bindings.glsl"
#include "surfaces.glsl"
#include "paths.glsl"
#include "candidates.glsl"
#include "own_surfaces.glsl"

layout(buffer_reference, std430) writeonly buffer Ids { int64_t v[]; };

// A time in the interval: as a fraction, and between which instants of `poses` it lies.
struct Moment {
    float alpha;
    uint instant;
    float beyond;
};

Moment moment_of(Slice slice, uint offset_ns) {
    const float alpha = float(since_start_ns(slice, offset_ns)) / float(slice.interval_ns);
    const float place = alpha * float(POSE_INSTANTS - 1u);
    const uint instant = min(uint(place), POSE_INSTANTS - 2u);
    return Moment(alpha, instant, place - float(instant));
}

// Poses are straight lines from instant to instant: what they differ by does not show in which pixel a point is.
Pose pose_at_moment(Geometry geo, uint instance, Moment moment) {
    const Pose before = pose_at_instant(geo, instance, moment.instant);
    const Pose after = pose_at_instant(geo, instance, moment.instant + 1u);
    const vec4 beyond = vec4(moment.beyond);
    return Pose(
        fma(beyond, after.x - before.x, before.x), fma(beyond, after.y - before.y, before.y),
        fma(beyond, after.z - before.z, before.z));
}

// Whether a key frame shows that a surface is there at a position.
bool is_shown(Camera cam, Geometry geo, uint key, vec2 position, Surface surface) {
    const vec2 outside = max(-position, position - vec2(cam.width - 1u, cam.height - 1u));
    // NaN is outside too.
    if (!all(lessThanEqual(outside, vec2(0.5)))) {
        return false;
    }
    const uint base = surface_base(cam, geo, key);
    const Spot spot = spot_at(cam, base, position);
    const Seen seen = Seen(surface.instance, surface.planes[key], parallax_of(geo, surface.instance));
    const vec2 beside = abs(spot.off);
    float belonging = 0.0;
    [[unroll]] for (uint i = 0u; i < 4u; ++i) {
        const uvec2 is_beside = uvec2(i & 1u, i >> 1);
        const vec2 weights = mix(1.0 - beside, beside, equal(is_beside, uvec2(1u)));
        const ivec2 at = spot.nearest + ivec2(sign(spot.off)) * ivec2(is_beside);
        const bool counts = weights.x * weights.y > 0.0 && belongs(geo, load_surface(base, cam, at), vec2(at), seen);
        belonging += counts ? weights.x * weights.y : 0.0;
    }
    return belonging > EVENT_ID_WEIGHT;
}

// The candidates so far: the nearest that is there, and the farthest. Inverse depths are along the pixel's ray.
struct Found {
    uint nearest;
    float nearest_inverse;
    uint farthest;
    float farthest_inverse;
};

void consider(Camera cam, Geometry geo, vec3 ray, Moment moment, Surface surface, inout Found found) {
    bool seen = true;
    float inverse_depth;
    const Pose pose = pose_at_moment(geo, surface.instance, moment);
    const vec3 point = point_on_path(pose, surface.planes[0], ray, inverse_depth, seen);
    const vec2 in_start = project(geo, point, seen);
    const vec3 at_end = moved(pose_between_keys(geo, surface.instance), point, inverse_depth);
    const vec2 in_end = project(geo, at_end, seen);
    if (!seen) {
        return;
    }
    if (found.farthest == NO_INSTANCE || inverse_depth < found.farthest_inverse) {
        found.farthest = surface.instance;
        found.farthest_inverse = inverse_depth;
    }
    if (found.nearest != NO_INSTANCE && inverse_depth <= found.nearest_inverse) {
        return;
    }
    if (is_shown(cam, geo, 0u, in_start, surface) || is_shown(cam, geo, 1u, in_end, surface)) {
        found.nearest = surface.instance;
        found.nearest_inverse = inverse_depth;
    }
}

// The row of the instance that a pixel shows; NO_INSTANCE if no path tells it.
uint instance_at(Camera cam, Geometry geo, Slice slice, uvec2 at, Moment moment) {
    const vec3 ray = ray_of(geo, vec2(at));
    const RigidPixel own = own_surfaces(cam, geo, at, ray);
    Found found = Found(NO_INSTANCE, 0.0, NO_INSTANCE, 0.0);
    if (own.own == NO_SURFACE) {
        return NO_INSTANCE;
    }
    Words lists = Words(slice.lists);
    const uvec2 block = at / BLOCK_PX;
    const uint list = (block.y * cam.blocks_x + block.x) * EVENT_IDS_LIST_WORDS;
    const uint listed = lists.v[list];
    const uint owned = own.own == TWO_SURFACES ? 2u : 1u;
    if (owned + listed == 1u) {
        return own.start.instance;
    }
    for (uint c = 0u; c < owned; ++c) {
        consider(cam, geo, ray, moment, own_candidate_at(own, c, moment.alpha), found);
    }
    for (uint c = 0u; c < listed; ++c) {
        const uint entry = lists.v[list + 1u + c];
        const uint pixel = entry & ~PASSING_KEY;
        const ivec2 from = ivec2(pixel % cam.width, pixel / cam.width);
        bool seen = true;
        const Surface surface = surface_of_pixel(cam, geo, entry >> 31, from, seen);
        consider(cam, geo, ray, moment, surface, found);
    }
    return found.nearest != NO_INSTANCE ? found.nearest : found.farthest;
}

void main() {
    const Slice slice = slice_of_workgroup();
    FISHEYE = slice.fisheye != 0u;
    const Camera cam = cameras[slice.row];
    const Geometry geo = geometries[cam.slot];
    Ids ids = Ids(push.target);
    Words ids_of_rows = Words(slice.ids);
    const uint stride = gl_NumWorkGroups.x * gl_WorkGroupSize.x;
    for (uint e = gl_GlobalInvocationID.x; e < slice.events; e += stride) {
        const uint from = slice.event_base + e;
        const uvec2 at = uvec2(event_x[from], event_y[from]);
        const uint row = instance_at(cam, geo, slice, at, moment_of(slice, event_t[from]));
        ids.v[slice.events_before + e] = row == NO_INSTANCE ? int64_t(-1) : int64_t(ids_of_rows.v[row]);
    }
}
