// cross, for GPUs: see cross.glsl. The kernels of `synthesize` make the levels of synthesis `rigid` and of tiles where
// motions meet; READS_LEVELS is defined for the kernels that read them. One workgroup per sub-tile of half a tile: a small workgroup ends as soon as its own
// pixels are done, and makes place for the next. Events go into a queue as they are found.
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

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint in_order = gl_WorkGroupID.x / SUB_TILES;
    const uint sub_tile = gl_WorkGroupID.x % SUB_TILES;
    if (cameras[index].frame_kind != FRAME_INTERVAL || in_order >= tile_count(cameras[index])) {
        return;
    }
    const Camera cam = cameras[index];
    corner = tile_corner(cam.blocks_x, tile_order[cam.tile_base + in_order]) + uvec2(0u, sub_tile * SUB_TILE_ROWS);
    const uvec2 at = sub_tile_pixel();
    const bool inside = at.x < cam.width && at.y < cam.height;
    if (LAYERS > 1u && motions_meet(cam) != LAYERED) {
        // The other kernel's tile.
        return;
    }
#ifdef READS_LEVELS
    const uvec4 levels_of_tile = level_words[cam.tile_base + tile_order[cam.tile_base + in_order]];
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
    if (inside && !SKIPS_STILL_TILES) {
        // Every tile is walked, so these loads are issued together with those of the blocks and share their latency.
        read_pixel(cam, at, before, s);
    }
#ifdef READS_LEVELS
    if (gl_LocalInvocationID.x == 0u) {
        clear_queue();
    }
    barrier();
    const bool still = is_still_tile(levels_of_tile);
    const uint n = substeps_of_levels(levels_of_tile[tile.in_tile]);
#else
    load_activity(cam, tile);
    const bool still = is_still(cam);
    const uint n = substeps_of_block(cam, tile);
#endif
    if (skip_sub_tiles(cam, tile, sub_tile, rows_of(sub_tile, 1u), still)) {
        return;
    }
    if (inside && SKIPS_STILL_TILES) {
        read_pixel(cam, at, before, s);
    }
#ifdef READS_LEVELS
    s.first_level = first_level_word(levels_of_tile[tile.in_tile], at);
#endif
    cross_sub_tile(cam, sub_tile, tile.first_block, n, inside, sub_tile == 0u, before, s);
}
