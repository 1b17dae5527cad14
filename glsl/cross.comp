// cross: from planes and motion to events in bins; the synthesis and the pixel model in one kernel, so
// that sub-steps never leave the chip.
//
// One workgroup a part of a strip of four 8x8 blocks side by side, some rows of it, a thread a pixel, which synthesises
// each sub-step and walks it; what they find is kept in a list, and all threads stamp and stage the list together. A
// row of a strip is 32 pixels, so that a subgroup reads neighbouring words. On the software driver, where all that
// comes before the first pixel is dear, a workgroup takes a strip's parts one after the other. x over parts or strips,
// in the order of `strip_order`, y over cameras. Reads `planes`, `motion`, `blocks`. Puts events into their bins;
// updates `state` in place, but only if the part's events fitted: one whose events did not fit leaves everything as it
// was and runs again, once the buffers have grown, or without a list (CROWDED) if that was too short. The order within
// a bin is that of the atomics; `sort` makes the packet independent of it.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "random.glsl"
#include "substeps.glsl"
#include "strips.glsl"

layout(local_size_x = CROSS_THREADS, local_size_x_id = 14) in;
layout(constant_id = 0) const uint INTENSITY = 0;
layout(constant_id = 8) const uint SYNTHESIS = 0;
layout(constant_id = 9) const uint TAPS = 0;
// Whether sub-steps are also written to `samples`, for tests.
layout(constant_id = 10) const bool DUMP_SAMPLES = false;
// Whether events are counted in one walk and staged in a second, for strips that have more than a list.
layout(constant_id = 11) const bool CROWDED = false;
layout(constant_id = 12) const bool BY_ADDRESS = true;
// Whether the device skips branches that no thread takes, as GPUs do and the software driver does not.
layout(constant_id = 13) const bool BRANCHES = true;
// Whether pixels may be unarmed.
layout(constant_id = 15) const bool MAY_BE_UNARMED = true;
// Whether a workgroup takes whole strips, a part after the other.
layout(constant_id = 16) const bool WHOLE_STRIPS = false;

BUFFER(, SLOT_COUNTERS, Counters, counters);
BUFFER(readonly, SLOT_PLANES, float, planes);
BUFFER(readonly, SLOT_MOTION, vec2, motion);
BUFFER(, SLOT_STATE, uint, state);
BUFFER(, SLOT_BLOCKS, uvec4, blocks);
BUFFER(readonly, SLOT_STRIP_ORDER, uint, strip_order);
BUFFER(, SLOT_BINS, uint, bins);
BUFFER(writeonly, SLOT_ROOMS, uvec2, rooms);
BUFFER(writeonly, SLOT_SPILLED, uvec2, spilled);
BUFFER(writeonly, SLOT_APS, uint16_t, aps);
BUFFER(writeonly, SLOT_SAMPLES, int, samples_out);

// Rows of a part, and parts of a strip.
const uint PART_PX = gl_WorkGroupSize.x / STRIP_PX;
const uint STRIP_PARTS = uint(BLOCK_PX) / PART_PX;

const uint LIST_EVENTS = 8u * CROSS_THREADS;

// Time after the interval's start, and what else there is of an event (see `event_tag`). Small: the less of the
// shared memory a workgroup takes, the faster is this kernel. On the software driver times lie where their pixel has
// its slots, and the rest of the list is written when a walk is over: what a step does costs it for every pixel,
// whether that has an event or not.
shared uint list_at_ns[LIST_EVENTS];
shared uint16_t list_tags[LIST_EVENTS];
shared uint list_count;
shared uint list_base;
shared uint around_motion[STRIP_BLOCKS];
shared uint own_change[STRIP_BLOCKS];
// What moves or changes in or around the strip, if that is asked for.
shared uint anything;

#include "texels.glsl"
#include "synthesize.glsl"
#include "pixel_log_state.glsl"

// First pixel of the part.
uvec2 corner;

// In a crowded strip's second walk.
bool staging;

// Slots of a pixel, and which of its events so far are ON. A pixel that has more makes the part a crowded one, and its
// walk need not go on.
const bool HAS_SLOTS = !BRANCHES && !CROWDED;
const uint PIXEL_SLOTS = LIST_EVENTS / gl_WorkGroupSize.x;
uint on_events;

void emit(uint at_ns, bool on, uint ordinal);

bool walks_on(uint ordinal) {
    return !HAS_SLOTS || ordinal <= PIXEL_SLOTS;
}

#include "pixel_log.glsl"
#include "bins.glsl"
#include "put.glsl"

// Parts that a workgroup takes. (The software driver ends a thread's loops, all of them together, after 65535 rounds:
// a crowded strip, whose pixels may have thousands of events, is shared out among more threads.)
const uint PARTS = WHOLE_STRIPS && !CROWDED ? STRIP_PARTS : 1u;

// Which rows of a strip belong to some parts.
uint rows_of(uint first_part, uint parts) {
    return ((1u << (parts * PART_PX)) - 1u) << (first_part * PART_PX);
}

// Whether a strip in which nothing moves or changes has nothing to do.
const bool SKIPS_STILL = !EFFECT_LEAK && !EFFECT_SHOT && !EFFECT_APS && !DUMP_SAMPLES;

// Whether sub-steps are read along a pixel's motion.
const bool FOLLOWS_MOTION = SYNTHESIS == SYNTHESIS_MOTION || SYNTHESIS == SYNTHESIS_PAPER;

// Pixel in the part, polarity << 7, ordinal in the interval << 8.
uint event_tag(bool on, uint ordinal) {
    return gl_LocalInvocationID.x | (uint(on) << 7) | (ordinal << 8);
}

// Stamps an event and puts it where it belongs.
void stage(Camera cam, uint at_ns, uint tag) {
    const uint in_part = tag & 127u;
    const uint pixel = (corner.y + in_part / STRIP_PX) * cam.width + corner.x + in_part % STRIP_PX;
    uint since_start_ns = at_ns;
    if (EFFECT_DELAY) {
        int delay_ns = int(cam.latency_ns);
        if (cam.latency_jitter_ns != 0u) {
            // The state's count is that of the intervals before: it is stored when all is staged.
            const uint index = load_state(cam, pixel, STATE_EVENTS) + (tag >> 8);
            delay_ns += jitter_ns(draw(cam, pixel, STREAM_JITTER, index), cam.latency_jitter_ns);
        }
        since_start_ns += uint(max(delay_ns, 0));
    }
    uvec2 event = uvec2(since_start_ns, (pixel << 1) | ((tag >> 7) & 1u));
    uint bin = cam.bin_count;
    if (since_start_ns > cam.interval_ns) {
        event.y |= LATE;
    } else {
        event.x = stamp_offset(cam, since_start_ns);
        bin = bin_of(cam, event.x, pixel);
    }
    put(cam, bin, event);
}

// Slot of a pixel of the part.
uint slot_of(uint in_part, uint ordinal) {
    return min(ordinal, PIXEL_SLOTS - 1u) * gl_WorkGroupSize.x + in_part;
}

// Lists the `count` events that are in the pixel's slots.
void list_slots(uint count) {
    const uint position = atomicAdd(list_count, count > PIXEL_SLOTS ? LIST_EVENTS + 1u : count);
    if (count == 0u || position >= LIST_EVENTS) {
        return;
    }
    const uint last = min(count, LIST_EVENTS - position);
    uint ordinal = 0u;
    do {
        list_tags[position + ordinal] = uint16_t(event_tag(((on_events >> ordinal) & 1u) != 0u, ordinal));
        ordinal += 1u;
    } while (ordinal < last);
}

void emit(uint at_ns, bool on, uint ordinal) {
    if (HAS_SLOTS) {
        list_at_ns[slot_of(gl_LocalInvocationID.x, ordinal)] = at_ns;
        on_events |= uint(on) << (ordinal & 31u);
        return;
    }
    const uint tag = event_tag(on, ordinal);
    // An ordinal that the list has no bits for makes the part a crowded one.
    const uint position = atomicAdd(list_count, !CROWDED && tag > 0xffffu ? LIST_EVENTS : 1u);
    if (CROWDED) {
        if (staging) {
            stage(cameras[push.first_camera + gl_WorkGroupID.y], at_ns, tag);
        }
    } else if (position < LIST_EVENTS) {
        list_at_ns[position] = at_ns;
        list_tags[position] = uint16_t(tag);
    }
}

// What a pixel's sub-steps are worked out from.
struct Source {
    uvec2 at;
    Frames frames;
    // Log intensity in both frames.
    float log_previous;
    float log_current;
    // Its exponential, where it would be worked out whether it is needed or not.
    float light_previous;
    float light_current;
    // Whether the pixel has motion to warp by, and where that leads.
    bool warps;
    Course course;
    bool leaves;
};

// Log intensity at a fraction of the interval.
float synthesize(Camera cam, Source s, float alpha) {
    if (SYNTHESIS == SYNTHESIS_LINEAR || !s.warps) {
        const float light_previous = BRANCHES ? exp(s.log_previous) : s.light_previous;
        const float light_current = BRANCHES ? exp(s.log_current) : s.light_current;
        return max(synthesize_linear(light_previous, light_current, alpha), cam.log_dark);
    } else if (SYNTHESIS == SYNTHESIS_MOTION) {
        return max(synthesize_motion(cam, s.frames, vec2(s.at), s.course, s.leaves, alpha), cam.log_dark);
    }
    return max(synthesize_paper(cam, s.frames, ivec2(s.at), alpha), cam.log_dark);
}

// What is read of a pixel whatever its sub-steps are.
Source read_source(Camera cam, uvec2 at) {
    Source s;
    s.at = at;
    s.frames = frames_of(cam, INTENSITY == INTENSITY_BAYER_RGGB ? (at.x & 1u) + (at.y & 1u) : 0u);
    const uint word = frame_word(cam, has_lattice(), ivec2(at));
    s.log_previous = plane_at(s.frames.previous + word);
    s.log_current = plane_at(s.frames.current + word);
    if (!BRANCHES) {
        s.light_previous = exp(s.log_previous);
        s.light_current = exp(s.log_current);
    }
    s.warps = FOLLOWS_MOTION && has_vector(cam, motion_base(cam, true), ivec2(at));
    s.leaves = false;
    return s;
}

// Synthesises and walks a pixel's interval; returns its exposure.
float cross_interval(
    Camera cam, Source s, bool active_pixel, uint n, inout PixelState p
) {
    const uint pixel = s.at.y * cam.width + s.at.x;
    const int first_q24 = to_q24(s.log_previous);
    if (!active_pixel) {
        silence(p, first_q24);
    }
    // Sub-step i ends at floor(i T / n): whole nanoseconds, and what is over of them. Both are counted on, exact in
    // 32 bits.
    const uint whole_ns = cam.interval_ns / n;
    const uint rest_ns = cam.interval_ns - whole_ns * n;
    const float inverse = 1.0 / float(n);
    uint end_ns = 0u;
    uint over = 0u;
    float done = 0.0;
    Walk w = begin_walk(cam, pixel, first_q24, to_q24(s.log_current), whole_ns, p);
    if (DUMP_SAMPLES) {
        samples_out[cam.samples_base + pixel] = first_q24;
    }
    uint i = 1u;
    do {
        while (i <= n && !needs_draw(w)) {
            if (!has_stopped(w)) {
                end_ns += whole_ns;
                over += rest_ns;
                if (over >= n) {
                    over -= n;
                    end_ns += 1u;
                }
                done += 1.0;
            }
            const int level_q24 = to_q24(i == n ? s.log_current : synthesize(cam, s, done * inverse));
            if (DUMP_SAMPLES) {
                samples_out[cam.samples_base + i * cam.pixels + pixel] = level_q24;
            }
            walk_substep(cam, pixel, end_ns, level_q24, p, w);
            if (!has_stopped(w)) {
                i += 1u;
            }
        }
        if (needs_draw(w)) {
            draw_shot(cam, pixel, p, w);
        }
    } while (WALKS_STOP && i <= n);
    end_walk(cam, w, p);
    return w.exposed;
}

// This thread's pixel.
uvec2 part_pixel() {
    return corner + uvec2(gl_LocalInvocationID.x % STRIP_PX, gl_LocalInvocationID.x / STRIP_PX);
}

// Whether this thread is the one that writes its block's facts and counts for it.
bool counts_block(Camera cam) {
    const uint lane = gl_LocalInvocationID.x;
    return lane < STRIP_PX && lane % BLOCK_PX == 0u && corner.x + lane < cam.width;
}

// Reads what is known of a pixel.
void read_pixel(Camera cam, uvec2 at, out PixelState before, out Source s) {
    before = load_pixel(cam, at.y * cam.width + at.x);
    s = read_source(cam, at);
}

// The part of the strip that begins at `corner`, whose pixels have `n` sub-steps; `before` and `s` are what was read
// of this thread's. Rows of it may be done already, on a device on which the parts of crowded strips are larger.
void cross_part(Camera cam, uint part, uint rows_done, uint first_block, uint n, PixelState before, Source s) {
    const uint lane = gl_LocalInvocationID.x;
    const uint counter = 2u * cam.slot + cam.parity;
    const uvec2 at = part_pixel();
    const bool is_done = !BRANCHES && CROWDED && ((rows_done >> (at.y % BLOCK_PX)) & 1u) != 0u;
    const bool inside = at.x < cam.width && at.y < cam.height && !is_done;
    const uint pixel = at.y * cam.width + at.x;
    bool active_pixel = false;
    if (inside) {
        active_pixel = !MAY_BE_UNARMED || (before.reference != UNARMED && before.reference != ARMING);
        s.warps = s.warps && n > 1u;
        if (SYNTHESIS == SYNTHESIS_MOTION && s.warps) {
            const Path start = path_at_start(cam, ivec2(at));
            const Path end = path_at_end(cam, ivec2(at));
            s.course = course_between(start, end);
            s.leaves = leaves_image(cam, vec2(at), start, end);
        }
    }

    PixelState p = before;
    float exposed = 0.0;
    staging = false;
    on_events = 0u;
    if (inside) {
        exposed = cross_interval(cam, s, active_pixel, n, p);
        if (HAS_SLOTS) {
            list_slots(p.events - before.events);
        }
    }
    barrier();
    const uint found = list_count;
    if (!CROWDED && found > LIST_EVENTS) {
        if (lane == 0u) {
            atomicAdd(counters[counter].crowded_strips, 1u);
        }
        return;
    }
    barrier();
    if (lane == 0u) {
        list_base = found == 0u ? 0u : atomicAdd(counters[counter].staged, found);
        list_count = 0u;
    }
    barrier();
    if (found != 0u && (list_base > cam.event_capacity || found > cam.event_capacity - list_base)) {
        if (lane == 0u) {
            atomicMin(counters[counter].staged_fit, list_base);
        }
        return;
    }
    if (CROWDED) {
        staging = true;
        if (inside) {
            p = before;
            cross_interval(cam, s, active_pixel, n, p);
        }
    } else {
        uint e = lane;
        if (e < found) {
            do {
                const uint tag = uint(list_tags[e]);
                stage(cam, list_at_ns[BRANCHES ? e : slot_of(tag & 127u, tag >> 8)], tag);
                e += gl_WorkGroupSize.x;
            } while (e < found);
        }
        if (EFFECT_DELAY) {
            // Others' counts of events are read until here.
            barrier();
        }
    }
    if (inside) {
        if (active_pixel) {
            store_pixel(cam, pixel, p);
        } else if (before.reference == ARMING) {
            arm_pixel(cam, pixel, to_q24(s.log_current));
        } else {
            atomicAdd(counters[counter].unarmed_pixels, 1u);
        }
        if (EFFECT_APS) {
            const float mean = exposed / float(max(cam.aps_end_ns - cam.aps_start_ns, 1u));
            aps[cam.aps_base + pixel] = uint16_t(clamp(round(mean * cam.aps_scale), 0.0, cam.aps_max));
        }
    }
    if (lane == 0u) {
        atomicOr(blocks[first_block].z, rows_of(part, 1u));
    }
    if (part == 0u && (BRANCHES || (rows_done & 1u) == 0u) && counts_block(cam)) {
        atomicAdd(counters[counter].substeps, n);
    }
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint in_line = gl_WorkGroupID.x * PARTS / STRIP_PARTS;
    const uint first_part = gl_WorkGroupID.x * PARTS % STRIP_PARTS;
    if (cameras[index].phase != PHASE_INTERVAL || in_line >= strip_count(cameras[index])) {
        return;
    }
    const Camera cam = cameras[index];
    corner = strip_corner(cam.blocks_x, strip_order[cam.strip_base + in_line]) + uvec2(0u, first_part * PART_PX);
    const uint lane = gl_LocalInvocationID.x;
    const uvec2 at = part_pixel();
    const bool inside = at.x < cam.width && at.y < cam.height;
    // Every thread knows its own block's facts.
    const uint in_strip = (lane % STRIP_PX) / BLOCK_PX;
    const uvec2 block_at = uvec2(min(corner.x / BLOCK_PX + in_strip, cam.blocks_x - 1u), corner.y / BLOCK_PX);
    const uint own_block = cam.block_base + cam.parity * cam.blocks + block_at.y * cam.blocks_x + block_at.x;

    const uint first_block =
        cam.block_base + cam.parity * cam.blocks + block_at.y * cam.blocks_x + corner.x / BLOCK_PX;
    const uint rows_done = blocks[first_block].z;
    const uint own_rows = rows_of(first_part, PARTS);
    PixelState before;
    Source s;
    if (inside && !SKIPS_STILL) {
        // It will be needed: better all at once than one after the other, memory is far.
        read_pixel(cam, at, before, s);
    }
    if (lane < STRIP_BLOCKS) {
        around_motion[lane] = 0u;
        own_change[lane] = 0u;
    }
    if (lane == 0u) {
        list_count = 0u;
        anything = 0u;
    }
    barrier();
    // Nine blocks around each of four, in both frames.
    const uint facts = FOLLOWS_MOTION ? 18u * STRIP_BLOCKS : 0u;
    for (uint fact = lane; fact < facts; fact += gl_WorkGroupSize.x) {
        const uint which_block = fact / 18u;
        const uint neighbour = fact % 18u;
        const ivec2 near = ivec2(corner / BLOCK_PX) + ivec2(which_block, 0)
            + ivec2(int(neighbour % 3u) - 1, int((neighbour / 3u) % 3u) - 1);
        const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
        if (all(greaterThanEqual(near, ivec2(0))) && all(lessThanEqual(near, last_block))) {
            const uint which = neighbour < 9u ? cam.parity : 1u - cam.parity;
            const uint motion_bits =
                blocks[cam.block_base + which * cam.blocks + uint(near.y) * cam.blocks_x + uint(near.x)].x;
            atomicMax(around_motion[which_block], motion_bits);
            if (SKIPS_STILL) {
                atomicOr(anything, motion_bits);
            }
        }
    }
    if (counts_block(cam)) {
        const uint change_bits = blocks[own_block].y;
        own_change[in_strip] = change_bits;
        if (SKIPS_STILL) {
            atomicOr(anything, change_bits);
        }
    }
    barrier();
    // What was done before the buffer had to grow is not done again; bits in the strip's first block tell.
    if ((rows_done & own_rows) == own_rows) {
        return;
    }
    if (SKIPS_STILL && anything == 0u && cam.no_skip == 0u) {
        if (lane == 0u) {
            atomicOr(blocks[first_block].z, own_rows);
        }
        // Where a strip is cut, its first part counts for all of it.
        if (first_part == 0u && counts_block(cam)) {
            atomicAdd(counters[2u * cam.slot + cam.parity].skipped_blocks, 1u);
        }
        return;
    }
    const uint n = SYNTHESIS == SYNTHESIS_NONE
        ? 1u
        : substep_count(cam, uintBitsToFloat(around_motion[in_strip]), uintBitsToFloat(own_change[in_strip]));
    uint taken = 0u;
    do {
        const uint part = first_part + taken;
        if (taken != 0u) {
            corner.y += PART_PX;
            barrier();
            if (lane == 0u) {
                list_count = 0u;
            }
            barrier();
        }
        if (PARTS == 1u || (rows_done & rows_of(part, 1u)) == 0u) {
            const uvec2 own = part_pixel();
            if ((SKIPS_STILL || taken != 0u) && own.x < cam.width && own.y < cam.height) {
                read_pixel(cam, own, before, s);
            }
            cross_part(cam, part, rows_done, first_block, n, before, s);
        }
        taken += 1u;
    } while (taken < PARTS);
}
