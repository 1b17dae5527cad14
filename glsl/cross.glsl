// cross: from planes and motion to events in bins. The synthesis and the pixel model are one kernel, so that sub-steps
// never leave the chip.
//
// Shared by cross_gpu.comp and cross_cpu.comp. A tile is four 8x8 blocks side by side, a sub-tile some rows of it, with
// one thread per pixel. A row of a tile is 32 pixels, so that a subgroup reads neighbouring words. Each thread
// synthesises the sub-steps of its pixel and walks them; the events go through shared memory into bins. x over
// sub-tiles or tiles, in the order of `tile_order`, y over cameras.
//
// Reads `planes`, `motion`, `blocks`, and for synthesis `rigid` surfaces, poses and what passes blocks. Writes events to
// bins; updates `state` in place, but only if all events of the sub-tile fit. A sub-tile whose events do not fit changes
// nothing and runs again: after the buffers have grown or, if the queue was too short, in the permutation
// QUEUE_OVERFLOWED. The order within a bin is that of the atomics; `sort`
// makes the packet independent of it.
//
// The including file provides, before this one: RIGID (whether this is the kernel of synthesis `rigid`), PHYSICAL (defined
// for the kernel of the physical pixel), frame loads,
// `fast_udiv`, INCREMENT, MAY_BIN_BY_SAMPLE, WALKS_SUSPEND; after it: the functions that are declared here without a
// body.

// Rows of a sub-tile, and sub-tiles of a tile.
const uint SUB_TILE_ROWS = gl_WorkGroupSize.x / TILE_WIDTH_PX;
const uint SUB_TILES = uint(BLOCK_PX) / SUB_TILE_ROWS;

// Largest motion in each block of the tile and the blocks around it, and the block's own change.
shared uint neighbourhood_motion[TILE_BLOCKS];
shared uint own_change[TILE_BLOCKS];
// All bits of both together, gathered only where still tiles are skipped.
shared uint any_activity;

// First pixel of the sub-tile.
uvec2 corner;

#include "synthesize.glsl"
#include "surfaces.glsl"
#include "paths.glsl"
#include "candidates.glsl"
#include "rigid.glsl"
#include "block_pairs.glsl"
#include "layers.glsl"
#include "layer_lists.glsl"
#include "state_words.glsl"
#ifdef PHYSICAL
#include "pixel_physical_state.glsl"
#else
#include "pixel_log_state.glsl"
#endif

void emit(uint at_ns, bool on, uint ordinal);
bool walks_on(uint ordinal);

#ifdef PHYSICAL
#include "pixel_physical.glsl"
#else
#include "pixel_log.glsl"
#endif
#include "bins.glsl"
#include "scatter.glsl"
#include "event_sink.glsl"
#include "reserve_events.glsl"

// Called before and after a pixel's walk, which emitted `count` events; time of the event at a position of the queue.
void begin_events();
void end_events(uint count);
uint queued_time_ns(uint position, uint tag);

// Whether a pixel has had a valid colour, and is armed since an earlier interval.
bool is_armed(PixelState before);

// Bits of the rows of some sub-tiles.
uint rows_of(uint first_sub_tile, uint sub_tiles) {
    return ((1u << (sub_tiles * SUB_TILE_ROWS)) - 1u) << (first_sub_tile * SUB_TILE_ROWS);
}

// Whether a tile without motion and change can be skipped. A physical pixel moves on after the light has come to rest.
#ifdef PHYSICAL
const bool SKIPS_STILL_TILES = false;
#else
const bool SKIPS_STILL_TILES = !EFFECT_LEAK && !EFFECT_SHOT && !EFFECT_APS && !EFFECT_FLICKER && !DUMP_SAMPLES;
#endif

// Whether sub-steps may be read along a pixel's motion: by synthesis `rigid` where a pixel has no path.
const bool FOLLOWS_MOTION = SYNTHESIS_FOLLOWS_MOTION(SYNTHESIS);

// Inputs of a pixel's synthesis.
struct Source {
    uvec2 at;
    Frames frames;
    // Log intensity in both frames.
    float log_previous;
    float log_current;
    // Whether the pixel has a usable motion vector; its warp; whether the warp may leave the image.
    bool warps;
    Warp warp;
    bool leaves;
    // Its surfaces, for synthesis `rigid`.
    RigidPixel rigid;
    // Its layers from near to far, and the first of its block's; none if it follows one surface.
    uint layers;
    uint layer_block;
};

// Log of the linear blend of both frames at `alpha`. `prepare_blend` takes the exponentials in advance, on devices
// where that is cheaper.
float blend_frames(Source s, float alpha);
void prepare_blend(Source s);

// Log intensity at a fraction of the interval.
float synthesize(Camera cam, Source s, float alpha) {
    if (SYNTHESIS == SYNTHESIS_LINEAR || !s.warps) {
        return max(blend_frames(s, alpha), cam.log_dark);
    } else if (SYNTHESIS == SYNTHESIS_MOTION) {
        if (LAYERED && s.layers != 0u) {
            bool lost;
            const float level = synthesize_layers(cam, s.frames, vec2(s.at), s.layer_block, s.layers, alpha, lost);
            if (!lost) {
                return max(level, cam.log_dark);
            }
        }
        return max(synthesize_motion(cam, s.frames, vec2(s.at), s.warp, s.leaves, alpha), cam.log_dark);
    }
    return max(synthesize_paper(cam, s.frames, ivec2(s.at), alpha), cam.log_dark);
}

// Log intensity at the end of sub-step `i` of `n`, at `alpha`, before the interval's end.
float synthesize_substep(Camera cam, Geometry geo, Source s, uint n, uint i, float alpha) {
    if (!RIGID) {
        return synthesize(cam, s, alpha);
    }
    bool lost = s.rigid.own == NO_SURFACE;
    float level;
    if (!lost) {
        level = synthesize_rigid(cam, geo, s.frames, s.at, s.rigid, n, i, alpha, lost);
    }
    if (lost && s.warps) {
        // Made for each sub-step: few pixels have no path, and all others would hold its registers.
        const Warp warp = warp_at(cam, s.at, s.leaves);
        level = synthesize_motion(cam, s.frames, vec2(s.at), warp, s.leaves, alpha);
    } else if (lost) {
        level = blend_frames(s, alpha);
    }
    return max(level, cam.log_dark);
}

// Loads the inputs that do not depend on the pixel's number of sub-steps.
Source read_source(Camera cam, uvec2 at) {
    Source s;
    s.at = at;
    s.frames = frames_of(cam, INTENSITY == INTENSITY_BAYER_RGGB ? (at.x & 1u) + (at.y & 1u) : 0u);
    const uint word = frame_word(cam, has_half_pel_frames(), ivec2(at));
    s.log_previous = load_plane(s.frames.previous + word);
    s.log_current = load_plane(s.frames.current + word);
    s.warps = FOLLOWS_MOTION && (!RIGID || cam.has_motion != 0u) && has_vector(cam, motion_base(cam, true), ivec2(at));
    s.leaves = false;
    prepare_blend(s);
    return s;
}

#ifdef PHYSICAL
#include "interval_by_levels.glsl"
#else
#include "interval_by_substeps.glsl"
#endif

// This thread's pixel.
uvec2 sub_tile_pixel() {
    return corner + uvec2(gl_LocalInvocationID.x % TILE_WIDTH_PX, gl_LocalInvocationID.x / TILE_WIDTH_PX);
}

// Whether this thread does the counting for its block.
bool counts_block(Camera cam) {
    const uint lane = gl_LocalInvocationID.x;
    return lane < TILE_WIDTH_PX && lane % BLOCK_PX == 0u && corner.x + lane < cam.width;
}

// Loads a pixel's state and the inputs of its synthesis.
void read_pixel(Camera cam, uvec2 at, out PixelState before, out Source s) {
    before = load_pixel(cam, at.y * cam.width + at.x);
    s = read_source(cam, at);
}

// The tile's blocks, as this thread addresses them.
struct TileBlocks {
    // Number of the thread's own block in the tile, and its element of `blocks`.
    uint in_tile;
    uint own_block;
    // Element of the tile's first block, whose word z has a bit for each row of the tile that is done.
    uint first_block;
    uint rows_done;
};

TileBlocks find_blocks(Camera cam) {
    const uint in_tile = (gl_LocalInvocationID.x % TILE_WIDTH_PX) / BLOCK_PX;
    const uvec2 block_at = uvec2(min(corner.x / BLOCK_PX + in_tile, cam.blocks_x - 1u), corner.y / BLOCK_PX);
    const uint row_base = cam.block_base + cam.frame_slot * cam.blocks + block_at.y * cam.blocks_x;
    const uint first_block = row_base + corner.x / BLOCK_PX;
    return TileBlocks(in_tile, row_base + block_at.x, first_block, blocks[first_block].z);
}

// Loads into shared memory the largest motion in and around each block of the tile, and each block's own change. Called
// by the whole workgroup; ends with a barrier.
void load_activity(Camera cam, TileBlocks tile) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < TILE_BLOCKS) {
        neighbourhood_motion[lane] = 0u;
        own_change[lane] = 0u;
    }
    if (lane == 0u) {
        queue_count = 0u;
        any_activity = 0u;
    }
    barrier();
    // Nine blocks around each of four, in both frames.
    const uint loads = FOLLOWS_MOTION && (!RIGID || cam.has_motion != 0u) ? 18u * TILE_BLOCKS : 0u;
    for (uint load = lane; load < loads; load += gl_WorkGroupSize.x) {
        const uint which_block = load / 18u;
        const uint neighbour = load % 18u;
        const ivec2 near = ivec2(corner / BLOCK_PX) + ivec2(which_block, 0)
            + ivec2(int(neighbour % 3u) - 1, int((neighbour / 3u) % 3u) - 1);
        const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
        if (all(greaterThanEqual(near, ivec2(0))) && all(lessThanEqual(near, last_block))) {
            const uint which = neighbour < 9u ? cam.frame_slot : 1u - cam.frame_slot;
            const uint motion_bits =
                blocks[cam.block_base + which * cam.blocks + uint(near.y) * cam.blocks_x + uint(near.x)].x;
            atomicMax(neighbourhood_motion[which_block], motion_bits);
            if (SKIPS_STILL_TILES) {
                atomicOr(any_activity, motion_bits);
            }
        }
    }
    if (RIGID && lane < TILE_BLOCKS) {
        const uint passing_bits = passing_motion(cam, lane);
        atomicMax(neighbourhood_motion[lane], passing_bits);
        if (SKIPS_STILL_TILES) {
            atomicOr(any_activity, passing_bits);
        }
    }
    if (LAYERED && lane < TILE_BLOCKS) {
        const uint meeting_bits = meeting_motion(cam, lane);
        atomicMax(neighbourhood_motion[lane], meeting_bits);
        if (SKIPS_STILL_TILES) {
            atomicOr(any_activity, meeting_bits);
        }
    }
    if (counts_block(cam)) {
        const uint change_bits = blocks[tile.own_block].y;
        own_change[tile.in_tile] = change_bits;
        if (SKIPS_STILL_TILES) {
            atomicOr(any_activity, change_bits);
        }
    }
    barrier();
}

// Whether the workgroup's sub-tiles need no walk: an earlier attempt at this tick did them, or nothing in and around
// the tile moves or changes.
bool skip_sub_tiles(Camera cam, TileBlocks tile, uint first_sub_tile, uint own_rows) {
    bool skips = (tile.rows_done & own_rows) == own_rows;
    if (!skips && SKIPS_STILL_TILES && any_activity == 0u && cam.no_skip == 0u) {
        if (gl_LocalInvocationID.x == 0u) {
            atomicOr(blocks[tile.first_block].z, own_rows);
        }
        // The first sub-tile counts for the whole tile.
        if (first_sub_tile == 0u && counts_block(cam)) {
            atomicAdd(counters[2u * cam.slot + cam.frame_slot].skipped_blocks, 1u);
        }
        skips = true;
    }
    return skips;
}

// Sub-steps of this thread's block.
uint substeps_of_block(Camera cam, TileBlocks tile) {
    return SYNTHESIS == SYNTHESIS_NONE
        ? 1u
        : substep_count(
            cam, uintBitsToFloat(neighbourhood_motion[tile.in_tile]), uintBitsToFloat(own_change[tile.in_tile]));
}

// Walks the sub-tile at `corner`, whose pixels have `n` sub-steps, and scatters its events. `before` and `s` are those
// of this thread's pixel, which takes part if it is `inside`. If `counts`, this sub-tile adds its blocks' sub-steps to
// the counters.
void cross_sub_tile(
    Camera cam, uint sub_tile, uint first_block, uint n, bool inside, bool counts, PixelState before, Source s
) {
    const uint lane = gl_LocalInvocationID.x;
    const uint counter = 2u * cam.slot + cam.frame_slot;
    const uvec2 at = sub_tile_pixel();
    const uint pixel = at.y * cam.width + at.x;
    bool active_pixel = false;
    if (inside) {
        active_pixel = is_armed(before);
        s.warps = s.warps && n > 1u;
        if (SYNTHESIS == SYNTHESIS_MOTION && s.warps) {
            s.warp = warp_at(cam, at, s.leaves);
            if (LAYERED) {
                const uint in_tile = (at.x - corner.x) / BLOCK_PX;
                s.layers = layers_of_pixel(cam, at, in_tile);
                s.layer_block = in_tile * BLOCK_LAYERS;
            }
        }
        if (RIGID) {
            s.rigid = read_rigid_pixel(cam, geometries[cam.slot], at, (at.x - corner.x) / BLOCK_PX);
        }
    }

    PixelState p = before;
    float exposed = 0.0;
    scattering = false;
    unseen_samples = 0u;
    begin_events();
    if (inside) {
        exposed = cross_interval(cam, s, active_pixel, n, p);
        end_events(p.events - before.events);
    }
    barrier();
    const uint found = queue_count;
    if (!QUEUE_OVERFLOWED && found > QUEUE_EVENTS) {
        if (lane == 0u) {
            atomicAdd(counters[counter].queue_overflows, 1u);
        }
        return;
    }
    barrier();
    if (lane == 0u) {
        queue_base = found == 0u ? 0u : reserve_events(counter, found);
        queue_count = 0u;
    }
    barrier();
    if (found != 0u && (queue_base > cam.event_capacity || found > cam.event_capacity - queue_base)) {
        if (lane == 0u) {
            atomicMin(counters[counter].emitted_fit, queue_base);
        }
        return;
    }
    if (QUEUE_OVERFLOWED) {
        scattering = true;
        if (inside) {
            unseen_samples = 0u;
            p = before;
            cross_interval(cam, s, active_pixel, n, p);
        }
    } else {
        uint e = lane;
        if (e < found) {
            do {
                const uint tag = uint(queue_tags[e]);
                stamp_and_scatter(cam, queued_time_ns(e, tag), tag);
                e += gl_WorkGroupSize.x;
            } while (e < found);
        }
        if (EFFECT_DELAY) {
            // Until here, `stamp_and_scatter` reads the event counts of other threads' pixels.
            barrier();
        }
    }
    if (inside) {
        if (active_pixel) {
            store_pixel(cam, pixel, p);
        } else if (before.reference == ARMING) {
            arm_pixel(cam, pixel, to_q24(lit_at_end(cam, s.log_current)));
        } else {
            atomicAdd(counters[counter].unarmed_pixels, 1u);
        }
        if (RIGID && unseen_samples != 0u) {
            atomicAdd(counters[counter].unseen_samples, unseen_samples);
        }
        if (EFFECT_APS) {
            const float mean = exposed / float(max(cam.aps_end_ns - cam.aps_start_ns, 1u));
            aps[cam.aps_base + pixel] = uint16_t(clamp(round(mean * cam.aps_scale), 0.0, cam.aps_max));
        }
    }
    if (lane == 0u) {
        atomicOr(blocks[first_block].z, rows_of(sub_tile, 1u));
    }
    if (counts && counts_block(cam)) {
        atomicAdd(counters[counter].substeps, n);
    }
}
