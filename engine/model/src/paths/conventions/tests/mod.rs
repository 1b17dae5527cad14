//! Planted mistakes must be named, and right input must agree.

mod sequences;

use super::*;
use crate::paths::Intrinsics;
use glam::{DQuat, DVec3};
use sequences::*;

fn mistaken(agreement: &Agreement) -> &[Vec<Mistake>] {
    match &agreement.verdict {
        Verdict::Mistaken { causes, .. } => causes,
        verdict => panic!("{verdict:?}, error {} px", agreement.median_error_px),
    }
}

#[test]
fn a_right_sequence_agrees() {
    let report = report(&right());
    assert!(report.agrees(), "{report:?}");
    let world = report.world.unwrap();
    assert_eq!(world.verdict, Verdict::Agrees);
    assert!(world.median_error_px < 1e-4 && world.median_motion_px > 1.0, "{world:?}");
    assert_eq!(report.instances[&BALL].verdict, Verdict::Agrees);
    assert_eq!(report.pixels_without_poses, 0);
}

#[test]
fn each_mistake_of_vectors_camera_depth_or_time_is_the_one_named() {
    let vectors = SIGNS.iter().chain(&UNITS).filter_map(|one| one.first()).chain(&FACTORS);
    for &mistake in vectors.chain(&CAMERA).chain(&SURFACE) {
        let report = report(&planted(mistake));
        let world = report.world.as_ref().unwrap();
        let causes = mistaken(world);
        assert_eq!(causes[0], [mistake], "{world:?}");
        assert_eq!(causes.len(), 1, "{mistake:?} is not told from {causes:?}");
        assert!(!report.agrees());
        // The ball has no mistake of its own.
        assert_eq!(report.instances[&BALL].verdict, Verdict::Agrees, "{mistake:?}");
    }
}

#[test]
fn each_mistake_of_a_body_is_named_and_the_world_agrees() {
    for mistake in [
        Mistake::BodyInverted,
        Mistake::BodyTransposed,
        Mistake::BodyScalarFirst,
        Mistake::BodyStill,
        Mistake::BodyOf(OTHER),
    ] {
        let report = report(&planted(mistake));
        assert_eq!(report.world.as_ref().unwrap().verdict, Verdict::Agrees);
        let causes = mistaken(&report.instances[&BALL]);
        assert_eq!(causes, [vec![mistake]], "{mistake:?}");
    }
}

#[test]
fn a_mistake_of_vectors_is_named_once_for_a_body_before_a_camera_that_stands_still() {
    let mut sequence = right_of(scene(lens(), |_| camera(0.0), ball));
    change_vectors(&mut sequence, |[x, y]| [x, -y]);
    let report = report(&sequence);
    assert_eq!(report.world.as_ref().unwrap().verdict, Verdict::Still);
    assert_eq!(mistaken(&report.instances[&BALL]), [vec![Mistake::VectorsYUp]]);
}

/// A world of hills far away, before which the ball is near; the camera turns and hardly moves.
fn far_world(lens: Intrinsics) -> Sequence {
    let turning = |k: f64| Pose::from_parts(camera(k).rotation(), 0.02 * camera(k).translation_m());
    let near = |k: f64| {
        let (forward, pose) = (turning(k).rotation() * DVec3::NEG_Z, ball(k));
        Pose::from_parts(pose.rotation(), 2.0 * forward + 0.3 * pose.translation_m())
    };
    let mut sequence = right_of(scene(lens, turning, near));
    for (t_ns, depth, ids, motion) in &mut sequence.frames {
        for i in 40..motion.len() {
            depth[i] = if ids[i] == BALL { 1.5 + 0.01 * (i % 17) as f32 } else { 60.0 + (i % 13) as f32 };
            let (pixel_px, depth_m) = (pixel_px(i), f64::from(depth[i]));
            let end = sequence.scene.path(pixel_px, depth_m, ids[i], *t_ns, *t_ns - FRAME_NS).unwrap();
            motion[i] = (end.pixel_px - pixel_px).to_array().map(|v| v as f32);
        }
    }
    sequence
}

#[test]
fn depth_that_the_static_world_does_not_tell_is_named_by_the_body() {
    let wide = Intrinsics::pinhole(20.0, 18.0, 31.0, 24.0).unwrap();
    let told = |sequence: &Sequence| {
        let report = report(sequence);
        assert_eq!(report.world.as_ref().unwrap().verdict, Verdict::Agrees, "{report:?}");
        assert_eq!(report.trust(), Trust::Without([BALL].into()), "{report:?}");
        mistaken(&report.instances[&BALL]).to_vec()
    };
    let mut from_centre = far_world(wide);
    change_depth(&mut from_centre, |depth_m, pixel_px| wide.ray(pixel_px).unwrap().length() * depth_m);
    assert_eq!(told(&from_centre), [vec![Mistake::DepthOfOtherKind]]);
    let mut twice = far_world(wide);
    change_depth(&mut twice, |depth_m, _| 2.0 * depth_m);
    assert_eq!(told(&twice), [vec![Mistake::DepthTimes(0.5)]]);
    // One that would spoil the world is none: it is the ball's depth alone.
    let mut ball_alone = far_world(lens());
    for (_, depth, ids, _) in &mut ball_alone.frames {
        depth.iter_mut().zip(ids).filter(|(_, id)| **id == BALL).for_each(|(depth, _)| *depth *= 1000.0);
    }
    let report = report(&ball_alone);
    assert!(matches!(report.instances[&BALL].verdict, Verdict::Unexplained { .. }), "{report:?}");
}

#[test]
fn a_factor_that_depth_or_a_rate_may_have_as_well_is_not_the_vectors_alone() {
    // The camera goes steadily and does not turn.
    let forward = |k: f64| Pose::from_parts(DQuat::IDENTITY, DVec3::new(0.05 * k, 0.02 * k, -0.04 * k));
    let mut sequence = right_of(scene(lens(), forward, ball));
    change_vectors(&mut sequence, |[x, y]| [2.0 * x, 2.0 * y]);
    let report = report(&sequence);
    let causes = mistaken(report.world.as_ref().unwrap());
    let of_vectors = vec![Mistake::VectorsTimes(0.5)];
    assert!(causes.contains(&of_vectors) && causes.len() > 1, "{causes:?}");
    assert_eq!(report.trust(), Trust::Nothing);
}

#[test]
fn what_leaves_more_than_rounding_is_not_likely_but_nearest() {
    let mut sequence = planted(Mistake::VectorsNegated);
    let mut sign = 1.0;
    change_vectors(&mut sequence, |[x, y]| {
        sign = -sign;
        [x + 0.25 * sign, y]
    });
    let report = report(&sequence);
    let Verdict::Unexplained { nearest: Some(nearest) } = &report.world.as_ref().unwrap().verdict else {
        panic!("{report:?}");
    };
    assert_eq!(nearest.cause, [Mistake::VectorsNegated]);
    let words = report.disagreement().unwrap();
    assert!(
        words.contains("no known mistake explains it; nearest is that the vectors' sign is flipped"),
        "{words}"
    );
    assert!(!words.contains("likely"), "{words}");
}

#[test]
fn a_slight_error_is_not_said_to_be_right() {
    let slight = report(&planted(Mistake::DepthOfOtherKind));
    let words = slight.consequence(&slight.trust());
    assert!(words.starts_with("depth and poses are followed as they are, for an error so slight"), "{words}");
    let of_vectors = report(&planted(Mistake::VectorsPerSecond));
    assert_eq!(
        of_vectors.consequence(&of_vectors.trust()),
        "depth and poses are right by that and are followed"
    );
}

#[test]
fn a_shift_is_found_in_three_intervals_whose_times_are_rounded() {
    let key_ns = |k: i64| (k as f64 * 1e9 / 30.0).round() as i64;
    // The poses end with the last frame to the nanosecond, and are a frame behind.
    let late = |pose: fn(f64) -> Pose| {
        let samples = (0..=3).map(|k| (key_ns(k), pose(k as f64 - 1.0)));
        let (times_ns, poses) = samples.unzip();
        PoseTrack::new(times_ns, poses).unwrap()
    };
    let mut scene = SceneMotion::new(lens(), late(camera));
    scene.insert(BALL, late(ball)).unwrap();
    let mut check = ConventionCheck::default();
    for (k, (_, depth, ids, motion)) in (1..=3).zip(&right().frames) {
        let times = (key_ns(k - 1), key_ns(k));
        check.add(&KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap());
    }
    let report = check.report(&scene).unwrap();
    assert_eq!(mistaken(report.world.as_ref().unwrap()), [vec![Mistake::PosesBehind]]);
}

#[test]
fn two_mistakes_are_both_named() {
    let mut sequence = planted(Mistake::CameraOpenCv);
    change_vectors(&mut sequence, |[x, y]| [2.0 * x / WIDTH_PX as f32, -2.0 * y / HEIGHT_PX as f32]);
    let report = report(&sequence);
    let causes = mistaken(report.world.as_ref().unwrap());
    let expected = [Mistake::CameraOpenCv, Mistake::VectorsYUp, Mistake::VectorsOfHalfSize];
    assert_eq!(causes, [expected.to_vec()]);
    assert_eq!(report.instances[&BALL].verdict, Verdict::Agrees);
}

#[test]
fn noise_is_unexplained() {
    let mut sequence = right();
    let mut state = 1_u32;
    for vector in sequence.frames.iter_mut().flat_map(|(_, _, _, motion)| motion) {
        *vector = [0; 2].map(|_: i32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as f32 - 128.0
        });
    }
    assert_eq!(report(&sequence).world.unwrap().verdict, Verdict::Unexplained { nearest: None });
}

#[test]
fn a_still_scene_tells_nothing_and_says_so() {
    let mut sequence = right();
    sequence.scene = scene(lens(), |_| camera(0.0), |_| ball(0.0));
    change_vectors(&mut sequence, |_| [0.001, 0.0]);
    let report = report(&sequence);
    assert_eq!(report.world.as_ref().unwrap().verdict, Verdict::Still);
    assert!(report.agrees());
}

#[test]
fn without_a_world_the_ball_alone_tells_the_sign() {
    let mut sequence = planted(Mistake::VectorsNegated);
    sequence.frames.iter_mut().for_each(|(_, _, ids, _)| ids.fill(BALL));
    for (t_ns, depth, _, motion) in &mut sequence.frames {
        for i in 0..motion.len() {
            let pixel_px = pixel_px(i);
            let depth_m = f64::from(depth[i]);
            let end = sequence.scene.path(pixel_px, depth_m, BALL, *t_ns, *t_ns - FRAME_NS).unwrap();
            motion[i] = (pixel_px - end.pixel_px).to_array().map(|v| v as f32);
        }
    }
    let report = report(&sequence);
    assert_eq!(report.world, None);
    assert_eq!(mistaken(&report.instances[&BALL])[0], [Mistake::VectorsNegated]);
}

#[test]
fn pixels_that_cannot_be_compared_are_left_out_or_counted() {
    let mut sequence = right();
    sequence.scene = SceneMotion::new(lens(), track(camera));
    let without = report(&sequence);
    assert!(without.pixels_without_poses > 500 && without.instances.is_empty());
    // Nothing but background, bad depth, bad vectors or vectors of a first frame: nothing to compare.
    for depth_m in [f32::INFINITY, 0.0, f32::NAN, -1.0] {
        change_depth(&mut sequence, |_, _| f64::from(depth_m));
        let mut check = ConventionCheck::default();
        for (t_ns, depth, ids, motion) in &sequence.frames {
            let times = (t_ns - FRAME_NS, *t_ns);
            check.add(&KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap());
        }
        assert_eq!(check.report(&sequence.scene), None, "{depth_m}");
    }
    for vector in [[f32::NAN, 0.0], [1e30, 0.0], [0.0, 0.0]] {
        let mut sequence = right();
        change_vectors(&mut sequence, |_| vector);
        let (t_ns, depth, ids, motion) = &sequence.frames[0];
        let mut check = ConventionCheck::default();
        let times = (t_ns - FRAME_NS, *t_ns);
        check.add(&KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap());
        assert_eq!(check.report(&sequence.scene), None, "{vector:?}");
    }
}

#[test]
fn images_of_a_wrong_size_are_named() {
    let (depth, ids, motion) = ([1.0; 12], [0; 12], [[1.0; 2]; 12]);
    let error = |depth: &[f32], ids: &[u32], motion: &[[f32; 2]]| {
        KeyFrame::new((4, 3), (0, 1), depth, Some(ids), motion).unwrap_err().to_string()
    };
    assert_eq!(error(&depth[1..], &ids, &motion), "depth has 11 pixels, expected 12 (4x3)");
    assert_eq!(error(&depth, &ids[2..], &motion), "ids has 10 pixels, expected 12 (4x3)");
    assert_eq!(error(&depth, &ids, &motion[..0]), "motion has 0 pixels, expected 12 (4x3)");
    assert!(KeyFrame::new((4, 3), (0, 1), &depth, None, &motion).is_ok());
}

/// What a camera's check has found after each of a sequence's frames. The poses come interval by interval.
fn checked(sequence: &Sequence) -> Vec<Trust> {
    let (mut check, mut said) = (PoseCheck::default(), Vec::new());
    let trust = sequence.frames.iter().map(|(t_ns, depth, ids, motion)| {
        let times = (t_ns - FRAME_NS, *t_ns);
        let part = |track: &PoseTrack| {
            let samples = track.times_ns().iter().copied().zip(track.poses().iter().copied());
            let (times_ns, poses) = samples.filter(|&(at, _)| times.0 <= at && at <= times.1).unzip();
            PoseTrack::new(times_ns, poses).unwrap()
        };
        let mut scene = SceneMotion::new(lens(), part(sequence.scene.camera()));
        for id in sequence.scene.ids() {
            scene.insert(id, part(sequence.scene.instance(id).unwrap())).unwrap();
        }
        let frame = KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap();
        check.add(&frame, &scene);
        // A step that is tried again shows the same frame.
        check.add(&frame, &scene);
        said.push(check.report().and_then(ConventionReport::disagreement));
        check.trust().clone()
    });
    let trust: Vec<Trust> = trust.collect();
    assert!(check.is_over(), "{check:?}");
    said.dedup();
    assert!(said.len() <= 2, "once more if a cause is found: {said:#?}");
    trust
}

#[test]
fn each_mistake_leaves_the_poses_that_are_right() {
    let vectors = SIGNS.iter().chain(&UNITS).filter_map(|one| one.first()).chain(&FACTORS);
    let own = vectors.chain(&[Mistake::VectorsToNextFrame]).copied();
    let of_vectors: Vec<Mistake> = own.collect();
    // The other distance and the other lens are told from these, but here they move no pixel by more than hardly.
    let slight = [Mistake::DepthOfOtherKind, Mistake::LensOfOtherKind];
    for mistake in slight {
        let report = report(&planted(mistake));
        assert!(!report.agrees() && report.trust() == Trust::All, "{mistake:?}");
    }
    let told = |mistake: &&Mistake| !slight.contains(mistake);
    for &mistake in of_vectors.iter().chain(CAMERA.iter().chain(&SURFACE).filter(told)) {
        let expected = if of_vectors.contains(&mistake) { Trust::All } else { Trust::Nothing };
        assert_eq!(report(&planted(mistake)).trust(), expected, "{mistake:?}");
        // Where the poses of each interval come by themselves, the next frame's are not there yet.
        if mistake != Mistake::VectorsToNextFrame {
            assert_eq!(checked(&planted(mistake)), vec![expected; 5], "{mistake:?}");
        }
    }
    let without = Trust::Without([BALL].into());
    for mistake in BODY.iter().filter(|mistake| mistake.shift_frames() == 0) {
        assert_eq!(checked(&planted(*mistake)), vec![without.clone(); 5], "{mistake:?}");
    }
    assert_eq!(checked(&right()), vec![Trust::All; 5]);
}

#[test]
fn a_shift_is_named_though_poses_come_interval_by_interval() {
    for (mistake, shift) in [(Mistake::PosesAhead, 1.0), (Mistake::PosesBehind, -1.0)] {
        let mut sequence = right();
        let scene = scene(lens(), |k| camera(k + shift), |k| ball(k + shift));
        sequence.scene = scene.clone();
        let mut check = PoseCheck::default();
        for (t_ns, depth, ids, motion) in &sequence.frames {
            let times = (t_ns - FRAME_NS, *t_ns);
            let frame = KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap();
            check.add(&frame, &scene);
        }
        assert_eq!(mistaken(check.report().unwrap().world.as_ref().unwrap()), [vec![mistake]]);
        assert_eq!(*check.trust(), Trust::Nothing);
    }
}

#[test]
fn poses_that_lead_behind_the_camera_are_doubted() {
    let mut sequence = right();
    let turned = |k: f64| {
        let pose = camera(k);
        let about = DQuat::from_rotation_y(std::f64::consts::PI * k);
        Pose::new(pose.rotation() * about, pose.translation_m()).unwrap()
    };
    sequence.scene = scene(lens(), turned, ball);
    assert_eq!(report(&sequence).trust(), Trust::Nothing);
}

#[test]
fn what_stands_still_does_not_end_the_check() {
    let mut still = right();
    still.scene = scene(lens(), |_| camera(0.0), |_| ball(0.0));
    change_vectors(&mut still, |_| [0.001, 0.0]);
    let wrong = planted(Mistake::CameraInverted);
    let mut check = PoseCheck::default();
    let add = |check: &mut PoseCheck, sequence: &Sequence, k: usize, t_ns: i64| {
        let (_, depth, ids, motion) = &sequence.frames[k];
        let times = (t_ns - FRAME_NS, t_ns);
        check.add(
            &KeyFrame::new((WIDTH_PX, HEIGHT_PX), times, depth, Some(ids), motion).unwrap(),
            &sequence.scene,
        );
    };
    for k in 0..5 {
        add(&mut check, &still, k, still.frames[k].0);
    }
    assert!(!check.is_over() && *check.trust() == Trust::All);
    assert!(check.report().unwrap().to_string().contains("nothing moves"));
    add(&mut check, &wrong, 2, wrong.frames[2].0 + 1);
    assert_eq!(*check.trust(), Trust::Nothing, "{:?}", check.report());
    // Once in doubt, always in doubt.
    let mut check = PoseCheck::resumed(Trust::Without([OTHER].into()), false);
    add(&mut check, &right(), 0, right().frames[0].0);
    assert_eq!(*check.trust(), Trust::Without([OTHER].into()));
}

#[test]
fn a_few_rows_are_enough() {
    let (t_ns, depth, ids, motion) = &right().frames[1];
    let rows: Vec<u32> = (1..HEIGHT_PX).step_by(3).collect();
    let width = WIDTH_PX as usize;
    let of = |row: &u32| *row as usize * width..(*row as usize + 1) * width;
    let depth: Vec<f32> = rows.iter().flat_map(|row| depth[of(row)].to_vec()).collect();
    let ids: Vec<u32> = rows.iter().flat_map(|row| ids[of(row)].to_vec()).collect();
    let motion: Vec<[f32; 2]> = rows.iter().flat_map(|row| motion[of(row)].to_vec()).collect();
    let (size_px, times_ns) = ((WIDTH_PX, HEIGHT_PX), (t_ns - FRAME_NS, *t_ns));
    let frame = KeyFrame::of_rows(size_px, times_ns, Some(&rows), &depth, Some(&ids), &motion).unwrap();
    let mut check = PoseCheck::default();
    check.add(&frame, &right().scene);
    let report = check.report().unwrap();
    assert!(report.agrees() && report.world.as_ref().unwrap().verdict == Verdict::Agrees, "{report:?}");
    let error =
        KeyFrame::of_rows(size_px, times_ns, Some(&rows[1..]), &depth, Some(&ids), &motion).unwrap_err();
    assert_eq!(error.to_string(), "depth has 1024 pixels, expected 960 (64x48)");
}

#[test]
fn findings_have_words() {
    let words = report(&right()).to_string();
    assert!(
        words
            .starts_with("depth and poses predict the motion vectors within (median): the static world 0 px"),
        "{words}"
    );
    assert_eq!(report(&right()).disagreement(), None);
    let words = report(&planted(Mistake::CameraInverted)).disagreement().unwrap();
    assert!(words.contains("motion vectors of the static world: "), "{words}");
    assert!(
        words.contains("; likely the camera's matrix is camera from world, not world from camera (then 0 px")
    );
}
