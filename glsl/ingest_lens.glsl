// What a lens does to light before a pixel sees it: blur and vignetting. Twin of the model crate's `optics`. Included by
// ingest.glsl.

// The tile, its apron, and as many rows above and below as light is spread.
const uint BLURRED_X = CACHE_X;
const uint BLURRED_Y = CACHE_Y + 2u * PSF_RADIUS_PX;

// Blurred along x: the sum of the valid pixels' colours and that of their weights. Lists leave no room for it in shared
// memory. There each pixel blurs the rows around it again.
const bool SHARES_BLURRED_ROWS = EFFECT_PSF && !MAKES_LISTS;
shared vec4 blurred_rows[SHARES_BLURRED_ROWS ? BLURRED_X * BLURRED_Y : 1u];

float psf_weight(Optics row, int distance_px) {
    return vec4(row.psf_0, row.psf_1, row.psf_2, row.psf_3)[abs(distance_px)];
}

// The light around pixel `at` of the image, blurred along x.
vec4 blurred_row(Camera cam, Optics row, ivec2 at) {
    const ivec2 last = ivec2(cam.width, cam.height) - 1;
    const uint row_pixel = uint(clamp(at.y, 0, last.y)) * cam.width;
    vec4 sum = vec4(0.0);
    [[unroll]] for (int d = -PSF_RADIUS_PX; d <= PSF_RADIUS_PX; ++d) {
        const vec3 colour = read_colour(cam, row_pixel + uint(clamp(at.x + d, 0, last.x)));
        if (!is_invalid(cam, colour)) {
            sum += psf_weight(row, d) * vec4(colour, 1.0);
        }
    }
    return sum;
}

// Fills `blurred_rows`. Called by the whole workgroup; ends with a barrier.
void blur_rows(Camera cam) {
    const Optics row = optics[cam.slot];
    const ivec2 first = tile_origin - int(APRON_BEFORE_PX) - ivec2(0, PSF_RADIUS_PX);
    uint entry = gl_LocalInvocationID.x;
    do {
        blurred_rows[entry] = blurred_row(cam, row, first + ivec2(entry % BLURRED_X, entry / BLURRED_X));
        entry += gl_WorkGroupSize.x;
    } while (entry < BLURRED_X * BLURRED_Y);
    barrier();
}

// Light on pixel `at` of the image, which lies in the tile or its apron and has the valid colour `colour`.
vec3 through_lens(Camera cam, ivec2 at, vec3 colour) {
    vec3 light = colour;
    if (EFFECT_PSF) {
        const Optics row = optics[cam.slot];
        // The entry as far above the pixel as light is spread.
        const uint top = cache_index(at);
        vec4 sum = vec4(0.0);
        [[unroll]] for (int d = -PSF_RADIUS_PX; d <= PSF_RADIUS_PX; ++d) {
            sum += psf_weight(row, d)
                * (SHARES_BLURRED_ROWS ? blurred_rows[top + uint(d + PSF_RADIUS_PX) * BLURRED_X]
                                       : blurred_row(cam, row, at + ivec2(0, d)));
        }
        light = sum.xyz / sum.w;
    }
    if (EFFECT_VIGNETTING) {
        const vec2 from_centre = vec2(at) - 0.5 * vec2(cam.width - 1u, cam.height - 1u);
        const float square = fma(dot(from_centre, from_centre), optics[cam.slot].vignetting_per_px2, 1.0);
        light /= square * square;
    }
    return light;
}
