// The making of the lists of candidates of a tile's blocks, for synthesis `rigid`: from what passes each block. Twin of
// the oracle's `candidates`. Needs candidates.glsl, tile_activity.glsl, and the buffers `representatives` and `passing`.

// What passes: an entry of `passing`, its instance (LEFT_OUT if it is left out), and its inverse depth along the ray of
// the block's centre in both key frames. Of all blocks of the tile or, where they are too many, of one.
const uint PASSERS = RIGID ? 3u * PASSING_ENTRIES : 1u;
shared uint passer_entry[PASSERS];
shared uint passer_instance[PASSERS];
shared vec2 passer_depths[PASSERS];
shared uint passer_count[TILE_BLOCKS];

// In a passer's instance: it is decided that it is chosen, or left out.
const uint DECIDED = 0x80000000u;
const uint LEFT_OUT = 0xffffffffu;

// The chosen ones of each block, likewise; how many a block gains; and whether a passer is left to decide on, in turns.
shared uint chosen_pixel[LISTED];
shared uint chosen_instance[LISTED];
shared vec2 chosen_depths[LISTED];
shared uint gained[TILE_BLOCKS];
shared uint undecided[2];

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
    passer_instance[passer] = seen ? surface.instance : LEFT_OUT;
    passer_depths[passer] = seen ? depths_along(surface.planes, ray_of(geo, centre)) : vec2(0.0);
}

// Whether a passer is one with a chosen one of its block.
bool is_listed(Geometry geo, uint passer, uint chosen) {
    const uint instance = passer_instance[passer];
    return instance == chosen_instance[chosen]
        && are_one(chosen_depths[chosen], passer_depths[passer], parallax_of(geo, instance));
}

// What is decided on a passer: DECIDED if it is chosen, LEFT_OUT if it is left out, 0 if it has to wait for others.
// [first, last) are those of its block.
uint decision(Geometry geo, uint passer, uint first, uint last) {
    const uint instance = passer_instance[passer];
    const uint entry = passer_entry[passer];
    const vec2 depths = passer_depths[passer];
    const float parallax = parallax_of(geo, instance);
    bool waits = false;
    bool is_left_out = false;
    for (uint other = first; other < last; ++other) {
        const uint theirs = passer_instance[other];
        if (theirs != LEFT_OUT && (theirs & ~DECIDED) == instance && passer_entry[other] < entry
            && are_one(passer_depths[other], depths, parallax)) {
            const bool is_chosen = (theirs & DECIDED) != 0u;
            is_left_out = is_left_out || is_chosen;
            waits = waits || !is_chosen;
        }
    }
    return is_left_out ? LEFT_OUT : waits ? 0u : DECIDED;
}

// Chooses from what passes, in the order of entries, and leaves out what is one with something chosen; until the lists are
// full. A round decides on all that wait for nothing before them, so most take few. Of `passers`, `per_block` are of each
// block from `first_block` on. Called by the whole workgroup; begins with what others have noted, ends with a barrier.
void choose_passers(Camera cam, Geometry geo, uint first_block, uint per_block, uint passers) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < TILE_BLOCKS) {
        gained[lane] = 0u;
    }
    if (lane < 2u) {
        undecided[lane] = 0u;
    }
    barrier();
    for (uint passer = lane; passer < passers; passer += gl_WorkGroupSize.x) {
        const uint b = first_block + passer / per_block;
        bool listed = false;
        for (uint chosen = 0u; chosen < listed_count[b] && passer_instance[passer] != LEFT_OUT; ++chosen) {
            listed = listed || is_listed(geo, passer, b * BLOCK_CANDIDATES + chosen);
        }
        if (listed) {
            passer_instance[passer] = LEFT_OUT;
        }
    }
    barrier();
    uint turn = 0u;
    do {
        // A bit for each passer of this thread.
        uint choose = 0u;
        uint leave_out = 0u;
        uint own = 0u;
        for (uint passer = lane; passer < passers; passer += gl_WorkGroupSize.x) {
            if ((passer_instance[passer] & DECIDED) == 0u) {
                const uint first = passer / per_block * per_block;
                const uint decided = decision(geo, passer, first, first + per_block);
                choose |= uint(decided == DECIDED) << own;
                leave_out |= uint(decided == LEFT_OUT) << own;
            }
            own += 1u;
        }
        barrier();
        own = 0u;
        for (uint passer = lane; passer < passers; passer += gl_WorkGroupSize.x) {
            if (((choose >> own) & 1u) != 0u) {
                passer_instance[passer] |= DECIDED;
            } else if (((leave_out >> own) & 1u) != 0u) {
                passer_instance[passer] = LEFT_OUT;
            } else if ((passer_instance[passer] & DECIDED) == 0u) {
                undecided[turn & 1u] = 1u;
            }
            own += 1u;
        }
        if (lane == 0u) {
            undecided[1u - (turn & 1u)] = 0u;
        }
        barrier();
        turn += 1u;
    } while (undecided[1u - (turn & 1u)] != 0u);
    for (uint passer = lane; passer < passers; passer += gl_WorkGroupSize.x) {
        if (passer_instance[passer] == LEFT_OUT) {
            continue;
        }
        const uint b = first_block + passer / per_block;
        const uint first = passer / per_block * per_block;
        const uint entry = passer_entry[passer];
        uint place = listed_count[b];
        for (uint other = first; other < first + per_block; ++other) {
            place += uint(passer_instance[other] != LEFT_OUT && passer_entry[other] < entry);
        }
        if (place < BLOCK_CANDIDATES) {
            const uint chosen = b * BLOCK_CANDIDATES + place;
            chosen_pixel[chosen] = pixel_of_entry(cam, geo, entry) | (entry & PASSING_KEY);
            chosen_instance[chosen] = passer_instance[passer] & ~DECIDED;
            chosen_depths[chosen] = passer_depths[passer];
            atomicAdd(gained[b], 1u);
        }
    }
    barrier();
    if (lane < TILE_BLOCKS) {
        listed_count[lane] += gained[lane];
    }
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
    uint knot = 0u;
    do {
        bool seen = true;
        vec2 place = vec2(at);
        if (moves) {
            place = project(geo, moved(inverse_of(pose_at_knot(geo, instance, knot)), point, inverse_depth), seen);
        }
        const ivec4 blocks_passed = passed_blocks(cam, own_block, place - vec2(at));
        passed = passed
            || (seen && all(lessThanEqual(blocks_passed.xy, block)) && all(greaterThanEqual(blocks_passed.zw, block)));
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
            passer_instance[lane] = LEFT_OUT;
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
            passer_instance[passer] = LEFT_OUT;
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
