// Writing a half-pel frame. Needs frame_words.glsl, `planes` and `store_pair`, which writes two neighbouring words.

// Writes the copies of an outermost pixel's samples to the border.
void store_border(Camera cam, uint base, ivec2 at, vec4 entries) {
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const ivec2 own = 2 * at + ivec2(2, 1);
    const ivec2 from = ivec2(at.x == 0 ? 1 : own.x, at.y == 0 ? 0 : own.y);
    const ivec2 to = own + 1 + 2 * ivec2(equal(at, last));
    for (int row = from.y; row <= to.y; ++row) {
        const vec2 pair = row <= own.y ? entries.xy : entries.zw;
        for (int column = from.x; column <= to.x; ++column) {
            planes[base + uint(row) * cam.half_pel_stride + uint(column)] = column <= own.x ? pair.x : pair.y;
        }
    }
}

// Writes a pixel's sample of the half-pel frame at `base` and its half-pel samples right, below, and right and below.
void store_entries(Camera cam, uint base, ivec2 at, vec4 entries) {
    const uint word = base + frame_word(cam, true, at);
    store_pair(cam, word, entries.xy);
    store_pair(cam, word + cam.half_pel_stride, entries.zw);
    const ivec2 room = min(at, ivec2(cam.width, cam.height) - 1 - at);
    if (min(room.x, room.y) == 0) {
        store_border(cam, base, at, entries);
    }
}
