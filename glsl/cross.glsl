// cross: from planes and motion to events in bins. The synthesis and the pixel model are one kernel, so that sub-steps
// never leave the chip; or, with READS_LEVELS, `synthesize` has made the levels, in passes that push.level counts.
//
// Shared by cross_gpu.glsl and cross_cpu.glsl. A tile is four 8x8 blocks side by side, a sub-tile some rows of it, with
// one thread per pixel. A row of a tile is 32 pixels, so that a subgroup reads neighbouring words. Each thread
// synthesises or reads the sub-steps of its pixel and walks them; the events go through shared memory into bins. x over
// sub-tiles or tiles, in the order of `tile_order`, y over cameras.
//
// Reads `planes`, `motion`, `blocks`, and for synthesis `rigid` surfaces, poses and what passes blocks; or `planes` and
// `levels`. Writes events to bins; updates `state` in place, but only if all events of the sub-tile fit. A sub-tile whose
// events do not fit changes nothing and runs again: after the buffers have grown or, if the queue was too short, in a
// permutation WALKS_AGAIN: of the sub-tiles that the first run has listed (SECOND_RUN), or of all that are not done. The
// order within a bin is that of the atomics; `sort` makes the packet independent of it.
//
// The including file provides, before this one: RIGID (whether this is the kernel of synthesis `rigid`), LAYERED (whether
// it is that of tiles where motions meet), READS_LEVELS (defined for kernels that do), PHYSICAL (defined for the kernel of
// the physical pixel), LEVELS_FIRST (defined if a log pixel is walked once all its levels are synthesised), frame loads,
// `fast_udiv`, INCREMENT, MAY_BIN_BY_SAMPLE, WALKS_SUSPEND, SAVES_ROUNDS; after it: the functions that are declared here
// without a body.

// Whether a tile without motion and change can be skipped; or only such pixels of it as rest, in a permutation that lets
// them rest. A physical pixel moves on after the light has come to rest.
#ifdef PHYSICAL
const bool SKIPS_STILL_TILES = false;
const bool MAY_REST = false;
#else
const bool SKIPS_STILL_TILES = !EFFECT_LEAK && !EFFECT_SHOT && !EFFECT_APS && !EFFECT_FLICKER && !DUMP_SAMPLES;
const bool MAY_REST = (EFFECT_LEAK || EFFECT_SHOT) && !EFFECT_APS && !EFFECT_FLICKER && !DUMP_SAMPLES;
#endif

// Whether it is found out first if a tile is still; else pixels are read at once.
const bool LOOKS_FIRST = SKIPS_STILL_TILES || PIXELS_REST;

// Whether sub-steps may be read along a pixel's motion: by synthesis `rigid` where a pixel has no path.
const bool FOLLOWS_MOTION = SYNTHESIS_FOLLOWS_MOTION(SYNTHESIS);

#include "synthesize.glsl"
#include "surfaces.glsl"
#include "block_pairs.glsl"
#include "tile_activity.glsl"
#ifdef READS_LEVELS
#define LIST_BLOCKS 1u
#include "levels.glsl"
#include "paths.glsl"
#include "candidates.glsl"
#include "rigid.glsl"
#include "unoccluded.glsl"
#include "level_source.glsl"
#else
#define LIST_BLOCKS TILE_BLOCKS
#include "paths.glsl"
#include "candidates.glsl"
#include "candidate_lists.glsl"
#include "rigid.glsl"
#include "unoccluded.glsl"
#include "layers.glsl"
#include "layer_lists.glsl"
#include "source.glsl"
#endif
#include "state_words.glsl"
#ifdef PHYSICAL
#include "pixel_physical_state.glsl"
#else
#include "pixel_log_state.glsl"
#endif

void emit(uint at_ns, bool on, uint ordinal);
void emit_refused();
bool walks_on(uint ordinal);

// How often the sub-tile was walked before the walk under way.
uint earlier_walks;

#if defined(PHYSICAL) || defined(LEVELS_FIRST)
#include "substep_levels.glsl"
#endif
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

// Whether this thread's pixel has sent all its events, after a walk.
bool has_sent_all();

// After a walk of a sub-tile with `found` events, its queue scattered: how many it has sent. What comes before the next walk.
uint events_sent(uint found);
void begin_next_walk();

// Leaves the workgroup's sub-tile, which has more events than the queue holds.
void leave_crowded(Camera cam, uint counter);

// Whether a pixel has had a valid colour, and is armed since an earlier interval.
bool is_armed(PixelState before);

// Bits of the rows of some sub-tiles.
uint rows_of(uint first_sub_tile, uint sub_tiles) {
    return ((1u << (sub_tiles * SUB_TILE_ROWS)) - 1u) << (first_sub_tile * SUB_TILE_ROWS);
}

#ifdef PHYSICAL
#include "interval_physical.glsl"
#elif defined(LEVELS_FIRST)
#include "interval_by_levels.glsl"
#else
#include "interval_by_substeps.glsl"
#endif

// Loads a pixel's state and the inputs of its synthesis.
void read_pixel(Camera cam, uvec2 at, out PixelState before, out Source s) {
    before = load_pixel(cam, at.y * cam.width + at.x);
    s = read_source(cam, at);
}

#include "resting.glsl"
#ifdef PHYSICAL
#include "pixel_never_rests.glsl"
#else
#include "pixel_log_rest.glsl"
#endif

// Which pixels are awake, as the threads of the workgroup tell each other: begins with none, notes those of this thread.
// What `awake` means is up to the including file; 0 is none.
void begin_awake();
void note_awake(uint awake);

// This thread's pixels that are awake, if pixels rest; whether nothing in and around the tile moves or changes, and in and
// around this thread's block, if that is looked for.
uint own_awake = 0u;
bool still_tile = false;
bool still_block = false;
#ifdef READS_LEVELS
// Rows of `levels` that this thread's block has.
uint block_rows = 0u;
#endif

void begin_tile() {
    begin_queue();
    if (PIXELS_REST) {
        begin_awake();
    }
}

void note_own() {
    if (PIXELS_REST) {
        note_awake(own_awake);
    }
}

// Whether the tile is still, so that its pixels may rest.
bool may_rest() {
    return PIXELS_REST && still_tile;
}

// Counts the sub-steps of this thread's block, and whether it is still; called once in a tick for each tile.
void count_block(Camera cam, uint n) {
    const uint counter = 2u * cam.slot + cam.frame_slot;
    if (counts_block(cam)) {
        atomicAdd(counters[counter].substeps, n);
        if (MAY_REST && still_block) {
            atomicAdd(counters[counter].still_blocks, 1u);
        }
#ifdef READS_LEVELS
        if (block_rows != 0u) {
            atomicAdd(counters[counter].level_rows, block_rows);
        }
#endif
    }
}

// Whether the workgroup's sub-tiles need no walk: an earlier attempt at this tick did them, or the tile is still and is
// skipped.
bool skip_sub_tiles(Camera cam, TileBlocks tile, uint first_sub_tile, uint own_rows) {
    bool skips = (tile.rows_done & own_rows) == own_rows;
    if (!skips && still_tile && skips_still(cam)) {
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

// Makes room for the sub-tile's events. Returns whether there is.
bool make_room(Camera cam, uint counter, uint found) {
    if (gl_LocalInvocationID.x == 0u) {
        queue_base = found == 0u ? 0u : reserve_events(counter, found);
        if (WALKS_AGAIN && !SECOND_RUN && found > QUEUE_EVENTS) {
            atomicAdd(counters[counter].crowded_sub_tiles, 1u);
        }
    }
    barrier();
    const bool fits = found == 0u || (queue_base <= cam.event_capacity && found <= cam.event_capacity - queue_base);
    if (!fits && gl_LocalInvocationID.x == 0u) {
        atomicMin(counters[counter].emitted_fit, queue_base);
    }
    return fits;
}

// Scatters the events in the queue.
void scatter_queue(Camera cam) {
    const uint waiting = min(queue_count, QUEUE_EVENTS);
    uint e = gl_LocalInvocationID.x;
    if (e < waiting) {
        do {
            const uint low = uint(queue_tags[e]);
            const uint tag = LONG_TAGS ? low | (uint(queue_tags_high[e]) << 16) : low;
            stamp_and_scatter(cam, queued_time_ns(e, tag), tag);
            e += gl_WorkGroupSize.x;
        } while (e < waiting);
    }
}

// Walks the sub-tile at `corner`, which has these rows of the tile and whose pixels have `n` sub-steps, and scatters its
// events. `before` and `s` are those of this thread's pixel, which takes part if it is `inside`. If `counts`, this
// sub-tile adds its blocks' sub-steps to the counters.
void cross_sub_tile(
    Camera cam, uint rows, uint first_block, uint n, bool inside, bool counts, PixelState before, Source s
) {
    const uint lane = gl_LocalInvocationID.x;
    const uint counter = 2u * cam.slot + cam.frame_slot;
    const uvec2 at = sub_tile_pixel();
    const uint pixel = at.y * cam.width + at.x;
    bool active_pixel = false;
    if (inside) {
        active_pixel = is_armed(before);
        prepare_source(cam, s, n, (at.x - corner.x) / BLOCK_PX);
    }

    Rest rest;
    if (PIXELS_REST && inside) {
        rest = rests[cam.slot];
        if (active_pixel) {
            catch_up(cam, rest, load_state(cam, pixel, STATE_REST), to_q24(s.log_previous), before);
        }
    }

    PixelState p = before;
    float exposed = 0.0;
    uint found = 0u;
    uint sent = 0u;
    bool walks = inside;
    bool is_last;
    earlier_walks = 0u;
    queued = 0u;
    begin_interval();
    do {
        begin_events();
        if (walks) {
            if (!is_midway()) {
                p = before;
            }
            exposed = cross_interval(cam, s, active_pixel, n, p);
            const uint count = p.events - before.events;
            end_events(count);
            if (WALKS_AGAIN && earlier_walks == 0u) {
                atomicAdd(queue_found, count);
            }
            walks = !has_sent_all();
        }
        barrier();
        if (earlier_walks == 0u) {
            found = WALKS_AGAIN ? queue_found : queue_count;
            if (!WALKS_AGAIN && found > QUEUE_EVENTS) {
                if (lane == 0u) {
                    leave_crowded(cam, counter);
                }
                return;
            }
            if (!make_room(cam, counter, found)) {
                return;
            }
        }
        scatter_queue(cam);
        sent += events_sent(found);
        is_last = !WALKS_AGAIN || sent == found;
        if (!is_last) {
            begin_next_walk();
        }
        earlier_walks += 1u;
    } while (!is_last);
    if (EFFECT_DELAY) {
        // Until here, `stamp_and_scatter` reads the event counts of other threads' pixels.
        barrier();
    }
    if (inside) {
        if (PIXELS_REST) {
            const uint units = active_pixel && may_rest() ? rest_units(cam, p, to_q24(s.log_current)) : 0u;
            store_state(cam, pixel, STATE_REST, rest_word(cam, rest, units));
        }
        bool is_overrun = false;
#ifdef PHYSICAL
        is_overrun = active_pixel && p.silent;
        if (is_overrun) {
            arm_pixel_after(cam, pixel, to_q24(lit_at_end(cam, s.log_current)), p.events);
            atomicAdd(counters[counter].overrun_pixels, 1u);
        }
#endif
        if (active_pixel && !is_overrun) {
            store_pixel(cam, pixel, p);
        } else if (before.reference == ARMING) {
            arm_pixel(cam, pixel, to_q24(lit_at_end(cam, s.log_current)));
        }
        const uint unseen = RIGID ? count_unseen(s, n) : 0u;
        if (unseen != 0u) {
            atomicAdd(counters[counter].unseen_samples, unseen);
        }
        if (EFFECT_APS) {
            const float mean = exposed / float(max(cam.aps_end_ns - cam.aps_start_ns, 1u));
            aps[cam.aps_base + pixel] = uint16_t(clamp(round(mean * cam.aps_scale), 0.0, cam.aps_max));
        }
    }
    if (lane == 0u) {
        atomicOr(blocks[first_block].z, rows);
        if (SECOND_RUN) {
            atomicAdd(counters[counter].queue_overflows, 0xffffffffu);
        }
    }
    if (counts) {
        count_block(cam, n);
    }
}

// Passes over rows whose pixels need no walk.
void rest_rows(Camera cam, uint rows, uint first_block, uint n, bool counts) {
    if (gl_LocalInvocationID.x == 0u) {
        atomicOr(blocks[first_block].z, rows);
    }
    if (counts) {
        count_block(cam, n);
    }
}
