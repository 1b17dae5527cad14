// A pixel whose levels `synthesize` has made. Needs levels.glsl and the buffer `levels`.

struct Source {
    uvec2 at;
    // Log intensity in both frames.
    float log_previous;
    float log_current;
    // The pixel's word in the first row of its block's levels.
    uint first_level;
};

// Loads the inputs that do not depend on the pixel's number of sub-steps.
Source read_source(Camera cam, uvec2 at) {
    Source s;
    s.at = at;
    const Frames frames = frames_of(cam, INTENSITY == INTENSITY_BAYER_RGGB ? (at.x & 1u) + (at.y & 1u) : 0u);
    const uint word = frame_word(cam, has_half_pel_frames(), ivec2(at));
    s.log_previous = load_plane(frames.previous + word);
    s.log_current = load_plane(frames.current + word);
    s.first_level = 0u;
    return s;
}

void prepare_source(Camera cam, inout Source s, uint n, uint in_tile) {}

Geometry geometry_of(Camera cam) {
    Geometry geo;
    return geo;
}

// Log intensity at the end of sub-step `i` of `n`, before the interval's end.
float synthesize_substep(Camera cam, Geometry geo, Source s, uint n, uint i, float alpha) {
    return uintBitsToFloat(levels[s.first_level + i * ROW_WORDS]);
}

// Counting of the samples of a pixel that show what neither key frame shows: `synthesize` has done it.
void begin_count() {}

uint count_unseen(Source s, uint n) {
    return n > 1u ? levels[s.first_level] >> LIST_BITS : 0u;
}
