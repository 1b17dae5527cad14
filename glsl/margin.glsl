// Writes an entry of a lattice, and for an outermost one its copies in the margin. Needs `planes`.
void store_entry(Camera cam, uint base, uvec2 entry, float value) {
    const uvec2 end = 2u * uvec2(cam.width, cam.height) - 1u;
    planes[base + (entry.y + 1u) * cam.lattice_stride + entry.x + 1u] = value;
    if (any(equal(entry, uvec2(0u))) || any(equal(entry, end))) {
        const uvec2 first = uvec2(entry.x == 0u ? 0u : entry.x + 1u, entry.y == 0u ? 0u : entry.y + 1u);
        const uvec2 last = entry + uvec2(entry.x == end.x ? 3u : 1u, entry.y == end.y ? 3u : 1u);
        for (uint row = first.y; row <= last.y; ++row) {
            for (uint column = first.x; column <= last.x; ++column) {
                planes[base + row * cam.lattice_stride + column] = value;
            }
        }
    }
}
