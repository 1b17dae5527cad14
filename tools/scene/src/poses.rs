//! What a simulator knows of a scene beside its images: the lens, and where the camera and every moving instance are.
//!
//! In the terms of [`esaac_model::paths`]: the world has z up; a camera's axes are x right, y up, z backwards.

use crate::registry::Family;
use crate::scene::Scene;
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use glam::{DMat3, DQuat, DVec3};

/// Camera axes of the model (y up, z backwards) from those of the image (y down, z forward), and back.
const IMAGE_FROM_CAMERA: DMat3 = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));

impl Scene {
    /// The lens.
    #[must_use]
    pub fn intrinsics(&self) -> Intrinsics {
        let centre_px = |pixels: u32| 0.5 * (f64::from(pixels) - 1.0);
        let (cx_px, cy_px) = (centre_px(self.width_px), centre_px(self.height_px));
        Intrinsics::pinhole(self.focal_px, self.focal_px, cx_px, cy_px).expect("a scene has a focal length")
    }

    /// Pose of the camera, world from camera.
    #[must_use]
    pub fn camera_pose(&self, t_s: f64) -> Pose {
        let state = self.camera.state(self.clock_s(t_s));
        pose(state.world_from_body * IMAGE_FROM_CAMERA, state.position_m)
    }

    /// Ids of the instances that move, ascending.
    pub fn instances(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.objects.len()).map(|index| self.instance(index)).filter(|&id| id > 0)
    }

    /// Pose of a moving instance, world from body. `None` if the scene has no such instance.
    #[must_use]
    pub fn instance_pose(&self, id: u32, t_s: f64) -> Option<Pose> {
        let index = (0..self.objects.len()).find(|&index| id > 0 && self.instance(index) == id)?;
        let (position, turn) = self.objects[index].motion.pose(self.clock_s(t_s));
        if self.kind.family() == Family::Card {
            // A card is an image plane one metre before a camera that stands still. It moves in pixels.
            let world_from_image = self.camera.state(0.0).world_from_body;
            return Some(pose(world_from_image * turn, world_from_image * (position / self.focal_px)));
        }
        Some(pose(turn, position))
    }

    /// The lens, and the poses of the camera and all moving instances at `times_ns`, which ascend.
    #[must_use]
    pub fn scene_motion(&self, times_ns: &[i64]) -> SceneMotion {
        let track =
            |pose_at: &dyn Fn(f64) -> Pose| PoseTrack::through(times_ns, pose_at).expect("times that ascend");
        let mut motion = SceneMotion::new(self.intrinsics(), track(&|t_s| self.camera_pose(t_s)));
        for id in self.instances() {
            let known = |t_s| self.instance_pose(id, t_s).expect("an id of this scene");
            motion.insert(id, track(&known)).expect("each instance has an id of its own");
        }
        motion
    }
}

fn pose(rotation: DMat3, translation_m: DVec3) -> Pose {
    Pose::new(DQuat::from_mat3(&rotation), translation_m).expect("a rotation and finite numbers")
}
