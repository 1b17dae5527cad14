//! Follows what every pixel shows along the poses of its instance and the camera, and compares with the motion vectors.

use esaac_model::paths::STATIC_WORLD;
use esaac_model::{HdrFormat, MotionFormat};
use esaac_scene::{Scene, SceneKind, render_cpu};
use glam::{DVec2, DVec3};
use std::collections::BTreeSet;

const SIZE_PX: (u32, u32) = (64, 48);
const INTERVAL_NS: i64 = 33_333_333;

/// Largest difference between a motion vector and the path from depth, id and poses, pixels. Depth and motion are
/// rounded to f32: the largest motion of about 20 px to 1e-6 px, and depth by 6e-8 of itself, which shifts the path by
/// that share of the parallax.
const PATH_TOLERANCE_PX: f64 = 5e-6;

fn scenes() -> impl Iterator<Item = Scene> {
    SceneKind::ALL.into_iter().map(|kind| kind.scene(SIZE_PX.0, SIZE_PX.1))
}

#[test]
fn depth_ids_and_poses_predict_the_motion_vectors() {
    for scene in scenes() {
        let mut ids_seen = BTreeSet::new();
        let mut largest_px = 0.0_f64;
        for t_ns in [1_000_000_007, 1_066_666_667, 4_321_000_000] {
            let times_ns = [t_ns - INTERVAL_NS, t_ns];
            let known = scene.scene_motion(&times_ns);
            let frame = render_cpu(&scene, t_ns, Some(times_ns[0]), HdrFormat::F32x4, MotionFormat::F32x2);
            let depth_m: Vec<f32> = bytemuck::pod_collect_to_vec(&frame.depth);
            let ids: Vec<u32> = bytemuck::pod_collect_to_vec(&frame.ids);
            for (index, (&depth_m, &id)) in depth_m.iter().zip(&ids).enumerate() {
                let (x, y) = (index as u32 % SIZE_PX.0, index as u32 / SIZE_PX.0);
                let pixel_px = DVec2::new(f64::from(x), f64::from(y));
                let before = known.path(pixel_px, f64::from(depth_m), id, t_ns, times_ns[0]).expect("a path");
                let motion_px = DVec2::from_array(MotionFormat::F32x2.decode(&frame.motion, index));
                let off_px = (before.pixel_px - pixel_px - motion_px).length();
                assert!(
                    off_px < PATH_TOLERANCE_PX,
                    "{:?} ({x}, {y}), instance {id}, {depth_m} m: motion {motion_px}, path {}",
                    scene.kind,
                    before.pixel_px - pixel_px
                );
                largest_px = largest_px.max(off_px);
                ids_seen.insert(id);
            }
        }
        println!("{:?}: {largest_px:.1e} px, instances {ids_seen:?}", scene.kind);
        let known: BTreeSet<u32> = scene.instances().chain([STATIC_WORLD]).collect();
        assert!(ids_seen.is_subset(&known));
    }
}

#[test]
fn what_moves_has_an_instance_and_what_stands_still_has_none() {
    let moving = |kind: SceneKind| kind.scene(SIZE_PX.0, SIZE_PX.1).instances().count();
    assert_eq!([SceneKind::Edge, SceneKind::Lamp, SceneKind::Still].map(moving), [1, 0, 0]);
    assert_eq!([SceneKind::Flight, SceneKind::Shake].map(moving), [7, 7], "the turning spheres");
    let wall = [SceneKind::Poles, SceneKind::Foliage, SceneKind::Propeller, SceneKind::Bounce];
    assert_eq!(wall.map(moving), [2, 1, 1, 1]);
}

/// The camera looks along -z of its pose, with x to the right and y up, in a world with z up.
#[test]
fn a_level_camera_that_looks_along_world_y_has_its_axes_there() {
    let pose = SceneKind::Propeller.scene(SIZE_PX.0, SIZE_PX.1).camera_pose(0.3);
    for (own, world) in [(DVec3::NEG_Z, DVec3::Y), (DVec3::X, DVec3::X), (DVec3::Y, DVec3::Z)] {
        assert!((pose.direction(own) - world).length() < 1e-15);
    }
}

/// Sampled poses give the path at the times between them: at 960 Hz within a thousandth of a pixel, except where the
/// velocity jumps.
#[test]
fn poses_between_samples_are_those_of_the_scene() {
    for scene in scenes() {
        let step_ns = 1_041_667;
        let times_ns: Vec<i64> = (0..=32).map(|k| 1_000_000_000 + step_ns * k).collect();
        let known = scene.scene_motion(&times_ns);
        let instances = scene.instances().filter(|_| scene.kind != SceneKind::Bounce);
        for id in instances.chain([STATIC_WORLD]) {
            for k in 0..32 {
                let t_ns = times_ns[k] + step_ns / 2;
                let exact = scene.scene_motion(&[times_ns[0], t_ns]);
                let centre_px = scene.intrinsics().centre_px();
                let path = |motion: &esaac_model::paths::SceneMotion| {
                    motion.path(centre_px, 3.0, id, times_ns[0], t_ns).expect("a path").pixel_px
                };
                let off_px = (path(&known) - path(&exact)).length();
                assert!(off_px < 1e-3, "{:?}, instance {id}, sample {k}: {off_px} px", scene.kind);
            }
        }
    }
}
