// enhance: the previous frame's half sites take up what the current frame saw; for cameras with two transfers. (The
// other way, from the previous frame to the current one, `ingest` does.)
//
// One workgroup a strip of four 8x8 blocks side by side: a thread a pixel of the strip and of the next column and row,
// then a thread a pixel and its three half sites, of all colour components; x over strips, y over cameras. Reads the
// current lattice in `planes`, writes half sites of the previous one. Runs after `ingest`; `cross` reads both lattices.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = INGEST_THREADS) in;
layout(constant_id = 0) const uint INTENSITY = 0;
layout(constant_id = 1) const bool BY_ADDRESS = true;

BUFFER(, SLOT_PLANES, float, planes);
BUFFER(readonly, SLOT_MOTION, vec2, motion);
BUFFER(readonly, SLOT_BLOCKS, uvec4, blocks);

const uint COMPONENTS = INTENSITY == INTENSITY_BAYER_RGGB ? 3u : 1u;

#include "strips.glsl"
#include "texels.glsl"
#include "trajectory.glsl"
#include "lattice.glsl"
#include "margin.glsl"

vec2 motion_near(Camera cam, ivec2 at);

#include "transfer.glsl"

vec2 motion_near(Camera cam, ivec2 at) {
    const ivec2 seen_at = clamp(at, ivec2(0), ivec2(cam.width, cam.height) - 1);
    const vec2 m = motion_at(cam, motion_base(cam, true), seen_at);
    return floatBitsToUint(m.x) == INVALID_BIT ? vec2(NOWHERE_PX) : m;
}

// Ways of the sites to the current frame.
shared vec2 shifts[SITES];
shared uint moves;

// The ways of a pixel of the strip and of those right, below, and right and below of it: one coordinate of them.
vec4 shifts_around(uint site, int axis) {
    return vec4(
        shifts[site][axis], shifts[site + 1u][axis], shifts[site + SITES_X][axis], shifts[site + SITES_X + 1u][axis]);
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const ivec2 corner = ivec2(strip_corner(cameras[index].blocks_x, gl_WorkGroupID.x));
    if (cameras[index].phase != PHASE_INTERVAL || corner.y >= int(cameras[index].height)) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    const uint current = cam.plane_base + cam.parity * COMPONENTS * cam.frame_words;
    const uint previous = cam.plane_base + (1u - cam.parity) * COMPONENTS * cam.frame_words;

    if (lane == 0u) {
        moves = 0u;
    }
    barrier();
    if (lane < 3u * (STRIP_BLOCKS + 2u)) {
        const ivec2 near = corner / int(BLOCK_PX)
            + ivec2(int(lane % (STRIP_BLOCKS + 2u)) - 1, int(lane / (STRIP_BLOCKS + 2u)) - 1);
        const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
        if (all(greaterThanEqual(near, ivec2(0))) && all(lessThanEqual(near, last_block))) {
            const uint block = uint(near.y) * cam.blocks_x + uint(near.x);
            const uvec4 facts = blocks[cam.block_base + cam.parity * cam.blocks + block];
            atomicOr(moves, facts.x | facts.y | facts.w);
        }
    }
    barrier();
    if (moves == 0u) {
        // Nothing moved and nothing changed: the current frame knows no more.
        return;
    }
    for (uint number = lane; number < SITES; number += gl_WorkGroupSize.x) {
        const ivec2 at = site_pixel(cam, corner, site_at(number));
        const uint site = site_index(site_at(number));
        const vec2 shift = -motion_from_previous(cam, at);
        const vec2 there = to_lattice(cam, vec2(at) + shift);
        shifts[site] = shift;
        trusts[site] = trust_at(cam, at, motions_around(cam, at), shift);
        [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
            const float level = plane_at(previous + k * cam.frame_words + frame_word(cam, true, at));
            residuals[k * SITES + site] = level - lattice_cubic(cam, current + k * cam.frame_words, there);
        }
    }
    barrier();
    const uvec2 in_strip = site_at(lane);
    const ivec2 at = corner + ivec2(in_strip);
    if (!has_half_sites(cam, corner, in_strip)) {
        return;
    }
    const Around around[3] = around_half_sites(in_strip);
    vec2 there[3];
    const vec4 shifts_x = shifts_around(site_index(in_strip), 0);
    const vec4 shifts_y = shifts_around(site_index(in_strip), 1);
    float most_trust = 0.0;
    [[unroll]] for (int half_phase = 1; half_phase < 4; ++half_phase) {
        const ivec2 half_step = half_step_of(half_phase);
        const vec2 shift = vec2(mean_around(shifts_x, half_step), mean_around(shifts_y, half_step));
        there[half_phase - 1] = to_lattice(cam, vec2(at) + 0.5 * vec2(half_step) + shift);
        most_trust = max(most_trust, around[half_phase - 1].trust);
    }
    if (most_trust == 0.0) {
        return;
    }
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        const uint base = previous + k * cam.frame_words;
        const uint word = base + frame_word(cam, true, at);
        const uint below = word + cam.lattice_stride;
        vec4 entries = vec4(planes[word], planes[word + 1u], planes[below], planes[below + 1u]);
        [[unroll]] for (int half_phase = 1; half_phase < 4; ++half_phase) {
            const Around of = around[half_phase - 1];
            if (of.trust > 0.0) {
                const float seen = lattice_cubic(cam, current + k * cam.frame_words, there[half_phase - 1]);
                entries[half_phase] = blend(entries[half_phase], seen + of.residual[k], of.trust);
            }
        }
        store_entries(cam, base, at, entries);
    }
}
