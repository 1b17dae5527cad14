// Temporal detail transfer: a half-pel frame takes detail from the other frame. Frames sample a moving surface at
// different positions, so both together resolve more than either alone, and sub-steps are read between the pixels. One
// workgroup does one tile.
//
// Anchors are the pixels that a tile's half-pel samples lie between: the tile and the next column and row. Needs
// trajectory.glsl, tiles.glsl, COMPONENTS and `vec2 motion_near(Camera, ivec2)`: motion at a pixel at most one away
// from an anchor; NOWHERE_PX without a usable vector; beyond the image that of its border.

// Anchors in a row, and in all.
const uint ANCHORS_X = TILE_WIDTH_PX + 1u;
const uint ANCHORS = ANCHORS_X * (BLOCK_PX + 1u);

// For each anchor: its level minus that of the other frame at the same surface point, component by component, and the
// confidence in the other frame.
shared float residuals[COMPONENTS * ANCHORS];
shared float confidences[ANCHORS];

// Offset, in half pixels, from a pixel to its half-pel sample of a phase, 1 to 3.
ivec2 phase_offset_of(int phase) {
    return ivec2(phase & 1, phase >> 1);
}

// Anchors in the order in which threads take them: the tile's pixels, the next column, the next row.
const uint TILE_ANCHORS = TILE_WIDTH_PX * BLOCK_PX;

uvec2 anchor_at(uint number) {
    const uint beside = number - TILE_ANCHORS;
    return number < TILE_ANCHORS
        ? uvec2(number % TILE_WIDTH_PX, number / TILE_WIDTH_PX)
        : beside < BLOCK_PX ? uvec2(TILE_WIDTH_PX, beside) : uvec2(beside - BLOCK_PX, BLOCK_PX);
}

uint anchor_index(uvec2 anchor) {
    return anchor.y * ANCHORS_X + anchor.x;
}

// The pixel of an anchor, clamped to the image.
ivec2 anchor_pixel(Camera cam, ivec2 corner, uvec2 anchor) {
    return min(corner + ivec2(anchor), ivec2(cam.width, cam.height) - 1);
}

// Whether an anchor is a pixel of the tile and the image, which has half-pel samples of its own.
bool has_half_pels(Camera cam, ivec2 corner, uvec2 anchor) {
    return anchor.x < TILE_WIDTH_PX && anchor.y < BLOCK_PX && corner.x + int(anchor.x) < int(cam.width)
        && corner.y + int(anchor.y) < int(cam.height);
}

// Motion of a pixel without a usable vector: far from any other.
const float NOWHERE_PX = 1e30;

// Motion at a pixel and its eight neighbours, row by row.
vec2[9] motions_around(Camera cam, ivec2 at) {
    vec2 motions[9];
    [[unroll]] for (int i = 0; i < 9; ++i) {
        motions[i] = motion_near(cam, at + ivec2(i % 3 - 1, i / 3 - 1));
    }
    return motions;
}

// Largest difference of a pixel's vector to one of its neighbours, pixels, of the larger component; NOWHERE_PX or about that
// if one of them has no usable vector.
float disagreement_px(vec2 motions[9]) {
    const vec2 own = motions[4];
    vec2 least = own;
    vec2 most = own;
    [[unroll]] for (int i = 0; i < 9; ++i) {
        least = min(least, motions[i]);
        most = max(most, motions[i]);
    }
    const vec2 disagreement = max(own - least, most - own);
    return own.x < NOWHERE_PX ? max(disagreement.x, disagreement.y) : NOWHERE_PX;
}

// Confidence in the other frame, 0 to 1; 0 where vectors disagree too much or the pixel's place there is outside the image.
float confidence_at(Camera cam, float disagreement, vec2 there) {
    const float agreement = clamp(2.0 - disagreement * (1.0 / CONFIDENCE_PX), 0.0, 1.0);
    return agreement * max(1.0 - outside_px(cam, there), 0.0);
}

// The correction of a half-pel sample, interpolated from the anchors around it.
struct Correction {
    float confidence;
    vec3 residual;
};

const Correction NO_CORRECTION = Correction(0.0, vec3(0.0));

// Interpolates at a half-pel sample from a quad of anchors: a pixel and those right, below, and right and below of it.
float mean_of_quad(vec4 anchors, ivec2 phase_offset) {
    const int below = 2 * phase_offset.y;
    return 0.25 * (anchors[0] + anchors[phase_offset.x] + anchors[below] + anchors[below + phase_offset.x]);
}

vec4 residual_quad(uint anchor) {
    return vec4(
        residuals[anchor], residuals[anchor + 1u], residuals[anchor + ANCHORS_X], residuals[anchor + ANCHORS_X + 1u]);
}

// Corrections of the half-pel samples right, below, and right and below of a pixel of the tile.
Correction[3] corrections_at(uvec2 in_tile) {
    const uint anchor = anchor_index(in_tile);
    const vec4 confidence = vec4(
        confidences[anchor], confidences[anchor + 1u], confidences[anchor + ANCHORS_X],
        confidences[anchor + ANCHORS_X + 1u]);
    Correction corrections[3] = Correction[3](NO_CORRECTION, NO_CORRECTION, NO_CORRECTION);
    [[unroll]] for (int phase = 1; phase < 4; ++phase) {
        corrections[phase - 1].confidence = mean_of_quad(confidence, phase_offset_of(phase));
    }
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        const vec4 residual = residual_quad(k * ANCHORS + anchor);
        [[unroll]] for (int phase = 1; phase < 4; ++phase) {
            corrections[phase - 1].residual[k] = mean_of_quad(residual, phase_offset_of(phase));
        }
    }
    return corrections;
}
