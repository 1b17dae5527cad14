// event_ids, first part: for each block the pixels whose surfaces may show in it, for the second part.
//
// A workgroup for each tile; y over cameras. Reads what `ingest` has noted of the last tick's frame. Writes for each block
// EVENT_IDS_LIST_WORDS words at the address in its camera's slice: their number, then the pixels, with PASSING_KEY for those
// of key frame 1.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "slices.glsl"
#include "tiles.glsl"

layout(local_size_x = INGEST_THREADS) in;

#define RIGID true
#define LIST_BLOCKS TILE_BLOCKS

#include "event_ids_bindings.glsl"
#include "surfaces.glsl"
#include "tile_blocks.glsl"
#include "candidates.glsl"
#include "candidate_lists.glsl"

void main() {
    const Slice slice = slice_of_workgroup();
    FISHEYE = slice.fisheye != 0u;
    const Camera cam = cameras[slice.row];
    if (slice.events == 0u || gl_WorkGroupID.x >= tile_count(cam)) {
        return;
    }
    corner = tile_corner(cam.blocks_x, gl_WorkGroupID.x);
    list_candidates(cam);
    Words lists = Words(slice.lists);
    for (uint word = gl_LocalInvocationID.x; word < TILE_BLOCKS * EVENT_IDS_LIST_WORDS; word += gl_WorkGroupSize.x) {
        const uint b = word / EVENT_IDS_LIST_WORDS;
        const uint place = word % EVENT_IDS_LIST_WORDS;
        if (has_block(cam, b) && place <= listed_count[b]) {
            const uvec2 block = tile_block(b);
            const uint to = (block.y * cam.blocks_x + block.x) * EVENT_IDS_LIST_WORDS + place;
            lists.v[to] = place == 0u ? listed_count[b] : chosen_pixel[b * BLOCK_CANDIDATES + place - 1u];
        }
    }
}
