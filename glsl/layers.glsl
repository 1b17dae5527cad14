// Layers: surfaces that a pixel may show in an interval, told apart by their motion vectors, for synthesis `motion` where
// motions meet. Part of cross.glsl; twin of the oracle's `synthesize::layers`. Needs trajectory.glsl, and `snapped`.

// A layer is given by a pixel of the current frame that shows it. Its vectors are linear in the image.
struct Layer {
    vec2 at;
    vec2 motion;
    // Change of the vector from a pixel to the next: along x (xy), along y (zw).
    vec4 slopes;
    // The vector of its point in the previous frame, over the interval before.
    vec2 before;
    // From 0, one pixel wide, to 1.
    float thickness;
};

// Layers that the tile's blocks may have: those of the pairs in all blocks within reach, then one of each block itself.
// Where only one block has lists (LIST_BLOCKS), its own.
const uint REGION_X = TILE_BLOCKS + 2u * LAYER_REACH_BLOCKS;
const uint REGION_Y = 1u + 2u * LAYER_REACH_BLOCKS;
const uint REGION = REGION_X * REGION_Y;
const uint FOUND = !LAYERED ? 1u : LIST_BLOCKS == 1u ? BLOCK_LAYERS : 2u * REGION + TILE_BLOCKS;
// Pixel and vector of each. The pixel's column has a fraction: half the layer's thickness.
shared vec4 found_place[FOUND];
shared vec4 found_slopes[FOUND];
shared vec2 found_before[FOUND];

// The layers of each block, from near to far, by their number among those, and how many.
const uint LISTED_LAYERS = LAYERED ? LIST_BLOCKS * BLOCK_LAYERS : 1u;
shared uint listed_layer[LISTED_LAYERS];
// Of each, its vector at the block's first pixel (xy), and the one that its point has in the previous frame if it lies there,
// over the interval before (zw).
shared vec4 listed_vectors[LISTED_LAYERS];
shared vec4 listed_slopes[LISTED_LAYERS];
shared uint layer_count[LIST_BLOCKS];

// Lists of a block's layers from near to far: four bits for each, its place in the block's list plus one.
const uint LAYER_BITS = 4u;
const uint LAYER_MASK = (1u << LAYER_BITS) - 1u;
const uint NO_LAYER = 0xffffffffu;

// More than any square of a distance that counts, pixels squared.
const float FAR_APART = 1e30;

// A vector that no pixel is near to.
const float ABSENT_PX = 1e9;

// Whether vectors of the previous frame tell what it shows.
bool has_earlier_vectors(Camera cam) {
    return cam.has_previous_motion != 0u && cam.previous_interval_ns != 0u;
}

// Length of the interval before over that of this one; 1 where that tells nothing.
float interval_ratio(Camera cam) {
    return has_earlier_vectors(cam) ? float(cam.previous_interval_ns) / float(cam.interval_ns) : 1.0;
}

// The vector of a pixel. `known` becomes false if it has none.
vec2 vector_at(Camera cam, uint base, ivec2 at, inout bool known) {
    known = known && all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, ivec2(cam.width, cam.height)));
    if (!known) {
        return vec2(0.0);
    }
    const vec2 m = motion_at(cam, base, at);
    known = floatBitsToUint(m.x) != INVALID_BIT;
    return m;
}

// The pixel nearest to a position. Half way between two, rounding does not decide.
ivec2 nearest_pixel(vec2 position) {
    return ivec2(floor(fma(vec2(0.5), snapped(2.0 * position), vec2(0.5))));
}

float larger(vec2 v) {
    return max(abs(v.x), abs(v.y));
}

vec2 times(vec4 slopes, vec2 v) {
    return fma(slopes.xy, vec2(v.x), slopes.zw * v.y);
}

Layer found_layer(uint number) {
    const vec4 place = found_place[number];
    const float column = floor(place.x);
    return Layer(
        vec2(column, place.y), place.zw, found_slopes[number], found_before[number], 2.0 * (place.x - column));
}

// Its vector at a position in the current frame, and in the previous one over the interval before.
vec2 motion_of(Layer layer, vec2 at) {
    return layer.motion + times(layer.slopes, at - layer.at);
}

vec2 before_of(Layer layer, vec2 at, float ratio) {
    return layer.before + ratio * times(layer.slopes, (at - layer.at) - layer.motion);
}

// Where the point that lies at `at` at `alpha` is in the current frame (xy) and in the previous one (zw).
vec4 layer_sources(Layer layer, vec2 at, float alpha, float ratio) {
    const float t = alpha - 1.0;
    const vec2 c = curvature(layer.motion, layer.before, ratio);
    const vec2 along = fma(vec2(-t * alpha), c, fma(vec2(t), layer.motion, at - layer.at));
    const vec4 s = t * layer.slopes;
    const float determinant = fma(1.0 - s.x, 1.0 - s.w, -s.z * s.y);
    const vec2 from = vec2(
        fma(1.0 - s.w, along.x, s.z * along.y), fma(1.0 - s.x, along.y, s.y * along.x)) / determinant;
    const vec2 in_current = layer.at + from;
    return vec4(in_current, in_current + layer.motion + times(layer.slopes, from));
}

// The first pixel of a pixel's block.
vec2 first_of_block(uvec2 at) {
    return vec2(at / BLOCK_PX * BLOCK_PX);
}

// Notes the vectors of a listed layer of the block with this first pixel.
void note_vectors(uint listed, vec2 first, float ratio) {
    const Layer layer = found_layer(listed_layer[listed]);
    listed_vectors[listed] = vec4(motion_of(layer, first), before_of(layer, first, ratio));
    listed_slopes[listed] = layer.slopes;
}

// The vector of a listed layer, so far from its block's first pixel, in the current frame or in the previous one.
vec2 vector_of_listed(uint listed, bool current, vec2 from_first, float ratio) {
    const vec4 vectors = listed_vectors[listed];
    const vec2 change = times(listed_slopes[listed], from_first);
    return current ? vectors.xy + change : fma(vec2(ratio), change, vectors.zw);
}

// Takes a layer, at this place in an order, for the owner of a vector if it fits and is nearer than the one so far. `least`
// is the square of that one's distance.
void compare_owner(vec2 expected, uint place, vec2 vector, inout uint owner, inout float least) {
    const vec2 apart = vector - expected;
    const float squared = dot(apart, apart);
    const float most = fma(LAYER_BELONG_SHARE, length(expected), LAYER_BELONG_PX);
    const bool belongs = squared <= most * most && squared < least;
    owner = belongs ? place : owner;
    least = belongs ? squared : least;
}

// Which of some layers of a block a vector is, so far from the block's first pixel: its place in `order`; NO_LAYER if it is
// none.
uint owner_of(uint block, uint order, bool current, vec2 from_first, vec2 vector, float ratio) {
    uint owner = NO_LAYER;
    float least = FAR_APART;
    uint place = 0u;
    while (order != 0u) {
        const uint listed = block + (order & LAYER_MASK) - 1u;
        compare_owner(vector_of_listed(listed, current, from_first, ratio), place, vector, owner, least);
        order >>= LAYER_BITS;
        place += 1u;
    }
    return owner;
}

uint layers_in(uint order) {
    return uint(findMSB(order)) / LAYER_BITS + 1u;
}

// Which of some layers of a block a pixel shows, by its place in `order`: the farthest if it is none of them, NO_LAYER
// without a usable vector.
uint shown_layer(Camera cam, uint block, vec2 first, uint order, bool current, ivec2 at, float ratio) {
    bool known = true;
    if (current || has_earlier_vectors(cam)) {
        const vec2 vector = vector_at(cam, motion_base(cam, current), at, known);
        if (!known) {
            return NO_LAYER;
        }
        const uint owner = owner_of(block, order, current, vec2(at) - first, vector, ratio);
        return owner == NO_LAYER ? layers_in(order) - 1u : owner;
    }
    // The nearest one whose point is seen in the current frame; else the farthest.
    uint place = 0u;
    uint rest = order;
    while (rest != 0u) {
        const Layer layer = found_layer(listed_layer[block + (rest & LAYER_MASK) - 1u]);
        const ivec2 there = nearest_pixel(layer_sources(layer, vec2(at), 0.0, ratio).xy);
        known = true;
        const vec2 vector = vector_at(cam, motion_base(cam, true), there, known);
        if (known && owner_of(block, order, true, vec2(there) - first, vector, ratio) == place) {
            return place;
        }
        rest >>= LAYER_BITS;
        place += 1u;
    }
    return place - 1u;
}

// A pixel's layers, from near to far; 0 if it has fewer than two.
uint layers_of_pixel(Camera cam, uvec2 at, uint in_tile) {
    const uint count = layer_count[in_tile];
    if (count < 2u) {
        return 0u;
    }
    const uint block = in_tile * BLOCK_LAYERS;
    const uint every = 0x87654321u & ((1u << (LAYER_BITS * count)) - 1u);
    const float ratio = interval_ratio(cam);
    const vec2 first = first_of_block(at);
    float fastest = 0.0;
    for (uint a = 0u; a + 1u < count; ++a) {
        const vec2 own = motion_of(found_layer(listed_layer[block + a]), vec2(at));
        for (uint b = a + 1u; b < count; ++b) {
            fastest = max(fastest, larger(own - motion_of(found_layer(listed_layer[block + b]), vec2(at))));
        }
    }
    const uint steps = uint(clamp(ceil(fastest - SLIGHT_WEIGHT), 1.0, float(LAYER_STEPS)));
    // How often each is seen, in five bits; at most 17 times.
    uint seen_low = 0u;
    uint kept = 0u;
    for (uint k = 0u; k < count; ++k) {
        const Layer layer = found_layer(listed_layer[block + k]);
        uint seen = 0u;
        for (uint i = 0u; i <= steps; ++i) {
            const vec4 sources = layer_sources(layer, vec2(at), float(i) / float(steps), ratio);
            const ivec2 in_current = nearest_pixel(sources.xy);
            const ivec2 in_previous = nearest_pixel(sources.zw);
            seen += shown_layer(cam, block, first, every, true, in_current, ratio) == k
                    || shown_layer(cam, block, first, every, false, in_previous, ratio) == k ? 1u : 0u;
        }
        seen_low |= seen << (5u * k);
    }
    // Those that are seen most stay, of equals the nearest.
    for (uint place = 0u; place < LAYERS; ++place) {
        uint most = 0u;
        uint best = 0u;
        for (uint k = 0u; k < count; ++k) {
            const uint seen = (seen_low >> (5u * k)) & 31u;
            if (seen > most && ((kept >> k) & 1u) == 0u) {
                most = seen;
                best = k;
            }
        }
        kept |= most != 0u ? 1u << best : 0u;
    }
    if (bitCount(kept) < 2) {
        return 0u;
    }
    uint order = 0u;
    for (uint k = count; k > 0u; --k) {
        if (((kept >> (k - 1u)) & 1u) != 0u) {
            order = (order << LAYER_BITS) | k;
        }
    }
    return order;
}

// What a frame knows of a layer at a position: shares of the pixels around that show it, of those beside it, and of those
// that hide it; the layer's level and how much that counts; the level there whatever it is of; and that of farther
// layers, with whether there is any.
struct LayerView {
    float seen;
    float fringe;
    float hidden;
    float level;
    float trust;
    float as_shown;
    float behind;
    bool has_behind;
};

// The vectors that the layers of a pixel have at a pixel, the first of a window, and how they change from there to the next.
// Each sub-step asks for many pixels, and the software driver ends loops after so many iterations in all; so this has none.
struct ExpectedVectors {
    vec2 first[MOST_LAYERS];
    vec4 slopes[MOST_LAYERS];
};

// `from_first`: how far that pixel is from the block's first.
ExpectedVectors expected_vectors(uint block, uint order, bool current, vec2 from_first, float ratio) {
    ExpectedVectors expected;
    [[unroll]] for (uint place = 0u; place < LAYERS; ++place) {
        const uint listed = (order >> (place * LAYER_BITS)) & LAYER_MASK;
        expected.first[place] = vec2(ABSENT_PX);
        expected.slopes[place] = vec4(0.0);
        if (listed != 0u) {
            expected.first[place] = vector_of_listed(block + listed - 1u, current, from_first, ratio);
            expected.slopes[place] = (current ? 1.0 : ratio) * listed_slopes[block + listed - 1u];
        }
    }
    return expected;
}

// Which of them a vector is, so far from the window's first pixel; `none` if it is none.
uint owner_in_window(ExpectedVectors expected, uint none, vec2 from_first, vec2 vector) {
    uint owner = none;
    float least = FAR_APART;
    [[unroll]] for (uint place = 0u; place < LAYERS; ++place) {
        compare_owner(
            expected.first[place] + times(expected.slopes[place], from_first), place, vector, owner, least);
    }
    return owner;
}

// As `shown_layer`, of the layers of a pixel, without loops; for the previous frame if that has no vectors.
uint shown_by_paths(Camera cam, uint block, vec2 first, uint order, ivec2 at, float ratio) {
    uint shown = layers_in(order) - 1u;
    [[unroll]] for (uint after = 0u; after < LAYERS; ++after) {
        const uint place = LAYERS - 1u - after;
        const uint listed = (order >> (place * LAYER_BITS)) & LAYER_MASK;
        if (listed != 0u) {
            const Layer layer = found_layer(listed_layer[block + listed - 1u]);
            const ivec2 there = nearest_pixel(layer_sources(layer, vec2(at), 0.0, ratio).xy);
            bool known = true;
            const vec2 vector = vector_at(cam, motion_base(cam, true), there, known);
            const ExpectedVectors expected = expected_vectors(block, order, true, vec2(there) - first, ratio);
            shown = known && owner_in_window(expected, NO_LAYER, vec2(0.0), vector) == place ? place : shown;
        }
    }
    return shown;
}

// The 4x4 pixels around a cell, a bit for each, row by row: those that show a nearer layer than one, it, and a farther one.
struct Window {
    uint nearer;
    uint own;
    uint farther;
};

const uint WINDOW_SIDE = 4u;

// The bits of the 3x3 pixels around the first one that has all of them, of the window's second row and column.
const uint AROUND = 0x777u;

// `first`: the window's first pixel; `origin`: the first one of the pixel's block.
Window layer_window(
    Camera cam, uint block, vec2 origin, uint order, uint place, bool current, ivec2 first, float ratio
) {
    Window window = Window(0u, 0u, 0u);
    const ivec2 size = ivec2(cam.width, cam.height);
    const bool by_vectors = current || has_earlier_vectors(cam);
    const ExpectedVectors expected = expected_vectors(block, order, current, vec2(first) - origin, ratio);
    const uint farthest = layers_in(order) - 1u;
    int row = 0;
    do {
        [[unroll]] for (int column = 0; column < int(WINDOW_SIDE); ++column) {
            const ivec2 at = first + ivec2(column, row);
            const uint bit = 1u << (uint(row) * WINDOW_SIDE + uint(column));
            if (all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, size))) {
                uint shown;
                if (by_vectors) {
                    bool known = true;
                    const vec2 vector = vector_at(cam, motion_base(cam, current), at, known);
                    shown = known ? owner_in_window(expected, farthest, vec2(column, row), vector) : NO_LAYER;
                } else {
                    shown = shown_by_paths(cam, block, origin, order, at, ratio);
                }
                window.nearer |= shown < place ? bit : 0u;
                window.own |= shown == place ? bit : 0u;
                window.farther |= shown > place && shown != NO_LAYER ? bit : 0u;
            }
        }
        row += 1;
    } while (row < int(WINDOW_SIDE));
    return window;
}

LayerView view_layer(
    Camera cam, uint frame, float parameter, uint block, vec2 origin, uint order, uint place, bool current, vec2 position,
    float ratio
) {
    LayerView view = LayerView(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, false);
    view.as_shown = TAPS == TAPS_CUBIC ? half_pel_cubic(cam, frame, to_half_pel(cam, position), parameter)
                                       : frame_bilinear(cam, frame, position);
    const Cell cell = cell_at(cam, position);
    const vec2 g = 1.0 - cell.f;
    const vec4 weights = vec4(g.x * g.y, cell.f.x * g.y, g.x * cell.f.y, cell.f.x * cell.f.y);
    const ivec2 first = ivec2(cell.low) - 1;
    const Window window = layer_window(cam, block, origin, order, place, current, first, ratio);
    float farther = 0.0;
    float pure = 0.0;
    float all_weights = 0.0;
    [[unroll]] for (uint i = 0u; i < 4u; ++i) {
        if (weights[i] < SLIGHT_WEIGHT) {
            continue;
        }
        all_weights += weights[i];
        const ivec2 at = ivec2((i & 1u) == 0u ? cell.low.x : cell.high.x, i < 2u ? cell.low.y : cell.high.y);
        const float level = load_plane(frame + frame_word(cam, TAPS == TAPS_CUBIC, at));
        const uvec2 in_window = uvec2(at - first);
        const uint own = 1u << (in_window.y * WINDOW_SIDE + in_window.x);
        const uint around = AROUND << ((in_window.y - 1u) * WINDOW_SIDE + in_window.x - 1u);
        const bool by_nearer = (window.nearer & around) != 0u;
        if ((window.own & own) != 0u) {
            const float trust = by_nearer ? MIXED_WEIGHT * weights[i] : weights[i];
            pure += by_nearer ? 0.0 : weights[i];
            view.seen += weights[i];
            view.trust += trust;
            view.level = fma(trust, level, view.level);
        } else if ((window.farther & own) != 0u) {
            view.fringe += !by_nearer && (window.own & around) != 0u ? weights[i] : 0.0;
            farther += weights[i];
            view.behind = fma(weights[i], level, view.behind);
        } else {
            view.hidden += weights[i];
        }
    }
    if (view.seen > 0.0) {
        const float others = min((1.0 - pure / all_weights) * (1.0 / LAYER_WHOLE_SHARE), 1.0);
        view.level = lerp(view.as_shown, view.level / view.trust, others);
    }
    view.has_behind = farther > 0.0;
    view.behind /= farther > 0.0 ? farther : 1.0;
    view.seen /= all_weights;
    view.fringe /= all_weights;
    view.hidden /= all_weights;
    view.trust /= all_weights;
    return view;
}

// Light of a layer over that of the farther ones, `here`; 0 if none shows. `say` is how much each frame counts.
float light_over(LayerView previous, LayerView current, vec2 say, float thickness, float here) {
    const vec2 opens = vec2(say.x * (1.0 - previous.hidden), say.y * (1.0 - current.hidden));
    const float open = opens.x + opens.y;
    const float open_current = opens.y / open;
    const float mixture = exp(lerp(previous.as_shown, current.as_shown, open_current));
    const float trust_current = say.y * current.trust;
    const float trust = fma(say.x, previous.trust, trust_current);
    const float own = trust > 0.0 ? exp(lerp(previous.level, current.level, trust_current / trust)) : mixture;
    const float coverage = min(fma(say.x, previous.seen, say.y * current.seen) / open, 1.0);
    if (here == 0.0 || coverage >= 1.0 - SLIGHT_WEIGHT) {
        return own;
    }
    const float there = lerp(
        previous.has_behind ? exp(previous.behind) : here, current.has_behind ? exp(current.behind) : here,
        open_current);
    const float unlike = min(abs(log(here / there)) * (1.0 / LAYER_BACKGROUND_LOG), 1.0);
    const float reach =
        min(fma(say.x, previous.seen + previous.fringe, say.y * (current.seen + current.fringe)) / open, 1.0);
    return lerp(here, lerp(mixture, lerp(here, own, coverage), thickness * unlike), reach);
}

// Log intensity at `alpha` of a pixel of several layers. `lost` becomes true if none of them is seen.
float synthesize_layers(Camera cam, Frames frames, uvec2 at, uint block, uint layers, float alpha, out bool lost) {
    const float ratio = interval_ratio(cam);
    const vec2 origin = first_of_block(at);
    float light = 0.0;
    uint place = layers_in(layers);
    do {
        place -= 1u;
        const uint listed = (layers >> (place * LAYER_BITS)) & LAYER_MASK;
        const Layer layer = found_layer(listed_layer[block + listed - 1u]);
        const vec4 sources = layer_sources(layer, vec2(at), alpha, ratio);
        const vec2 in_current = 0.5 * snapped(2.0 * sources.xy);
        const vec2 in_previous = 0.5 * snapped(2.0 * sources.zw);
        const LayerView previous = view_layer(
            cam, frames.previous, frames.parameters.x, block, origin, layers, place, false, in_previous, ratio);
        const LayerView current = view_layer(
            cam, frames.current, frames.parameters.y, block, origin, layers, place, true, in_current, ratio);
        const vec2 say = vec2(
            (1.0 - alpha) * max(1.0 - outside_px(cam, in_previous) * (1.0 / EDGE_PX), EDGE_WEIGHT),
            alpha * max(1.0 - outside_px(cam, in_current) * (1.0 / EDGE_PX), EDGE_WEIGHT));
        if (say.x * (previous.seen + previous.fringe) + say.y * (current.seen + current.fringe) > 0.0) {
            light = light_over(previous, current, say, layer.thickness, light);
        }
    } while (place != 0u);
    lost = light == 0.0;
    return lost ? 0.0 : log(light);
}
