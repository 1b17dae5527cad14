// Half-pel frames with detail of the frame before along exact paths, for synthesis `rigid`. Part of ingest.glsl; needs
// ingest_surfaces.glsl.

#include "rigid_route.glsl"

// What the frame before says at an anchor's own sample: its residual, and the confidence in it.
void tell_anchor(Camera cam, Geometry geo, uint channel, uint number) {
    const ivec2 at = anchor_pixel(cam, tile_origin, anchor_at(number));
    const uint anchor = anchor_index(anchor_at(number));
    const Own own = own_surface(cam, geo, at);
    const Route route = route_of(geo, own.instance, own.plane, true);
    vec2 there;
    confidences[anchor] = follow(cam, geo, route, surface_base(cam, geo, 0u), vec2(at), false, there);
    if (confidences[anchor] > 0.0) {
        [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
            const uint previous = frame_of(cam, 1u - cam.frame_slot, channel + k);
            const float told = half_pel_cubic(cam, previous, there, cubic_parameter(cam, previous, at));
            residuals[k * ANCHORS + anchor] = cached_level[k * CACHE_PIXELS + cache_index(at)] - told;
        }
    }
}

// Writes a pixel's samples of the half-pel frame; `channel` is the first component that the workgroup takes. `tells`:
// whether anchors have been told what the frame before says.
void write_rigid_half_pels(Camera cam, Geometry geo, uint channel, uint number, bool tells) {
    const uvec2 in_tile = anchor_at(number);
    const ivec2 at = tile_origin + ivec2(in_tile);
    if (!in_image(cam, at)) {
        return;
    }
    if (any_change == 0u) {
        [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
            const vec4 entries = entries_before(cam, channel + k, at);
            store_entries(cam, frame_of(cam, cam.frame_slot, channel + k), at, entries);
        }
        return;
    }
    const uint anchor = anchor_index(in_tile);
    vec4 entries[COMPONENTS];
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        entries[k] = vec4(cached_level[k * CACHE_PIXELS + cache_index(at)], interpolate_frame(cam, k, at));
    }
    if (tells && confidences[anchor] > 0.0) {
        const Own own = own_surface(cam, geo, at);
        const uint joined = joined_phases(cam, geo, at, own);
        const Route route = route_of(geo, own.instance, own.plane, true);
        for (int phase = 1; phase < 4; ++phase) {
            const ivec2 offset = phase_offset_of(phase);
            const float anchors = least_confidence(anchor, offset);
            if (anchors == 0.0 || ((joined >> phase) & 1u) == 0u) {
                continue;
            }
            vec2 there;
            const vec2 position = vec2(at) + 0.5 * vec2(offset);
            const float trust = min(anchors, follow(cam, geo, route, surface_base(cam, geo, 0u), position, false, there));
            if (trust > 0.0) {
                [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
                    const uint previous = frame_of(cam, 1u - cam.frame_slot, channel + k);
                    const float told = half_pel_cubic(cam, previous, there, cubic_parameter(cam, previous, at));
                    const float residual = mean_of_quad(residual_quad(k * ANCHORS + anchor), offset);
                    entries[k][phase] = lerp(entries[k][phase], told + residual, trust);
                }
            }
        }
    }
    [[unroll]] for (uint k = 0u; k < COMPONENTS; ++k) {
        store_entries(cam, frame_of(cam, cam.frame_slot, channel + k), at, entries[k]);
    }
}

// Writes the tile's part of the half-pel frame. Called by the whole workgroup.
void write_rigid_frame(Camera cam, Geometry geo, uint channel) {
    const uint lane = gl_LocalInvocationID.x;
    const bool tells = any_change != 0u && !is_first(cam);
    if (tells) {
        for (uint number = lane; number < ANCHORS; number += gl_WorkGroupSize.x) {
            tell_anchor(cam, geo, channel, number);
        }
    }
    barrier();
    for (uint number = lane; number < TILE_ANCHORS; number += gl_WorkGroupSize.x) {
        write_rigid_half_pels(cam, geo, channel, number, tells);
    }
}
