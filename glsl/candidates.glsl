// Candidates of a tile's blocks, for synthesis `rigid`: the surfaces that pass each block, in order, those that move
// alike once; candidate_lists.glsl makes the lists. Needs surfaces.glsl and LIST_BLOCKS, the number of blocks that have
// lists in shared memory.

// A surface as both key frames see it: an instance, and a plane in the axes of each.
struct Surface {
    uint instance;
    vec3 planes[2];
};

// The candidates of each block that has lists here, the parallax of their instances, and their number.
const uint LISTED = RIGID ? LIST_BLOCKS * BLOCK_CANDIDATES : 1u;
shared uint listed_instance[LISTED];
shared float listed_parallax[LISTED];
shared vec3 listed_plane[2u * LISTED];
shared uint listed_count[LIST_BLOCKS];
// The longest way of what passes each of these blocks, pixels.
shared float listed_motion[LIST_BLOCKS];

// The surface that a pixel of key frame `key` shows. `seen` becomes false if there is none.
Surface surface_of_pixel(Camera cam, Geometry geo, uint key, ivec2 at, inout bool seen) {
    const uint base = surface_base(cam, geo, key);
    const uvec2 shown = load_surface(base, cam, at);
    Surface surface;
    surface.instance = instance_of(shown);
    // An instance without parallax has lost its poses.
    seen = seen && has_surface(shown) && parallax_of(geo, surface.instance) != 0.0;
    if (!seen) {
        return surface;
    }
    const float inverse_depth = inverse_depth_of(shown);
    const vec3 own = plane_of(geo, vec2(at), inverse_depth, load_slopes(base, cam, at, inverse_depth));
    const Pose to_end = pose_between_keys(geo, surface.instance);
    if (key == 0u) {
        surface.planes[0] = own;
        surface.planes[1] = moved_plane(own, to_end, seen);
    } else {
        surface.planes[0] = moved_plane(own, inverse_of(to_end), seen);
        surface.planes[1] = own;
    }
    return surface;
}

// Whether two surfaces of one instance, of these inverse depths along a ray in both key frames, are one candidate.
bool are_one(vec2 depths, vec2 other, float parallax) {
    const vec2 apart_px = abs(depths - other) * parallax;
    return max(apart_px.x, apart_px.y) < MERGE_PX;
}

vec2 depths_along(vec3 planes[2], vec3 ray) {
    return vec2(dot3(planes[0], ray), dot3(planes[1], ray));
}
