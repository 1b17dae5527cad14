// The way of a half-pel sample to the other key frame, along its exact path, for the transfer of detail by synthesis
// `rigid`. Needs surfaces.glsl.

// The way of the samples of one surface: the motion of its instance to the other key frame, and the surface as that key
// frame sees it. `exists` is false without a surface, or if the other key frame is behind it.
struct Route {
    bool exists;
    vec3 plane;
    Pose to_other;
    Seen surface;
};

Route route_of(Geometry geo, uint instance, vec3 plane, bool to_start) {
    Route route;
    route.exists = instance != NO_INSTANCE;
    route.plane = plane;
    const uint row = route.exists ? instance : 0u;
    const Pose between = pose_between_keys(geo, row);
    route.to_other = to_start ? inverse_of(between) : between;
    route.surface = Seen(row, moved_plane(plane, route.to_other, route.exists), parallax_of(geo, row));
    // Its poses may have been taken away.
    route.exists = route.exists && route.surface.parallax > 0.0;
    return route;
}

// Where the sample at `position` is read in the other key frame, half pixels. Returns the confidence in what is read
// there, 0 if that is not the sample's surface, or not pure if it must be; `base` is that key frame's first element in
// `surfaces`.
float follow(Camera cam, Geometry geo, Route route, uint base, vec2 position, bool from_pure, out vec2 there) {
    const vec3 ray = ray_of(geo, position);
    bool seen = route.exists && lens_shows(geo, position);
    const vec2 place = project(geo, moved(route.to_other, ray, dot3(route.plane, ray)), seen);
    const float inside = 1.0 - outside_px(cam, place);
    there = snapped(to_half_pel(cam, place));
    const bool shows = seen && inside > 0.0 && half_pel_shows(cam, geo, base, there, route.surface, from_pure);
    return shows ? inside : 0.0;
}

// The least confidence in the anchors that the half-pel sample of a phase lies between.
float least_confidence(uint anchor, ivec2 phase_offset) {
    const uint right = anchor + uint(phase_offset.x);
    const uint below = uint(phase_offset.y) * ANCHORS_X;
    return min(
        min(confidences[anchor], confidences[right]), min(confidences[anchor + below], confidences[right + below]));
}
