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

vec2 motion_near(Camera cam, ivec2 at) {
    return motion_at(cam, motion_base(cam, true), at);
}

#include "transfer.glsl"

shared uint moves;

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
            const uvec4 facts = blocks[cam.block_base + cam.parity * cam.blocks + uint(near.y) * cam.blocks_x + uint(near.x)];
            atomicOr(moves, facts.x | facts.y | facts.w);
        }
    }
    barrier();
    if (moves == 0u) {
        // Nothing moved and nothing changed: the current frame knows no more.
        return;
    }
    if (lane < SITES) {
        const ivec2 at = site_pixel(cam, corner, lane);
        const vec2 shift = -motion_from_previous(cam, at);
        float levels[COMPONENTS];
        [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
            levels[k] = plane_at(previous + k * cam.frame_words + frame_word(cam, true, at));
        }
        note_site(cam, lane, at, levels, shift, current);
    }
    barrier();
    const uvec2 in_strip = uvec2(lane % STRIP_PX, lane / STRIP_PX);
    const ivec2 at = corner + ivec2(in_strip);
    if (in_strip.y >= BLOCK_PX || at.x >= int(cam.width) || at.y >= int(cam.height)) {
        return;
    }
    [[unroll]] for (int half_phase = 1; half_phase < 4; ++half_phase) {
        const ivec2 half_step = ivec2(half_phase & 1, half_phase >> 1);
        const Around around = around_half_site(in_strip, half_step);
        if (around.trust > 0.0) {
            const uint word = frame_word(cam, true, at) + uint(half_step.x) + uint(half_step.y) * cam.lattice_stride;
            [[unroll]] for (uint c = 0u; c < COMPONENTS; ++c) {
                const uint base = previous + c * cam.frame_words;
                const float own = around.trust < 1.0 ? planes[base + word] : 0.0;
                const float seen = seen_from(cam, current + c * cam.frame_words, c, at, half_step, around);
                store_entry(cam, base, uvec2(2 * at + half_step), blend(own, seen, around.trust));
            }
        }
    }
}
