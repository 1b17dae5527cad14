// One frame's half-pixel lattice takes up the detail that another frame saw between its pixels. Frames sample a
// moving surface at different places; together they know it better than each alone, and it is from between pixels
// that sub-steps are read. A strip of four 8x8 blocks at a time, by a workgroup.
//
// Needs lattice.glsl, trajectory.glsl, margin.glsl and `vec2 motion_near(Camera, ivec2)`: motion over the interval
// at a pixel of the strip, or beside it.

// Pixels that a strip's half sites lie between: the strip and the next column and row.
const uint SITES_X = STRIP_PX + 1u;
const uint SITES = SITES_X * (BLOCK_PX + 1u);

// Displacement to the other frame, residual there, trust.
shared vec4 sites[SITES];

// The pixel of a site; beyond the image there is only its last pixel.
ivec2 site_pixel(Camera cam, ivec2 corner, uint site) {
    return min(corner + ivec2(site % SITES_X, site / SITES_X), ivec2(cam.width, cam.height) - 1);
}

// Where neighbouring vectors disagree, or the path leaves the image, the other frame is not trusted.
float trust_at(Camera cam, ivec2 at, vec2 shift) {
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const vec2 own = motion_near(cam, at);
    float disagreement = 0.0;
    bool valid = true;
    [[unroll]] for (int j = -1; j <= 1; ++j) {
        [[unroll]] for (int i = -1; i <= 1; ++i) {
            const vec2 m = motion_near(cam, clamp(at + ivec2(i, j), ivec2(0), last));
            disagreement = max(disagreement, max(abs(m.x - own.x), abs(m.y - own.y)));
            valid = valid && floatBitsToUint(m.x) != INVALID_BIT;
        }
    }
    const float agreement = clamp(2.0 - disagreement / TRUST_PX, 0.0, 1.0);
    return valid ? agreement * max(1.0 - outside_px(cam, vec2(at) + shift), 0.0) : 0.0;
}

// A site whose level is `level`, displaced by `shift` to the frame at `other`.
void note_site(Camera cam, uint site, ivec2 at, float level, vec2 shift, uint other) {
    const float residual = level - lattice_cubic(cam, other, to_lattice(cam, vec2(at) + shift));
    sites[site] = vec4(shift, residual, trust_at(cam, at, shift));
}

// What the sites around a half site say, the one right and below a pixel of the strip.
vec4 around_half_site(uvec2 in_strip, ivec2 half_step) {
    const uint site = in_strip.y * SITES_X + in_strip.x;
    const uint right = site + uint(half_step.x);
    const uint below = uint(half_step.y) * SITES_X;
    return 0.25 * (sites[site] + sites[right] + sites[site + below] + sites[right + below]);
}

// What the frame at `other` saw at a half site.
float seen_from(Camera cam, uint other, ivec2 at, ivec2 half_step, vec4 around) {
    return lattice_cubic(cam, other, to_lattice(cam, vec2(at) + 0.5 * vec2(half_step) + around.xy)) + around.z;
}
