// Samples the other frame at a pixel and its three half-pel neighbours from one 5x5 footprint without corners: 21
// loads, not 48. Assumes nearly equal motion. Needs half_pel.glsl, detail_anchors.glsl.

// Where a pixel and its half-pel samples are read in another frame.
struct SampleQuad {
    // Word of the footprint's first sample, within the frame.
    uint first;
    // Position in its own cell: of the pixel, and of its half-pel samples right, below, and right and below.
    vec2 f[4];
};

// The quad of pixel `at`, displaced by `shift`, and its half-pel samples, displaced by `half_shifts`. The cell follows
// from rendered motion without a rounding, so that every device finds the same one.
SampleQuad sample_quad(Camera cam, ivec2 at, vec2 shift, vec2 half_shifts[3]) {
    const vec2 last = vec2(2u * uvec2(cam.width, cam.height) - 1u);
    const vec2 anchor = vec2(2 * at);
    const vec2 cell = clamp(anchor + floor(2.0 * shift), vec2(0.0), last - 1.0);
    SampleQuad quad;
    quad.first = uint(cell.y) * cam.half_pel_stride + uint(cell.x) + 1u;
    quad.f[0] = clamp(fma(vec2(2.0), shift, anchor - cell), -cell, last - cell);
    [[unroll]] for (int phase = 1; phase < 4; ++phase) {
        const vec2 corner = cell + vec2(phase_offset_of(phase));
        const vec2 f = fma(vec2(2.0), half_shifts[phase - 1], anchor - cell);
        quad.f[phase] = clamp(f, max(-corner, -CELL_SLACK), min(last - corner, 1.0 + CELL_SLACK));
    }
    return quad;
}

// Samples the frame at `base` at a pixel's position and, if `with_half_pels`, at those of its half-pel samples;
// `parameter` is Keys'.
vec4 sample_shared_footprint(Camera cam, uint base, SampleQuad quad, float parameter, bool with_half_pels) {
    float rows[5][5];
    [[unroll]] for (uint j = 0u; j < 5u; ++j) {
        const uint row = base + quad.first + j * cam.half_pel_stride;
        [[unroll]] for (uint i = 0u; i < 5u; ++i) {
            // No sample reads the corners.
            if (i % 4u != 0u || j % 4u != 0u) {
                rows[j][i] = load_in_row(cam, row, i);
            }
        }
    }
    vec4 reprojected = vec4(0.0);
    [[unroll]] for (int phase = 0; phase < 4; ++phase) {
        if (phase == 0 || with_half_pels) {
            const int i = phase_offset_of(phase).x;
            const int j = phase_offset_of(phase).y;
            const CubicTaps taps = CubicTaps(
                vec2(rows[j][i + 1], rows[j][i + 2]),
                vec4(rows[j + 1][i], rows[j + 1][i + 1], rows[j + 1][i + 2], rows[j + 1][i + 3]),
                vec4(rows[j + 2][i], rows[j + 2][i + 1], rows[j + 2][i + 2], rows[j + 2][i + 3]),
                vec2(rows[j + 3][i + 1], rows[j + 3][i + 2]));
            reprojected[phase] = cubic(taps, quad.f[phase], parameter);
        }
    }
    return reprojected;
}
