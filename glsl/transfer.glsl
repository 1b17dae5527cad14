// One frame's half-pixel lattice takes up the detail that another frame saw between its pixels. Frames sample a
// moving surface at different places; together they know it better than each alone, and it is from between pixels
// that sub-steps are read. A strip of four 8x8 blocks at a time, by a workgroup.
//
// Needs trajectory.glsl, strips.glsl, COMPONENTS and `vec2 motion_near(Camera, ivec2)`: motion over the interval at a
// pixel that is at most one from the sites; NOWHERE_PX where it is not usable, and beyond the image as at its edge.

// Pixels that a strip's half sites lie between: the strip and the next column and row.
const uint SITES_X = STRIP_PX + 1u;
const uint SITES = SITES_X * (BLOCK_PX + 1u);

// Of the sites: what a pixel has more than the other frame shows there, component after component, and trust.
shared float residuals[COMPONENTS * SITES];
shared float trusts[SITES];

// From a pixel of the strip to the one of its half sites that is `half_phase`, 1 to 3.
ivec2 half_step_of(int half_phase) {
    return ivec2(half_phase & 1, half_phase >> 1);
}

// Sites as threads take them: the strip's pixels first, then the next column, then the next row.
const uint OWN_SITES = STRIP_PX * BLOCK_PX;

uvec2 site_at(uint number) {
    const uint beside = number - OWN_SITES;
    return number < OWN_SITES
        ? uvec2(number % STRIP_PX, number / STRIP_PX)
        : beside < BLOCK_PX ? uvec2(STRIP_PX, beside) : uvec2(beside - BLOCK_PX, BLOCK_PX);
}

uint site_index(uvec2 site) {
    return site.y * SITES_X + site.x;
}

// The pixel of a site; beyond the image there is only its last pixel.
ivec2 site_pixel(Camera cam, ivec2 corner, uvec2 site) {
    return min(corner + ivec2(site), ivec2(cam.width, cam.height) - 1);
}

// Whether a site has half sites of its own in the image.
bool has_half_sites(Camera cam, ivec2 corner, uvec2 site) {
    return site.x < STRIP_PX && site.y < BLOCK_PX && corner.x + int(site.x) < int(cam.width)
        && corner.y + int(site.y) < int(cam.height);
}

// Motion of a pixel that has no usable vector: it agrees with nobody's.
const float NOWHERE_PX = 1e30;

// Motion at a pixel and around it, row after row.
vec2[9] motions_around(Camera cam, ivec2 at) {
    vec2 motions[9];
    [[unroll]] for (int i = 0; i < 9; ++i) {
        motions[i] = motion_near(cam, at + ivec2(i % 3 - 1, i / 3 - 1));
    }
    return motions;
}

// Where neighbouring vectors disagree, or the path leaves the image, the other frame is not trusted.
float trust_at(Camera cam, ivec2 at, vec2 motions[9], vec2 shift) {
    const vec2 own = motions[4];
    vec2 least = own;
    vec2 most = own;
    [[unroll]] for (int i = 0; i < 9; ++i) {
        least = min(least, motions[i]);
        most = max(most, motions[i]);
    }
    const vec2 disagreement = max(own - least, most - own);
    const float agreement = clamp(2.0 - max(disagreement.x, disagreement.y) * (1.0 / TRUST_PX), 0.0, 1.0);
    return own.x < NOWHERE_PX ? agreement * max(1.0 - outside_px(cam, vec2(at) + shift), 0.0) : 0.0;
}

// What the sites around a half site say.
struct Around {
    float trust;
    vec3 residual;
};

const Around NOTHING_AROUND = Around(0.0, vec3(0.0));

// The mean of the four sites around a half site, of those around a pixel of the strip: the pixel's, and those right,
// below, and right and below of it.
float mean_around(vec4 sites, ivec2 half_step) {
    const int below = 2 * half_step.y;
    return 0.25 * (sites[0] + sites[half_step.x] + sites[below] + sites[below + half_step.x]);
}

vec4 residuals_around(uint site) {
    return vec4(residuals[site], residuals[site + 1u], residuals[site + SITES_X], residuals[site + SITES_X + 1u]);
}

// Around the half sites right, below, and right and below a pixel of the strip.
Around[3] around_half_sites(uvec2 in_strip) {
    const uint site = site_index(in_strip);
    const vec4 trust = vec4(trusts[site], trusts[site + 1u], trusts[site + SITES_X], trusts[site + SITES_X + 1u]);
    Around around[3] = Around[3](NOTHING_AROUND, NOTHING_AROUND, NOTHING_AROUND);
    [[unroll]] for (int half_phase = 1; half_phase < 4; ++half_phase) {
        around[half_phase - 1].trust = mean_around(trust, half_step_of(half_phase));
    }
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        const vec4 residual = residuals_around(k * SITES + site);
        [[unroll]] for (int half_phase = 1; half_phase < 4; ++half_phase) {
            around[half_phase - 1].residual[k] = mean_around(residual, half_step_of(half_phase));
        }
    }
    return around;
}
