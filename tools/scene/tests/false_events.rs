//! The check for input that must send false events, on scenes whose motion is known.

use esaac_model::input::{InputCheck, InputReport};
use esaac_model::{HdrFormat, MotionFormat, SensorModel, Synthesis};
use esaac_scene::{SceneKind, render_cpu};

const SIZE_PX: (u32, u32) = (96, 72);
const FRAME_NS: i64 = 33_333_333;

fn found(kind: SceneKind, synthesis: Synthesis, with_motion: bool) -> InputReport {
    let (hdr, vectors) = (HdrFormat::F16x4, MotionFormat::F32x2);
    let (width, height) = SIZE_PX;
    let sensor = SensorModel { synthesis, width, height, ..SensorModel::default() };
    let mut check = InputCheck::new(&sensor, hdr, with_motion.then_some(vectors));
    let scene = kind.scene(width, height);
    for k in 0..6 {
        let before_ns = (k > 0).then_some((k - 1) * FRAME_NS);
        let frame = render_cpu(&scene, k * FRAME_NS, before_ns, hdr, vectors);
        check.add(k * FRAME_NS, &frame.hdr, with_motion.then_some(&frame.motion[..]));
    }
    check.report().expect("a synthesis that is checked")
}

#[test]
fn fast_scenes_without_poses_are_told_and_slow_ones_are_not() {
    for with_motion in [false, true] {
        for (kind, fast) in [
            (SceneKind::Shake, true),
            (SceneKind::Foliage, true),
            (SceneKind::Bounce, true),
            (SceneKind::Lamp, false),
            (SceneKind::Still, false),
        ] {
            let report = found(kind, Synthesis::Linear, with_motion);
            assert_eq!(report.warning.is_some(), fast, "{kind:?}, vectors {with_motion}: {report:?}");
            assert!(report.motion_px.is_some() && report.off_parabola_px.is_none());
        }
    }
}

#[test]
fn vectors_are_enough_unless_they_shake() {
    for (kind, shakes) in [(SceneKind::Shake, true), (SceneKind::Flight, false), (SceneKind::Poles, false)] {
        let report = found(kind, Synthesis::Motion, true);
        let told = report.warning.as_ref().is_some_and(|warning| warning.contains("parabola"));
        assert_eq!(told, shakes, "{kind:?}: {report:?}");
        assert!(report.motion_px.is_none() && report.off_parabola_px.is_some());
    }
}

#[test]
fn motion_seen_in_images_is_that_of_the_vectors() {
    let [seen, given] = [false, true].map(|with_motion| {
        found(SceneKind::Foliage, Synthesis::Linear, with_motion).motion_px.expect("it moves")
    });
    assert!((seen - given).abs() <= 1.0, "seen {seen} px, given {given} px");
}
