// The making of the lists of candidates of a tile's blocks, for synthesis `rigid`: from what passes each block. Twin of
// the oracle's `candidates`. Needs candidates.glsl, tile_activity.glsl, and the buffers `representatives` and `passing`.

#include "passed_blocks.glsl"

// What passes: an entry of `passing`, its instance (NO_INSTANCE if it is left out), and its inverse depth along the ray of
// the block's centre in both key frames. Of all blocks of the tile or, where they are too many, of one.
const uint PASSERS = RIGID ? 3u * PASSING_ENTRIES : 1u;
shared uint passer_entry[PASSERS];
shared uint passer_instance[PASSERS];
shared vec2 passer_depths[PASSERS];
shared uint passer_count[TILE_BLOCKS];

// The chosen ones of each block, likewise; and the first entry of each block that is left, in turns.
shared uint chosen_pixel[LISTED];
shared uint chosen_instance[LISTED];
shared vec2 chosen_depths[LISTED];
shared uint first_left[2u * TILE_BLOCKS];
const uint NONE_LEFT = 0xffffffffu;

vec2 block_centre(uvec2 block) {
    return vec2(block * BLOCK_PX) + 0.5 * float(BLOCK_PX - 1u);
}

// The pixel that an entry of `passing` names.
uint pixel_of_entry(Camera cam, Geometry geo, uint entry) {
    return representatives[representative_word(cam, geo, entry >> 31, 0u) + (entry & ~PASSING_KEY)];
}

// Notes an entry of `passing` for a block.
void note_passer(Camera cam, Geometry geo, uint passer, uint entry, uvec2 block) {
    const uint key = entry >> 31;
    const uint pixel = pixel_of_entry(cam, geo, entry);
    const ivec2 at = ivec2(pixel % cam.width, pixel / cam.width);
    const vec2 centre = block_centre(block);
    bool seen = lens_shows(geo, centre);
    const Surface surface = surface_of_pixel(cam, geo, key, at, seen);
    passer_entry[passer] = entry;
    passer_instance[passer] = seen ? surface.instance : NO_INSTANCE;
    passer_depths[passer] = seen ? depths_along(surface.planes, ray_of(geo, centre)) : vec2(0.0);
}

// Leaves out what is one with a chosen one of its block.
void leave_out(Geometry geo, uint passer, uint chosen) {
    const uint instance = passer_instance[passer];
    if (instance == chosen_instance[chosen]
        && are_one(chosen_depths[chosen], passer_depths[passer], parallax_of(geo, instance))) {
        passer_instance[passer] = NO_INSTANCE;
    }
}

// Chooses from what passes until the lists are full: the first that is left of each block, which leaves out what is one
// with it, and again. Of `passers`, `per_block` are of each block from `first_block` on. Called by the whole workgroup;
// begins with what others have noted, ends with a barrier.
void choose_passers(Camera cam, Geometry geo, uint first_block, uint per_block, uint passers) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < 2u * TILE_BLOCKS) {
        first_left[lane] = NONE_LEFT;
    }
    barrier();
    for (uint passer = lane; passer < passers; passer += gl_WorkGroupSize.x) {
        const uint b = first_block + passer / per_block;
        for (uint chosen = 0u; chosen < listed_count[b] && passer_instance[passer] != NO_INSTANCE; ++chosen) {
            leave_out(geo, passer, b * BLOCK_CANDIDATES + chosen);
        }
    }
    uint turn = 0u;
    bool any_left = true;
    do {
        const uint turns = TILE_BLOCKS * (turn & 1u);
        for (uint passer = lane; passer < passers; passer += gl_WorkGroupSize.x) {
            if (passer_instance[passer] != NO_INSTANCE) {
                atomicMin(first_left[turns + first_block + passer / per_block], passer_entry[passer]);
            }
        }
        barrier();
        any_left = false;
        for (uint b = 0u; b < TILE_BLOCKS; ++b) {
            any_left = any_left || (first_left[turns + b] != NONE_LEFT && listed_count[b] < BLOCK_CANDIDATES);
        }
        barrier();
        if (lane < TILE_BLOCKS) {
            first_left[TILE_BLOCKS - turns + lane] = NONE_LEFT;
        }
        for (uint passer = lane; passer < passers; passer += gl_WorkGroupSize.x) {
            const uint b = first_block + passer / per_block;
            if (passer_instance[passer] != NO_INSTANCE && passer_entry[passer] == first_left[turns + b]
                && listed_count[b] < BLOCK_CANDIDATES) {
                const uint chosen = b * BLOCK_CANDIDATES + listed_count[b];
                const uint entry = passer_entry[passer];
                chosen_pixel[chosen] = pixel_of_entry(cam, geo, entry) | (entry & PASSING_KEY);
                chosen_instance[chosen] = passer_instance[passer];
                chosen_depths[chosen] = passer_depths[passer];
                listed_count[b] += 1u;
                passer_instance[passer] = NO_INSTANCE;
            }
        }
        barrier();
        for (uint passer = lane; passer < passers; passer += gl_WorkGroupSize.x) {
            const uint b = first_block + passer / per_block;
            if (passer_instance[passer] != NO_INSTANCE) {
                leave_out(geo, passer, b * BLOCK_CANDIDATES + listed_count[b] - 1u);
            }
        }
        turn += 1u;
    } while (any_left);
    barrier();
}

// Whether the surface of a representative passes a block.
bool passes(Camera cam, Geometry geo, uint key, uint pixel, ivec2 block) {
    const ivec2 at = ivec2(pixel % cam.width, pixel / cam.width);
    const uvec2 shown = load_surface(surface_base(cam, geo, key), cam, at);
    const uint instance = instance_of(shown);
    if (!has_surface(shown) || parallax_of(geo, instance) == 0.0) {
        return false;
    }
    const float inverse_depth = inverse_depth_of(shown);
    const ivec2 own_block = at / int(BLOCK_PX);
    vec3 point = ray_of(geo, vec2(at));
    if (key == 1u) {
        point = moved(inverse_of(pose_between_keys(geo, instance)), point, inverse_depth);
    }
    const bool moves = instance_moves(geo, instance);
    bool passed = false;
    bool seen_before = false;
    vec2 shift_before = vec2(0.0);
    uint knot = 0u;
    do {
        bool seen = true;
        vec2 place = vec2(at);
        if (moves) {
            place = project(geo, moved(inverse_of(pose_at_knot(geo, instance, knot)), point, inverse_depth), seen);
        }
        seen = seen && is_somewhere(place);
        const vec2 shift = place - vec2(at);
        const ivec4 blocks_passed = passed_blocks(cam, own_block, shift);
        passed = passed
            || (seen && all(lessThanEqual(blocks_passed.xy, block)) && all(greaterThanEqual(blocks_passed.zw, block)));
        if (seen && seen_before && !passed) {
            const ivec2 columns = columns_between(cam, own_block, shift_before, shift, block.y);
            passed = columns.x <= block.x && block.x <= columns.y;
        }
        seen_before = seen;
        shift_before = shift;
        knot += 1u;
    } while (knot < (moves ? KNOTS : 1u) && !passed);
    return passed;
}

// The list of a block that more surfaces pass than `passing` has room for: from all representatives within reach.
void list_all_within_reach(Camera cam, Geometry geo, uint b) {
    const uint lane = gl_LocalInvocationID.x;
    const ivec2 block = ivec2(tile_block(b));
    const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
    // What passes has not moved further than the longest way of all that do.
    const float motion_px = uintBitsToFloat(passing_motion(cam, b));
    const int reach = int(min((motion_px + REACH_PX) / float(BLOCK_PX) + 2.0, 65536.0));
    const ivec2 first = max(block - reach, ivec2(0));
    const uvec2 extent = uvec2(min(block + reach, last_block) - first + 1);
    const uint of_key = extent.x * extent.y * BLOCK_SURFACES;
    const uint at_once = min(gl_WorkGroupSize.x, PASSERS);
    uint start = 0u;
    do {
        const uint item = start + lane;
        if (lane < at_once) {
            passer_instance[lane] = NO_INSTANCE;
        }
        if (lane < at_once && item < 2u * of_key) {
            const uint key = item / of_key;
            const uint in_key = item % of_key;
            const uint place = in_key % BLOCK_SURFACES;
            const uint number = in_key / BLOCK_SURFACES;
            const uint from = (uint(first.y) + number / extent.x) * cam.blocks_x + uint(first.x) + number % extent.x;
            const uint word = representative_word(cam, geo, key, from);
            const uint head = representatives[word];
            if ((head & HAS_SILHOUETTE) != 0u && place < (head & ~HAS_SILHOUETTE)) {
                const uint pixel = representatives[word + 1u + place];
                if (passes(cam, geo, key, pixel, block)) {
                    note_passer(cam, geo, lane, passing_entry(key, from, place), uvec2(block));
                }
            }
        }
        barrier();
        choose_passers(cam, geo, b, at_once, at_once);
        start += at_once;
    } while (start < 2u * of_key && listed_count[b] < BLOCK_CANDIDATES);
}

// Makes the lists of the tile's blocks. Called by the whole workgroup; ends with a barrier.
void list_candidates(Camera cam) {
    const Geometry geo = geometries[cam.slot];
    const uint lane = gl_LocalInvocationID.x;
    if (lane < TILE_BLOCKS) {
        passer_count[lane] = has_block(cam, lane) ? passing[block_head(cam, geo, lane)] : 0u;
        listed_count[lane] = 0u;
        listed_motion[lane] = uintBitsToFloat(passing_motion(cam, lane));
    }
    barrier();
    uint most = 0u;
    for (uint b = 0u; b < TILE_BLOCKS; ++b) {
        most = max(most, passer_count[b]);
    }
    if (most == 0u) {
        return;
    }
    const uint per_block = min(most, PASSING_ENTRIES);
    const uint at_once = TILE_BLOCKS * per_block <= PASSERS ? TILE_BLOCKS : 1u;
    for (uint first = 0u; first < TILE_BLOCKS; first += at_once) {
        for (uint passer = lane; passer < at_once * per_block; passer += gl_WorkGroupSize.x) {
            const uint b = first + passer / per_block;
            passer_instance[passer] = NO_INSTANCE;
            if (passer % per_block < passer_count[b] && passer_count[b] <= PASSING_ENTRIES) {
                const uvec2 block = tile_block(b);
                const uint entries = passing_entries(cam, geo, block.y * cam.blocks_x + block.x);
                note_passer(cam, geo, passer, passing[entries + passer % per_block], block);
            }
        }
        choose_passers(cam, geo, first, per_block, at_once * per_block);
    }
    for (uint b = 0u; b < TILE_BLOCKS; ++b) {
        if (passer_count[b] > PASSING_ENTRIES) {
            list_all_within_reach(cam, geo, b);
        }
    }
    for (uint c = lane; c < LISTED; c += gl_WorkGroupSize.x) {
        if (c % BLOCK_CANDIDATES < listed_count[c / BLOCK_CANDIDATES]) {
            const uint pixel = chosen_pixel[c] & ~PASSING_KEY;
            const ivec2 at = ivec2(pixel % cam.width, pixel / cam.width);
            bool seen = true;
            const Surface surface = surface_of_pixel(cam, geo, chosen_pixel[c] >> 31, at, seen);
            listed_instance[c] = surface.instance;
            listed_parallax[c] = parallax_of(geo, surface.instance);
            listed_plane[2u * c] = surface.planes[0];
            listed_plane[2u * c + 1u] = surface.planes[1];
        }
    }
    barrier();
}
