// ingest: a rendered frame becomes log-intensity planes, motion and per-block facts.
//
// One workgroup of 256 threads a strip of four 8x8 blocks side by side, a thread a pixel; x over strips, y
// over cameras. Reads the images by device address. Writes `planes`, `motion` of this frame's parity and
// `blocks`, all read by `enhance` and `cross` after a barrier; arms pixels in `state`, which nothing else
// touches before `cross`.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#include "common.glsl"
#include "random.glsl"
#include "strips.glsl"

layout(local_size_x = 256) in;
layout(constant_id = 0) const uint INTENSITY = 0;
// Whether frames have lattices.
layout(constant_id = 1) const bool LATTICE = false;
layout(constant_id = 2) const uint HDR_FORMAT = 0;
layout(constant_id = 3) const uint MOTION_FORMAT = 0;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_PLANES, float, planes);
BUFFER(writeonly, SLOT_MOTION, vec2, motion);
BUFFER(, SLOT_STATE, uint, state);
BUFFER(writeonly, SLOT_BLOCKS, uvec4, blocks);

layout(buffer_reference, std430) readonly buffer Words1 { uint v[]; };
layout(buffer_reference, std430) readonly buffer Words2 { uvec2 v[]; };
layout(buffer_reference, std430) readonly buffer Floats2 { vec2 v[]; };
layout(buffer_reference, std430) readonly buffer Floats4 { vec4 v[]; };

#include "pixel_log_state.glsl"
#include "frame_words.glsl"
#include "margin.glsl"

// As in trajectory.glsl.
const uint INVALID_BIT = 0x80000000u;

shared uint block_motion[STRIP_BLOCKS];
shared uint block_change[STRIP_BLOCKS];
shared uint block_invalid[STRIP_BLOCKS];
shared uint block_invalid_motion[STRIP_BLOCKS];

vec3 srgb_to_linear(vec3 encoded) {
    return mix(pow((encoded + 0.055) / 1.055, vec3(2.4)), encoded / 12.92, lessThanEqual(encoded, vec3(0.04045)));
}

vec3 read_colour(Camera cam, uint pixel) {
    if (HDR_FORMAT == HDR_F16X4) {
        const uvec2 texel = Words2(cam.hdr_address).v[pixel];
        return vec3(unpackHalf2x16(texel.x), unpackHalf2x16(texel.y).x);
    } else if (HDR_FORMAT == HDR_F32X4) {
        return Floats4(cam.hdr_address).v[pixel].xyz;
    }
    return srgb_to_linear(unpackUnorm4x8(Words1(cam.hdr_address).v[pixel]).xyz);
}

vec2 read_motion(Camera cam, uint pixel) {
    if (MOTION_FORMAT == MOTION_F16X2) {
        return unpackHalf2x16(Words1(cam.motion_address).v[pixel]);
    } else if (MOTION_FORMAT == MOTION_F32X2) {
        return Floats2(cam.motion_address).v[pixel];
    }
    return Floats4(cam.motion_address).v[pixel].xy;
}

// Whether bits are those of a NaN or an infinity: a test that no fast-math compiler removes.
bool not_finite(float value) {
    return (floatBitsToUint(value) & 0x7f800000u) == 0x7f800000u;
}

bool bad(float value) {
    return not_finite(value) || value < 0.0;
}

// A pixel's log intensity, into a frame.
void store_level(Camera cam, uint base, uvec2 at, float level) {
    if (LATTICE) {
        store_entry(cam, base, 2u * at, level);
    } else {
        planes[base + frame_word(cam, false, ivec2(at))] = level;
    }
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uvec2 corner = strip_corner(cameras[index].blocks_x, BLOCK_PX);
    if (cameras[index].phase == 0u || corner.y >= cameras[index].height) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    const uvec2 at = corner + uvec2(lane % STRIP_PX, lane / STRIP_PX);
    const uint in_strip = (lane % STRIP_PX) / BLOCK_PX;
    if (lane < STRIP_BLOCKS) {
        block_motion[lane] = 0u;
        block_change[lane] = 0u;
        block_invalid[lane] = 0u;
        block_invalid_motion[lane] = 0u;
    }
    barrier();

    if (at.x < cam.width && at.y < cam.height) {
        const uint pixel = at.y * cam.width + at.x;
        const uint channels = INTENSITY == INTENSITY_BAYER_RGGB ? 3u : 1u;
        const uint stride = cam.frame_words;
        const uint word = frame_word(cam, LATTICE, ivec2(at));
        const uint current = cam.plane_base + cam.parity * channels * stride;
        const uint previous = cam.plane_base + (1u - cam.parity) * channels * stride + word;

        const vec3 colour = read_colour(cam, pixel);
        const bool invalid = bad(colour.x) || bad(colour.y) || bad(colour.z)
            || not_finite((colour.x + colour.y + colour.z) * cam.exposure_gain);
        vec3 log_intensity;
        if (INTENSITY == INTENSITY_GRAY) {
            log_intensity = vec3(log((colour.x + colour.y + colour.z) * (1.0 / 3.0) * cam.exposure_gain + cam.log_offset));
        } else if (INTENSITY == INTENSITY_LUMINANCE) {
            log_intensity = vec3(log(dot(colour, REC709) * cam.exposure_gain + cam.log_offset));
        } else {
            log_intensity = log(colour * cam.exposure_gain + cam.log_offset);
        }

        const uint own = INTENSITY == INTENSITY_BAYER_RGGB ? (at.x & 1u) + (at.y & 1u) : 0u;
        const int reference = int(load_state(cam, pixel, STATE_REFERENCE));
        const bool first = cam.phase == PHASE_FIRST;
        if (invalid) {
            atomicAdd(block_invalid[in_strip], 1u);
            for (uint c = 0u; c < channels; ++c) {
                store_level(cam, current + c * stride, at, first ? cam.log_dark : planes[previous + c * stride]);
            }
            if (first) {
                store_state(cam, pixel, STATE_REFERENCE, uint(UNARMED));
                atomicAdd(counters[2u * cam.slot + cam.parity].unarmed_pixels, 1u);
            }
        } else {
            float change = 0.0;
            bool changed = false;
            for (uint c = 0u; c < channels; ++c) {
                if (!first) {
                    const float before = planes[previous + c * stride];
                    if (c == own) {
                        change = abs(log_intensity[c] - before);
                    }
                    changed = changed || floatBitsToUint(before) != floatBitsToUint(log_intensity[c]);
                }
                store_level(cam, current + c * stride, at, log_intensity[c]);
            }
            if (changed) {
                atomicMax(block_change[in_strip], floatBitsToUint(max(change, 1e-12)));
            }
            if (first) {
                arm_pixel(cam, pixel, to_q24(log_intensity[own]));
            } else if (reference == UNARMED) {
                // It starts when the interval that ends with this frame is over.
                store_state(cam, pixel, STATE_REFERENCE, uint(ARMING));
                atomicMax(block_change[in_strip], floatBitsToUint(1e-12));
            }
        }

        if (cam.has_motion != 0u) {
            vec2 m = read_motion(cam, pixel);
            if (not_finite(m.x) || not_finite(m.y)) {
                atomicAdd(block_invalid_motion[in_strip], 1u);
                m = uintBitsToFloat(uvec2(INVALID_BIT, 0u));
            } else {
                if (floatBitsToUint(m.x) == INVALID_BIT) {
                    m.x = 0.0;
                }
                atomicMax(block_motion[in_strip], floatBitsToUint(length(m)));
            }
            motion[cam.motion_base + cam.parity * cam.pixels + pixel] = m;
        }
    }
    barrier();
    if (lane < STRIP_BLOCKS && corner.x + lane * BLOCK_PX < cam.width) {
        const uint block = (corner.y / BLOCK_PX) * cam.blocks_x + corner.x / BLOCK_PX + lane;
        blocks[cam.block_base + cam.parity * cam.blocks + block] =
            uvec4(block_motion[lane], block_change[lane], 0u, block_invalid_motion[lane]);
        const uint counter = 2u * cam.slot + cam.parity;
        if (block_invalid[lane] != 0u) {
            atomicAdd(counters[counter].invalid_pixels, block_invalid[lane]);
        }
        if (block_invalid_motion[lane] != 0u) {
            atomicAdd(counters[counter].invalid_motion, block_invalid_motion[lane]);
        }
    }
}
