// The layers of a tile's blocks, for synthesis `motion` where motions meet: what passes each block, those that move alike
// once, from near to far. Part of cross.glsl; twin of the oracle's `layers::candidates`. Needs layers.glsl, and the
// buffers `blocks` and `meetings`.

// Blocks of the tile (one bit each) for which a found layer is left to choose; the first one that is left of each, in
// turns.
shared uint layer_left[FOUND];
shared uint first_layer[2u * TILE_BLOCKS];
const uint NO_FIRST = 0xffffffffu;

// How many pixels vote that one layer of a block hides another, and for each layer how many others are before it.
shared uint layer_votes[LAYERED ? TILE_BLOCKS * BLOCK_LAYERS * BLOCK_LAYERS : 1u];
shared uint ranked_layer[LISTED_LAYERS];

// The word of a block for its pair.
uint pair_of_block(Camera cam, ivec2 block) {
    return blocks[cam.block_base + cam.frame_slot * cam.blocks + uint(block.y) * cam.blocks_x + uint(block.x)].w;
}

// Whether a position lies outside the image. A rounding's width outside does not matter.
bool is_outside(Camera cam, vec2 position) {
    return outside_px(cam, position) > LAYER_OUTSIDE_PX;
}

// How far a vector goes on, a step at a time, up to LAYER_SLOPE_PX: the last one, and the number of steps.
vec3 walk_vectors(Camera cam, ivec2 at, vec2 own, ivec2 way) {
    const uint base = motion_base(cam, true);
    vec2 last = own;
    int steps = 0;
    bool goes_on = true;
    while (goes_on) {
        bool known = true;
        const vec2 next = vector_at(cam, base, at + (steps + 1) * way, known);
        goes_on = known && larger(next - last) <= SMOOTH_PX;
        if (goes_on) {
            last = next;
            steps += 1;
        }
        goes_on = goes_on && steps < int(LAYER_SLOPE_PX);
    }
    return vec3(last, float(steps));
}

// Change of the vectors along an axis (xy), and the number of steps that it is measured over.
vec3 slope_of_vectors(Camera cam, ivec2 at, vec2 own, ivec2 way) {
    const vec3 before = walk_vectors(cam, at, own, -way);
    const vec3 after = walk_vectors(cam, at, own, way);
    const float steps = before.z + after.z;
    return vec3(steps < 2.0 ? vec2(0.0) : (after.xy - before.xy) / steps, steps);
}

// Notes the layer that a pixel shows. Returns whether its path is known.
bool note_layer(Camera cam, uint number, ivec2 at) {
    bool known = true;
    const vec2 motion = vector_at(cam, motion_base(cam, true), at, known);
    if (!known) {
        return false;
    }
    const vec3 along_x = slope_of_vectors(cam, at, motion, ivec2(1, 0));
    const vec3 along_y = slope_of_vectors(cam, at, motion, ivec2(0, 1));
    const float thickness = min(min(along_x.z, along_y.z) * (1.0 / LAYER_THICK_STEPS), 1.0);
    vec4 slopes = vec4(along_x.xy, along_y.xy);
    if (fma(1.0 + slopes.x, 1.0 + slopes.w, -slopes.z * slopes.y) < LAYER_LEAST_DETERMINANT) {
        slopes = vec4(0.0);
    }
    // As if vectors at a place of the image stayed the same.
    vec2 before = motion + times(slopes, motion);
    if (has_earlier_vectors(cam)) {
        const vec2 there = vec2(at) + motion;
        if (is_outside(cam, there)) {
            return false;
        }
        const vec2 steady = interval_ratio(cam) * motion;
        const Cell cell = cell_at(cam, there);
        const vec2 g = 1.0 - cell.f;
        const vec4 weights = vec4(g.x * g.y, cell.f.x * g.y, g.x * cell.f.y, cell.f.x * cell.f.y);
        vec2 taps[4];
        bvec4 is_known;
        vec2 nearest = vec2(0.0);
        float least = -1.0;
        for (uint i = 0u; i < 4u; ++i) {
            const ivec2 tap = ivec2((i & 1u) == 0u ? cell.low.x : cell.high.x, i < 2u ? cell.low.y : cell.high.y);
            bool has_tap = weights[i] > 0.0;
            taps[i] = vector_at(cam, motion_base(cam, false), tap, has_tap);
            is_known[i] = has_tap;
            const vec2 off = taps[i] - steady;
            const float apart = dot(off, off);
            if (has_tap && (least < 0.0 || apart < least)) {
                nearest = taps[i];
                least = apart;
            }
        }
        if (least < 0.0) {
            return false;
        }
        vec2 sum = vec2(0.0);
        float sum_weights = 0.0;
        for (uint i = 0u; i < 4u; ++i) {
            if (is_known[i] && larger(taps[i] - nearest) <= SMOOTH_PX) {
                sum = fma(vec2(weights[i]), taps[i] - nearest, sum);
                sum_weights += weights[i];
            }
        }
        // Where all are equal, so is this: rounding must not part layers that have one vector.
        before = nearest + sum / sum_weights;
        if (distance(before, steady) > fma(LAYER_BEND_SHARE, length(steady), LAYER_BEND_PX)) {
            return false;
        }
    }
    found_place[number] = vec4(float(at.x) + 0.5 * thickness, at.y, motion);
    found_slopes[number] = slopes;
    found_before[number] = before;
    return true;
}

// First pixel of the region of blocks within reach of the tile, in blocks; it may lie outside the image.
ivec2 region_corner() {
    return ivec2(corner / BLOCK_PX) - int(LAYER_REACH_BLOCKS);
}

// The order in which the tile's `b`th block chooses among the found layers: by distance of their blocks, then row by row.
uint layer_key(uint number, uint b) {
    if (number >= 2u * REGION) {
        return number;
    }
    const uint in_region = number / 2u;
    const ivec2 off = abs(ivec2(in_region % REGION_X, in_region / REGION_X) - ivec2(b, 0) - int(LAYER_REACH_BLOCKS));
    return (uint(max(off.x, off.y)) << 16) | number;
}

vec2 middle_of_block(uint b) {
    return vec2((corner / BLOCK_PX + uvec2(b, 0u)) * BLOCK_PX) + 0.5 * float(BLOCK_PX - 1u);
}

// Finds what passes the tile's blocks, and which blocks.
void find_layers(Camera cam) {
    const ivec2 last_block = ivec2(cam.blocks_x, cam.blocks / cam.blocks_x) - 1;
    for (uint number = gl_LocalInvocationID.x; number < FOUND; number += gl_WorkGroupSize.x) {
        uint left = 0u;
        if (number >= 2u * REGION) {
            // The middle of a block in which motions do not meet.
            const uint b = number - 2u * REGION;
            const ivec2 block = ivec2(corner / BLOCK_PX) + ivec2(b, 0);
            if (block.x <= last_block.x && meeting_motion(cam, b) != 0u && pair_of_block(cam, block) == 0u) {
                const ivec2 last = ivec2(cam.width, cam.height) - 1;
                left = note_layer(cam, number, min(block * int(BLOCK_PX) + int(BLOCK_PX / 2u), last)) ? 1u << b : 0u;
            }
        } else {
            const ivec2 block = region_corner() + ivec2((number / 2u) % REGION_X, (number / 2u) / REGION_X);
            const bool inside = all(greaterThanEqual(block, ivec2(0))) && all(lessThanEqual(block, last_block));
            const uint pair = inside ? pair_of_block(cam, block) : 0u;
            if (pair != 0u) {
                const ivec2 first = pixel_of_pair(block, pair);
                const ivec2 second = first + way_of_pair(pair);
                const uint base = motion_base(cam, true);
                const vec2 motions[2] = vec2[2](motion_at(cam, base, first), motion_at(cam, base, second));
                for (uint b = 0u; b < TILE_BLOCKS; ++b) {
                    const ivec2 to = ivec2(corner / BLOCK_PX) + ivec2(b, 0);
                    const ivec2 off = abs(to - block);
                    if (to.x <= last_block.x && max(off.x, off.y) <= int(LAYER_REACH_BLOCKS)
                        && (passes_block(block, motions[0], to) || passes_block(block, motions[1], to))) {
                        left |= 1u << b;
                    }
                }
                if (left != 0u && !note_layer(cam, number, (number & 1u) == 0u ? first : second)) {
                    left = 0u;
                }
            }
        }
        layer_left[number] = left;
    }
}

// Chooses the layers of each block: the first that is left, which leaves out those that move alike, and again.
void choose_layers() {
    const uint lane = gl_LocalInvocationID.x;
    uint turn = 0u;
    bool any_left = true;
    do {
        const uint turns = TILE_BLOCKS * (turn & 1u);
        for (uint number = lane; number < FOUND; number += gl_WorkGroupSize.x) {
            for (uint b = 0u; b < TILE_BLOCKS; ++b) {
                if (((layer_left[number] >> b) & 1u) != 0u) {
                    atomicMin(first_layer[turns + b], layer_key(number, b));
                }
            }
        }
        barrier();
        any_left = false;
        for (uint b = 0u; b < TILE_BLOCKS; ++b) {
            any_left = any_left || first_layer[turns + b] != NO_FIRST;
        }
        for (uint number = lane; number < FOUND; number += gl_WorkGroupSize.x) {
            uint left = layer_left[number];
            for (uint b = 0u; b < TILE_BLOCKS; ++b) {
                if (((left >> b) & 1u) != 0u) {
                    const Layer chosen = found_layer(first_layer[turns + b] & 0xffffu);
                    const vec2 middle = middle_of_block(b);
                    const bool alike =
                        distance(motion_of(found_layer(number), middle), motion_of(chosen, middle)) < LAYER_MERGE_PX;
                    left &= alike ? ~(1u << b) : left;
                }
            }
            layer_left[number] = left;
        }
        if (lane < TILE_BLOCKS && first_layer[turns + lane] != NO_FIRST && layer_count[lane] < BLOCK_LAYERS) {
            ranked_layer[lane * BLOCK_LAYERS + layer_count[lane]] = first_layer[turns + lane] & 0xffffu;
            layer_count[lane] += 1u;
        }
        if (lane < TILE_BLOCKS) {
            first_layer[TILE_BLOCKS - turns + lane] = NO_FIRST;
        }
        barrier();
        turn += 1u;
    } while (any_left && turn < BLOCK_LAYERS);
}

// The first pixel of the tile's `b`th block.
vec2 first_of_list(uint b) {
    return first_of_block(corner + uvec2(b * BLOCK_PX, 0u));
}

// The pixels in and around a block vote: what disappears is behind.
void vote_on_order(Camera cam, uint b) {
    const uint block = b * BLOCK_LAYERS;
    const uint count = layer_count[b];
    if (count < 2u) {
        return;
    }
    const uint every = 0x87654321u & ((1u << (LAYER_BITS * count)) - 1u);
    const float ratio = interval_ratio(cam);
    const vec2 first = first_of_list(b);
    const uint side = 3u * BLOCK_PX;
    for (uint item = gl_LocalInvocationID.x; item < side * side; item += gl_WorkGroupSize.x) {
        const ivec2 at = ivec2(first) - int(BLOCK_PX) + ivec2(item % side, item / side);
        bool known = true;
        const vec2 vector = vector_at(cam, motion_base(cam, true), at, known);
        const vec2 there = vec2(at) + vector;
        const ivec2 before = nearest_pixel(there);
        const vec2 vector_before = vector_at(cam, motion_base(cam, false), before, known);
        if (!known || is_outside(cam, there)) {
            continue;
        }
        const uint hidden = owner_of(block, every, true, vec2(at) - first, vector, ratio);
        const uint front = owner_of(block, every, false, vec2(before) - first, vector_before, ratio);
        if (hidden == NO_LAYER || front == NO_LAYER || hidden == front) {
            continue;
        }
        const vec2 source = layer_sources(found_layer(listed_layer[block + front]), vec2(before), 0.0, ratio).xy;
        const ivec2 now = nearest_pixel(source);
        const vec2 vector_now = vector_at(cam, motion_base(cam, true), now, known);
        if (known && owner_of(block, every, true, vec2(now) - first, vector_now, ratio) == front) {
            atomicAdd(layer_votes[(block + front) * BLOCK_LAYERS + hidden], 1u);
        }
    }
}

// Whether the votes say that one layer of a block hides another.
bool hides_layer(uint block, uint front, uint hidden) {
    return layer_votes[(block + front) * BLOCK_LAYERS + hidden]
        >= LAYER_VOTES + 2u * layer_votes[(block + hidden) * BLOCK_LAYERS + front];
}

// Sorts the layers of each block from near to far: by the votes, else the faster is nearer.
void rank_layers(Camera cam) {
    const uint lane = gl_LocalInvocationID.x;
    for (uint listed = lane; listed < TILE_BLOCKS * BLOCK_LAYERS; listed += gl_WorkGroupSize.x) {
        const uint b = listed / BLOCK_LAYERS;
        const uint block = b * BLOCK_LAYERS;
        const uint own = listed % BLOCK_LAYERS;
        if (own < layer_count[b]) {
            const vec2 middle = middle_of_block(b);
            const float speed = length(motion_of(found_layer(listed_layer[listed]), middle));
            uint nearer = 0u;
            for (uint k = 0u; k < layer_count[b]; ++k) {
                const float other = length(motion_of(found_layer(listed_layer[block + k]), middle));
                const bool behind = hides_layer(block, k, own);
                const bool before = hides_layer(block, own, k);
                // Of those that are equal in all, the first.
                const bool first = other > speed || (other == speed && k < own);
                nearer += k != own && (behind != before ? behind : first) ? 1u << BLOCK_LAYERS : 0u;
            }
            ranked_layer[listed] = nearer | own;
        }
    }
    barrier();
    // Cycles leave equal ranks: the first comes first.
    uint number = NO_FIRST;
    uint place = 0u;
    for (uint listed = lane; listed < TILE_BLOCKS * BLOCK_LAYERS; listed += gl_WorkGroupSize.x) {
        const uint b = listed / BLOCK_LAYERS;
        if (listed % BLOCK_LAYERS < layer_count[b]) {
            for (uint k = 0u; k < layer_count[b]; ++k) {
                place += ranked_layer[b * BLOCK_LAYERS + k] < ranked_layer[listed] ? 1u : 0u;
            }
            place += b * BLOCK_LAYERS;
            number = listed_layer[listed];
        }
    }
    barrier();
    if (number != NO_FIRST) {
        listed_layer[place] = number;
        note_vectors(place, first_of_list(place / BLOCK_LAYERS), interval_ratio(cam));
    }
}

// Makes the lists of the tile's blocks. Called by the whole workgroup; ends with a barrier.
void list_layers(Camera cam) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane < TILE_BLOCKS) {
        layer_count[lane] = 0u;
        first_layer[lane] = NO_FIRST;
    }
    for (uint vote = lane; vote < TILE_BLOCKS * BLOCK_LAYERS * BLOCK_LAYERS; vote += gl_WorkGroupSize.x) {
        layer_votes[vote] = 0u;
    }
    find_layers(cam);
    barrier();
    choose_layers();
    for (uint listed = lane; listed < TILE_BLOCKS * BLOCK_LAYERS; listed += gl_WorkGroupSize.x) {
        listed_layer[listed] = ranked_layer[listed];
        if (listed % BLOCK_LAYERS < layer_count[listed / BLOCK_LAYERS]) {
            note_vectors(listed, first_of_list(listed / BLOCK_LAYERS), interval_ratio(cam));
        }
    }
    barrier();
    if (has_earlier_vectors(cam)) {
        for (uint b = 0u; b < TILE_BLOCKS; ++b) {
            vote_on_order(cam, b);
        }
        barrier();
    }
    rank_layers(cam);
    barrier();
}
