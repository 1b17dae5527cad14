// poses: where instances are before the camera at POSE_INSTANTS instants of the interval, in double precision. Only for
// rigs with many moving tracks: for few, the host does the same (engine/gpu/src/rig/poses.rs), to the same bits. So
// everything is sums and products in the order of the host's, and of what a device might round in its own way there is
// nothing: no division, no root, no sine, and no product that a sum could be fused with. NVIDIA's compiler fuses those of
// double precision although they are decorated with `NoContraction`.
//
// A workgroup takes an instance at a time, a thread an instant; y over cameras. Reads `tracks` and `segments`, which the
// host writes; writes `poses`, which `ingest` reads after a barrier.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "pose_segments.glsl"

layout(local_size_x = POSES_THREADS) in;

BUFFER(readonly, SLOT_TRACKS, Track, tracks);
BUFFER(readonly, SLOT_SEGMENTS, PoseSegment, segments);
BUFFER(writeonly, SLOT_POSES, vec4, poses);

const uint LAST = POSE_INSTANTS - 1u;
const uint KNOT_INSTANTS = LAST / (KNOTS - 1u);

// World from body, or from camera.
struct Placement {
    dvec4 rotation;
    dvec3 translation;
};

// Placements of body and camera at the first and the last instant.
shared Placement camera_ends[2];
shared Placement body_ends[2];
// Square of the longest shift to the first or the last instant, by knot.
shared double shift_squares[KNOTS];
// Whether the instance moves before the camera.
shared uint moves;

// A product, rounded before anything else: the compiler does not know that this word of the push constants is 0.
double times(double a, double b) {
    return packDouble2x32(unpackDouble2x32(a * b) ^ uvec2(push.level));
}

dvec3 times(dvec3 a, double b) {
    return dvec3(times(a.x, b), times(a.y, b), times(a.z, b));
}

double dot_of(dvec3 a, dvec3 b) {
    return times(a.x, b.x) + times(a.y, b.y) + times(a.z, b.z);
}

dvec3 cross_of(dvec3 a, dvec3 b) {
    return dvec3(
        times(a.y, b.z) - times(b.y, a.z), times(a.z, b.x) - times(b.z, a.x), times(a.x, b.y) - times(b.x, a.y));
}

// Rotation `b`, then `a`.
dvec4 product(dvec4 a, dvec4 b) {
    return dvec4(
        times(a.w, b.x) + times(a.x, b.w) + times(a.y, b.z) - times(a.z, b.y),
        times(a.w, b.y) - times(a.x, b.z) + times(a.y, b.w) + times(a.z, b.x),
        times(a.w, b.z) + times(a.x, b.y) - times(a.y, b.x) + times(a.z, b.w),
        times(a.w, b.w) - times(a.x, b.x) - times(a.y, b.y) - times(a.z, b.z));
}

dvec4 renormalised(dvec4 q) {
    const double square = dot_of(q.xyz, q.xyz) + times(q.w, q.w);
    const double unit = 1.5lf - times(0.5lf, square);
    return dvec4(times(q.xyz, unit), times(q.w, unit));
}

dvec3 turned(dvec4 q, dvec3 v) {
    const dvec3 b = q.xyz;
    return times(v, times(q.w, q.w) - dot_of(b, b)) + times(b, times(dot_of(v, b), 2.0lf))
        + times(cross_of(b, v), times(q.w, 2.0lf));
}

Placement inverse_of(Placement p) {
    const dvec4 back = dvec4(-p.rotation.xyz, p.rotation.w);
    return Placement(back, -turned(back, p.translation));
}

// `inner`, then `outer`.
Placement both(Placement outer, Placement inner) {
    return Placement(
        renormalised(product(outer.rotation, inner.rotation)),
        turned(outer.rotation, inner.translation) + outer.translation);
}

// The rotation of a rotation vector.
dvec4 rotation_of(dvec3 turn) {
    double square = times(0.25lf, dot_of(turn, turn));
    if (square <= SERIES_SQUARE) {
        double half_sine = HALF_SINE[0];
        double cosine = COSINE[0];
        [[unroll]] for (uint i = 1u; i < HALF_SINE.length(); ++i) {
            half_sine = times(half_sine, square) + HALF_SINE[i];
        }
        [[unroll]] for (uint i = 1u; i < COSINE.length(); ++i) {
            cosine = times(cosine, square) + COSINE[i];
        }
        return dvec4(times(turn, half_sine), cosine);
    }
    double part = 1.0lf;
    uint halvings = 0u;
    while (square > LONG_SERIES_SQUARE && halvings < MOST_HALVINGS) {
        square *= 0.25lf;
        part *= 0.5lf;
        ++halvings;
    }
    double half_sine = LONG_HALF_SINE[0];
    double cosine = LONG_COSINE[0];
    [[unroll]] for (uint i = 1u; i < LONG_COSINE.length(); ++i) {
        half_sine = times(half_sine, square) + LONG_HALF_SINE[i];
        cosine = times(cosine, square) + LONG_COSINE[i];
    }
    dvec3 axis = times(turn, times(part, half_sine));
    for (uint i = 0u; i < halvings; ++i) {
        const double sine_square = dot_of(axis, axis);
        const double cosine_square = times(cosine, cosine);
        const double unit = 1.5lf - times(0.5lf, sine_square + cosine_square);
        axis = times(axis, times(times(2.0lf, cosine), unit));
        cosine = times(cosine_square - sine_square, unit);
    }
    return dvec4(axis, cosine);
}

// The cubic from 0 to `end` with two slopes.
dvec3 curve(dvec3 end, dvec3 start_slope, dvec3 end_slope, double s) {
    const double left = 1.0lf - s;
    const double square = times(s, s);
    return times(end, times(square, 3.0lf - times(2.0lf, s))) + times(start_slope, times(times(s, left), left))
        - times(end_slope, times(square, left));
}

// Placement by a track at an instant, which is `offset_ns` after the interval's start.
Placement placement(uint track, uint instant, int64_t offset_ns) {
    const uint past = instant == 0u ? 0u : tracks[track].next << (32u - instant);
    const PoseSegment s = segments[TRACK_SEGMENTS * track + bitCount(past)];
    const dvec4 rotation = dvec4(s.rotation_x, s.rotation_y, s.rotation_z, s.rotation_w);
    const dvec3 translation = dvec3(s.translation_x_m, s.translation_y_m, s.translation_z_m);
    const double fraction = times(double(uint64_t(offset_ns - s.start_ns)), s.per_ns);
    if (fraction == 0.0lf) {
        return Placement(rotation, translation);
    }
    const dvec3 shift = curve(
        dvec3(s.shift_x_m, s.shift_y_m, s.shift_z_m),
        dvec3(s.shift_start_x_m, s.shift_start_y_m, s.shift_start_z_m),
        dvec3(s.shift_end_x_m, s.shift_end_y_m, s.shift_end_z_m), fraction);
    const dvec3 turn = curve(
        dvec3(s.turn_x, s.turn_y, s.turn_z), dvec3(s.turn_start_x, s.turn_start_y, s.turn_start_z),
        dvec3(s.turn_end_x, s.turn_end_y, s.turn_end_z), fraction);
    return Placement(renormalised(product(rotation, rotation_of(turn))), translation + shift);
}

double square_root(double x) {
    double inverse = packDouble2x32(uvec2(0u, ROOT_SEED - (unpackDouble2x32(x).y >> 1)));
    [[unroll]] for (uint i = 0u; i < ROOT_STEPS; ++i) {
        inverse = times(inverse, 1.5lf - times(times(times(0.5lf, x), inverse), inverse));
    }
    return times(x, inverse);
}

// Writes three rows of a motion from `row` on: those of no motion if it is only rounding.
void put(uint row, Placement p) {
    const dvec3 shifts = abs(p.translation);
    const dvec3 turns = abs(p.rotation.xyz);
    if (max(shifts.x, max(shifts.y, shifts.z)) < POSE_REST && max(turns.x, max(turns.y, turns.z)) < POSE_REST) {
        poses[row] = vec4(1.0, 0.0, 0.0, 0.0);
        poses[row + 1u] = vec4(0.0, 1.0, 0.0, 0.0);
        poses[row + 2u] = vec4(0.0, 0.0, 1.0, 0.0);
        return;
    }
    moves = 1u;
    const dvec4 q = p.rotation;
    const dvec3 twice = q.xyz + q.xyz;
    const double xx = times(q.x, twice.x);
    const double xy = times(q.x, twice.y);
    const double xz = times(q.x, twice.z);
    const double yy = times(q.y, twice.y);
    const double yz = times(q.y, twice.z);
    const double zz = times(q.z, twice.z);
    const double wx = times(q.w, twice.x);
    const double wy = times(q.w, twice.y);
    const double wz = times(q.w, twice.z);
    poses[row] = vec4(dvec4(1.0lf - (yy + zz), xy - wz, xz + wy, p.translation.x));
    poses[row + 1u] = vec4(dvec4(xy + wz, 1.0lf - (xx + zz), yz - wx, p.translation.y));
    poses[row + 2u] = vec4(dvec4(xz - wy, yz + wx, 1.0lf - (xx + yy), p.translation.z));
}

void main() {
    const uint index = push.first_camera + gl_WorkGroupID.y;
    if (cameras[index].frame_kind == FRAME_NONE) {
        return;
    }
    const Geometry geo = geometries[cameras[index].slot];
    const uint lane = gl_LocalInvocationID.x;
    const uint instant = min(lane, LAST);
    // The nearest whole nanosecond.
    const int64_t offset_ns =
        int64_t((uint64_t(cameras[index].interval_ns) * instant + LAST / 2u) / uint64_t(LAST));
    const bool camera_moves = tracks[geo.track_base].kind == TRACK_MOVES;
    const double focal_px = tracks[geo.track_base].focal_px;
    const Placement camera = placement(geo.track_base, instant, offset_ns);
    if (lane == 0u || lane == LAST) {
        camera_ends[min(lane, 1u)] = camera;
    }
    for (uint instance = gl_WorkGroupID.x; instance < geo.instances; instance += gl_NumWorkGroups.x) {
        const uint row = geo.pose_base + instance * POSE_ROWS;
        const uint kind = tracks[geo.track_base + 1u + instance].kind;
        const bool body_moves = kind == TRACK_MOVES;
        if (kind == TRACK_NONE) {
            for (uint i = lane; i < POSE_ROWS; i += gl_WorkGroupSize.x) {
                poses[row + i] = vec4(0.0);
            }
            continue;
        }
        // All that stands moves before the camera as the world does.
        Placement body = Placement(dvec4(0.0lf, 0.0lf, 0.0lf, 1.0lf), dvec3(0.0lf));
        if (body_moves) {
            body = placement(geo.track_base + 1u + instance, instant, offset_ns);
            if (lane == 0u || lane == LAST) {
                body_ends[min(lane, 1u)] = body;
            }
        }
        if (lane == 0u) {
            moves = 0u;
        }
        barrier();
        const bool still = !body_moves && !camera_moves;
        Placement to_ends[2];
        [[unroll]] for (uint end = 0u; end < 2u; ++end) {
            Placement to_end = inverse_of(camera_ends[end]);
            if (body_moves) {
                to_end = both(both(to_end, body_ends[end]), both(inverse_of(body), camera));
            } else {
                to_end = both(to_end, camera);
            }
            // At rest, whatever rounding makes of it.
            to_ends[end] = Placement(
                still ? dvec4(0.0lf, 0.0lf, 0.0lf, 1.0lf) : to_end.rotation, still ? dvec3(0.0lf) : to_end.translation);
        }
        if (lane <= LAST) {
            put(row + 3u * lane, to_ends[0]);
            if (lane % KNOT_INSTANTS == 0u) {
                shift_squares[lane / KNOT_INSTANTS] = max(
                    dot_of(to_ends[0].translation, to_ends[0].translation),
                    dot_of(to_ends[1].translation, to_ends[1].translation));
            }
        }
        if (lane == 0u) {
            put(row + 3u * POSE_INSTANTS, to_ends[1]);
        }
        barrier();
        if (lane == 0u) {
            double largest = 0.0lf;
            [[unroll]] for (uint knot = 0u; knot < KNOTS; ++knot) {
                largest = max(largest, shift_squares[knot]);
            }
            const double parallax_px = max(times(focal_px, square_root(largest)), 1.0lf);
            poses[row + POSE_ROWS - 1u] =
                still ? vec4(1.0, 0.0, 0.0, 0.0) : vec4(float(parallax_px), float(moves), 0.0, 0.0);
        }
        barrier();
    }
}
