// The surfaces that represent each block, and the blocks that these pass during the interval, for synthesis `rigid`.
// Part of ingest.glsl; needs ingest_surfaces.glsl.

// For each block: the pixels that represent it, a bit each; those in order; the largest motion of them, pixels.
shared uint representing[2u * TILE_BLOCKS];
shared uint represented_by[TILE_BLOCKS * BLOCK_SURFACES];
shared uint own_motion[TILE_BLOCKS];

// Pixel `number` of a block of the tile.
ivec2 block_pixel(uint block, uint number) {
    return tile_origin + ivec2(block * BLOCK_PX + number % BLOCK_PX, number / BLOCK_PX);
}

bool in_image(Camera cam, ivec2 at) {
    return at.x < int(cam.width) && at.y < int(cam.height);
}

// Marks a pixel of the tile if it is the nearest or the farthest of its instance in its block; of equals the first.
void mark_representative(Camera cam, uint number) {
    const uint block = number / (BLOCK_PX * BLOCK_PX);
    const uint own = number % (BLOCK_PX * BLOCK_PX);
    const ivec2 at = block_pixel(block, own);
    if (!in_image(cam, at)) {
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
        const uvec2 block_at = uvec2(tile_origin) / BLOCK_PX + uvec2(block, 0u);
        const uint word = representative_word(cam, geo, 1u, block_at.y * cam.blocks_x + block_at.x);
        representatives[word + 1u + place] = pixel;
        represented_by[block * BLOCK_SURFACES + place] = pixel;
    }
}

uint representative_count(uint block) {
    return min(uint(bitCount(representing[2u * block]) + bitCount(representing[2u * block + 1u])), BLOCK_SURFACES);
}

// Positions farther away than this are nowhere, pixels.
const float FARTHEST_PX = 1e15;

// Appends a representative of key frame `key` to the lists of the blocks that it passes. Returns its motion, pixels.
float append_to_passed(Camera cam, Geometry geo, uint key, ivec2 block, uint pixel) {
    const ivec2 at = ivec2(pixel % cam.width, pixel / cam.width);
    uint instance;
    float inverse_depth;
    if (key == 1u) {
        instance = cached_instance[surface_index(at)];
        inverse_depth = cached_inverse_depth[surface_index(at)];
    } else {
        const uvec2 shown = load_surface(surface_base(cam, geo, 0u), cam, at);
        instance = instance_of(shown);
        inverse_depth = inverse_depth_of(shown);
        // Its poses may have been taken away.
        if (parallax_of(geo, instance) == 0.0) {
            return 0.0;
        }
    }
    vec3 point = ray_of(geo, vec2(at));
    if (key == 1u) {
        point = moved(inverse_of(pose_between_keys(geo, instance)), point, inverse_depth);
    }
    const bool moves = instance_moves(geo, instance);
    ivec4 passed[KNOTS];
    float motion_px = 0.0;
    vec2 last_place = vec2(at);
    bool last_seen = false;
    const uint knots = moves ? KNOTS : 1u;
    for (uint knot = 0u; knot < knots; ++knot) {
        bool seen = true;
        vec2 place = vec2(at);
        if (moves) {
            place = project(geo, moved(inverse_of(pose_at_knot(geo, instance, knot)), point, inverse_depth), seen);
        }
        // Lengths of larger numbers have none. NaN is none either.
        seen = seen && all(lessThan(abs(place), vec2(FARTHEST_PX)));
        passed[knot] = seen ? passed_blocks(cam, block, place - vec2(at)) : ivec4(0, 0, -1, -1);
        motion_px += seen && last_seen ? length(place - last_place) : 0.0;
        last_place = place;
        last_seen = seen;
    }
    if (motion_px < REST_PX) {
        motion_px = 0.0;
    }
    for (uint knot = 0u; knot < knots; ++knot) {
        for (int y = passed[knot].y; y <= passed[knot].w; ++y) {
            for (int x = passed[knot].x; x <= passed[knot].z; ++x) {
                bool known = false;
                for (uint before = 0u; before < knot; ++before) {
                    known = known
                        || (all(lessThanEqual(passed[before].xy, ivec2(x, y)))
                            && all(greaterThanEqual(passed[before].zw, ivec2(x, y))));
                }
                if (!known) {
                    const uint passed_block = uint(y) * cam.blocks_x + uint(x);
                    const uint head = passing_head(cam, geo, passed_block);
                    const uint entry = atomicAdd(passing[head], 1u);
                    atomicMax(passing[head + 1u], floatBitsToUint(motion_px));
                    if (entry < PASSING_ENTRIES) {
                        passing[passing_entries(cam, geo, passed_block) + entry] =
                            pixel | (key == 1u ? PASSING_KEY : 0u);
                    }
                }
            }
        }
    }
    return motion_px;
}

// Writes the lists of the tile's blocks. Called by the whole workgroup.
void write_lists(Camera cam, Geometry geo) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < TILE_BLOCKS) {
        representing[2u * lane] = 0u;
        representing[2u * lane + 1u] = 0u;
        own_motion[lane] = 0u;
    }
    barrier();
    for (uint number = lane; number < TILE_ANCHORS; number += gl_WorkGroupSize.x) {
        mark_representative(cam, number);
    }
    barrier();
    for (uint number = lane; number < TILE_ANCHORS; number += gl_WorkGroupSize.x) {
        list_representative(cam, geo, number);
    }
    const uvec2 first_block = uvec2(tile_origin) / BLOCK_PX;
    if (lane < TILE_BLOCKS && first_block.x + lane < cam.blocks_x) {
        const uint block = first_block.y * cam.blocks_x + first_block.x + lane;
        representatives[representative_word(cam, geo, 1u, block)] = representative_count(lane);
        // The heads of the next tick.
        const uint head = geo.passing_base + ((1u - cam.frame_slot) * cam.blocks + block) * PASSING_HEAD_WORDS;
        passing[head] = 0u;
        passing[head + 1u] = 0u;
    }
    barrier();
    if (is_first(cam)) {
        return;
    }
    for (uint number = lane; number < 2u * TILE_BLOCKS * BLOCK_SURFACES; number += gl_WorkGroupSize.x) {
        const uint key = number / (TILE_BLOCKS * BLOCK_SURFACES);
        const uint in_tile = (number / BLOCK_SURFACES) % TILE_BLOCKS;
        const uint place = number % BLOCK_SURFACES;
        if (first_block.x + in_tile >= cam.blocks_x) {
            continue;
        }
        const uvec2 block_at = first_block + uvec2(in_tile, 0u);
        uint count = representative_count(in_tile);
        uint pixel = represented_by[in_tile * BLOCK_SURFACES + place];
        if (key == 0u) {
            const uint word = representative_word(cam, geo, 0u, block_at.y * cam.blocks_x + block_at.x);
            count = representatives[word];
            pixel = representatives[word + 1u + place];
        }
        if (place < count) {
            atomicMax(own_motion[in_tile], floatBitsToUint(append_to_passed(cam, geo, key, ivec2(block_at), pixel)));
        }
    }
    barrier();
    if (lane < TILE_BLOCKS) {
        block_motion[lane] = max(block_motion[lane], own_motion[lane]);
    }
    barrier();
}

