// Stores to `planes` of two words at once.
layout(buffer_reference, std430, buffer_reference_align = 8) writeonly buffer HalfPelPair { vec2 v; };

void store_pair(Camera cam, uint word, vec2 pair) {
    HalfPelPair(cam.planes_address + 4u * word).v = pair;
}
