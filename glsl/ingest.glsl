// ingest: a rendered frame becomes log-intensity planes, motion and statistics of each block. Frames that are warped by
// cubic taps become half-pel frames, whose samples between the pixels take detail from the previous frame.
//
// Shared by ingest_gpu.comp and ingest_cpu.comp. One workgroup a tile of four 8x8 blocks side by side; x over tiles, y
// over cameras, z over colour components or 1. For a half-pel frame it loads the tile plus an apron, so workgroups need
// not synchronise. Reads the images by device address, and the previous frame in `planes`. Writes the current frame
// there, `motion` of this frame's slot, `blocks` and `tile_order`, all read by `detail_transfer` and `cross` after a
// barrier. Arms pixels in `state`, which no other kernel touches before `cross`.
//
// The including file provides, before this one: RIGID, whether this is the kernel of synthesis `rigid`; PHYSICAL, defined
// for the kernel of the physical pixel; CHANNELS, the number of colour components; COMPONENTS, how many of them a
// workgroup takes, from `first_component()` on; MAKES_LISTS, whether the kernel makes surfaces and lists, for synthesis
// `rigid`; MAKES_FRAME, whether it makes the rest; `is_first(cam)`; frame loads and `store_pair`.

#include "state_words.glsl"
#ifdef PHYSICAL
#include "pixel_physical_state.glsl"
#else
#include "pixel_log_state.glsl"
#endif
#include "trajectory.glsl"
#include "half_pel.glsl"
#include "half_pel_store.glsl"

// Rows of the tile that the workgroup loads at once.
const uint ROWS_PX = gl_WorkGroupSize.x / TILE_WIDTH_PX;

// The tile cache: the tile and, for a half-pel frame, an apron of two columns and rows before and three after it.
const uint APRON_PX = 5u;
const uint APRON_BEFORE_PX = HALF_PEL ? 2u : 0u;
const uint CACHE_X = TILE_WIDTH_PX + (HALF_PEL ? APRON_PX : 0u);
const uint CACHE_Y = BLOCK_PX + (HALF_PEL ? APRON_PX : 0u);
const uint CACHE_PIXELS = CACHE_X * CACHE_Y;

// Colour components whose levels the cache holds, from `first_component()` on: those that the workgroup takes. Where
// sub-steps are by error it holds all, but only the workgroup of the first component fills in the others, and only so far as
// bends need them.
const uint CACHED_COMPONENTS = SUBSTEPS_BY_ERROR ? CHANNELS : COMPONENTS;

// Beyond the image the cache repeats the border pixels. Levels lie component by component.
shared float cached_level[CACHED_COMPONENTS * CACHE_PIXELS];
shared vec2 cached_motion[CACHE_PIXELS];
shared uint any_change;

ivec2 tile_origin;

uint cache_index(ivec2 at) {
    const uvec2 in_cache = uvec2(at - tile_origin + int(APRON_BEFORE_PX));
    return in_cache.y * CACHE_X + in_cache.x;
}

// Pixels of the apron in the order in which threads load them: whole rows first, then the rest of the columns.
ivec2 apron_pixel(uint number) {
    const int before = int(APRON_BEFORE_PX);
    const uint in_rows = APRON_PX * (TILE_WIDTH_PX + APRON_PX);
    if (number < in_rows) {
        const int row = int(number / (TILE_WIDTH_PX + APRON_PX)) - before;
        const int column = int(number % (TILE_WIDTH_PX + APRON_PX)) - before;
        return ivec2(column, row < 0 ? row : int(BLOCK_PX) + row);
    }
    const int row = int((number - in_rows) / APRON_PX);
    const int column = int((number - in_rows) % APRON_PX) - before;
    return ivec2(column < 0 ? column : int(TILE_WIDTH_PX) + column, row);
}

vec2 motion_near(Camera cam, ivec2 at) {
    return cached_motion[cache_index(at)];
}

// Whether a pixel of the tile or its apron is an anchor or beside one: no other's motion is asked for.
bool is_beside_anchor(ivec2 in_tile) {
    return all(greaterThanEqual(in_tile, ivec2(-1))) && all(lessThan(in_tile, ivec2(TILE_WIDTH_PX, BLOCK_PX) + 2));
}

#include "detail_anchors.glsl"
#include "shared_footprint.glsl"

shared uint block_motion[TILE_BLOCKS];
shared uint block_change[TILE_BLOCKS];
shared uint block_invalid[TILE_BLOCKS];
shared uint block_invalid_motion[TILE_BLOCKS];

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

// Tests the bits: compilers with fast math remove comparisons with NaN.
bool not_finite(float value) {
    return (floatBitsToUint(value) & 0x7f800000u) == 0x7f800000u;
}

bool bad(float value) {
    return not_finite(value) || value < 0.0;
}

// Whether a colour is no light.
bool is_invalid(Camera cam, vec3 colour) {
    return bad(colour.x) || bad(colour.y) || bad(colour.z)
        || not_finite((colour.x + colour.y + colour.z) * cam.exposure_gain);
}

#include "ingest_lens.glsl"

// Log intensity of colour component `channel`.
float log_intensity_of(Camera cam, vec3 colour, uint channel) {
    float intensity = colour[channel];
    if (INTENSITY == INTENSITY_GRAY) {
        intensity = (colour.x + colour.y + colour.z) * (1.0 / 3.0);
    } else if (INTENSITY == INTENSITY_LUMINANCE) {
        intensity = dot(colour, REC709);
    } else if (INTENSITY == INTENSITY_SILICON_FRONT) {
        intensity = dot(colour, SILICON_FRONT);
    } else if (INTENSITY == INTENSITY_SILICON_BACK) {
        intensity = dot(colour, SILICON_BACK);
    } else if (INTENSITY == INTENSITY_SILICON_FRONT_IR) {
        intensity = dot(colour, SILICON_FRONT_IR);
    } else if (INTENSITY == INTENSITY_SILICON_BACK_IR) {
        intensity = dot(colour, SILICON_BACK_IR);
    }
    return log(intensity * cam.exposure_gain + cam.log_offset);
}

// First word of a frame of one colour component.
uint frame_of(Camera cam, uint frame_slot, uint channel) {
    return cam.plane_base + (frame_slot * CHANNELS + channel) * cam.frame_words;
}

// Level of a colour component in the previous frame, of which a camera's first has none.
float previous_level(Camera cam, uint channel, ivec2 at) {
    return load_plane(frame_of(cam, 1u - cam.frame_slot, channel) + frame_word(cam, HALF_PEL, at));
}

// The same; dark before a camera's first frame.
float level_before(Camera cam, uint channel, ivec2 at) {
    return is_first(cam) ? cam.log_dark : previous_level(cam, channel, at);
}

// Statistics of a block's pixels; words of `blocks`.
struct BlockStats {
    uint motion;
    uint change;
    uint invalid;
    uint invalid_motion;
};

// Handles a pixel with a valid colour: a camera's first frame arms it, a later frame adds its change to its block's
// statistics. `level` and `before` are the levels of the first colour component, in this frame and in the previous one.
void add_pixel(Camera cam, ivec2 at, vec3 colour, float level, float before, int reference, inout BlockStats stats) {
    const uint pixel = uint(at.y) * cam.width + uint(at.x);
    const uint own = INTENSITY == INTENSITY_BAYER_RGGB ? uint(at.x & 1) + uint(at.y & 1) : 0u;
    if (is_first(cam)) {
        arm_pixel(cam, pixel, to_q24(lit_at_end(cam, own == 0u ? level : log_intensity_of(cam, colour, own))));
        return;
    }
    float change = abs(level - before);
    bool changed = floatBitsToUint(before) != floatBitsToUint(level);
    for (uint c = 1u; c < CHANNELS; ++c) {
        const float other_before = previous_level(cam, c, at);
        const float other = log_intensity_of(cam, colour, c);
        if (c == own) {
            change = abs(other - other_before);
        }
        changed = changed || floatBitsToUint(other_before) != floatBitsToUint(other);
    }
    if (changed) {
        stats.change = max(stats.change, floatBitsToUint(max(change, 1e-12)));
    }
    if (reference == UNARMED) {
        // `cross` arms it at the end of the interval, which is this frame.
        store_state(cam, pixel, STATE_REFERENCE, uint(ARMING));
        stats.change = max(stats.change, floatBitsToUint(1e-12));
    }
}

// Counts a pixel without a valid colour, and whether it never had one; a camera's first frame marks it as unarmed.
void add_invalid_pixel(Camera cam, ivec2 at, int reference, inout BlockStats stats) {
    stats.invalid += 1u;
    if (is_first(cam)) {
        store_state(cam, uint(at.y) * cam.width + uint(at.x), STATE_REFERENCE, uint(UNARMED));
    }
    if (is_first(cam) || reference == UNARMED) {
        atomicAdd(counters[2u * cam.slot + cam.frame_slot].unarmed_pixels, 1u);
    }
}

// Adds this thread's statistics to those of a block of the tile.
void add_block_stats(uint block, BlockStats stats) {
    atomicMax(block_motion[block], stats.motion);
    atomicMax(block_change[block], stats.change);
    if (stats.invalid != 0u) {
        atomicAdd(block_invalid[block], stats.invalid);
    }
    if (stats.invalid_motion != 0u) {
        atomicAdd(block_invalid_motion[block], stats.invalid_motion);
    }
}

// Motion as rendered, or the mark of an unusable vector (see INVALID_BIT).
vec2 to_usable(vec2 m, out bool usable) {
    usable = !(not_finite(m.x) || not_finite(m.y)) && max(abs(m.x), abs(m.y)) < MOST_MOTION_PX;
    if (!usable) {
        return uintBitsToFloat(uvec2(INVALID_BIT, 0u));
    }
    return vec2(floatBitsToUint(m.x) == INVALID_BIT ? 0.0 : m.x, m.y);
}

// Loads a further colour component of a pixel of the tile or its apron.
void load_component(Camera cam, uint channel, uint cached, ivec2 at, bool own, vec3 colour, bool invalid) {
    const ivec2 clamped_at = clamp(at, ivec2(0), ivec2(cam.width, cam.height) - 1);
    const float before = level_before(cam, channel, clamped_at);
    const float level = invalid ? before : log_intensity_of(cam, colour, channel);
    if (HALF_PEL) {
        cached_level[channel * CACHE_PIXELS + cached] = level;
        if (floatBitsToUint(level) != floatBitsToUint(before)) {
            any_change = 1u;
        }
    }
    if (own && !HALF_PEL) {
        planes[frame_of(cam, cam.frame_slot, channel) + frame_word(cam, HALF_PEL, clamped_at)] = level;
    }
}

// Whether a pixel of the tile has an exact path.
bool shows_surface(ivec2 at);

// Loads a pixel of the tile or its apron; `channel` is the first component that the workgroup takes.
void load_tile_pixel(Camera cam, uint channel, ivec2 in_tile, bool of_tile, inout BlockStats stats) {
    const ivec2 at = tile_origin + in_tile;
    const uint cached = cache_index(at);
    const ivec2 clamped_at = clamp(at, ivec2(0), ivec2(cam.width, cam.height) - 1);
    const uint pixel = uint(clamped_at.y) * cam.width + uint(clamped_at.x);
    const bool own = of_tile && at == clamped_at;
    // What does not depend on a component is done once, by the workgroup of the first.
    const bool notes = own && channel == 0u;

    // Issues all loads at once: memory latency is long.
    const vec3 rendered = read_colour(cam, pixel);
    const bool has_motion = cam.has_motion != 0u && (!HALF_PEL || is_beside_anchor(in_tile));
    const vec2 motion_read = has_motion ? read_motion(cam, pixel) : vec2(0.0);
    float before = cam.log_dark;
    int reference = 0;
    if (!is_first(cam)) {
        before = previous_level(cam, channel, clamped_at);
        if (notes) {
            reference = int(load_state(cam, pixel, STATE_REFERENCE));
        }
    }
    const bool invalid = is_invalid(cam, rendered);
    const vec3 colour = through_lens(cam, clamped_at, rendered);
    const float level = invalid ? before : log_intensity_of(cam, colour, channel);
    if (HALF_PEL) {
        cached_level[cached] = level;
        if (floatBitsToUint(level) != floatBitsToUint(before)) {
            any_change = 1u;
        }
    }
    if (own && !HALF_PEL) {
        planes[frame_of(cam, cam.frame_slot, channel) + frame_word(cam, false, at)] = level;
    }
    [[unroll]] for (uint further = 1u; further < COMPONENTS; ++further) {
        load_component(cam, further, cached, at, own, colour, invalid);
    }
    if (CACHED_COMPONENTS > COMPONENTS && channel == 0u && is_beside_anchor(in_tile)) {
        [[unroll]] for (uint further = COMPONENTS; further < CACHED_COMPONENTS; ++further) {
            cached_level[further * CACHE_PIXELS + cached] =
                invalid ? level_before(cam, further, clamped_at) : log_intensity_of(cam, colour, further);
        }
    }
    if (notes && invalid) {
        add_invalid_pixel(cam, at, reference, stats);
    } else if (notes) {
        add_pixel(cam, at, colour, level, before, reference, stats);
    }

    if (has_motion) {
        bool usable;
        const vec2 m = to_usable(motion_read, usable);
        if (HALF_PEL) {
            cached_motion[cached] = usable ? m : vec2(NOWHERE_PX);
            if (floatBitsToUint(m.x) != 0u || m.y != 0.0) {
                any_change = 1u;
            }
        }
        if (notes) {
            motion[cam.motion_base + cam.frame_slot * cam.pixels + pixel] = m;
            if (usable) {
                // Synthesis `rigid` follows vectors only where it has no surface.
                if (!RIGID || !shows_surface(at)) {
                    stats.motion = max(stats.motion, floatBitsToUint(length(m)));
                }
            } else {
                stats.invalid_motion += 1u;
            }
        }
    }
}

#include "block_pairs.glsl"
#include "ingest_meetings.glsl"
#include "ingest_bends.glsl"
#include "ingest_texture.glsl"

// What else `cross` must know of a block: where motions meet in it, or its texture.
uint further_word(uint in_tile) {
    if (RIGID) {
        return SUBSTEPS_BY_ERROR ? block_texture(in_tile) : 0u;
    }
    return LAYERED ? pair_word(in_tile) : 0u;
}

// Writes a block's statistics.
void write_block(Camera cam, uint in_tile) {
    const uint block = (uint(tile_origin.y) / BLOCK_PX) * cam.blocks_x + uint(tile_origin.x) / BLOCK_PX + in_tile;
    blocks[cam.block_base + cam.frame_slot * cam.blocks + block] =
        uvec4(needed_motion(cam, in_tile), needed_change(in_tile), 0u, further_word(in_tile));
    const uint counter = 2u * cam.slot + cam.frame_slot;
    if (block_invalid[in_tile] != 0u) {
        atomicAdd(counters[counter].invalid_pixels, block_invalid[in_tile]);
    }
    if (block_invalid_motion[in_tile] != 0u) {
        atomicAdd(counters[counter].invalid_motion, block_invalid_motion[in_tile]);
    }
}

// Enqueues the tile for `cross`. Tiles with many sub-steps take long. They are first in the order: started last, one of
// them would run alone at the end.
void enqueue_tile(Camera cam) {
    uint most = 0u;
    for (uint b = 0u; b < TILE_BLOCKS; ++b) {
        most = max(most, substep_count(cam, uintBitsToFloat(needed_motion(cam, b)), uintBitsToFloat(needed_change(b))));
    }
    const uint counter = 2u * cam.slot + cam.frame_slot;
    const uint place = most > cam.many_substeps
        ? atomicAdd(counters[counter].slow_tiles, 1u)
        : tile_count(cam) - 1u - atomicAdd(counters[counter].quick_tiles, 1u);
    tile_order[cam.tile_base + place] = gl_WorkGroupID.x;
}

#include "ingest_half_pels.glsl"

// Where the previous frame shows an anchor and its half-pel samples.
SampleQuad history_quad(Camera cam, ivec2 at, vec2 motions[9]) {
    const vec2 own = motions[4];
    const vec2 right = own + motions[5];
    const vec2 below = motions[7];
    const vec2 all = right + below + motions[8];
    return sample_quad(cam, at, own, vec2[3](0.5 * right, 0.5 * (own + below), 0.25 * all));
}

// Reprojects an anchor and, if `with_half_pels`, its half-pel samples to the previous frame; stores the anchor's
// residual and confidence. `channel` is the first component that the workgroup takes.
void reproject(Camera cam, uint channel, uvec2 anchor, bool with_half_pels, out vec4 reprojected[COMPONENTS]) {
    const ivec2 at = anchor_pixel(cam, tile_origin, anchor);
    const vec2 motions[9] = motions_around(cam, at);
    confidences[anchor_index(anchor)] = confidence_at(cam, disagreement_px(motions), vec2(at) + motions[4]);
    const SampleQuad quad = history_quad(cam, at, motions);
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        const uint previous = frame_of(cam, 1u - cam.frame_slot, channel + k);
        reprojected[k] =
            sample_shared_footprint(cam, previous, quad, cubic_parameter(cam, previous, at), with_half_pels);
        residuals[k * ANCHORS + anchor_index(anchor)] =
            cached_level[k * CACHE_PIXELS + cache_index(at)] - reprojected[k].x;
    }
}

// A pixel's own sample and its half-pel samples, of the `k`th component that the workgroup takes; `reprojected` are
// their levels in the previous frame.
vec4 entries_of(Camera cam, uint k, ivec2 at, vec4 reprojected, Correction corrections[3]) {
    vec4 entries = vec4(cached_level[k * CACHE_PIXELS + cache_index(at)], 0.0, 0.0, 0.0);
    if (min(min(corrections[0].confidence, corrections[1].confidence), corrections[2].confidence) < 1.0) {
        entries.yzw = interpolate_frame(cam, k, at);
    }
    [[unroll]] for (int phase = 1; phase < 4; ++phase) {
        const Correction of = corrections[phase - 1];
        if (of.confidence >= 1.0) {
            entries[phase] = reprojected[phase] + of.residual[k];
        } else if (of.confidence > 0.0) {
            entries[phase] = lerp(entries[phase], reprojected[phase] + of.residual[k], of.confidence);
        }
    }
    return entries;
}

// A pixel's samples of the frame before, of a component. They still hold if nothing moved or changed.
vec4 entries_before(Camera cam, uint component, ivec2 at) {
    const uint top = frame_of(cam, 1u - cam.frame_slot, component) + frame_word(cam, true, at);
    const uint below = top + cam.half_pel_stride;
    return vec4(load_plane(top), load_plane(top + 1u), load_plane(below), load_plane(below + 1u));
}

// Writes a pixel's samples of the half-pel frame; `channel` is the first component that the workgroup takes.
void write_half_pels(Camera cam, uint channel, uvec2 in_tile, vec4 reprojected[COMPONENTS]) {
    const ivec2 at = tile_origin + ivec2(in_tile);
    Correction corrections[3] = Correction[3](NO_CORRECTION, NO_CORRECTION, NO_CORRECTION);
    if (any_change != 0u && !is_first(cam)) {
        corrections = corrections_at(in_tile);
    }
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        vec4 entries;
        if (any_change != 0u) {
            entries = entries_of(cam, k, at, reprojected[k], corrections);
        } else {
            entries = entries_before(cam, channel + k, at);
        }
        store_entries(cam, frame_of(cam, cam.frame_slot, channel + k), at, entries);
    }
}

#include "ingest_surfaces.glsl"
#include "ingest_lists.glsl"
#include "rigid_half_pels.glsl"

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uvec2 corner = tile_corner(cameras[index].blocks_x, gl_WorkGroupID.x);
    if (cameras[index].frame_kind == 0u || corner.y >= cameras[index].height) {
        return;
    }
    const Camera cam = cameras[index];
    const uint lane = gl_LocalInvocationID.x;
    const uint channel = first_component();
    tile_origin = ivec2(corner);
    if (lane < TILE_BLOCKS) {
        block_motion[lane] = 0u;
        block_change[lane] = 0u;
        block_invalid[lane] = 0u;
        block_invalid_motion[lane] = 0u;
        if (LAYERED) {
            largest_pair[lane] = 0u;
        }
        if (SUBSTEPS_BY_ERROR) {
            begin_bends(lane);
        }
    }
    if (HALF_PEL) {
        begin_roughness(lane);
    }
    if (lane == 0u) {
        any_change = is_first(cam) ? 1u : 0u;
        if (MAKES_LISTS) {
            silhouettes = 0u;
        }
    }
    barrier();
    if (RIGID) {
        for (uint pixel = lane; pixel < SURFACE_PIXELS; pixel += gl_WorkGroupSize.x) {
            load_geometry(cam, geometries[cam.slot], pixel, MAKES_LISTS);
        }
        barrier();
        if (!MAKES_FRAME) {
            write_surfaces(cam, geometries[cam.slot]);
            return;
        }
    }
    if (SHARES_BLURRED_ROWS) {
        blur_rows(cam);
    }
    BlockStats stats = BlockStats(0u, 0u, 0u, 0u);
    uint number = lane;
    do {
        load_tile_pixel(cam, channel, ivec2(number % TILE_WIDTH_PX, number / TILE_WIDTH_PX), true, stats);
        number += gl_WorkGroupSize.x;
    } while (number < TILE_ANCHORS);
    if (channel == 0u) {
        add_block_stats((lane % TILE_WIDTH_PX) / BLOCK_PX, stats);
    }
    number = lane;
    if (number < CACHE_PIXELS - TILE_ANCHORS) {
        do {
            load_tile_pixel(cam, channel, apron_pixel(number), false, stats);
            number += gl_WorkGroupSize.x;
        } while (number < CACHE_PIXELS - TILE_ANCHORS);
    }
    barrier();
    if (MAKES_LISTS) {
        write_surfaces(cam, geometries[cam.slot]);
    }
    // Where nothing moves or changes, no motions meet. Without half-pel frames that is not known.
    const bool may_change = !HALF_PEL || any_change != 0u;
    const bool compares = LAYERED && channel == 0u && cam.has_motion != 0u && !is_first(cam) && may_change;
    if (compares) {
        for (uint pixel = lane; pixel < TILE_ANCHORS; pixel += gl_WorkGroupSize.x) {
            compare_vectors(cam, pixel);
        }
    }
    if (HALF_PEL) {
        sum_texture(cam, SUBSTEPS_BY_ERROR && channel == 0u && (RIGID || cam.has_motion != 0u));
    }
    if (RIGID || HALF_PEL || LAYERED) {
        barrier();
    }
    if (compares && motions_meet_in_tile()) {
        mark_meetings(cam);
    }
    if (HALF_PEL) {
        write_parameters(cam, channel);
    }
    if (channel == 0u && lane < TILE_BLOCKS && corner.x + lane * BLOCK_PX < cam.width) {
        write_block(cam, lane);
        clear_meetings(cam, lane);
    }
    if (MAKES_LISTS) {
        if (lane < TILE_BLOCKS) {
            block_motion[lane] = max(block_motion[lane], own_motion[lane]);
        }
        barrier();
    }
    if (channel == 0u && lane == gl_WorkGroupSize.x - 1u) {
        enqueue_tile(cam);
    }
    if (!HALF_PEL) {
        return;
    }
    if (RIGID) {
        barrier();
        write_rigid_frame(cam, geometries[cam.slot], channel);
        return;
    }
    const bool reprojects = any_change != 0u && !is_first(cam);
    vec4 reprojected[COMPONENTS];
    if (reprojects) {
        number = TILE_ANCHORS + lane;
        if (number < ANCHORS) {
            do {
                reproject(cam, channel, anchor_at(number), false, reprojected);
                number += gl_WorkGroupSize.x;
            } while (number < ANCHORS);
        }
    }
    // Half-pel samples of a row need the anchors of the next row, so reprojection runs ahead of them.
    uvec2 anchor = anchor_at(lane);
    if (reprojects) {
        reproject(cam, channel, anchor, has_half_pels(cam, tile_origin, anchor), reprojected);
    }
    uint row = 0u;
    do {
        const uvec2 next = anchor + uvec2(0u, ROWS_PX);
        vec4 reprojected_next[COMPONENTS];
        if (reprojects) {
            if (row + ROWS_PX < BLOCK_PX) {
                reproject(cam, channel, next, has_half_pels(cam, tile_origin, next), reprojected_next);
            }
            barrier();
        }
        if (has_half_pels(cam, tile_origin, anchor)) {
            write_half_pels(cam, channel, anchor, reprojected);
        }
        anchor = next;
        [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
            reprojected[k] = reprojected_next[k];
        }
        row += ROWS_PX;
    } while (row < BLOCK_PX);
}
