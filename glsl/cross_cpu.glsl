// cross, for the software driver: see cross.glsl. A thread costs much before its first pixel, so a workgroup walks all
// sub-tiles of a tile, each a row, one after the other. Events lie in slots of their pixel.
//
// The driver silently ends all loops of a thread after 65535 rounds in all. Pixels may have thousands of events in a
// tile whose queue overflowed; so its rerun (WALKS_AGAIN) has more threads, one workgroup per sub-tile.
#include "common.glsl"
#include "cross_constants.glsl"
#include "cross_cpu_constants.glsl"
#include "random.glsl"
#include "optics.glsl"
#include "substeps.glsl"
#include "tiles.glsl"

layout(local_size_x = CROSS_THREADS, local_size_x_id = THREADS_ID) in;

#include "cross_bindings.glsl"

// Macros, not constants: a constant equal to a specialisation constant would take over its name.
#define MAY_BIN_BY_SAMPLE AT_SAMPLE
#define WALKS_SUSPEND EFFECT_SHOT
#ifndef PHYSICAL
// Two loops, so that neither runs the other's code for lanes that wait.
#define LEVELS_FIRST
#endif
// Whether a walk takes several events in a round of its loop: those of a rerun may be more than the driver has rounds for.
#define SAVES_ROUNDS WALKS_AGAIN

// Pixels that pass an interval in still light do so row by row, before the others are walked: a branch that they take in the
// walk would spare nothing.
const bool PASSES_IN_WALK = false;

#define READS_SURFACE_TEXELS
#include "frame_load_by_texel.glsl"
#include "udiv_float.glsl"

uint fast_udiv(uint x, uint divisor) {
    return float_udiv(x, divisor);
}

#include "thread_atomic.glsl"
#include "cross.glsl"
#include "event_slots.glsl"
#ifndef PHYSICAL
#include "shot_draws_cpu.glsl"
#endif

// Linear intensity of the pixel in both frames, computed once: on this driver a branch costs the same whether it is
// taken often or seldom.
float light_previous;
float light_current;

void prepare_blend(Source s) {
    light_previous = exp(s.log_previous);
    light_current = exp(s.log_current);
}

float blend_frames(Source s, float alpha) {
    return synthesize_linear(light_previous, light_current, alpha);
}

bool is_armed(PixelState before) {
    return !MAY_BE_UNARMED || (before.reference != UNARMED && before.reference != ARMING);
}

// Sub-tiles that a workgroup takes.
const uint OWN_SUB_TILES = WHOLE_TILES && !WALKS_AGAIN ? SUB_TILES : 1u;

uint place_of(uint thread) {
    return thread;
}

void leave_crowded(Camera cam, uint counter) {
    atomicAdd(counters[counter].queue_overflows, 1u);
}

// A bit for each row of the tile that has a pixel awake.
shared uint awake_rows;

void begin_awake() {
    awake_rows = 0u;
}

void note_awake(uint awake) {
    if (awake != 0u) {
        atomicOr(awake_rows, awake);
    }
}

// Bits of the rows in which this thread's pixel is awake; `first` is its pixel of the first.
uint rows_awake(Camera cam, uvec2 first) {
    const Rest rest = rests[cam.slot];
    uint rows = 0u;
    uint sub_tile = 0u;
    do {
        const uvec2 at = first + uvec2(0u, sub_tile * SUB_TILE_ROWS);
        if (at.x < cam.width && at.y < cam.height
            && is_awake(cam, rest, load_state(cam, at.y * cam.width + at.x, STATE_REST))) {
            rows |= 1u << (at.y % BLOCK_PX);
        }
        sub_tile += 1u;
    } while (sub_tile < OWN_SUB_TILES);
    return rows;
}

// Catches up this thread's pixels; `first` is that of the first sub-tile.
void catch_up_sub_tiles(Camera cam, uvec2 first) {
    uint sub_tile = 0u;
    do {
        catch_up_pixel(cam, first + uvec2(0u, sub_tile * SUB_TILE_ROWS));
        sub_tile += 1u;
    } while (sub_tile < OWN_SUB_TILES);
}

#ifdef PHYSICAL
// A bit for each of the workgroup's sub-tiles that is to be walked.
shared uint walks;

// Levels of both frames at a pixel, as they are in the planes.
ivec2 frame_levels(Camera cam, uvec2 at) {
    const Frames frames = frames_of(cam, at);
    const uint word = frame_word(cam, has_half_pel_frames(), ivec2(at));
    return ivec2(to_q24(load_plane(frames.previous + word)), to_q24(load_plane(frames.current + word)));
}

// Lets each sub-tile of a still tile pass the interval whose pixels all can; `first` is this thread's pixel of the first.
// Returns which are left, a bit for each.
uint pass_sub_tiles(Camera cam, TileBlocks tile, uint first_sub_tile, uvec2 first, uint n) {
    uint activity = 0u;
    [[unroll]] for (uint b = 0u; b < TILE_BLOCKS; ++b) {
        activity |= neighbourhood_motion[b] | own_change[b];
    }
    const bool is_still = activity == 0u;
    if (gl_LocalInvocationID.x == 0u) {
        walks = is_still ? 0u : (1u << OWN_SUB_TILES) - 1u;
    }
    barrier();
    uint sub_tile = is_still ? 0u : OWN_SUB_TILES - 1u;
    uint passed_rows = 0u;
    do {
        const uvec2 at = first + uvec2(0u, sub_tile * SUB_TILE_ROWS);
        const uint pixel = at.y * cam.width + at.x;
        const uint rows = rows_of(first_sub_tile + sub_tile, 1u);
        // An earlier attempt at this tick may have done some.
        const bool is_left = is_still && (tile.rows_done & rows) != rows;
        const bool inside = is_left && at.x < cam.width && at.y < cam.height;
        PixelState p;
        if (inside) {
            p = load_pixel(cam, pixel);
            const ivec2 levels = frame_levels(cam, at);
            if (n != 1u || !is_armed(p) || levels.x != levels.y || !pass_interval(cam, pixel, levels.x, p)) {
                atomicOr(walks, 1u << sub_tile);
            }
        }
        barrier();
        if (is_left && ((walks >> sub_tile) & 1u) == 0u) {
            passed_rows |= rows;
            if (inside) {
                store_pixel(cam, pixel, p);
            }
        }
        sub_tile += 1u;
    } while (sub_tile < OWN_SUB_TILES);
    rest_rows(cam, passed_rows, tile.first_block, n, first_sub_tile == 0u && (passed_rows & 1u) != 0u);
    return walks;
}
#endif

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint in_order = gl_WorkGroupID.x * OWN_SUB_TILES / SUB_TILES;
    const uint first_sub_tile = gl_WorkGroupID.x * OWN_SUB_TILES % SUB_TILES;
    const uint frame_kind = cameras[index].frame_kind;
    const bool catches_up = PIXELS_REST && frame_kind == FRAME_CATCH_UP;
    if ((frame_kind != FRAME_INTERVAL && !catches_up) || in_order >= tile_count(cameras[index])) {
        return;
    }
    const Camera cam = cameras[index];
    // A restored rig may catch up before any `ingest` has ordered its tiles.
    const uint tile_number = catches_up ? in_order : tile_order[cam.tile_base + in_order];
    corner = tile_corner(cam.blocks_x, tile_number) + uvec2(0u, first_sub_tile * SUB_TILE_ROWS);
    const uvec2 first = sub_tile_pixel();
    if (catches_up) {
        if (!LAYERED) {
            catch_up_sub_tiles(cam, first);
        }
        return;
    }
    if (LAYERS > 1u && motions_meet(cam) != LAYERED) {
        // The other kernel's tile.
        return;
    }
    const TileBlocks tile = find_blocks(cam);
    PixelState before;
    Source s;
    if (PIXELS_REST) {
        own_awake = rows_awake(cam, first);
    }
    if (!LOOKS_FIRST && first.x < cam.width && first.y < cam.height) {
        read_pixel(cam, first, before, s);
    }
    load_activity(cam, tile);
    still_tile = is_still_tile();
    still_block = MAY_REST && is_still_block(tile);
    if (skip_sub_tiles(cam, tile, first_sub_tile, rows_of(first_sub_tile, OWN_SUB_TILES))) {
        return;
    }
    const uint n = substeps_of_block(cam, tile);
    const bool resting = may_rest() && rests[cam.slot].mode == REST_ALLOWED;
    if (RIGID) {
        list_candidates(cam);
    }
    if (LAYERED) {
        list_layers(cam);
    }
    uint done = 0u;
#ifdef PHYSICAL
    uint left = 0xffffffffu;
    if (PASSES_STILL && !WALKS_AGAIN) {
        left = pass_sub_tiles(cam, tile, first_sub_tile, first, n);
        if (left == 0u) {
            return;
        }
        done = uint(findLSB(left));
        // Ends the search for the next one.
        left |= 1u << OWN_SUB_TILES;
    }
#endif
    const uint first_y = corner.y;
    do {
        const uint sub_tile = first_sub_tile + done;
        if (done != 0u) {
            corner.y = first_y + done * SUB_TILE_ROWS;
            barrier();
            if (gl_LocalInvocationID.x == 0u) {
                begin_queue();
            }
            barrier();
        }
        const uint rows = rows_of(sub_tile, 1u);
        const bool counts = sub_tile == 0u && (tile.rows_done & 1u) == 0u;
        if (resting && (awake_rows & rows) == 0u) {
            rest_rows(cam, rows, tile.first_block, n, counts);
        } else if (OWN_SUB_TILES == 1u || (tile.rows_done & rows) == 0u) {
            const uvec2 at = sub_tile_pixel();
            bool in_image = at.x < cam.width && at.y < cam.height;
            if (PIXELS_REST) {
                in_image = in_image && (!resting || ((own_awake >> (at.y % BLOCK_PX)) & 1u) != 0u);
            }
            if ((LOOKS_FIRST || done != 0u) && in_image) {
                read_pixel(cam, at, before, s);
            }
            // A rerun's sub-tiles are larger than those of the first run, so some of their rows may be done.
            const bool row_done = WALKS_AGAIN && ((tile.rows_done >> (at.y % BLOCK_PX)) & 1u) != 0u;
            cross_sub_tile(cam, rows, tile.first_block, n, in_image && !row_done, counts, before, s);
        }
        done += 1u;
#ifdef PHYSICAL
        done += uint(findLSB(left >> done));
#endif
    } while (done < OWN_SUB_TILES);
}
