// A pixel whose levels `synthesize` has made, or that shows one surface: it is unoccluded, or has no layers. Needs levels.glsl,
// unoccluded.glsl, LAYERED, FOLLOWS_MOTION and the buffer `levels`.

struct Source {
    uvec2 at;
    // Log intensity in both frames.
    float log_previous;
    float log_current;
    // The block's word in `level_words`.
    uint of_block;
    // Whether the pixel shows one surface. Then its path or, where motions meet, whether it has a usable motion vector, its
    // warp, and whether that may leave the image.
    bool one_surface;
    Frames frames;
    OwnPath path;
    bool warps;
    Warp warp;
    bool leaves;
    // The pixel's word in the first row of its block's levels.
    uint first_level;
};

// Loads the inputs that do not depend on the pixel's number of sub-steps.
Source read_source(Camera cam, uvec2 at) {
    Source s;
    s.at = at;
    s.frames = frames_of(cam, at);
    const uint word = frame_word(cam, has_half_pel_frames(), ivec2(at));
    s.log_previous = load_plane(s.frames.previous + word);
    s.log_current = load_plane(s.frames.current + word);
    s.of_block = 0u;
    s.first_level = 0u;
    s.one_surface = false;
    s.warps = false;
    s.leaves = false;
    return s;
}

// Finds where the levels of a pixel with `n` sub-steps are; `of_block` is its block's word in `level_words`.
void prepare_source(Camera cam, inout Source s, uint n, uint in_tile) {
    if (n <= 1u) {
        return;
    }
    const bool rows = has_rows(s.of_block);
    s.first_level = rows ? first_level_word(s.of_block, s.at) : 0u;
    s.one_surface = !rows || (levels[s.first_level] & LIST_MASK) == (RIGID ? UNOCCLUDED : 0u);
    if (LAYERED && s.one_surface) {
        s.warps = has_vector(cam, motion_base(cam, true), ivec2(s.at));
        if (s.warps) {
            s.warp = warp_at(cam, s.at, s.leaves);
        }
    }
    if (RIGID && s.one_surface) {
        const Geometry geo = geometries[cam.slot];
        s.path = own_path(own_surfaces(cam, geo, s.at, ray_of(geo, vec2(s.at))));
    }
}

// Log of the linear blend of both frames at `alpha`.
float blend_frames(Source s, float alpha);

// Whether `level_of_one` makes a pixel's levels: it makes or reads those of all pixels.
bool shows_one(Source s) {
    return true;
}

float level_of_many(Camera cam, Geometry geo, Source s, uint n, uint i, float alpha, out bool lost) {
    lost = false;
    return 0.0;
}

float level_of_lost(Camera cam, Source s, float alpha) {
    return 0.0;
}

// Log intensity at the end of sub-step `i` of `n`, before the interval's end.
float level_of_one(Camera cam, Geometry geo, Source s, uint n, uint i, float alpha) {
    if (LAYERED && s.one_surface) {
        const float level = s.warps ? synthesize_motion(cam, s.frames, vec2(s.at), s.warp, s.leaves, alpha)
                                    : blend_frames(s, alpha);
        return max(level, cam.log_dark);
    }
    if (RIGID && s.one_surface) {
        return max(level_on_path(cam, geo, s.frames, vec2(s.at), s.path, n, i, alpha), cam.log_dark);
    }
    return uintBitsToFloat(levels[s.first_level + i * LEVEL_ROW_WORDS]);
}

// Counting of the samples of a pixel that show what neither key frame shows: `synthesize` has done it.
void begin_count() {}

uint count_unseen(Source s, uint n) {
    return n > 1u && !s.one_surface ? levels[s.first_level] >> LIST_BITS : 0u;
}
