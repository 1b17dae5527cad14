// detail_transfer: a frame's half-pel samples take detail from the other frame. `ingest` does the first transfer, which
// is forward: the current frame takes from the previous one. This does those after it in turn: backward, then forward
// again.
//
// One workgroup per tile; x over tiles, y over cameras; push.level is the number of the transfer, from 1 on. A thread
// first takes anchors, then one pixel with its three half-pel samples, in all colour components. Reads one half-pel frame
// in `planes` and writes half-pel samples of the other. Each transfer waits for the one before; `cross` reads both frames.
#include "common.glsl"
#include "detail_transfer_constants.glsl"

layout(local_size_x = INGEST_THREADS) in;

BUFFER(, SLOT_PLANES, float, planes);
BUFFER(readonly, SLOT_MOTION, vec2, motion);
BUFFER(readonly, SLOT_BLOCKS, uvec4, blocks);
BUFFER(readonly, SLOT_POSES, vec4, poses);
BUFFER(readonly, SLOT_SURFACES, uvec2, surfaces);
BUFFER(readonly, SLOT_SLOPES, uint, slopes);
BUFFER(readonly, SLOT_PASSING, uint, passing);

const uint COMPONENTS = INTENSITY == INTENSITY_BAYER_RGGB ? 3u : 1u;

#include "tiles.glsl"
#define READS_SURFACE_TEXELS
#include "frame_load_by_texel.glsl"
#include "trajectory.glsl"
#include "half_pel.glsl"
#include "store_by_word.glsl"
#include "half_pel_store.glsl"

vec2 motion_near(Camera cam, ivec2 at);

// Whether the previous frame takes from the current one, or the other way round.
bool is_backward() {
    return push.level == 1u;
}

#include "detail_anchors.glsl"

vec2 motion_near(Camera cam, ivec2 at) {
    const ivec2 clamped_at = clamp(at, ivec2(0), ivec2(cam.width, cam.height) - 1);
    const vec2 m = motion_at(cam, motion_base(cam, true), clamped_at);
    return floatBitsToUint(m.x) == INVALID_BIT ? vec2(NOWHERE_PX) : m;
}

// Displacement of what a pixel shows to the frame that is taken from, pixels.
vec2 shift_at(Camera cam, ivec2 at) {
    return is_backward() ? -motion_from_previous(cam, at) : motion_at(cam, motion_base(cam, true), at);
}

// How far the vectors are from agreeing on the way of a pixel, which `shift` displaces. Vectors are those of the current
// frame: a pixel of the previous one also asks where the current frame shows it, and whether they lead back from there.
float disagreement_on_way(Camera cam, ivec2 at, vec2 shift) {
    const float here = disagreement_px(motions_around(cam, at));
    if (!is_backward()) {
        return here;
    }
    const vec2 there = clamp(vec2(at) + shift, vec2(0.0), vec2(cam.width, cam.height) - 1.0);
    const vec2 astray = abs(motion_bilinear(cam, motion_base(cam, true), there) + shift);
    const float around = max(here, disagreement_px(motions_around(cam, ivec2(floor(there + 0.5)))));
    return max(around, LEADING_BACK * max(astray.x, astray.y));
}

#include "surfaces.glsl"
#include "rigid_route.glsl"

// Displacement of each anchor, pixels.
shared vec2 shifts[ANCHORS];
// Nonzero if anything moved or changed in the tile or the blocks around it.
shared uint any_change;

// Notes an anchor's residuals: its level minus that of the other frame at `there`, half pixels. `own` and `other` are the
// first words of the frame that takes detail and of the one that it takes from.
void note_residuals(Camera cam, uint own, uint other, uint anchor, ivec2 at, vec2 there) {
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        const float level = load_plane(own + k * cam.frame_words + frame_word(cam, true, at));
        const uint frame = other + k * cam.frame_words;
        residuals[k * ANCHORS + anchor] = level - half_pel_cubic(cam, frame, there, cubic_parameter(cam, frame, at));
    }
}

// One coordinate of the displacements of a quad of anchors.
vec4 shift_quad(uint anchor, int axis) {
    return vec4(
        shifts[anchor][axis], shifts[anchor + 1u][axis], shifts[anchor + ANCHORS_X][axis],
        shifts[anchor + ANCHORS_X + 1u][axis]);
}

// The way of a pixel's samples along its exact path; `key` is the key frame that has the pixel.
Route route_at(Camera cam, Geometry geo, uint key, ivec2 at) {
    const uint base = surface_base(cam, geo, key);
    const uvec2 shown = load_surface(base, cam, at);
    const float inverse_depth = inverse_depth_of(shown);
    const vec3 plane = plane_of(geo, vec2(at), inverse_depth, load_slopes(base, cam, at, inverse_depth));
    return route_of(geo, instance_of(shown), plane, key == 1u);
}

// The transfer of a tile along exact paths. `own` and `other` are the first words of the frame that takes detail and of
// the one that it takes from.
void transfer_rigid(Camera cam, ivec2 corner, uint own, uint other) {
    const Geometry geo = geometries[cam.slot];
    const uint lane = gl_LocalInvocationID.x;
    const uint key = is_backward() ? 0u : 1u;
    const uint base = surface_base(cam, geo, 1u - key);
    // The current frame's mixtures are of another background.
    const bool from_pure = is_backward();
    vec2 there;
    for (uint number = lane; number < ANCHORS; number += gl_WorkGroupSize.x) {
        const ivec2 at = anchor_pixel(cam, corner, anchor_at(number));
        const uint anchor = anchor_index(anchor_at(number));
        confidences[anchor] = follow(cam, geo, route_at(cam, geo, key, at), base, vec2(at), from_pure, there);
        if (confidences[anchor] > 0.0) {
            note_residuals(cam, own, other, anchor, at, there);
        }
    }
    barrier();
    const uvec2 in_tile = anchor_at(lane);
    const uint anchor = anchor_index(in_tile);
    const ivec2 at = corner + ivec2(in_tile);
    if (!has_half_pels(cam, corner, in_tile) || confidences[anchor] == 0.0) {
        return;
    }
    const Route route = route_at(cam, geo, key, at);
    const uvec2 shown = load_surface(surface_base(cam, geo, key), cam, at);
    for (int phase = 1; phase < 4; ++phase) {
        const ivec2 offset = phase_offset_of(phase);
        const float anchors = least_confidence(anchor, offset);
        if (anchors == 0.0 || !is_joined(shown, uint(phase))) {
            continue;
        }
        const vec2 position = vec2(at) + 0.5 * vec2(offset);
        const float trust = min(anchors, follow(cam, geo, route, base, position, from_pure, there));
        if (trust > 0.0) {
            [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
                const uint word = own + k * cam.frame_words + frame_word(cam, true, at) + uint(offset.x)
                    + uint(offset.y) * cam.half_pel_stride;
                const uint frame = other + k * cam.frame_words;
                const float told = half_pel_cubic(cam, frame, there, cubic_parameter(cam, frame, at));
                const float residual = mean_of_quad(residual_quad(k * ANCHORS + anchor), offset);
                planes[word] = lerp(planes[word], told + residual, trust);
            }
        }
    }
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        const uint frame = own + k * cam.frame_words;
        const uint word = frame + frame_word(cam, true, at);
        const uint below = word + cam.half_pel_stride;
        // Again, for the copies at the image's border.
        store_entries(cam, frame, at, vec4(planes[word], planes[word + 1u], planes[below], planes[below + 1u]));
    }
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const ivec2 corner = ivec2(tile_corner(cameras[index].blocks_x, gl_WorkGroupID.x));
    if (cameras[index].frame_kind != FRAME_INTERVAL || corner.y >= int(cameras[index].height)) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    // The frame that takes detail, and the one that it takes from.
    const uint own_slot = is_backward() ? 1u - cam.frame_slot : cam.frame_slot;
    const uint own = cam.plane_base + own_slot * COMPONENTS * cam.frame_words;
    const uint other = cam.plane_base + (1u - own_slot) * COMPONENTS * cam.frame_words;

    if (lane == 0u) {
        any_change = 0u;
    }
    barrier();
    if (lane < 3u * (TILE_BLOCKS + 2u)) {
        const ivec2 near = corner / int(BLOCK_PX)
            + ivec2(int(lane % (TILE_BLOCKS + 2u)) - 1, int(lane / (TILE_BLOCKS + 2u)) - 1);
        const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
        if (all(greaterThanEqual(near, ivec2(0))) && all(lessThanEqual(near, last_block))) {
            const uint block = uint(near.y) * cam.blocks_x + uint(near.x);
            const uvec4 stats = blocks[cam.block_base + cam.frame_slot * cam.blocks + block];
            atomicOr(any_change, stats.x | stats.y);
            if (RIGID) {
                atomicOr(any_change, passing[passing_head(cam, geometries[cam.slot], block) + 1u]);
            }
        }
    }
    barrier();
    if (any_change == 0u) {
        // Nothing moved or changed: the other frame has no further detail.
        return;
    }
    if (RIGID) {
        transfer_rigid(cam, corner, own, other);
        return;
    }
    for (uint number = lane; number < ANCHORS; number += gl_WorkGroupSize.x) {
        const ivec2 at = anchor_pixel(cam, corner, anchor_at(number));
        const uint anchor = anchor_index(anchor_at(number));
        const vec2 shift = shift_at(cam, at);
        const vec2 there = to_half_pel(cam, vec2(at) + shift);
        shifts[anchor] = shift;
        confidences[anchor] = confidence_at(cam, disagreement_on_way(cam, at, shift), vec2(at) + shift);
        note_residuals(cam, own, other, anchor, at, there);
    }
    barrier();
    const uvec2 in_tile = anchor_at(lane);
    const ivec2 at = corner + ivec2(in_tile);
    if (!has_half_pels(cam, corner, in_tile)) {
        return;
    }
    const Correction corrections[3] = corrections_at(in_tile);
    vec2 there[3];
    const vec4 shifts_x = shift_quad(anchor_index(in_tile), 0);
    const vec4 shifts_y = shift_quad(anchor_index(in_tile), 1);
    float most_confidence = 0.0;
    [[unroll]] for (int phase = 1; phase < 4; ++phase) {
        const ivec2 phase_offset = phase_offset_of(phase);
        const vec2 shift = vec2(mean_of_quad(shifts_x, phase_offset), mean_of_quad(shifts_y, phase_offset));
        there[phase - 1] = to_half_pel(cam, vec2(at) + 0.5 * vec2(phase_offset) + shift);
        most_confidence = max(most_confidence, corrections[phase - 1].confidence);
    }
    if (most_confidence == 0.0) {
        return;
    }
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        const uint base = own + k * cam.frame_words;
        const uint word = base + frame_word(cam, true, at);
        const uint below = word + cam.half_pel_stride;
        vec4 entries = vec4(planes[word], planes[word + 1u], planes[below], planes[below + 1u]);
        const uint frame = other + k * cam.frame_words;
        const float parameter = cubic_parameter(cam, frame, at);
        [[unroll]] for (int phase = 1; phase < 4; ++phase) {
            const Correction of = corrections[phase - 1];
            if (of.confidence > 0.0) {
                const float reprojected = half_pel_cubic(cam, frame, there[phase - 1], parameter);
                entries[phase] = lerp(entries[phase], reprojected + of.residual[k], of.confidence);
            }
        }
        store_entries(cam, base, at, entries);
    }
}
