//! Optical flow by the poses: where what each pixel shows is at another time.

use super::{NoPath, Pose, STATIC_WORLD, SceneMotion};
use glam::DVec2;
use std::collections::HashMap;

impl SceneMotion {
    /// The displacement of what each pixel of an image shows at `from_ns`, until `to_ns`, which may be earlier: columns and
    /// rows, pixels, y down. `depth_m` and `ids` are of the image, row by row, `width_px` columns; without ids all is the
    /// static world. Not a number where there is no path: without depth, without poses that reach both times, or if the
    /// camera does not see the point. What comes to lie before the point is not looked for.
    ///
    /// # Panics
    /// If there are not as many ids as depths.
    #[must_use]
    pub fn flow(
        &self,
        depth_m: &[f32],
        ids: Option<&[u32]>,
        width_px: usize,
        from_ns: i64,
        to_ns: i64,
    ) -> Vec<[f32; 2]> {
        assert!(ids.is_none_or(|ids| ids.len() == depth_m.len()), "an id for each depth");
        let mut motions: HashMap<u32, Result<Pose, NoPath>> = HashMap::new();
        let displacement = |(pixel, &depth_m): (usize, &f32)| {
            let id = ids.map_or(STATIC_WORLD, |ids| ids[pixel]);
            let motion = motions.entry(id).or_insert_with(|| self.relative(id, from_ns, to_ns));
            let at = DVec2::new((pixel % width_px) as f64, (pixel / width_px) as f64);
            let there = motion.as_ref().ok().and_then(|m| self.lens().path(at, f64::from(depth_m), m).ok());
            there.map_or([f32::NAN; 2], |there| (there.pixel_px - at).as_vec2().to_array())
        };
        depth_m.iter().enumerate().map(displacement).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paths::{Intrinsics, PoseTrack};
    use glam::{DQuat, DVec3};

    #[test]
    fn flow_is_what_depth_and_poses_say_and_nothing_where_they_say_nothing() {
        let going = |way_m: DVec3| {
            let poses = [DVec3::ZERO, way_m].map(|at| Pose::new(DQuat::IDENTITY, at).unwrap());
            PoseTrack::new(vec![0, 1000], poses.to_vec()).unwrap()
        };
        let lens = Intrinsics::pinhole(20.0, 30.0, 1.0, 0.5).unwrap();
        let mut scene = SceneMotion::new(lens, going(DVec3::new(0.2, 0.4, 0.0)));
        scene.insert(7, going(DVec3::new(0.2, 0.4, 0.0))).unwrap();
        let infinite = f32::INFINITY;
        let depth = [2.0, 4.0, infinite, 0.0, 2.0, 2.0, f32::NAN, -1.0];
        let ids = [0, 0, 0, 0, 7, 8, 0, 0];
        let expect = |actual: &[[f32; 2]], expected: &[Option<[f32; 2]>]| {
            for (pixel, (actual, expected)) in actual.iter().zip(expected).enumerate() {
                match expected {
                    None => assert!(actual.iter().all(|a| a.is_nan()), "{pixel}: {actual:?}"),
                    Some(e) => {
                        assert!((0..2).all(|i| (actual[i] - e[i]).abs() < 1e-6), "{pixel}: {actual:?}")
                    }
                }
            }
        };
        // The camera goes right and up, so the world goes left and down; the body goes with it.
        let (near, far, rests) = (Some([-2.0, 6.0]), Some([-1.0, 3.0]), Some([0.0, 0.0]));
        let forth = scene.flow(&depth, Some(&ids), 4, 0, 1000);
        expect(&forth, &[near, far, rests, rests, rests, None, None, None]);
        let back = scene.flow(&depth[..2], None, 4, 1000, 0);
        expect(&back, &[Some([2.0, -6.0]), Some([1.0, -3.0])]);
        // The poses end there.
        expect(&scene.flow(&depth[..1], None, 4, 0, 1001), &[None]);
    }
}
