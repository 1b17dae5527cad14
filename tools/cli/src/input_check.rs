//! Tells when events must be false whatever the engine does: the frames move fast, and nothing in them says how.

use crate::image_motion::{Luminance, fastest_px, upper};
use esaac_formats::exr_frame::{FrameImages, FrameLayout};
use esaac_model::{MotionFormat, SensorModel, Synthesis};
use serde::Serialize;

/// Motion from frame to frame, pixels, from which blending sends events at wrong places: an edge is at two places at
/// once, farther apart than it is wide.
const FAST_PX: f64 = 2.0;

/// Distance from a parabola, pixels, from which warping along it sends events at wrong places.
const OFF_PARABOLA_PX: f64 = 0.5;

/// The share of the image that may move faster than the figure that is reported.
const FASTER_SHARE: f64 = 0.05;

/// Largest distance of a cubic from the parabola through three of its samples, between the last two, for each unit of
/// its third difference: the maximum of `t (1 - t) (1 + t) / 6`.
const CUBIC_REMAINDER: f64 = 0.064_15;

/// Frames that are looked at. What a simulator lacks, it lacks in all of them.
const CHECKED_FRAMES: usize = 16;

/// Every so many pixels' vector is looked at, on both axes.
const VECTOR_STEP_PX: usize = 3;

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct InputReport {
    /// Pixels that a twentieth of the image moves by from frame to frame, or more. Synthesis `linear` only.
    pub motion_px: Option<f64>,
    /// Distance of trajectories from parabolas, pixels: the median of what moves. Synthesis `motion` only.
    pub off_parabola_px: Option<f64>,
    /// What follows, if events must be false.
    pub warning: Option<String>,
}

/// The check of one run.
pub struct InputCheck<'a> {
    layout: &'a FrameLayout,
    synthesis: Synthesis,
    log_offset: f64,
    checked: usize,
    before: Option<Luminance>,
    /// Vectors of the last frames, the latest first.
    vectors: Vec<Vec<[f64; 2]>>,
    fast_px: Vec<f64>,
    off_px: Vec<f64>,
}

impl<'a> InputCheck<'a> {
    /// A check of frames of `layout` for `sensor`, whose synthesis has been chosen.
    #[must_use]
    pub fn new(layout: &'a FrameLayout, sensor: &SensorModel) -> Self {
        InputCheck {
            layout,
            synthesis: sensor.synthesis,
            log_offset: sensor.dark_level(),
            checked: 0,
            before: None,
            vectors: Vec::new(),
            fast_px: Vec::new(),
            off_px: Vec::new(),
        }
    }

    /// Takes the next frame.
    pub fn add(&mut self, images: &FrameImages) {
        if self.checked == CHECKED_FRAMES {
            return;
        }
        self.checked += 1;
        let is_first = self.checked == 1;
        match (self.synthesis, &images.motion) {
            // The first frame's vectors lead to a frame that is not there.
            (Synthesis::Linear | Synthesis::Motion, Some(_)) if is_first => {}
            (Synthesis::Linear, Some(motion)) => {
                let mut lengths: Vec<f64> =
                    self.decode(motion).iter().map(|[x, y]| x.hypot(*y)).filter(|l| l.is_finite()).collect();
                self.fast_px.extend(upper(&mut lengths, FASTER_SHARE));
            }
            (Synthesis::Linear, None) => {
                let this = Luminance::new(self.layout, &images.hdr, self.log_offset);
                if let Some(before) = &self.before {
                    self.fast_px.extend(fastest_px(before, &this, FASTER_SHARE));
                }
                self.before = Some(this);
            }
            (Synthesis::Motion, Some(motion)) => {
                self.vectors.insert(0, self.decode(motion));
                self.vectors.truncate(3);
                let size = (self.layout.width_px as usize, self.layout.height_px as usize);
                if let [now, before, earlier] = &self.vectors[..] {
                    self.off_px.extend(off_parabola_px(size, [now, before, earlier]));
                }
            }
            _ => {}
        }
    }

    /// What was found, if the synthesis can fail in this way.
    #[must_use]
    pub fn report(mut self) -> Option<InputReport> {
        let motion_px = upper(&mut self.fast_px, 0.5);
        let off_parabola_px = upper(&mut self.off_px, 0.5);
        motion_px.or(off_parabola_px)?;
        let fast = motion_px.filter(|px| *px > FAST_PX).map(|px| {
            format!(
                "part of the image moves by {px:.1} px a frame or more, and blended frames show it at two places at \
                 once, so that many events are false; give motion vectors, or depth and poses"
            )
        });
        let off = off_parabola_px.filter(|px| *px > OFF_PARABOLA_PX).map(|px| {
            format!(
                "what moves leaves a parabola through three frames by {px:.1} px or more, so that many events are at \
                 wrong times and places; give depth and poses, or more frames a second"
            )
        });
        Some(InputReport { motion_px, off_parabola_px, warning: fast.or(off) })
    }

    fn decode(&self, motion: &[u8]) -> Vec<[f64; 2]> {
        let format = self.layout.motion.unwrap_or(MotionFormat::F32x2);
        (0..motion.len() / format.texel_bytes()).map(|i| format.decode(motion, i)).collect()
    }
}

/// Median distance from parabolas of what moves, from the vectors of three frames, the latest first.
fn off_parabola_px((width, height): (usize, usize), vectors: [&[[f64; 2]]; 3]) -> Option<f64> {
    let at = |field: usize, [x, y]: [f64; 2]| {
        let (column, row) = (x.round(), y.round());
        let inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
        // A vector may lead farther than an index can count.
        let vector = inside.then(|| vectors[field][row as usize * width + column as usize])?;
        (vector[0].is_finite() && vector[1].is_finite()).then_some(vector)
    };
    let third_difference = |x: usize, y: usize| {
        let mut place = [x as f64, y as f64];
        let mut along = [[0.0; 2]; 3];
        for (field, vector) in along.iter_mut().enumerate() {
            *vector = at(field, place)?;
            place = [place[0] + vector[0], place[1] + vector[1]];
        }
        let of = |axis: usize| along[0][axis] - 2.0 * along[1][axis] + along[2][axis];
        let moves = along.iter().any(|[x, y]| x.hypot(*y) > 1.0);
        moves.then(|| of(0).hypot(of(1)))
    };
    let mut off_px: Vec<f64> = (0..height)
        .step_by(VECTOR_STEP_PX)
        .flat_map(|y| (0..width).step_by(VECTOR_STEP_PX).map(move |x| (x, y)))
        .filter_map(|(x, y)| third_difference(x, y))
        .map(|difference| CUBIC_REMAINDER * difference)
        .collect();
    upper(&mut off_px, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_formats::exr_frame::ChannelNames;
    use esaac_model::HdrFormat;
    use esaac_scene::{SceneKind, render_cpu};

    const SIZE_PX: (u32, u32) = (96, 72);
    const FRAME_NS: i64 = 33_333_333;

    fn found(kind: SceneKind, synthesis: Synthesis, with_motion: bool) -> InputReport {
        let layout = FrameLayout {
            width_px: SIZE_PX.0,
            height_px: SIZE_PX.1,
            names: ChannelNames::default(),
            hdr: HdrFormat::F16x4,
            motion: with_motion.then_some(MotionFormat::F32x2),
            motion_factors: [1.0; 2],
            depth: None,
            ids: None,
        };
        let sensor = SensorModel { synthesis, ..SensorModel::default() };
        let mut check = InputCheck::new(&layout, &sensor);
        let scene = kind.scene(SIZE_PX.0, SIZE_PX.1);
        for k in 0..6 {
            let before_ns = (k > 0).then_some((k - 1) * FRAME_NS);
            let frame = render_cpu(&scene, k * FRAME_NS, before_ns, layout.hdr, MotionFormat::F32x2);
            let motion = with_motion.then_some(frame.motion);
            check.add(&FrameImages { hdr: frame.hdr, motion, ..FrameImages::default() });
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
        for (kind, shakes) in
            [(SceneKind::Shake, true), (SceneKind::Flight, false), (SceneKind::Poles, false)]
        {
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

    #[test]
    fn exact_paths_are_not_checked() {
        let layout = FrameLayout {
            width_px: 2,
            height_px: 1,
            names: ChannelNames::default(),
            hdr: HdrFormat::F32x4,
            motion: None,
            motion_factors: [1.0; 2],
            depth: None,
            ids: None,
        };
        let sensor = SensorModel { synthesis: Synthesis::Rigid, ..SensorModel::default() };
        let mut check = InputCheck::new(&layout, &sensor);
        check.add(&FrameImages { hdr: vec![0; 32], ..FrameImages::default() });
        assert_eq!(check.report(), None);
    }

    #[test]
    fn vectors_that_lead_far_out_of_the_image_are_passed_over() {
        for far in [[1e30, 0.0], [0.0, 3e38], [-1e30, -3e38], [f64::INFINITY, 0.0], [f64::NAN, 0.0]] {
            let field = vec![far; 8 * 6];
            assert_eq!(off_parabola_px((8, 6), [&field, &field, &field]), None, "{far:?}");
        }
    }

    #[test]
    fn a_share_of_the_values_reaches_what_is_reported() {
        let mut values: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!((upper(&mut values, 0.05), upper(&mut values, 0.5)), (Some(96.0), Some(51.0)));
        assert_eq!((upper(&mut [7.0], 0.0), upper(&mut [], 0.5)), (Some(7.0), None));
    }
}
