// Stores to `planes`, word by word unless BY_ADDRESS (see frame_load_by_texel.glsl).
layout(buffer_reference, std430, buffer_reference_align = 8) writeonly buffer HalfPelPair { vec2 v; };

void store_pair(Camera cam, uint word, vec2 pair) {
    if (BY_ADDRESS) {
        HalfPelPair(cam.planes_address + 4u * word).v = pair;
    } else {
        planes[word] = pair.x;
        planes[word + 1u] = pair.y;
    }
}
