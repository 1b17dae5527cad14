// ingest: a rendered frame becomes log-intensity planes, motion and per-block facts. Frames that are warped by cubic
// taps become lattices of half pixels, whose half sites take up what the previous frame saw there.
//
// One workgroup a strip of four 8x8 blocks side by side; x over strips, y over cameras. For a lattice it first takes in
// the strip and the pixels around it that half sites draw on, so that no workgroup waits for another. A workgroup takes
// all colour components TOGETHER, and works out once what they have in common, or one of them, z: a GPU with few strips
// to go round fills up better so. On the software driver, where all that comes before the first pixel is dear, it has a
// thread a pixel of a row, and takes row after row. Reads the images by device address, and the previous frame in
// `planes`. Writes the current frame there, `motion` of this frame's parity, `blocks` and `strip_order`, all read by
// `enhance` and `cross` after a barrier; arms pixels in `state`, which nothing else touches before `cross`.
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#include "common.glsl"
#include "random.glsl"
#include "substeps.glsl"
#include "strips.glsl"

layout(local_size_x = INGEST_THREADS, local_size_x_id = 6) in;
layout(constant_id = 0) const uint INTENSITY = 0;
// Whether frames have lattices.
layout(constant_id = 1) const bool LATTICE = false;
layout(constant_id = 2) const uint HDR_FORMAT = 0;
layout(constant_id = 3) const uint MOTION_FORMAT = 0;
layout(constant_id = 4) const bool BY_ADDRESS = true;
layout(constant_id = 5) const bool TOGETHER = false;
// Whether the frame may be a camera's first.
layout(constant_id = 7) const bool MAY_BE_FIRST = true;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(, SLOT_PLANES, float, planes);
BUFFER(, SLOT_MOTION, vec2, motion);
BUFFER(, SLOT_STATE, uint, state);
BUFFER(writeonly, SLOT_BLOCKS, uvec4, blocks);
BUFFER(writeonly, SLOT_STRIP_ORDER, uint, strip_order);

layout(buffer_reference, std430) readonly buffer Words1 { uint v[]; };
layout(buffer_reference, std430) readonly buffer Words2 { uvec2 v[]; };
layout(buffer_reference, std430) readonly buffer Floats2 { vec2 v[]; };
layout(buffer_reference, std430) readonly buffer Floats4 { vec4 v[]; };

#include "texels.glsl"
#include "pixel_log_state.glsl"
#include "trajectory.glsl"
#include "lattice.glsl"
#include "margin.glsl"

// Colour components that there are, and that a workgroup takes.
const uint CHANNELS = INTENSITY == INTENSITY_BAYER_RGGB ? 3u : 1u;
const uint COMPONENTS = TOGETHER ? CHANNELS : 1u;

// Rows of the strip that all threads take at once.
const uint ROWS_PX = gl_WorkGroupSize.x / STRIP_PX;

// What a workgroup takes in: the strip, and for a lattice a column and row before and two after it.
const uint AROUND_PX = 3u;
const uint BEFORE_PX = LATTICE ? 1u : 0u;
const uint TAKEN_X = STRIP_PX + (LATTICE ? AROUND_PX : 0u);
const uint TAKEN_Y = BLOCK_PX + (LATTICE ? AROUND_PX : 0u);
const uint TAKEN = TAKEN_X * TAKEN_Y;

// Beyond the image these are its outermost pixels. Levels are component after component.
shared float taken_level[COMPONENTS * TAKEN];
shared vec2 taken_motion[TAKEN];
shared uint moves;

ivec2 strip_at;

uint taken_index(ivec2 at) {
    const uvec2 in_taken = uvec2(at - strip_at + int(BEFORE_PX));
    return in_taken.y * TAKEN_X + in_taken.x;
}

// Pixels around the strip as threads take them: whole rows first, then what is left of the columns.
ivec2 beside_strip(uint number) {
    const uint in_rows = AROUND_PX * (STRIP_PX + AROUND_PX);
    if (number < in_rows) {
        const int row = int(number / (STRIP_PX + AROUND_PX));
        const int column = int(number % (STRIP_PX + AROUND_PX));
        return ivec2(column - 1, row == 0 ? -1 : int(BLOCK_PX) + row - 1);
    }
    const int row = int((number - in_rows) / AROUND_PX);
    const int column = int((number - in_rows) % AROUND_PX);
    return ivec2(column == 0 ? -1 : int(STRIP_PX) + column - 1, row);
}

vec2 motion_near(Camera cam, ivec2 at) {
    return taken_motion[taken_index(at)];
}

#include "transfer.glsl"
#include "beside.glsl"

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

// Log intensity of colour component `channel`.
float log_intensity_of(Camera cam, vec3 colour, uint channel) {
    float intensity = colour[channel];
    if (INTENSITY == INTENSITY_GRAY) {
        intensity = (colour.x + colour.y + colour.z) * (1.0 / 3.0);
    } else if (INTENSITY == INTENSITY_LUMINANCE) {
        intensity = dot(colour, REC709);
    }
    return log(intensity * cam.exposure_gain + cam.log_offset);
}

bool is_first(Camera cam) {
    return MAY_BE_FIRST && cam.phase == PHASE_FIRST;
}

// First word of a frame of one colour component.
uint frame_of(Camera cam, uint parity, uint channel) {
    return cam.plane_base + (parity * CHANNELS + channel) * cam.frame_words;
}

// What is known of some of a block's pixels, as the words of `blocks` are.
struct Facts {
    uint motion;
    uint change;
    uint invalid;
    uint invalid_motion;
};

// Facts of a pixel with a valid colour for its block, and its state. `level` and `before` are those of the first
// colour component, of this frame and of the one before.
void note_pixel(Camera cam, ivec2 at, vec3 colour, float level, float before, int reference, inout Facts facts) {
    const uint pixel = uint(at.y) * cam.width + uint(at.x);
    const uint own = INTENSITY == INTENSITY_BAYER_RGGB ? uint(at.x & 1) + uint(at.y & 1) : 0u;
    if (is_first(cam)) {
        arm_pixel(cam, pixel, to_q24(own == 0u ? level : log_intensity_of(cam, colour, own)));
        return;
    }
    float change = abs(level - before);
    bool changed = floatBitsToUint(before) != floatBitsToUint(level);
    for (uint c = 1u; c < CHANNELS; ++c) {
        const float other_before = plane_at(frame_of(cam, 1u - cam.parity, c) + frame_word(cam, LATTICE, at));
        const float other = log_intensity_of(cam, colour, c);
        if (c == own) {
            change = abs(other - other_before);
        }
        changed = changed || floatBitsToUint(other_before) != floatBitsToUint(other);
    }
    if (changed) {
        facts.change = max(facts.change, floatBitsToUint(max(change, 1e-12)));
    }
    if (reference == UNARMED) {
        // It starts when the interval that ends with this frame is over.
        store_state(cam, pixel, STATE_REFERENCE, uint(ARMING));
        facts.change = max(facts.change, floatBitsToUint(1e-12));
    }
}

// The same of one that has none.
void note_invalid(Camera cam, ivec2 at, inout Facts facts) {
    facts.invalid += 1u;
    if (is_first(cam)) {
        store_state(cam, uint(at.y) * cam.width + uint(at.x), STATE_REFERENCE, uint(UNARMED));
        atomicAdd(counters[2u * cam.slot + cam.parity].unarmed_pixels, 1u);
    }
}

// What was noted of pixels, to that of their block of the strip.
void note_facts(uint block, Facts facts) {
    atomicMax(block_motion[block], facts.motion);
    atomicMax(block_change[block], facts.change);
    if (facts.invalid != 0u) {
        atomicAdd(block_invalid[block], facts.invalid);
    }
    if (facts.invalid_motion != 0u) {
        atomicAdd(block_invalid_motion[block], facts.invalid_motion);
    }
}

// Motion as it was read, usable or marked.
vec2 to_usable(vec2 m, out bool usable) {
    usable = !(not_finite(m.x) || not_finite(m.y));
    if (!usable) {
        return uintBitsToFloat(uvec2(INVALID_BIT, 0u));
    }
    return vec2(floatBitsToUint(m.x) == INVALID_BIT ? 0.0 : m.x, m.y);
}

// Takes in what one pixel of the strip, or of those around it, has of a further colour component.
void take_further(Camera cam, uint channel, uint taken, ivec2 at, bool own, vec3 colour, bool invalid) {
    const uint word = frame_word(cam, LATTICE, clamp(at, ivec2(0), ivec2(cam.width, cam.height) - 1));
    const float before =
        is_first(cam) ? cam.log_dark : plane_at(frame_of(cam, 1u - cam.parity, channel) + word);
    const float level = invalid ? before : log_intensity_of(cam, colour, channel);
    if (LATTICE) {
        taken_level[channel * TAKEN + taken] = level;
        if (floatBitsToUint(level) != floatBitsToUint(before)) {
            moves = 1u;
        }
    }
    if (own && !LATTICE) {
        planes[frame_of(cam, cam.parity, channel) + word] = level;
    }
}

// Takes in one pixel of the strip, or of those around it; `channel` is the first component that the workgroup takes.
void take(Camera cam, uint channel, ivec2 in_strip, bool of_strip, inout Facts facts) {
    const ivec2 at = strip_at + in_strip;
    const uint taken = taken_index(at);
    const ivec2 seen_at = clamp(at, ivec2(0), ivec2(cam.width, cam.height) - 1);
    const uint pixel = uint(seen_at.y) * cam.width + uint(seen_at.x);
    const bool own = of_strip && at == seen_at;
    // What is not of one component is noted by the first one's workgroup.
    const bool notes = own && channel == 0u;

    // All that will be needed is read at once: memory is far.
    const vec3 colour = read_colour(cam, pixel);
    const vec2 motion_read = cam.has_motion != 0u ? read_motion(cam, pixel) : vec2(0.0);
    float before = cam.log_dark;
    int reference = 0;
    if (!is_first(cam)) {
        before = plane_at(frame_of(cam, 1u - cam.parity, channel) + frame_word(cam, LATTICE, seen_at));
        if (notes) {
            reference = int(load_state(cam, pixel, STATE_REFERENCE));
        }
    }
    const bool invalid = bad(colour.x) || bad(colour.y) || bad(colour.z)
        || not_finite((colour.x + colour.y + colour.z) * cam.exposure_gain);
    const float level = invalid ? before : log_intensity_of(cam, colour, channel);
    if (LATTICE) {
        taken_level[taken] = level;
        if (floatBitsToUint(level) != floatBitsToUint(before)) {
            moves = 1u;
        }
    }
    if (own && !LATTICE) {
        planes[frame_of(cam, cam.parity, channel) + frame_word(cam, false, at)] = level;
    }
    [[unroll]] for (uint further = 1u; further < COMPONENTS; ++further) {
        take_further(cam, further, taken, at, own, colour, invalid);
    }
    if (notes && invalid) {
        note_invalid(cam, at, facts);
    } else if (notes) {
        note_pixel(cam, at, colour, level, before, reference, facts);
    }

    if (cam.has_motion != 0u) {
        bool usable;
        const vec2 m = to_usable(motion_read, usable);
        if (LATTICE) {
            taken_motion[taken] = usable ? m : vec2(NOWHERE_PX);
            if (floatBitsToUint(m.x) != 0u || m.y != 0.0) {
                moves = 1u;
            }
        }
        if (notes) {
            motion[cam.motion_base + cam.parity * cam.pixels + pixel] = m;
            if (usable) {
                facts.motion = max(facts.motion, floatBitsToUint(length(m)));
            } else {
                facts.invalid_motion += 1u;
            }
        }
    }
}

// Writes what was noted of a block.
void write_block(Camera cam, uint in_strip) {
    const uint block = (uint(strip_at.y) / BLOCK_PX) * cam.blocks_x + uint(strip_at.x) / BLOCK_PX + in_strip;
    blocks[cam.block_base + cam.parity * cam.blocks + block] =
        uvec4(block_motion[in_strip], block_change[in_strip], 0u, block_invalid_motion[in_strip]);
    const uint counter = 2u * cam.slot + cam.parity;
    if (block_invalid[in_strip] != 0u) {
        atomicAdd(counters[counter].invalid_pixels, block_invalid[in_strip]);
    }
    if (block_invalid_motion[in_strip] != 0u) {
        atomicAdd(counters[counter].invalid_motion, block_invalid_motion[in_strip]);
    }
}

// Puts the strip in line for `cross`: those with many sub-steps take long, and are taken first, so that none of them
// starts when others are almost done.
void line_up(Camera cam) {
    uint most = 0u;
    for (uint b = 0u; b < STRIP_BLOCKS; ++b) {
        most = max(most, substep_count(cam, uintBitsToFloat(block_motion[b]), uintBitsToFloat(block_change[b])));
    }
    const uint counter = 2u * cam.slot + cam.parity;
    const uint place = most > cam.many_substeps
        ? atomicAdd(counters[counter].slow_strips, 1u)
        : strip_count(cam) - 1u - atomicAdd(counters[counter].quick_strips, 1u);
    strip_order[cam.strip_base + place] = gl_WorkGroupID.x;
}

// The levels that a pixel's half sites are made of when there is the frame alone: those of four rows, see `cubic`.
struct Levels {
    vec2 above;
    vec4 top;
    vec4 bottom;
    vec2 below;
};

// Around pixel `at`, of the `k`th component that the workgroup takes.
Levels levels_around(uint k, ivec2 at) {
    const uint first = k * TAKEN + taken_index(at - 1);
    const uint top = first + TAKEN_X;
    const uint bottom = top + TAKEN_X;
    const uint below = bottom + TAKEN_X;
    return Levels(
        vec2(taken_level[first + 1u], taken_level[first + 2u]),
        vec4(taken_level[top], taken_level[top + 1u], taken_level[top + 2u], taken_level[top + 3u]),
        vec4(taken_level[bottom], taken_level[bottom + 1u], taken_level[bottom + 2u], taken_level[bottom + 3u]),
        vec2(taken_level[below + 1u], taken_level[below + 2u]));
}

// A half site (`half_step` 0 or 1 a coordinate) right and below pixel `at`, from the frame alone.
float frame_cubic(Camera cam, Levels levels, ivec2 at, ivec2 half_step) {
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    // Beyond the last pixel there is only that one.
    const vec2 f = vec2(at.x < last.x ? 0.5 * float(half_step.x) : 0.0, at.y < last.y ? 0.5 * float(half_step.y) : 0.0);
    return cubic(levels.above, levels.top, levels.bottom, levels.below, f, CUBIC_FRAME);
}

// Where the previous frame shows a pixel of the strip, or of those beside it, and its half sites.
Places places_before(Camera cam, ivec2 at, vec2 motions[9]) {
    const vec2 own = motions[4];
    const vec2 right = own + motions[5];
    const vec2 below = motions[7];
    const vec2 all = right + below + motions[8];
    return places_beside(cam, at, own, vec2[3](0.5 * right, 0.5 * (own + below), 0.25 * all));
}

// What the previous frame showed of a site and, if they are asked for, of its half sites; notes what it says of the
// former. `channel` is the first component that the workgroup takes.
void look_back(Camera cam, uint channel, uvec2 site, bool half_sites, out vec4 seen[COMPONENTS]) {
    const ivec2 at = site_pixel(cam, strip_at, site);
    const vec2 motions[9] = motions_around(cam, at);
    trusts[site_index(site)] = trust_at(cam, at, motions, motions[4]);
    const Places places = places_before(cam, at, motions);
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        seen[k] = seen_beside(cam, frame_of(cam, 1u - cam.parity, channel + k), places, half_sites);
        residuals[k * SITES + site_index(site)] = taken_level[k * TAKEN + taken_index(at)] - seen[k].x;
    }
}

// The lattice at a pixel of the strip: its own level and those of its half sites; of the `k`th component that the
// workgroup takes, where the previous frame showed what `seen` says of them.
vec4 entries_of(Camera cam, uint k, ivec2 at, vec4 seen, Around around[3]) {
    vec4 entries = vec4(taken_level[k * TAKEN + taken_index(at)], 0.0, 0.0, 0.0);
    if (min(min(around[0].trust, around[1].trust), around[2].trust) < 1.0) {
        const Levels levels = levels_around(k, at);
        [[unroll]] for (int half_phase = 1; half_phase < 4; ++half_phase) {
            entries[half_phase] = frame_cubic(cam, levels, at, half_step_of(half_phase));
        }
    }
    [[unroll]] for (int half_phase = 1; half_phase < 4; ++half_phase) {
        const Around of = around[half_phase - 1];
        if (of.trust >= 1.0) {
            entries[half_phase] = seen[half_phase] + of.residual[k];
        } else if (of.trust > 0.0) {
            entries[half_phase] = blend(entries[half_phase], seen[half_phase] + of.residual[k], of.trust);
        }
    }
    return entries;
}

// Writes the lattice at a pixel of the strip, where the previous frame showed what `seen` says of its half sites;
// `channel` is the first component that the workgroup takes.
void write_lattice(Camera cam, uint channel, uvec2 in_strip, vec4 seen[COMPONENTS]) {
    const ivec2 at = strip_at + ivec2(in_strip);
    Around around[3] = Around[3](NOTHING_AROUND, NOTHING_AROUND, NOTHING_AROUND);
    if (moves != 0u && !is_first(cam)) {
        around = around_half_sites(in_strip);
    }
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        vec4 entries;
        if (moves != 0u) {
            entries = entries_of(cam, k, at, seen[k], around);
        } else {
            // Nothing moved and nothing changed: what was known of the last frame holds for this one.
            const uint top = frame_of(cam, 1u - cam.parity, channel + k) + frame_word(cam, true, at);
            const uint below = top + cam.lattice_stride;
            entries = vec4(plane_at(top), plane_at(top + 1u), plane_at(below), plane_at(below + 1u));
        }
        store_entries(cam, frame_of(cam, cam.parity, channel + k), at, entries);
    }
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uvec2 corner = strip_corner(cameras[index].blocks_x, gl_WorkGroupID.x);
    if (cameras[index].phase == 0u || corner.y >= cameras[index].height) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    // Were it a constant for one component too, a GPU would need registers for what it then moves ahead, and have room
    // for a fourth fewer workgroups.
    const uint channel = TOGETHER ? 0u : gl_WorkGroupID.z;
    strip_at = ivec2(corner);
    if (lane < STRIP_BLOCKS) {
        block_motion[lane] = 0u;
        block_change[lane] = 0u;
        block_invalid[lane] = 0u;
        block_invalid_motion[lane] = 0u;
    }
    if (lane == 0u) {
        moves = is_first(cam) ? 1u : 0u;
    }
    barrier();
    Facts facts = Facts(0u, 0u, 0u, 0u);
    uint number = lane;
    do {
        take(cam, channel, ivec2(number % STRIP_PX, number / STRIP_PX), true, facts);
        number += gl_WorkGroupSize.x;
    } while (number < OWN_SITES);
    if (channel == 0u) {
        note_facts((lane % STRIP_PX) / BLOCK_PX, facts);
    }
    number = lane;
    if (number < TAKEN - OWN_SITES) {
        do {
            take(cam, channel, beside_strip(number), false, facts);
            number += gl_WorkGroupSize.x;
        } while (number < TAKEN - OWN_SITES);
    }
    barrier();
    if (channel == 0u && lane < STRIP_BLOCKS && corner.x + lane * BLOCK_PX < cam.width) {
        write_block(cam, lane);
    }
    if (channel == 0u && lane == gl_WorkGroupSize.x - 1u) {
        line_up(cam);
    }
    if (!LATTICE) {
        return;
    }
    const bool looks_back = moves != 0u && !is_first(cam);
    vec4 seen[COMPONENTS];
    if (looks_back) {
        number = OWN_SITES + lane;
        if (number < SITES) {
            do {
                look_back(cam, channel, site_at(number), false, seen);
                number += gl_WorkGroupSize.x;
            } while (number < SITES);
        }
    }
    // What a row's half sites draw on is known once the next row was looked up.
    uvec2 site = site_at(lane);
    if (looks_back) {
        look_back(cam, channel, site, has_half_sites(cam, strip_at, site), seen);
    }
    uint row = 0u;
    do {
        const uvec2 next = site + uvec2(0u, ROWS_PX);
        vec4 seen_next[COMPONENTS];
        if (looks_back) {
            if (row + ROWS_PX < BLOCK_PX) {
                look_back(cam, channel, next, has_half_sites(cam, strip_at, next), seen_next);
            }
            barrier();
        }
        if (has_half_sites(cam, strip_at, site)) {
            write_lattice(cam, channel, site, seen);
        }
        site = next;
        [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
            seen[k] = seen_next[k];
        }
        row += ROWS_PX;
    } while (row < BLOCK_PX);
}
