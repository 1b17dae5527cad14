// One frame's half-pixel lattice takes up the detail that another frame saw between its pixels. Frames sample a
// moving surface at different places; together they know it better than each alone, and it is from between pixels
// that sub-steps are read. A strip of four 8x8 blocks at a time, by a workgroup.
//
// Needs lattice.glsl, trajectory.glsl, margin.glsl, COMPONENTS and `vec2 motion_near(Camera, ivec2)`: motion over the
// interval at a pixel of the strip, or beside it.

// Pixels that a strip's half sites lie between: the strip and the next column and row.
const uint SITES_X = STRIP_PX + 1u;
const uint SITES = SITES_X * (BLOCK_PX + 1u);

// Displacement to the other frame, trust, residual of the first component there.
shared vec4 sites[SITES];
// Residuals of the second and third one.
shared vec2 further_residuals[COMPONENTS > 1u ? SITES : 1u];

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

// A site whose levels are `levels`, displaced by `shift` to the frame of the first component at `other`.
void note_site(Camera cam, uint site, ivec2 at, float levels[COMPONENTS], vec2 shift, uint other) {
    const vec2 there = to_lattice(cam, vec2(at) + shift);
    vec3 residual = vec3(0.0);
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        residual[k] = levels[k] - lattice_cubic(cam, other + k * cam.frame_words, there);
    }
    sites[site] = vec4(shift, trust_at(cam, at, shift), residual.x);
    if (COMPONENTS > 1u) {
        further_residuals[site] = residual.yz;
    }
}

// What the sites around a half site say.
struct Around {
    vec2 shift;
    float trust;
    vec3 residual;
};

const Around NOTHING_AROUND = Around(vec2(0.0), 0.0, vec3(0.0));

// Around the half site right and below a pixel of the strip.
Around around_half_site(uvec2 in_strip, ivec2 half_step) {
    const uint site = in_strip.y * SITES_X + in_strip.x;
    const uint right = site + uint(half_step.x);
    const uint below = uint(half_step.y) * SITES_X;
    const vec4 all = 0.25 * (sites[site] + sites[right] + sites[site + below] + sites[right + below]);
    vec2 further = vec2(0.0);
    if (COMPONENTS > 1u) {
        further = 0.25
            * (further_residuals[site] + further_residuals[right] + further_residuals[site + below]
               + further_residuals[right + below]);
    }
    return Around(all.xy, all.z, vec3(all.w, further));
}

// What the frame at `other` saw at a half site of its component `component`.
float seen_from(Camera cam, uint other, uint component, ivec2 at, ivec2 half_step, Around around) {
    const vec2 there = to_lattice(cam, vec2(at) + 0.5 * vec2(half_step) + around.shift);
    return lattice_cubic(cam, other, there) + around.residual[component];
}
