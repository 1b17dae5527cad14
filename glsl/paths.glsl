// Poses at the ends of sub-steps, as `paths` has made them. Needs surfaces.glsl, and the buffer `paths`, declared by the
// including file.

// Number of an instant in `paths`: the end of sub-step `i` of `n`, 0 < i < n.
uint path_instant(uint n, uint i) {
    return (n - 1u) * (n - 2u) / 2u + i - 1u;
}

// The motion of an instance from camera axes at the end of sub-step `i` of `n` to those of key frame 0, 0 < i < n.
Pose pose_at_substep(Geometry geo, uint instance, uint n, uint i) {
    const uint row = geo.path_base + 3u * (instance * geo.path_instants + path_instant(n, i));
    return Pose(PATH_ROW(row), PATH_ROW(row + 1u), PATH_ROW(row + 2u));
}

// Where the plane `plane` (axes of key frame 0) that a ray shows lies in key frame 0, as a homogeneous point; `pose` is
// that to key frame 0. `inverse_depth` is that at the instant. `seen` becomes false if it is not before the camera.
vec3 point_on_path(Pose pose, vec3 plane, vec3 ray, out float inverse_depth, inout bool seen) {
    const vec3 direction = turned(pose, ray);
    const float room = 1.0 - dot3(plane, shift_of(pose));
    seen = seen && room > 0.0;
    inverse_depth = dot3(plane, direction) / (room > 0.0 ? room : 1.0);
    seen = seen && inverse_depth >= 0.0;
    return fma(shift_of(pose), vec3(inverse_depth), direction);
}
