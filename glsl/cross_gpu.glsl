// cross, for GPUs: see cross.glsl. The kernels of `synthesize` make the levels of synthesis `rigid` and of tiles where
// motions meet; READS_LEVELS is defined for the kernels that read them. One workgroup per sub-tile of half a tile: a small
// workgroup ends as soon as its own pixels are done, and makes place for the next. Events go into a queue as they are found.
// Sub-tiles with more events than it holds are listed behind the bins, for the permutation SECOND_RUN; where a rig has
// many events, they are walked again at once.
#include "common.glsl"
#include "cross_constants.glsl"
#include "random.glsl"
#include "optics.glsl"
#include "substeps.glsl"
#include "tiles.glsl"

layout(local_size_x = CROSS_THREADS) in;

#include "cross_bindings.glsl"

// Leaves the test of `bin_samples` to run time: decided at compile time, it lets the compiler use fewer registers and
// load fewer taps at once, which is slower.
const bool MAY_BIN_BY_SAMPLE = true;
const bool WALKS_SUSPEND = false;
const bool SAVES_ROUNDS = false;

// Whether pixels that pass an interval in still light do so one by one, in the walk of a sub-tile.
const bool PASSES_IN_WALK = true;

#include "frame_load_by_address.glsl"
#include "udiv_native.glsl"
#include "subgroup_atomic.glsl"
#include "cross.glsl"
#include "event_queue.glsl"
#ifndef PHYSICAL
#include "shot_draws_gpu.glsl"
#endif

float blend_frames(Source s, float alpha) {
    return synthesize_linear(exp(s.log_previous), exp(s.log_current), alpha);
}

void prepare_blend(Source s) {}

bool is_armed(PixelState before) {
    return before.reference != UNARMED && before.reference != ARMING;
}

// Pixels of a still tile that are awake are packed into as few subgroups as hold them. If they are no more than a workgroup
// has threads, the first workgroup takes those of the whole tile.
shared uint awake_places[PIXELS_REST ? CROSS_THREADS : 1];
shared uint awake_count;
bool packs;

uint place_of(uint thread) {
    return PIXELS_REST && packs ? awake_places[thread] : thread;
}

void begin_awake() {
    awake_count = 0u;
}

// `awake` has a bit for each sub-tile, for the pixel in it that has the place of this thread.
void note_awake(uint awake) {
    for (uint sub_tile = 0u; sub_tile < SUB_TILES; ++sub_tile) {
        if (((awake >> sub_tile) & 1u) != 0u) {
            uint position;
            INCREMENT(awake_count, position);
            if (position < CROSS_THREADS) {
                awake_places[position] = sub_tile * CROSS_THREADS + gl_LocalInvocationID.x;
            }
        }
    }
}

// Which of the tile's pixels with the place of this thread are awake; `first` is that of the first sub-tile.
uint find_awake(Camera cam, uvec2 first) {
    const Rest rest = rests[cam.slot];
    uint awake = 0u;
    for (uint sub_tile = 0u; sub_tile < SUB_TILES; ++sub_tile) {
        const uvec2 at = first + uvec2(0u, sub_tile * SUB_TILE_ROWS);
        if (at.x < cam.width && at.y < cam.height
            && is_awake(cam, rest, load_state(cam, at.y * cam.width + at.x, STATE_REST))) {
            awake |= 1u << sub_tile;
        }
    }
    return awake;
}

// Number of the workgroup's sub-tile, in the order of `tile_order`; beyond the last one if it has none.
uint own_place(uint index) {
    if (SECOND_RUN) {
        const Camera cam = cameras[index];
        const bool is_left = gl_WorkGroupID.x < counters[2u * cam.slot + cam.frame_slot].crowded_sub_tiles;
        return is_left ? bins[crowded_of(cam) + gl_WorkGroupID.x] : 0xffffffffu;
    }
    return gl_WorkGroupID.x;
}

void leave_crowded(Camera cam, uint counter) {
    atomicAdd(counters[counter].queue_overflows, 1u);
#ifndef READS_LEVELS
    const uint entry = atomicAdd(counters[counter].crowded_sub_tiles, 1u);
    bins[crowded_of(cam) + entry] = gl_WorkGroupID.x;
#endif
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint place = own_place(index);
    const uint in_order = place / SUB_TILES;
    const uint sub_tile = place % SUB_TILES;
    const uint frame_kind = cameras[index].frame_kind;
    const bool catches_up = PIXELS_REST && frame_kind == FRAME_CATCH_UP;
    if ((frame_kind != FRAME_INTERVAL && !catches_up) || in_order >= tile_count(cameras[index])) {
        return;
    }
    const Camera cam = cameras[index];
    // A restored rig may catch up before any `ingest` has ordered its tiles.
    const uint tile_number = catches_up ? in_order : tile_order[cam.tile_base + in_order];
    corner = tile_corner(cam.blocks_x, tile_number) + uvec2(0u, sub_tile * SUB_TILE_ROWS);
    packs = false;
    uvec2 at = sub_tile_pixel();
    bool inside = at.x < cam.width && at.y < cam.height;
    if (catches_up) {
        if (!LAYERED) {
            catch_up_pixel(cam, at);
        }
        return;
    }
    if (LAYERS > 1u && motions_meet(cam) != LAYERED) {
        // The other kernel's tile.
        return;
    }
#ifdef READS_LEVELS
    const uvec4 levels_of_tile = level_words[cam.tile_base + tile_number];
    if (!has_levels(levels_of_tile)) {
        if (levels_of_tile.x == NO_LEVELS && push.level + 1u == push.passes && gl_LocalInvocationID.x == 0u) {
            atomicAdd(counters[2u * cam.slot + cam.frame_slot].without_levels, 1u);
        }
        return;
    }
#endif
    const TileBlocks tile = find_blocks(cam);
    PixelState before;
    Source s;
    if (PIXELS_REST) {
        own_awake = find_awake(cam, at - uvec2(0u, sub_tile * SUB_TILE_ROWS));
    }
    if (inside && !LOOKS_FIRST) {
        // Every tile is walked, so these loads are issued together with those of the blocks and share their latency.
        read_pixel(cam, at, before, s);
    }
#ifdef READS_LEVELS
    if (gl_LocalInvocationID.x == 0u) {
        begin_tile();
    }
    barrier();
    note_own();
    still_tile = is_still_tile(levels_of_tile);
    still_block = (levels_of_tile[tile.in_tile] & STILL_BLOCK) != 0u;
    const uint n = substeps_of_levels(levels_of_tile[tile.in_tile]);
    block_rows = rows_of_levels(levels_of_tile[tile.in_tile]);
    if (PIXELS_REST) {
        // All pixels awake are noted.
        barrier();
    }
#else
    load_activity(cam, tile);
    still_tile = is_still_tile();
    still_block = MAY_REST && is_still_block(tile);
    const uint n = substeps_of_block(cam, tile);
#endif
    uint rows = rows_of(sub_tile, 1u);
    if (skip_sub_tiles(cam, tile, sub_tile, rows)) {
        return;
    }
    if (may_rest() && rests[cam.slot].mode == REST_ALLOWED) {
        packs = awake_count <= CROSS_THREADS;
        if (packs) {
            rows = rows_of(0u, SUB_TILES);
            if (sub_tile == 0u && awake_count == 0u) {
                rest_rows(cam, rows, tile.first_block, n, true);
            }
            if (sub_tile != 0u || awake_count == 0u) {
                return;
            }
            inside = gl_LocalInvocationID.x < awake_count;
            at = sub_tile_pixel();
        } else {
            inside = ((own_awake >> sub_tile) & 1u) != 0u;
        }
    }
    if (inside && LOOKS_FIRST) {
        read_pixel(cam, at, before, s);
    }
#ifdef READS_LEVELS
    s.of_block = levels_of_tile[(at.x - corner.x) / BLOCK_PX];
#endif
    cross_sub_tile(cam, rows, tile.first_block, n, inside, sub_tile == 0u, before, s);
}
