//! Tracks against the paths that they were sampled from, and what they refuse.

use super::*;
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;

const MS: i64 = 1_000_000;

/// A hand-held camera that shakes at 9 to 23 Hz, and its pose at every time.
fn shaking(t_s: f64) -> Pose {
    let wave = |hz: f64, phase: f64| (TAU * hz * t_s + phase).sin();
    let turn = DVec3::new(
        0.02 * wave(9.0, 0.3) + 0.004 * wave(23.0, 1.0),
        0.02 * wave(11.0, 2.0) + 0.3 * t_s,
        0.01 * wave(17.0, 0.7),
    );
    let place = DVec3::new(0.02 * wave(10.0, 0.0), 0.01 * wave(13.0, 1.0), 1.5 + 0.005 * wave(21.0, 0.0));
    Pose::new(DQuat::from_scaled_axis(DVec3::new(0.7, 1.1, -0.4)) * DQuat::from_scaled_axis(turn), place)
        .unwrap()
}

fn angle(a: Pose, b: Pose) -> f64 {
    rotation_vector(a.rotation().conjugate() * b.rotation()).length()
}

/// Largest distance and angle between a track and the path it was sampled from.
fn errors(track: &PoseTrack, path: impl Fn(f64) -> Pose) -> (f64, f64) {
    let (first_ns, last_ns) = (track.times_ns()[0], *track.times_ns().last().unwrap());
    let at = |k: i64| first_ns + (last_ns - first_ns) * k / 997;
    (0..=997).fold((0.0, 0.0), |(distance, turn), k| {
        let (found, expected) = (track.at(at(k)).unwrap(), path(at(k) as f64 * 1e-9));
        let apart_m = (found.translation_m() - expected.translation_m()).length();
        (f64::max(distance, apart_m), f64::max(turn, angle(found, expected)))
    })
}

#[test]
fn samples_come_back_as_they_are() {
    let times_ns: Vec<i64> = (0..9).map(|k| k * 4_166_667).collect();
    let track = PoseTrack::through(&times_ns, shaking).unwrap();
    for (&t_ns, &pose) in times_ns.iter().zip(track.poses()) {
        assert_eq!(track.at(t_ns).unwrap(), pose);
    }
}

#[test]
fn poses_at_many_times_are_those_at_each() {
    let times_ns: Vec<i64> = (0..9).map(|k| k * 4_166_667).collect();
    let track = PoseTrack::through(&times_ns, shaking).unwrap();
    let wanted: Vec<i64> = (0..=200).rev().chain(50..70).map(|k| k * 8 * 4_166_667 / 200).collect();
    let mut together = vec![Pose::IDENTITY];
    track.at_all(&wanted, &mut together).unwrap();
    assert_eq!(together, wanted.iter().map(|&t_ns| track.at(t_ns).unwrap()).collect::<Vec<_>>());
    assert!(track.at_all(&[0, 8 * 4_166_667 + 1], &mut together).is_err());
    let still = PoseTrack::still(shaking(0.3));
    still.at_all(&[-5, 7], &mut together).unwrap();
    assert_eq!(together, [shaking(0.3); 2]);
}

#[test]
fn a_shake_is_followed_many_times_closer_than_straight_lines() {
    let times_ns: Vec<i64> = (0..25).map(|k| k * 25 * MS / 6).collect();
    let smooth = errors(&PoseTrack::through(&times_ns, shaking).unwrap(), shaking);
    let mut straight = (0.0_f64, 0.0_f64);
    for pair in times_ns.windows(2) {
        let piece = errors(&PoseTrack::through(pair, shaking).unwrap(), shaking);
        straight = (straight.0.max(piece.0), straight.1.max(piece.1));
    }
    assert!(smooth.0 < straight.0 / 15.0, "{smooth:?} {straight:?}");
    assert!(smooth.1 < straight.1 / 15.0, "{smooth:?} {straight:?}");
}

#[test]
fn the_error_falls_with_the_fourth_power_of_the_spacing_even_at_uneven_times() {
    let uneven = |n: i64| -> Vec<i64> {
        (0..=n).map(|k| 100 * MS * k / n + if k % 2 == 1 { 20 * MS / n } else { 0 }).collect()
    };
    let (coarse, fine) = (
        errors(&PoseTrack::through(&uneven(32), shaking).unwrap(), shaking),
        errors(&PoseTrack::through(&uneven(64), shaking).unwrap(), shaking),
    );
    assert!(fine.0 < coarse.0 / 12.0, "{coarse:?} {fine:?}");
    assert!(fine.1 < coarse.1 / 12.0, "{coarse:?} {fine:?}");
}

/// Physics counts its steps in whole nanoseconds, and a frame has a pose of its own, some nanoseconds after the last step's. Poses
/// in single precision differ by more than the way between the two.
#[test]
fn a_frames_pose_beside_that_of_a_step_changes_next_to_nothing() {
    let single = |pose: Pose| {
        let single = |v: f64| f64::from(v as f32);
        let (q, t) = (pose.rotation(), pose.translation_m());
        let rotation = DQuat::from_xyzw(single(q.x), single(q.y), single(q.z), single(q.w)).normalize();
        Pose::new(rotation, DVec3::new(single(t.x), single(t.y), single(t.z))).unwrap()
    };
    let steps_ns: Vec<i64> = (0..=16).map(|k| k * 4_166_666).collect();
    let frames_ns = [33_333_333, 66_666_666];
    let mut times_ns: Vec<i64> = steps_ns.iter().copied().chain(frames_ns).collect();
    times_ns.sort_unstable();
    let of = |times_ns: &[i64]| PoseTrack::through(times_ns, |t_s| single(shaking(t_s))).unwrap();
    let (alone, both) = (of(&steps_ns), of(&times_ns));
    let (expected, found) = (errors(&alone, shaking), errors(&both, shaking));
    println!("{expected:?} m and rad without the frames' poses, {found:?} with them");
    assert!(found.0 < 1.1 * expected.0 && found.1 < 1.1 * expected.1);
    for t_ns in steps_ns.windows(2).map(|pair| (pair[0] + pair[1]) / 2) {
        assert!(angle(alone.at(t_ns).unwrap(), both.at(t_ns).unwrap()) < 2e-6, "{t_ns} ns");
    }
    // Two samples alone are a line, however close they are.
    let close = PoseTrack::through(&[0, 5], shaking).unwrap();
    assert!(angle(close.at(5).unwrap(), shaking(5e-9)) < 1e-12);
}

#[test]
fn velocities_are_continuous_at_every_sample() {
    let times_ns = [0, 3, 9, 11, 20, 26, 33].map(|ms| ms * MS);
    let track = PoseTrack::through(&times_ns, shaking).unwrap();
    let step_ns = 1000;
    for &t_ns in &times_ns[1..6] {
        let [a, b, c] = [t_ns - step_ns, t_ns, t_ns + step_ns].map(|t_ns| track.at(t_ns).unwrap());
        let speed = |a: Pose, b: Pose| (b.translation_m() - a.translation_m()) / (step_ns as f64 * 1e-9);
        // What the acceleration adds within a step.
        assert!((speed(b, c) - speed(a, b)).length() < 1e-3, "{t_ns}");
        let turn = |a: Pose, b: Pose| {
            rotation_vector(a.rotation().conjugate() * b.rotation()) / (step_ns as f64 * 1e-9)
        };
        assert!((turn(b, c) - turn(a, b)).length() < 2e-3, "{t_ns}");
    }
}

#[test]
fn a_steady_screw_is_exact_however_fast_it_turns() {
    // Up to just below half a turn from sample to sample.
    for turn_a_sample in [0.01, 1.0, 2.0, 3.1] {
        let axis = DVec3::new(1.0, -2.0, 0.5).normalize();
        let screw = |t_s: f64| {
            Pose::new(
                DQuat::from_scaled_axis(axis * (turn_a_sample * t_s / 0.01)),
                DVec3::new(3.0 * t_s, 0.0, 1.0 - t_s),
            )
            .unwrap()
        };
        let times_ns: Vec<i64> = (0..7).map(|k| k * 10 * MS).collect();
        let (distance, turn) = errors(&PoseTrack::through(&times_ns, screw).unwrap(), screw);
        assert!(distance < 1e-12 && turn < 1e-7, "{turn_a_sample}: {distance} {turn}");
    }
}

#[test]
fn the_sign_of_a_quaternion_means_nothing() {
    let times_ns: Vec<i64> = (0..8).map(|k| k * 5 * MS).collect();
    let track = PoseTrack::through(&times_ns, shaking).unwrap();
    let flipped: Vec<Pose> = track
        .poses()
        .iter()
        .enumerate()
        .map(|(i, p)| if i % 3 == 1 { Pose::new(-p.rotation(), p.translation_m()).unwrap() } else { *p })
        .collect();
    let flipped = PoseTrack::new(times_ns, flipped).unwrap();
    for k in 0..350 {
        let (a, b) = (track.at(k * MS / 10).unwrap(), flipped.at(k * MS / 10).unwrap());
        assert!(angle(a, b) < 1e-7 && (a.translation_m() - b.translation_m()).length() < 1e-15, "{k}");
    }
}

#[test]
fn two_samples_are_slerp_and_a_straight_line() {
    let (start, end) = (shaking(0.0), shaking(0.03));
    let track = PoseTrack::new(vec![-10, 10], vec![start, end]).unwrap();
    let middle = track.at(5).unwrap();
    let line = start.translation_m().lerp(end.translation_m(), 0.75);
    assert!((middle.translation_m() - line).length() < 1e-15);
    let total = angle(start, end);
    assert!((angle(start, middle) - 0.75 * total).abs() < 1e-7);
    assert!((angle(middle, end) - 0.25 * total).abs() < 1e-7);
}

#[test]
fn one_sample_stands_still_at_all_times() {
    let pose = shaking(0.2);
    for track in [PoseTrack::still(pose), PoseTrack::new(vec![7], vec![pose]).unwrap()] {
        for t_ns in [i64::MIN, 0, 7, i64::MAX] {
            assert_eq!(track.at(t_ns).unwrap(), pose);
        }
        track.check_span(i64::MIN, i64::MAX).unwrap();
    }
}

#[test]
fn samples_at_one_place_stand_still_within_their_times() {
    let stands = PoseTrack::new(vec![0, 4, 9], vec![shaking(0.2); 3]).unwrap();
    assert!(stands.stands() && stands.at(3) == Ok(shaking(0.2)) && stands.at(10).is_err());
    let moves = PoseTrack::new(vec![0, 4], vec![shaking(0.2), shaking(0.3)]).unwrap();
    assert!(!moves.stands());
}

#[test]
fn tracks_at_shared_times_are_those_of_times_of_their_own() {
    let times_ns: Vec<i64> = [0, 3, 9, 11, 20, 26, 33].map(|ms| ms * MS).to_vec();
    let track = PoseTrack::through(&times_ns, shaking).unwrap();
    let times = PoseTimes::new(times_ns).unwrap();
    assert_eq!(PoseTrack::at_times(&times, track.poses().to_vec()), Ok(track));
    let few = PoseTrack::at_times(&times, vec![Pose::IDENTITY; 3]);
    assert_eq!(few, Err(TrackError::Count { times: 7, poses: 3 }));
}

#[test]
fn a_track_in_the_memory_of_another_has_nothing_of_it() {
    let times_ns: Vec<i64> = [0, 3, 9, 11, 20, 26, 33].map(|ms| ms * MS).to_vec();
    let track = PoseTrack::through(&times_ns, shaking).unwrap();
    let still = PoseTrack::new(times_ns[..3].to_vec(), vec![shaking(0.2); 3]).unwrap();
    let again = |old: &PoseTrack, new: &PoseTrack| {
        let mut memory = TrackMemory::from(old.clone());
        memory.fill(new.poses().iter().map(|pose| Ok::<_, ()>(*pose))).unwrap();
        PoseTrack::in_memory(&PoseTimes::new(new.times_ns().to_vec()).unwrap(), memory).unwrap()
    };
    assert_eq!(again(&still, &track), track);
    assert_eq!(again(&track, &still), still);
    let mut memory = TrackMemory::from(track);
    assert_eq!(memory.fill([Ok(Pose::IDENTITY), Err("no pose")].into_iter()), Err("no pose"));
}

#[test]
fn wrong_tracks_and_times_outside_are_named() {
    let pose = Pose::IDENTITY;
    assert_eq!(PoseTrack::new(vec![], vec![]), Err(TrackError::Empty));
    assert_eq!(PoseTrack::new(vec![1, 2], vec![pose]), Err(TrackError::Count { times: 2, poses: 1 }));
    let order = PoseTrack::new(vec![5, 9, 9], vec![pose; 3]).unwrap_err();
    assert_eq!(order, TrackError::Order { index: 2, previous_ns: 9, actual_ns: 9 });
    assert_eq!(order.to_string(), "pose 2 is at 9 ns, expected after pose 1 at 9 ns");
    let track = PoseTrack::new(vec![5, 9], vec![pose; 2]).unwrap();
    track.check_span(5, 9).unwrap();
    for t_ns in [4, 10] {
        assert!(matches!(track.at(t_ns), Err(TrackError::Span { first_ns: 5, last_ns: 9, .. })));
    }
    let error = track.check_span(0, 20).unwrap_err().to_string();
    assert_eq!(error, "poses from 5 to 9 ns, expected them to span 0 to 20 ns");
}

#[test]
fn times_at_both_ends_of_the_clock_do_not_overflow() {
    let track = PoseTrack::new(vec![i64::MIN, i64::MAX], vec![Pose::IDENTITY, shaking(0.0)]).unwrap();
    let middle = track.at(0).unwrap().translation_m();
    assert!((middle - 0.5 * shaking(0.0).translation_m()).length() < 1e-9);
}
