// The surfaces that represent each block, and the blocks that these pass during the interval, for synthesis `rigid`.
// Part of ingest.glsl; needs ingest_surfaces.glsl.

#include "passed_blocks.glsl"

// For each block: the pixels that represent it, a bit each; those in order, and the word before them in
// `representatives`; the largest motion of them, pixels.
shared uint representing[2u * TILE_BLOCKS];
shared uint represented_by[TILE_BLOCKS * BLOCK_SURFACES];
shared uint own_head[TILE_BLOCKS];
shared uint own_motion[TILE_BLOCKS];

// The least and the largest instance of each block, and the bits of the least and the largest depth of its pixels with a
// surface. For a block of one instance: its first pixels of these depths.
shared uint least_instance[TILE_BLOCKS];
shared uint largest_instance[TILE_BLOCKS];
shared uint least_depth[TILE_BLOCKS];
shared uint largest_depth[TILE_BLOCKS];
shared uint nearest_pixel_of[TILE_BLOCKS];
shared uint farthest_pixel_of[TILE_BLOCKS];
const uint NO_PIXEL = 0xffffffffu;

// The representatives of the tile's blocks in both key frames, in any order, and their number: the pixel; the entry in
// `passing`; the block in the tile, with HANDS_ON if its surfaces are candidates of the blocks that they pass; the length of
// its way, pixels; and the bend of its way, pixels (see `measure_way`).
const uint HANDED = 2u * TILE_BLOCKS * BLOCK_SURFACES;
const uint HANDS_ON = 0x80000000u;
shared uint handed_count;
shared uint handed_pixel[HANDED];
shared uint handed_entry[HANDED];
shared uint handed_block[HANDED];
shared float handed_motion[HANDED];
shared float handed_bend[HANDED];

// At each knot: where a representative is, and the first and last block that it passes, two halves each.
shared vec2 knot_place[HANDED * KNOTS];
shared uvec2 knot_blocks[HANDED * KNOTS];

// The square of a block and what it reaches is narrower than two blocks: it passes three in a row at most.
const uint PASSED_IN_ROW = 3u;

// Pixel `number` of a block of the tile.
ivec2 block_pixel(uint block, uint number) {
    return tile_origin + ivec2(block * BLOCK_PX + number % BLOCK_PX, number / BLOCK_PX);
}

bool in_image(Camera cam, ivec2 at) {
    return at.x < int(cam.width) && at.y < int(cam.height);
}

// Whether a block of the tile lies in the image.
bool block_in_image(Camera cam, uint in_tile) {
    return uint(tile_origin.x) / BLOCK_PX + in_tile < cam.blocks_x;
}

// The number of a block of the tile in the camera.
uint block_number(Camera cam, uint in_tile) {
    const uvec2 first = uvec2(tile_origin) / BLOCK_PX;
    return first.y * cam.blocks_x + first.x + in_tile;
}

// The first word of a block of the tile in `representatives` of key frame `key`.
uint own_word(Camera cam, Geometry geo, uint key, uint in_tile) {
    return representative_word(cam, geo, key, block_number(cam, in_tile));
}

// Whether all pixels of a block show one instance.
bool is_uniform(uint block) {
    return least_instance[block] == largest_instance[block];
}

// Notes what the pixels of a block have in common.
void note_extremes(Camera cam, uint number) {
    const uint block = number / (BLOCK_PX * BLOCK_PX);
    const ivec2 at = block_pixel(block, number % (BLOCK_PX * BLOCK_PX));
    if (!in_image(cam, at)) {
        return;
    }
    const uint instance = cached_instance[surface_index(at)];
    atomicMin(least_instance[block], instance);
    atomicMax(largest_instance[block], instance);
    if (instance != NO_INSTANCE) {
        // Depths are not negative, so their bits are in their order.
        const uint depth = floatBitsToUint(cached_depth[surface_index(at)]);
        atomicMin(least_depth[block], depth);
        atomicMax(largest_depth[block], depth);
    }
}

// Finds the representatives of a block of one instance.
void find_extremes(Camera cam, uint number) {
    const uint block = number / (BLOCK_PX * BLOCK_PX);
    const uint own = number % (BLOCK_PX * BLOCK_PX);
    const ivec2 at = block_pixel(block, own);
    if (!is_uniform(block) || !in_image(cam, at)) {
        return;
    }
    const uint depth = floatBitsToUint(cached_depth[surface_index(at)]);
    if (depth == least_depth[block]) {
        atomicMin(nearest_pixel_of[block], own);
    }
    if (depth == largest_depth[block]) {
        atomicMin(farthest_pixel_of[block], own);
    }
}

// Marks a pixel of a block of more than one instance if it is the nearest or the farthest of its instance there; of
// equals the first.
void mark_representative(Camera cam, uint number) {
    const uint block = number / (BLOCK_PX * BLOCK_PX);
    const uint own = number % (BLOCK_PX * BLOCK_PX);
    const ivec2 at = block_pixel(block, own);
    if (is_uniform(block) || !in_image(cam, at)) {
        return;
    }
    const uint instance = cached_instance[surface_index(at)];
    // The depth as it was given: rounding makes inverse depths equal that are not.
    const float depth = cached_depth[surface_index(at)];
    if (instance == NO_INSTANCE) {
        return;
    }
    bool nearest = true;
    bool farthest = true;
    uint other = 0u;
    do {
        const ivec2 there = block_pixel(block, other);
        const uint cached = surface_index(there);
        if (in_image(cam, there) && cached_instance[cached] == instance) {
            const float depth_there = cached_depth[cached];
            const bool wins_ties = other < own;
            nearest = nearest && !(depth_there < depth || (depth_there == depth && wins_ties));
            farthest = farthest && !(depth_there > depth || (depth_there == depth && wins_ties));
        }
        other += 1u;
    } while (other < BLOCK_PX * BLOCK_PX && (nearest || farthest));
    if (nearest || farthest) {
        atomicOr(representing[2u * block + own / 32u], 1u << (own % 32u));
    }
}

// Writes a representative to its place in its block's list: from near to far, and of equals the first.
void list_representative(Camera cam, Geometry geo, uint number) {
    const uint block = number / (BLOCK_PX * BLOCK_PX);
    const uint own = number % (BLOCK_PX * BLOCK_PX);
    if (((representing[2u * block + own / 32u] >> (own % 32u)) & 1u) == 0u) {
        return;
    }
    const ivec2 at = block_pixel(block, own);
    const float depth = cached_depth[surface_index(at)];
    uint place = 0u;
    for (uint half_block = 0u; half_block < 2u; ++half_block) {
        uint bits = representing[2u * block + half_block];
        while (bits != 0u) {
            const uint other = 32u * half_block + uint(findLSB(bits));
            bits &= bits - 1u;
            const float there = cached_depth[surface_index(block_pixel(block, other))];
            place += uint(there < depth || (there == depth && other < own));
        }
    }
    if (place < BLOCK_SURFACES) {
        const uint pixel = uint(at.y) * cam.width + uint(at.x);
        const uint word = own_word(cam, geo, 1u, block);
        representatives[word + 1u + place] = pixel;
        represented_by[block * BLOCK_SURFACES + place] = pixel;
    }
}

// The first word in `representatives` of a block whose representatives were found.
uint found_head(uint block) {
    const uint count = uint(bitCount(representing[2u * block]) + bitCount(representing[2u * block + 1u]));
    return min(count, BLOCK_SURFACES) | (((silhouettes >> block) & 1u) != 0u ? HAS_SILHOUETTE : 0u);
}

const float NOWHERE = 2.0 * FARTHEST_PX;

// Notes the representatives of both key frames, or only those that are handed on. By one thread for each place of both
// lists of each block.
void hand_on(Camera cam, Geometry geo, uint number, bool only_handed_on) {
    const uint key = number / (TILE_BLOCKS * BLOCK_SURFACES);
    const uint in_tile = (number / BLOCK_SURFACES) % TILE_BLOCKS;
    const uint place = number % BLOCK_SURFACES;
    if (!block_in_image(cam, in_tile)) {
        return;
    }
    uint head = own_head[in_tile];
    uint pixel = represented_by[in_tile * BLOCK_SURFACES + place];
    if (key == 0u) {
        const uint word = own_word(cam, geo, 0u, in_tile);
        head = representatives[word];
        pixel = representatives[word + 1u + place];
    }
    const bool hands_on = (head & HAS_SILHOUETTE) != 0u;
    if (place < (head & ~HAS_SILHOUETTE) && (hands_on || !only_handed_on)) {
        const uint entry = atomicAdd(handed_count, 1u);
        handed_pixel[entry] = pixel;
        handed_entry[entry] = passing_entry(key, block_number(cam, in_tile), place);
        handed_block[entry] = in_tile | (hands_on ? HANDS_ON : 0u);
    }
}

// Finds where a representative is at a knot, and which blocks it passes there.
void follow_to_knot(Camera cam, Geometry geo, uint number) {
    const uint entry = number / KNOTS;
    const uint knot = number % KNOTS;
    const uint pixel = handed_pixel[entry];
    const bool in_start = (handed_entry[entry] & PASSING_KEY) == 0u;
    const ivec2 at = ivec2(pixel % cam.width, pixel / cam.width);
    uint instance;
    float inverse_depth;
    bool seen = true;
    if (in_start) {
        const uvec2 shown = load_surface(surface_base(cam, geo, 0u), cam, at);
        instance = instance_of(shown);
        inverse_depth = inverse_depth_of(shown);
        // Its poses may have been taken away.
        seen = parallax_of(geo, instance) != 0.0;
    } else {
        instance = cached_instance[surface_index(at)];
        inverse_depth = cached_inverse_depth[surface_index(at)];
    }
    vec2 place = vec2(at);
    if (instance_moves(geo, instance)) {
        vec3 point = ray_of(geo, vec2(at));
        if (!in_start) {
            point = moved(inverse_of(pose_between_keys(geo, instance)), point, inverse_depth);
        }
        place = project(geo, moved(inverse_of(pose_at_knot(geo, instance, knot)), point, inverse_depth), seen);
    }
    seen = seen && is_somewhere(place);
    const ivec2 block = tile_origin / int(BLOCK_PX) + ivec2(handed_block[entry] & ~HANDS_ON, 0);
    const ivec4 blocks_passed = seen ? passed_blocks(cam, block, place - vec2(at)) : ivec4(0, 0, -1, -1);
    const bool passes_any = all(lessThanEqual(blocks_passed.xy, blocks_passed.zw));
    knot_place[number] = seen ? place : vec2(NOWHERE);
    knot_blocks[number] = passes_any
        ? uvec2(blocks_passed.x | blocks_passed.y << 16, blocks_passed.z | blocks_passed.w << 16)
        : uvec2(0xffffffffu, 0u);
}

// Adds up the way of a representative from knot to knot, and finds where it bends most.
void measure_way(uint entry) {
    float motion_px = 0.0;
    float bend_px = 0.0;
    vec2 before = vec2(NOWHERE);
    vec2 place = knot_place[entry * KNOTS];
    for (uint knot = 1u; knot < KNOTS; ++knot) {
        const vec2 next = knot_place[entry * KNOTS + knot];
        if (place.x < NOWHERE && next.x < NOWHERE) {
            motion_px += length(next - place);
            bend_px = max(bend_px, before.x < NOWHERE ? length(before - 2.0 * place + next) : 0.0);
        }
        before = place;
        place = next;
    }
    handed_motion[entry] = motion_px < REST_PX ? 0.0 : motion_px;
    handed_bend[entry] = bend_px * float((KNOTS - 1u) * (KNOTS - 1u));
    atomicMax(own_motion[handed_block[entry] & ~HANDS_ON], floatBitsToUint(handed_motion[entry]));
}

bool passes_at(uint entry, uint knot, uvec2 block) {
    const uvec2 passed = knot_blocks[entry * KNOTS + knot];
    const uvec2 first = uvec2(passed.x & 0xffffu, passed.x >> 16);
    const uvec2 last = uvec2(passed.y & 0xffffu, passed.y >> 16);
    return all(lessThanEqual(first, block)) && all(greaterThanEqual(last, block));
}

// Tells a block that a representative passes it.
void tell_block(Camera cam, Geometry geo, uint entry, uvec2 block) {
    const uint passed_block = block.y * cam.blocks_x + block.x;
    const uint head = passing_head(cam, geo, passed_block);
    atomicMax(passing[head + 1u], floatBitsToUint(handed_motion[entry]));
    if (SUBSTEPS_BY_ERROR) {
        atomicMax(passing[head + 2u], floatBitsToUint(handed_bend[entry]));
    }
    if ((handed_block[entry] & HANDS_ON) != 0u) {
        const uint place = atomicAdd(passing[head], 1u);
        if (place < PASSING_ENTRIES) {
            passing[passing_entries(cam, geo, passed_block) + place] = handed_entry[entry];
        }
    }
}

// Tells one of the blocks that a representative passes at a knot, unless it passed that at an earlier one.
void tell_passed(Camera cam, Geometry geo, uint number) {
    const uint entry = number / (KNOTS * PASSED_IN_ROW * PASSED_IN_ROW);
    const uint knot = number / (PASSED_IN_ROW * PASSED_IN_ROW) % KNOTS;
    const uint beside = number % (PASSED_IN_ROW * PASSED_IN_ROW);
    const uvec2 passed = knot_blocks[entry * KNOTS + knot];
    if (knot != 0u && passed == knot_blocks[entry * KNOTS + knot - 1u]) {
        return;
    }
    const uint first = passed.x;
    const uvec2 block = uvec2(first & 0xffffu, first >> 16) + uvec2(beside % PASSED_IN_ROW, beside / PASSED_IN_ROW);
    bool tells = passes_at(entry, knot, block);
    uint before = 0u;
    while (before < knot && tells) {
        tells = !passes_at(entry, before, block);
        before += 1u;
    }
    if (tells) {
        tell_block(cam, geo, entry, block);
    }
}

// Where a representative goes from a knot to the next.
struct Step {
    ivec2 block;
    vec2 shift_a;
    vec2 shift_b;
    // Whether it is seen at both.
    bool seen;
};

Step step_from(Camera cam, uint entry, uint knot) {
    const vec2 at = vec2(handed_pixel[entry] % cam.width, handed_pixel[entry] / cam.width);
    const ivec2 block = tile_origin / int(BLOCK_PX) + ivec2(handed_block[entry] & ~HANDS_ON, 0);
    const vec2 a = knot_place[entry * KNOTS + knot];
    const vec2 b = knot_place[entry * KNOTS + knot + 1u];
    return Step(block, a - at, b - at, a.x < NOWHERE && b.x < NOWHERE);
}

// Whether a representative passes a block at a knot, or between two knots before `knot`.
bool is_told(Camera cam, uint entry, uint knot, uvec2 block) {
    bool told = false;
    for (uint other = 0u; other < KNOTS && !told; ++other) {
        told = passes_at(entry, other, block);
    }
    for (uint before = 0u; before < knot && !told; ++before) {
        const Step way = step_from(cam, entry, before);
        if (way.seen) {
            const ivec2 columns = columns_between(cam, way.block, way.shift_a, way.shift_b, int(block.y));
            told = columns.x <= int(block.x) && int(block.x) <= columns.y;
        }
    }
    return told;
}

// Tells the blocks that a representative passes between a knot and the next, and nowhere before.
void tell_passed_between(Camera cam, Geometry geo, uint number) {
    const uint entry = number / (KNOTS - 1u);
    const uint knot = number % (KNOTS - 1u);
    const Step way = step_from(cam, entry, knot);
    if (!way.seen) {
        return;
    }
    const ivec2 rows = rows_between(cam, way.block, way.shift_a, way.shift_b);
    for (int row = rows.x; row <= rows.y; ++row) {
        const ivec2 columns = columns_between(cam, way.block, way.shift_a, way.shift_b, row);
        for (int column = columns.x; column <= columns.y; ++column) {
            const uvec2 block = uvec2(column, row);
            if (!is_told(cam, entry, knot, block)) {
                tell_block(cam, geo, entry, block);
            }
        }
    }
}

// Finds and writes the representatives of the tile's blocks. Called by the whole workgroup.
void find_representatives(Camera cam, Geometry geo) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < TILE_BLOCKS) {
        representing[2u * lane] = 0u;
        representing[2u * lane + 1u] = 0u;
        least_instance[lane] = NO_INSTANCE;
        largest_instance[lane] = 0u;
        least_depth[lane] = NO_PIXEL;
        largest_depth[lane] = 0u;
        nearest_pixel_of[lane] = NO_PIXEL;
        farthest_pixel_of[lane] = NO_PIXEL;
    }
    barrier();
    for (uint number = lane; number < TILE_ANCHORS; number += gl_WorkGroupSize.x) {
        note_extremes(cam, number);
    }
    barrier();
    for (uint number = lane; number < TILE_ANCHORS; number += gl_WorkGroupSize.x) {
        find_extremes(cam, number);
        mark_representative(cam, number);
    }
    barrier();
    if (lane < TILE_BLOCKS && is_uniform(lane) && least_instance[lane] != NO_INSTANCE) {
        representing[2u * lane + nearest_pixel_of[lane] / 32u] |= 1u << (nearest_pixel_of[lane] % 32u);
        representing[2u * lane + farthest_pixel_of[lane] / 32u] |= 1u << (farthest_pixel_of[lane] % 32u);
    }
    barrier();
    for (uint number = lane; number < TILE_ANCHORS; number += gl_WorkGroupSize.x) {
        list_representative(cam, geo, number);
    }
    if (lane < TILE_BLOCKS) {
        own_head[lane] = found_head(lane);
        if (block_in_image(cam, lane)) {
            representatives[own_word(cam, geo, 1u, lane)] = own_head[lane];
        }
    }
}

// Takes over the representatives of the frame before, with whether blocks have silhouettes.
void keep_representatives(Camera cam, Geometry geo) {
    for (uint number = gl_LocalInvocationID.x; number < TILE_BLOCKS * (1u + BLOCK_SURFACES);
         number += gl_WorkGroupSize.x) {
        const uint in_tile = number % TILE_BLOCKS;
        const uint word = number / TILE_BLOCKS;
        if (block_in_image(cam, in_tile)) {
            const uint kept = representatives[own_word(cam, geo, 0u, in_tile) + word];
            representatives[own_word(cam, geo, 1u, in_tile) + word] = kept;
            if (word == 0u) {
                own_head[in_tile] = kept;
            } else {
                represented_by[in_tile * BLOCK_SURFACES + word - 1u] = kept;
            }
        }
    }
}

// Writes `representatives` and `passing` of the tile's blocks. If `still`, nothing has moved and their surfaces are those of the frame before.
// Called by the whole workgroup.
void write_passing(Camera cam, Geometry geo, bool still) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < TILE_BLOCKS) {
        own_motion[lane] = 0u;
    }
    if (lane == 0u) {
        handed_count = 0u;
    }
    if (still) {
        keep_representatives(cam, geo);
    } else {
        find_representatives(cam, geo);
    }
    if (lane < TILE_BLOCKS && block_in_image(cam, lane)) {
        // The heads of the next tick.
        const uint head = geo.passing_base
            + ((1u - cam.frame_slot) * cam.blocks + block_number(cam, lane)) * PASSING_HEAD_WORDS;
        passing[head] = 0u;
        passing[head + 1u] = 0u;
        passing[head + 2u] = 0u;
    }
    barrier();
    if (is_first(cam)) {
        return;
    }
    for (uint number = lane; number < HANDED; number += gl_WorkGroupSize.x) {
        hand_on(cam, geo, number, still);
    }
    barrier();
    const uint handed = handed_count;
    for (uint number = lane; number < handed * KNOTS; number += gl_WorkGroupSize.x) {
        follow_to_knot(cam, geo, number);
    }
    barrier();
    for (uint entry = lane; entry < handed; entry += gl_WorkGroupSize.x) {
        measure_way(entry);
    }
    barrier();
    const uint told = handed * KNOTS * PASSED_IN_ROW * PASSED_IN_ROW;
    for (uint number = lane; number < told; number += gl_WorkGroupSize.x) {
        tell_passed(cam, geo, number);
    }
    for (uint number = lane; number < handed * (KNOTS - 1u); number += gl_WorkGroupSize.x) {
        tell_passed_between(cam, geo, number);
    }
}

// Writes the surfaces of the tile's pixels and the lists of its blocks. Called by the whole workgroup, after a barrier.
void write_surfaces(Camera cam, Geometry geo) {
    const bool still = any_change == 0u;
    if (still) {
        keep_surfaces(cam, geo);
    } else {
        find_surfaces(cam, geo);
    }
    write_passing(cam, geo, still);
}
