// A pixel's synthesis: its inputs, and its log intensity at the ends of sub-steps. Needs synthesize.glsl, rigid.glsl and
// layers.glsl, RIGID, LAYERED and FOLLOWS_MOTION.

// Inputs of a pixel's synthesis.
struct Source {
    uvec2 at;
    Frames frames;
    // Log intensity in both frames.
    float log_previous;
    float log_current;
    // Whether the pixel has a usable motion vector; its warp; whether the warp may leave the image.
    bool warps;
    Warp warp;
    bool leaves;
    // Its surfaces, for synthesis `rigid`.
    RigidPixel rigid;
    // Whether it is unoccluded, and its path then.
    bool unoccluded;
    OwnPath path;
    // Its layers from near to far, and the first of its block's; none if it follows one surface.
    uint layers;
    uint layer_block;
};

// Log of the linear blend of both frames at `alpha`. `prepare_blend` takes the exponentials in advance, on devices
// where that is cheaper.
float blend_frames(Source s, float alpha);
void prepare_blend(Source s);

// Log intensity at a fraction of the interval, along one surface.
float synthesize(Camera cam, Source s, float alpha) {
    if (SYNTHESIS == SYNTHESIS_LINEAR || !s.warps) {
        return max(blend_frames(s, alpha), cam.log_dark);
    } else if (SYNTHESIS == SYNTHESIS_MOTION) {
        return max(synthesize_motion(cam, s.frames, vec2(s.at), s.warp, s.leaves, alpha), cam.log_dark);
    }
    return max(synthesize_paper(cam, s.frames, ivec2(s.at), alpha), cam.log_dark);
}

// Whether a pixel shows one surface in all sub-steps, so that `level_of_one` makes its levels; else `level_of_many` does.
bool shows_one(Source s) {
    return RIGID ? s.unoccluded : !LAYERED || !s.warps || s.layers == 0u;
}

// Log intensity at the end of sub-step `i` of `n`, at `alpha`, before the interval's end.
float level_of_one(Camera cam, Geometry geo, Source s, uint n, uint i, float alpha) {
    if (RIGID) {
        return max(level_on_path(cam, geo, s.frames, vec2(s.at), s.path, n, i, alpha), cam.log_dark);
    }
    return synthesize(cam, s, alpha);
}

// The same of any pixel; `lost` becomes true if none of its surfaces is there.
float level_of_many(Camera cam, Geometry geo, Source s, uint n, uint i, float alpha, out bool lost) {
    lost = true;
    float level = cam.log_dark;
    if (RIGID && s.rigid.own != NO_SURFACE) {
        level = synthesize_rigid(cam, geo, s.frames, s.at, s.rigid, n, i, alpha, lost);
    } else if (LAYERED && s.layers != 0u) {
        level = synthesize_layers(cam, s.frames, s.at, s.layer_block, s.layers, alpha, lost);
    }
    return max(level, cam.log_dark);
}

// The same where none of the pixel's surfaces is there.
float level_of_lost(Camera cam, Source s, float alpha) {
    float level;
    if (s.warps) {
        // Along exact paths made for each sub-step: few pixels have no path, and all others would hold its registers.
        const Warp warp = RIGID ? warp_at(cam, s.at, s.leaves) : s.warp;
        level = synthesize_motion(cam, s.frames, vec2(s.at), warp, s.leaves, alpha);
    } else {
        level = blend_frames(s, alpha);
    }
    return max(level, cam.log_dark);
}

// Loads the inputs that do not depend on the pixel's number of sub-steps.
Source read_source(Camera cam, uvec2 at) {
    Source s;
    s.at = at;
    s.frames = frames_of(cam, at);
    const uint word = frame_word(cam, has_half_pel_frames(), ivec2(at));
    s.log_previous = load_plane(s.frames.previous + word);
    s.log_current = load_plane(s.frames.current + word);
    s.warps = FOLLOWS_MOTION && (!RIGID || cam.has_motion != 0u) && has_vector(cam, motion_base(cam, true), ivec2(at));
    s.leaves = false;
    s.unoccluded = false;
    s.layers = 0u;
    prepare_blend(s);
    return s;
}

// Finds what a pixel with `n` sub-steps follows, in the tile's `in_tile`th block. The lists of the tile's blocks are made.
void prepare_source(Camera cam, inout Source s, uint n, uint in_tile) {
    s.warps = s.warps && n > 1u;
    if (SYNTHESIS == SYNTHESIS_MOTION && s.warps) {
        s.warp = warp_at(cam, s.at, s.leaves);
        if (LAYERED) {
            s.layers = layers_of_pixel(cam, s.at, in_tile);
            s.layer_block = in_tile * BLOCK_LAYERS;
        }
    }
    if (RIGID) {
        const Geometry geo = geometries[cam.slot];
        s.rigid = read_rigid_pixel(cam, geo, s.at, in_tile);
        s.unoccluded = n > 1u && is_unoccluded(cam, geo, vec2(s.at), s.rigid, in_tile);
        s.path = own_path(s.rigid);
    }
}

// Counting of the samples of a pixel that show what neither key frame shows.
void begin_count() {
    unseen_samples = 0u;
}

uint count_unseen(Source s, uint n) {
    return unseen_samples;
}
