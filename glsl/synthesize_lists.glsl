// synthesize, first part: for each tile what its pixels may show, and room in `levels`. For GPUs; see levels.glsl.
//
// A thread for each pixel of a tile. x over tiles, y over cameras. A tick has passes, one after the other, until every
// tile has had room; push.level counts them.
//
// Reads `blocks`, and surfaces, poses and what passes blocks, or vectors and where they meet. Writes `level_words` and
// `level_entries`, and of `levels` first rows and lists. The second part and `cross` read them after barriers. Which rows
// a tile gets is up to the order of atomics, and no level depends on it.
#include "common.glsl"
#include "synthesize_constants.glsl"
#include "optics.glsl"
#include "substeps.glsl"
#include "tiles.glsl"

layout(local_size_x = INGEST_THREADS) in;

#include "synthesize_bindings.glsl"
BUFFER(writeonly, SLOT_LEVELS, uint, levels);
BUFFER(, SLOT_LEVEL_WORDS, uvec4, level_words);
BUFFER(, SLOT_LEVEL_ENTRIES, uvec4, level_entries);

const bool FOLLOWS_MOTION = SYNTHESIS_FOLLOWS_MOTION(SYNTHESIS);
#define LOOKS_FIRST SKIPS_STILL_TILES
#define LIST_BLOCKS TILE_BLOCKS

#include "frame_load_by_address.glsl"
#include "synthesize.glsl"
#include "surfaces.glsl"
#include "block_pairs.glsl"
#include "tile_activity.glsl"
#include "levels.glsl"
#include "paths.glsl"
#include "candidates.glsl"
#include "candidate_lists.glsl"
#include "rigid.glsl"
#include "unoccluded.glsl"
#include "layers.glsl"
#include "layer_lists.glsl"

uint place_of(uint thread) {
    return thread;
}

void begin_tile() {}

void note_own() {}

// Sub-steps of each block of the tile, 0 beyond the image; STILL_BLOCK of those that are still, and of those beyond it;
// the word of each in `level_words`; the pass's first entry of the tile; whether the tile has room.
shared uint block_substeps[TILE_BLOCKS];
shared uint block_stillness[TILE_BLOCKS];
shared uint block_words[TILE_BLOCKS];
// A bit for each pixel of a block whose levels are made by the second part.
shared uint block_pixels[2u * TILE_BLOCKS];
shared uint first_entry;
shared bool has_room;

bool takes_rows(uint b) {
    return (block_pixels[2u * b] | block_pixels[2u * b + 1u]) != 0u;
}

uint rows_of_block(uint b) {
    return takes_rows(b) ? block_substeps[b] + 1u : 0u;
}

// Sub-steps of an entry of a block.
uint substeps_of_entry(uint b) {
    return entry_substeps(uint(bitCount(block_pixels[2u * b]) + bitCount(block_pixels[2u * b + 1u])));
}

uint entries_of_block(uint b) {
    const uint each = substeps_of_entry(b);
    return takes_rows(b) ? (block_substeps[b] - 1u + each - 1u) / each : 0u;
}

// Takes room for the tile; called by one thread.
void take_room() {
    uint rows = 0u;
    uint entries = 0u;
    for (uint b = 0u; b < TILE_BLOCKS; ++b) {
        rows += rows_of_block(b);
        entries += entries_of_block(b);
    }
    uint row = rows == 0u ? 0u : atomicAdd(level_entries[push.level].y, rows);
    has_room = row + rows <= uint(levels.length()) / LEVEL_ROW_WORDS;
    first_entry = rows == 0u || !has_room ? 0u : atomicAdd(level_entries[push.level].x, entries);
    for (uint b = 0u; b < TILE_BLOCKS; ++b) {
        const uint own_row = takes_rows(b) ? row : NO_ROW;
        block_words[b] = has_room ? block_stillness[b] | (own_row << ROW_SHIFT) | block_substeps[b] : NO_LEVELS;
        row += rows_of_block(b);
    }
}

// Writes the entries of the tile's blocks.
void write_entries(uint index, Camera cam) {
    const uint most = (MAX_SUBSTEPS - 1u + LEAST_ENTRY_SUBSTEPS - 1u) / LEAST_ENTRY_SUBSTEPS;
    for (uint item = gl_LocalInvocationID.x; item < TILE_BLOCKS * most; item += gl_WorkGroupSize.x) {
        const uint b = item / most;
        uint entry = MOST_PASSES + first_entry + item % most;
        for (uint before = 0u; before < b; ++before) {
            entry += entries_of_block(before);
        }
        if (item % most < entries_of_block(b)) {
            const uvec2 block = tile_block(b);
            const uint first = 1u + (item % most) * substeps_of_entry(b);
            level_entries[entry] = uvec4(index, block.y * cam.blocks_x + block.x, block_words[b], first);
        }
    }
}

// Makes the lists of the tile's blocks. Called by the whole workgroup; ends with a barrier.
void make_lists(Camera cam) {
    if (RIGID) {
        list_candidates(cam);
    } else {
        list_layers(cam);
    }
}

// A word of the list of the tile's `b`th block: the number of its members, then what each is; at last the bits of the
// pixels that need it.
uint list_word(uint b, uint place) {
    if (place >= LIST_PIXELS_WORD) {
        return place < LIST_PIXELS_WORD + 2u ? block_pixels[2u * b + place - LIST_PIXELS_WORD] : 0u;
    }
    if (RIGID) {
        const uint member = place - 1u;
        return place == 0u ? listed_count[b]
            : member < listed_count[b] ? chosen_pixel[b * BLOCK_CANDIDATES + member] : 0u;
    }
    const uint member = (place - 1u) / LAYER_WORDS;
    if (place == 0u) {
        return layer_count[b];
    } else if (member >= layer_count[b]) {
        return 0u;
    }
    const uint layer = listed_layer[b * BLOCK_LAYERS + member];
    const uint word = (place - 1u) % LAYER_WORDS;
    const float value = word < 4u ? found_place[layer][word]
        : word < 8u               ? found_slopes[layer][word - 4u]
                                  : found_before[layer][word - 8u];
    return floatBitsToUint(value);
}

// What a pixel may show, as its block's first row has it.
uint list_of_pixel(Camera cam, uvec2 at, uint in_tile) {
    if (!RIGID) {
        return layers_of_pixel(cam, at, in_tile);
    }
    const Geometry geo = geometries[cam.slot];
    const RigidPixel p = read_rigid_pixel(cam, geo, at, in_tile);
    return is_unoccluded(cam, geo, vec2(at), p, in_tile) ? UNOCCLUDED : p.order;
}

// Writes the rows of `levels` that hold the lists of the tile's blocks, for the second part.
void write_list_rows() {
    const uint lane = gl_LocalInvocationID.x;
    const uint b = lane / LEVEL_ROW_WORDS;
    const uint place = lane % LEVEL_ROW_WORDS;
    if (takes_rows(b)) {
        const uint row = row_of_levels(block_words[b]) + block_substeps[b];
        levels[row * LEVEL_ROW_WORDS + place] = list_word(b, place);
    }
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    const uint number = gl_WorkGroupID.x;
    if (cameras[index].frame_kind != FRAME_INTERVAL || number >= tile_count(cameras[index])) {
        return;
    }
    const Camera cam = cameras[index];
    corner = tile_corner(cam.blocks_x, number);
    if (LAYERED && !motions_meet(cam)) {
        return;
    }
    const uint lane = gl_LocalInvocationID.x;
    const uint tile_number = cam.tile_base + number;
    const TileBlocks tile = find_blocks(cam);
    const uint every_row = (1u << BLOCK_PX) - 1u;
    if ((tile.rows_done & every_row) == every_row) {
        return;
    }
    if (push.level > 0u && level_words[tile_number].x != NO_LEVELS) {
        // Its events did not fit.
        barrier();
        if (lane == 0u) {
            level_words[tile_number] = uvec4(HAD_LEVELS);
        }
        return;
    }
    load_activity(cam, tile);
    if (is_still_tile() && skips_still(cam)) {
        if (lane == 0u) {
            level_words[tile_number] = uvec4(STILL_BLOCK | 1u);
        }
        return;
    }
    if (lane < TILE_WIDTH_PX && lane % BLOCK_PX == 0u) {
        const bool in_image = has_block(cam, tile.in_tile);
        block_substeps[tile.in_tile] = in_image ? substeps_of_block(cam, tile) : 1u;
        block_stillness[tile.in_tile] = !in_image || is_still_block(tile) ? STILL_BLOCK : 0u;
    }
    if (lane < 2u * TILE_BLOCKS) {
        block_pixels[lane] = 0u;
    }
    barrier();
    bool any_levels = false;
    for (uint b = 0u; b < TILE_BLOCKS; ++b) {
        any_levels = any_levels || block_substeps[b] > 1u;
    }
    const uvec2 at = sub_tile_pixel();
    const bool has_list = at.x < cam.width && at.y < cam.height && block_substeps[tile.in_tile] > 1u;
    const uint place = place_in_row(at);
    uint list = 0u;
    if (any_levels) {
        make_lists(cam);
        if (has_list) {
            list = list_of_pixel(cam, at, tile.in_tile);
            if (list != (RIGID ? UNOCCLUDED : 0u)) {
                atomicOr(block_pixels[2u * tile.in_tile + place / 32u], 1u << (place % 32u));
            }
        }
        barrier();
    }
    if (lane == 0u) {
        take_room();
        level_words[tile_number] = uvec4(block_words[0], block_words[1], block_words[2], block_words[3]);
    }
    barrier();
    if (!has_room || !any_levels) {
        return;
    }
    write_entries(index, cam);
    write_list_rows();
    if (has_list && takes_rows(tile.in_tile)) {
        levels[first_level_word(block_words[tile.in_tile], at)] = list;
    }
}
