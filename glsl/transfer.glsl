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

// Where neighbouring vectors disagree, or the path leaves the image, the other frame is not trusted.
float trust_at(Camera cam, ivec2 at, vec2 shift) {
    const vec2 own = motion_near(cam, at);
    vec2 least = own;
    vec2 most = own;
    [[unroll]] for (int j = -1; j <= 1; ++j) {
        [[unroll]] for (int i = -1; i <= 1; ++i) {
            if (i != 0 || j != 0) {
                const vec2 m = motion_near(cam, at + ivec2(i, j));
                least = min(least, m);
                most = max(most, m);
            }
        }
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

// Around the half site right and below a pixel of the strip.
Around around_half_site(uvec2 in_strip, ivec2 half_step) {
    const uint site = site_index(in_strip);
    const uint right = site + uint(half_step.x);
    const uint below = uint(half_step.y) * SITES_X;
    Around around = NOTHING_AROUND;
    around.trust = 0.25 * (trusts[site] + trusts[right] + trusts[site + below] + trusts[right + below]);
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        const uint left = k * SITES + site;
        const uint next = k * SITES + right;
        around.residual[k] =
            0.25 * (residuals[left] + residuals[next] + residuals[left + below] + residuals[next + below]);
    }
    return around;
}
