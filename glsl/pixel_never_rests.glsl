// What `cross` asks of a pixel model that cannot tell until when a pixel sends nothing: see resting.glsl.

void pass_intervals(Camera cam, uvec2 counts, uvec2 lengths_ns, int level, inout PixelState p) {}

uint rest_units(Camera cam, PixelState p, int level) {
    return 0u;
}
