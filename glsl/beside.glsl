// What one frame's lattice shows at a pixel and its three half sites of another frame, by the taps of four cells that
// lie to each other as these do. They are a half pixel apart, and what little the motion changes from one to the next,
// so that 21 entries serve in place of 48. Needs lattice.glsl, transfer.glsl.

// Where a lattice is read.
struct Places {
    // Word of the first entry that serves, within the frame.
    uint first;
    // Of the pixel, and of its half sites right, below, and right and below.
    vec2 f[4];
};

// The places of pixel `at`, displaced by `shift`, and of its half sites, displaced by `half_shifts`. The cell is found
// from what was rendered, without a rounding, so that every device finds the same.
Places places_beside(Camera cam, ivec2 at, vec2 shift, vec2 half_shifts[3]) {
    const vec2 last = vec2(2u * uvec2(cam.width, cam.height) - 1u);
    const vec2 site = vec2(2 * at);
    const vec2 cell = clamp(site + floor(2.0 * shift), vec2(0.0), last - 1.0);
    Places places;
    places.first = uint(cell.y) * cam.lattice_stride + uint(cell.x) + 1u;
    places.f[0] = clamp(fma(vec2(2.0), shift, site - cell), -cell, last - cell);
    [[unroll]] for (int half_phase = 1; half_phase < 4; ++half_phase) {
        const vec2 corner = cell + vec2(half_step_of(half_phase));
        const vec2 f = fma(vec2(2.0), half_shifts[half_phase - 1], site - cell);
        places.f[half_phase] = clamp(f, max(-corner, -CELL_SLACK), min(last - corner, 1.0 + CELL_SLACK));
    }
    return places;
}

// Entry `i` of a row whose first one is at `row`.
float in_row(Camera cam, uint row, uint i) {
    return BY_ADDRESS ? LatticeRow(cam.planes_address + 4u * row).v[i] : plane_at(row + i);
}

// What the frame at `base` shows at a pixel's own place and, if they are asked for, at those of its half sites.
vec4 seen_beside(Camera cam, uint base, Places places, bool half_sites) {
    float rows[5][5];
    [[unroll]] for (uint j = 0u; j < 5u; ++j) {
        const uint row = base + places.first + j * cam.lattice_stride;
        [[unroll]] for (uint i = 0u; i < 5u; ++i) {
            // The corners are nobody's.
            if (i % 4u != 0u || j % 4u != 0u) {
                rows[j][i] = in_row(cam, row, i);
            }
        }
    }
    vec4 seen = vec4(0.0);
    [[unroll]] for (int half_phase = 0; half_phase < 4; ++half_phase) {
        if (half_phase == 0 || half_sites) {
            const int i = half_step_of(half_phase).x;
            const int j = half_step_of(half_phase).y;
            seen[half_phase] = cubic(
                vec2(rows[j][i + 1], rows[j][i + 2]),
                vec4(rows[j + 1][i], rows[j + 1][i + 1], rows[j + 1][i + 2], rows[j + 1][i + 3]),
                vec4(rows[j + 2][i], rows[j + 2][i + 1], rows[j + 2][i + 2], rows[j + 2][i + 3]),
                vec2(rows[j + 3][i + 1], rows[j + 3][i + 2]), places.f[half_phase], CUBIC_LATTICE);
        }
    }
    return seen;
}
