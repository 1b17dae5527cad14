// enhance: one frame's half-pixel lattice takes up the detail that the other frame saw between its
// pixels. Frames sample a moving surface at different places; together they know it better than each
// alone, and it is from between pixels that sub-steps are read.
//
// One workgroup of 320 threads a strip of four 8x8 blocks side by side: a thread a pixel of the strip and of
// the next column and row, then a thread a pixel and its three half sites; x over strips, y over cameras,
// z over colour components. Pass 0 writes the half sites of the current frame from the previous frame's
// lattice, pass 1 those of the previous frame from the current one's; pass 1 runs only for cameras whose
// sensor has two transfers. Reads and writes `planes`: the frame that is read is never the one that is written. Runs after
// `ingest`; `cross` reads both lattices.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x = 320) in;
layout(constant_id = 0) const uint INTENSITY = 0;
layout(constant_id = 1) const uint PASS = 0;
layout(constant_id = 2) const bool BY_ADDRESS = true;

BUFFER(, SLOT_PLANES, float, planes);
BUFFER(readonly, SLOT_MOTION, vec2, motion);
BUFFER(readonly, SLOT_BLOCKS, uvec4, blocks);

#include "strips.glsl"
#include "trajectory.glsl"
#include "lattice.glsl"
#include "margin.glsl"

// Pixels that a strip's half sites lie between: the strip and the next column and row.
const uint SITES_X = STRIP_PX + 1;
const uint SITES = SITES_X * (BLOCK_PX + 1);

// Displacement to the other frame, residual there, trust.
shared vec4 sites[SITES];
shared uint moves;

float trust_at(Camera cam, ivec2 at, vec2 shift) {
    const uint base = motion_base(cam, true);
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const vec2 own = motion_at(cam, base, at);
    float disagreement = 0.0;
    bool valid = true;
    [[unroll]] for (int j = -1; j <= 1; ++j) {
        [[unroll]] for (int i = -1; i <= 1; ++i) {
            const vec2 m = motion_at(cam, base, clamp(at + ivec2(i, j), ivec2(0), last));
            disagreement = max(disagreement, max(abs(m.x - own.x), abs(m.y - own.y)));
            valid = valid && floatBitsToUint(m.x) != INVALID_BIT;
        }
    }
    const float agreement = clamp(2.0 - disagreement / TRUST_PX, 0.0, 1.0);
    return valid ? agreement * max(1.0 - outside_px(cam, vec2(at) + shift), 0.0) : 0.0;
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint phase = cameras[index].phase;
    // A first frame has only itself.
    const bool alone = phase == PHASE_FIRST;
    const ivec2 corner = ivec2(strip_corner(cameras[index].blocks_x, BLOCK_PX));
    if (corner.y >= int(cameras[index].height) || !(phase == PHASE_INTERVAL || (alone && PASS == 0u))) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    const uint channels = INTENSITY == INTENSITY_BAYER_RGGB ? 3u : 1u;
    const uint channel = gl_WorkGroupID.z;
    const uint current = cam.plane_base + (cam.parity * channels + channel) * cam.frame_words;
    const uint previous = cam.plane_base + ((1u - cam.parity) * channels + channel) * cam.frame_words;
    const uint own = PASS == 0u ? current : previous;
    const uint other = PASS == 0u ? previous : current;
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const ivec2 at = corner + ivec2(lane % STRIP_PX, lane / STRIP_PX);
    const bool inside = lane < STRIP_PX * BLOCK_PX && all(lessThanEqual(at, last));
    const uint word = frame_word(cam, true, at);

    if (lane == 0u) {
        moves = 0u;
    }
    barrier();
    if (lane < 3u * (STRIP_BLOCKS + 2u) && !alone) {
        const ivec2 near = corner / int(BLOCK_PX)
            + ivec2(int(lane % (STRIP_BLOCKS + 2u)) - 1, int(lane / (STRIP_BLOCKS + 2u)) - 1);
        const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
        if (all(greaterThanEqual(near, ivec2(0))) && all(lessThanEqual(near, last_block))) {
            const uvec4 facts = blocks[cam.block_base + cam.parity * cam.blocks + uint(near.y) * cam.blocks_x + uint(near.x)];
            atomicOr(moves, facts.x | facts.y | facts.w);
        }
    }
    barrier();
    if (moves == 0u && !alone) {
        // Nothing moved and nothing changed: what was known of the last frame holds for this one.
        if (PASS == 0u && inside) {
            [[unroll]] for (uint half_phase = 1u; half_phase < 4u; ++half_phase) {
                const uvec2 half_step = uvec2(half_phase & 1u, half_phase >> 1);
                const float value = planes[other + word + half_step.x + half_step.y * cam.lattice_stride];
                store_entry(cam, own, 2u * uvec2(at) + half_step, value);
            }
        }
        return;
    }

    if (lane < SITES && !alone) {
        const uint site = lane;
        const ivec2 at_site = min(corner + ivec2(site % SITES_X, site / SITES_X), last);
        const vec2 shift = PASS == 0u ? motion_at(cam, motion_base(cam, true), at_site)
                                      : -motion_from_previous(cam, at_site);
        const float residual = planes[own + frame_word(cam, true, at_site)]
            - lattice_cubic(cam, other, vec2(at_site) + shift);
        sites[site] = vec4(shift, residual, trust_at(cam, at_site, shift));
    }
    barrier();
    if (!inside) {
        return;
    }
    const uint site = (lane / STRIP_PX) * SITES_X + lane % STRIP_PX;
    [[unroll]] for (int half_phase = 1; half_phase < 4; ++half_phase) {
        const ivec2 half_step = ivec2(half_phase & 1, half_phase >> 1);
        const uint right = site + uint(half_step.x);
        const uint below = uint(half_step.y) * SITES_X;
        const uint entry = own + word + uint(half_step.x) + uint(half_step.y) * cam.lattice_stride;
        const vec4 around =
            alone ? vec4(0.0) : 0.25 * (sites[site] + sites[right] + sites[site + below] + sites[right + below]);
        float value = 0.0;
        if (around.w < 1.0) {
            value = PASS == 0u ? frame_cubic(cam, own, at, half_step) : planes[entry];
        }
        if (around.w > 0.0) {
            const float seen = lattice_cubic(cam, other, vec2(at) + 0.5 * vec2(half_step) + around.xy) + around.z;
            value = blend(value, seen, around.w);
        }
        store_entry(cam, own, uvec2(2 * at + half_step), value);
    }
}
