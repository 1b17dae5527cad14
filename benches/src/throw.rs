//! What a simulator of many environments shows: a still camera, a still wall, and one textured board that slides before
//! it. Most of the image neither moves nor changes.

use crate::scenes::{FRAME_NS, encode, pose_times_ns};
use esaac_engine::FrameBytes;
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;

/// The board's id.
const BOARD: u32 = 1;

/// Distances of both along the optical axis, metres.
const WALL_M: f64 = 4.0;
const BOARD_M: f64 = 2.0;

/// Half the board's width and height, metres.
const HALF_WIDTH_M: f64 = 0.4;
const HALF_HEIGHT_M: f64 = 0.5;

/// Where the board begins, metres from the middle of the image, and where it turns round on the other side.
const START_M: f64 = -0.5;

/// Focal length over the width of the image.
const FOCAL: f64 = 0.94;

/// Samples of a pixel along x: the board's edges are ramps of a pixel.
const SAMPLES: u32 = 4;

/// The scene, for images of one size.
#[derive(Clone, Copy, Debug)]
pub struct Throw {
    /// Columns and rows.
    pub size: (u32, u32),
    /// Speed of the board, pixels a frame.
    pub motion_px: f64,
}

/// Images of a frame: colour in f16x4, depth in f32, ids in u32.
pub(crate) struct ThrowFrame {
    hdr: Vec<u8>,
    depth: Vec<u8>,
    ids: Vec<u8>,
}

impl ThrowFrame {
    /// Colour, and if a camera takes them depth and ids.
    pub(crate) fn bytes(&self, with_geometry: bool) -> FrameBytes<'_> {
        let [depth, ids] = [&self.depth, &self.ids].map(|image| with_geometry.then_some(image.as_slice()));
        FrameBytes { hdr: &self.hdr, motion: None, depth, ids }
    }
}

impl Throw {
    fn focal_px(&self) -> f64 {
        FOCAL * f64::from(self.size.0)
    }

    fn centre_px(&self) -> [f64; 2] {
        [self.size.0, self.size.1].map(|pixels| (f64::from(pixels) - 1.0) / 2.0)
    }

    pub(crate) fn lens(&self) -> Intrinsics {
        let [x_px, y_px] = self.centre_px();
        Intrinsics::pinhole(self.focal_px(), self.focal_px(), x_px, y_px).expect("a lens")
    }

    /// Where the board is: it slides to and fro.
    fn board_x_m(&self, t_ns: i64) -> f64 {
        let way_m = self.motion_px * t_ns as f64 / FRAME_NS as f64 * BOARD_M / self.focal_px();
        let there_m = -2.0 * START_M;
        let turned_m = way_m.rem_euclid(2.0 * there_m);
        START_M + turned_m.min(2.0 * there_m - turned_m)
    }

    pub(crate) fn frame(&self, t_ns: i64) -> ThrowFrame {
        let board_x_m = self.board_x_m(t_ns);
        let [centre_x_px, centre_y_px] = self.centre_px();
        // A place on a plane `away_m` away, of a place in the image.
        let on = |px: f64, centre_px: f64, away_m: f64| (px - centre_px) / self.focal_px() * away_m;
        let board = |x_px: f64, y_px: f64| {
            let (x_m, y_m) = (on(x_px, centre_x_px, BOARD_M) - board_x_m, on(y_px, centre_y_px, BOARD_M));
            (x_m.abs() < HALF_WIDTH_M && y_m.abs() < HALF_HEIGHT_M).then_some(x_m)
        };
        let light = |x_px: f64, y_px: f64| match board(x_px, y_px) {
            Some(x_m) => 0.5 + 0.3 * (11.0 * x_m).sin(),
            None => {
                let [x_m, y_m] = [on(x_px, centre_x_px, WALL_M), on(y_px, centre_y_px, WALL_M)];
                0.5 + 0.2 * (TAU * 1.4 * x_m).sin() * (TAU * 1.1 * y_m).sin()
            }
        };
        let mut frame = ThrowFrame { hdr: Vec::new(), depth: Vec::new(), ids: Vec::new() };
        for (y_px, x_px) in
            (0..self.size.1).flat_map(|y| (0..self.size.0).map(move |x| (f64::from(y), f64::from(x))))
        {
            let sum: f64 = (0..SAMPLES)
                .map(|sample| light(x_px + (f64::from(sample) + 0.5) / f64::from(SAMPLES) - 0.5, y_px))
                .sum();
            frame.hdr.extend(encode(sum / f64::from(SAMPLES)));
            let shows_board = board(x_px, y_px).is_some();
            let (depth_m, id) = if shows_board { (BOARD_M, BOARD) } else { (WALL_M, 0) };
            frame.depth.extend((depth_m as f32).to_le_bytes());
            frame.ids.extend(u32::to_le_bytes(id));
        }
        frame
    }

    /// Poses of the interval that ends at `t_ns`.
    pub(crate) fn motion(&self, t_ns: i64) -> SceneMotion {
        let times_ns = pose_times_ns(t_ns, FRAME_NS);
        let track = |at: &dyn Fn(i64) -> DVec3| {
            let poses = times_ns.iter().map(|&t_ns| Pose::new(DQuat::IDENTITY, at(t_ns)).expect("finite"));
            PoseTrack::new(times_ns.clone(), poses.collect()).expect("times that ascend")
        };
        let mut motion = SceneMotion::new(self.lens(), track(&|_| DVec3::ZERO));
        let board = track(&|t_ns| DVec3::new(self.board_x_m(t_ns), 0.0, -BOARD_M));
        motion.insert(BOARD, board).expect("an id of its own");
        motion
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    #[test]
    fn the_board_moves_as_its_poses_say() {
        let throw = Throw { size: (64, 48), motion_px: 3.0 };
        let [first, second] = [4, 5].map(|index| throw.frame(index * FRAME_NS));
        let id = |frame: &ThrowFrame, x: usize| frame.ids[4 * (24 * 64 + x)];
        let left = |frame: &ThrowFrame| (0..64).find(|&x| id(frame, x) == 1).unwrap();
        assert_eq!(left(&second), left(&first) + 3);
        let motion = throw.motion(5 * FRAME_NS);
        let relative = motion.relative(BOARD, 5 * FRAME_NS, 4 * FRAME_NS).unwrap();
        let before = throw.lens().path(DVec2::new(30.0, 24.0), BOARD_M, &relative).unwrap();
        assert!((before.pixel_px.x - 27.0).abs() < 1e-6, "{before:?}");
    }
}
