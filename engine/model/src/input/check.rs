//! Tells when events must be false whatever the engine does: the frames move fast, and nothing in them says how, or they are
//! grainy.

use super::grain;
use super::image_motion::{Luminance, fastest_px};
use crate::quantile::upper;
use crate::{HdrFormat, MotionFormat, SensorModel, Synthesis};
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

/// Frames whose grain is looked at.
const GRAIN_FRAMES: usize = 4;

/// Frames after which a running camera is told of.
const FEWEST_FRAMES: usize = 5;

/// Every so many pixels' vector is looked at, on both axes.
const VECTOR_STEP_PX: usize = 3;

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct InputReport {
    /// Pixels that a twentieth of the image moves by from frame to frame, or more. Synthesis `linear` only.
    pub motion_px: Option<f64>,
    /// Distance of trajectories from parabolas, pixels: the median of what moves. Synthesis `motion` only.
    pub off_parabola_px: Option<f64>,
    /// Deviation of log intensity from pixel to pixel, if that was looked at.
    pub grain_log: Option<f64>,
    /// What follows, if events must be false.
    pub warning: Option<String>,
}

/// The check of one camera.
#[derive(Clone, Debug)]
pub struct InputCheck {
    size_px: (usize, usize),
    hdr: HdrFormat,
    motion: Option<MotionFormat>,
    synthesis: Synthesis,
    /// What mends it, if that is not more input.
    advice: Option<&'static str>,
    log_offset: f64,
    /// The contrast threshold that grain is held against; `None` if it is not looked at.
    threshold_log: Option<f64>,
    grains_log: Vec<f64>,
    checked: usize,
    last_ns: Option<i64>,
    before: Option<Luminance>,
    /// Vectors of the last frames, the latest first.
    vectors: Vec<Vec<[f64; 2]>>,
    fast_px: Vec<f64>,
    off_px: Vec<f64>,
}

impl InputCheck {
    /// A check of a camera's frames in these formats. The synthesis of `sensor` is what `auto` has come to.
    #[must_use]
    pub fn new(sensor: &SensorModel, hdr: HdrFormat, motion: Option<MotionFormat>) -> Self {
        InputCheck {
            size_px: (sensor.width as usize, sensor.height as usize),
            hdr,
            motion,
            synthesis: sensor.synthesis,
            advice: None,
            log_offset: sensor.dark_level(),
            threshold_log: None,
            grains_log: Vec::new(),
            checked: 0,
            last_ns: None,
            before: None,
            vectors: Vec::new(),
            fast_px: Vec::new(),
            off_px: Vec::new(),
        }
    }

    /// The same, with what to tell in place of the advice to give more, which may be there and not be followed.
    #[must_use]
    pub fn advising(self, advice: Option<&'static str>) -> Self {
        InputCheck { advice, ..self }
    }

    /// The same, which also looks at how grainy the frames are that `sensor` sees, whatever the synthesis.
    #[must_use]
    pub fn with_grain(self, sensor: &SensorModel) -> Self {
        InputCheck { threshold_log: Some(sensor.contrast_on.min(sensor.contrast_off)), ..self }
    }

    /// Whether motion has been seen enough, or cannot be false. Such a check needs no more frames but for their grain.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.checked == CHECKED_FRAMES || !matches!(self.synthesis, Synthesis::Linear | Synthesis::Motion)
    }

    /// The next frame does not follow the last one.
    pub fn restart(&mut self) {
        self.last_ns = None;
        self.before = None;
        self.vectors.clear();
    }

    /// Takes the next frame: its time and its images. The same one again is left out.
    pub fn add(&mut self, t_ns: i64, hdr: &[u8], motion: Option<&[u8]>) {
        if self.threshold_log.is_some() && self.grains_log.len() < GRAIN_FRAMES {
            let image = Luminance::new(self.size_px, self.hdr, hdr, self.log_offset);
            self.grains_log.extend(grain::grain_log(&image));
        }
        if self.is_over() || self.last_ns == Some(t_ns) {
            return;
        }
        self.checked += 1;
        let is_first = self.last_ns.replace(t_ns).is_none();
        match (self.synthesis, motion) {
            // The first frame's vectors lead to a frame that is not there.
            (_, Some(_)) if is_first => {}
            (Synthesis::Linear, Some(motion)) => {
                let mut lengths: Vec<f64> =
                    self.decode(motion).iter().map(|[x, y]| x.hypot(*y)).filter(|l| l.is_finite()).collect();
                self.fast_px.extend(upper(&mut lengths, FASTER_SHARE));
            }
            (Synthesis::Linear, None) => {
                let this = Luminance::new(self.size_px, self.hdr, hdr, self.log_offset);
                if let Some(before) = &self.before {
                    self.fast_px.extend(fastest_px(before, &this, FASTER_SHARE));
                }
                self.before = Some(this);
            }
            (_, Some(motion)) => {
                self.vectors.insert(0, self.decode(motion));
                self.vectors.truncate(3);
                if let [now, before, earlier] = &self.vectors[..] {
                    self.off_px.extend(off_parabola_px(self.size_px, [now, before, earlier]));
                }
            }
            (_, None) => {}
        }
    }

    /// What follows for a running camera from the frames so far, once there are some; `None` if events need not be false.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        if self.checked < FEWEST_FRAMES { None } else { self.report()?.warning }
    }

    /// What was found, if the synthesis can fail in this way.
    #[must_use]
    pub fn report(&self) -> Option<InputReport> {
        let [motion_px, off_parabola_px] =
            [&self.fast_px, &self.off_px].map(|all| upper(&mut all.clone(), 0.5));
        let grain_log = upper(&mut self.grains_log.clone(), 0.5);
        motion_px.or(off_parabola_px).or(grain_log)?;
        let fast = motion_px.filter(|px| *px > FAST_PX).map(|px| {
            format!(
                "part of the image moves by {px:.1} px a frame or more, and blended frames show it at two places at \
                 once, so that many events are false; {}",
                self.advice.unwrap_or("give motion vectors, or depth and poses")
            )
        });
        let off = off_parabola_px.filter(|px| *px > OFF_PARABOLA_PX).map(|px| {
            format!(
                "what moves leaves a parabola through three frames by {px:.1} px or more, so that many events are at \
                 wrong times and places; {}",
                self.advice.unwrap_or("give depth and poses, or more frames a second")
            )
        });
        let grainy =
            grain_log.zip(self.threshold_log).and_then(|(log, threshold)| grain::warning(log, threshold));
        let all: Vec<String> = fast.or(off).into_iter().chain(grainy).collect();
        let warning = (!all.is_empty()).then(|| all.join("; "));
        Some(InputReport { motion_px, off_parabola_px, grain_log, warning })
    }

    fn decode(&self, motion: &[u8]) -> Vec<[f64; 2]> {
        let format = self.motion.unwrap_or(MotionFormat::F32x2);
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
        // What stands may have been hidden by what passes, whose vectors are not its own.
        (along[0][0].hypot(along[0][1]) > 1.0).then(|| of(0).hypot(of(1)))
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

    const SIZE_PX: (usize, usize) = (64, 48);

    /// A check of frames of a pattern that has moved by `shifts_px`.
    fn after(synthesis: Synthesis, shifts_px: &[u32]) -> InputCheck {
        let (width, height) = (SIZE_PX.0 as u32, SIZE_PX.1 as u32);
        let sensor = SensorModel { synthesis, width, height, ..SensorModel::default() };
        let mut check = InputCheck::new(&sensor, HdrFormat::F32x4, None);
        for (frame, shift_px) in shifts_px.iter().enumerate() {
            check.add(frame as i64, &pattern(*shift_px), None);
        }
        check
    }

    /// Each pixel has a brightness that no other has.
    fn pattern(shift_px: u32) -> Vec<u8> {
        let pixel = |x: usize, y: usize| {
            let place = (x as u32).wrapping_sub(shift_px).wrapping_add(1000 * y as u32);
            let mix = |word: u32| (word ^ (word >> 15)).wrapping_mul(0x2c1b_3c6d);
            let scattered = mix(mix(mix(place)));
            [1.0 + (scattered >> 8) as f32 / (1 << 24) as f32; 4]
        };
        let pixels = (0..SIZE_PX.1).flat_map(|y| (0..SIZE_PX.0).map(move |x| pixel(x, y)));
        pixels.flatten().flat_map(f32::to_ne_bytes).collect()
    }

    #[test]
    fn a_running_camera_is_told_of_after_some_frames() {
        let fast = [0, 5, 10, 15, 20];
        assert_eq!(after(Synthesis::Linear, &fast[..4]).warning(), None);
        let warning = after(Synthesis::Linear, &fast).warning().expect("5 px a frame");
        assert!(warning.contains("moves by 5.0 px a frame"), "{warning}");
        assert_eq!(after(Synthesis::Linear, &[0, 1, 2, 3, 4, 5]).warning(), None);
    }

    #[test]
    fn grain_is_looked_at_only_where_it_is_asked_for_and_along_exact_paths_too() {
        let sensor =
            SensorModel { synthesis: Synthesis::Rigid, width: 64, height: 48, ..SensorModel::default() };
        let plain = InputCheck::new(&sensor, HdrFormat::F32x4, None);
        let [mut plain, mut grainy] = [plain.clone(), plain.with_grain(&sensor)];
        for frame in 0..6 {
            plain.add(frame, &pattern(0), None);
            grainy.add(frame, &pattern(0), None);
        }
        assert_eq!((plain.report(), grainy.grains_log.len()), (None, GRAIN_FRAMES));
        let report = grainy.report().expect("grain");
        // The logarithm of evenly spread values from 1 to 2.
        assert!((0.15..0.25).contains(&report.grain_log.expect("blocks")), "{report:?}");
        assert!(report.warning.expect("half a threshold and more").contains("is grainy"));
    }

    #[test]
    fn a_frame_that_comes_again_or_does_not_follow_is_no_motion() {
        let mut check = after(Synthesis::Linear, &[0, 5]);
        check.add(1, &pattern(5), None);
        assert_eq!(check.report().expect("one interval").motion_px, Some(5.0));
        check.restart();
        check.add(2, &pattern(12), None);
        check.add(3, &pattern(12), None);
        assert_eq!(check.fast_px, [5.0, 0.0]);
    }

    #[test]
    fn it_ends_and_exact_paths_are_not_checked() {
        let check = after(Synthesis::Linear, &[0; 20]);
        assert!(check.is_over() && check.fast_px.len() == CHECKED_FRAMES - 1);
        let check = after(Synthesis::Rigid, &[0, 5]);
        assert!(check.is_over() && check.report().is_none());
    }

    #[test]
    fn bars_that_pass_a_still_wall_are_on_their_parabola() {
        // Bars of 4 px, 24 px apart, that go 8 px a frame.
        let field = |frame: usize| -> Vec<[f64; 2]> {
            let is_bar = |x: usize| (x + 48 - 8 * frame) % 24 < 4;
            (0..12).flat_map(|_| (0..96).map(|x| if is_bar(x) { [-8.0, 0.0] } else { [0.0; 2] })).collect()
        };
        assert_eq!(off_parabola_px((96, 12), [&field(2), &field(1), &field(0)]), Some(0.0));
        // A camera that shakes is not.
        let [left, right] = [-6.0, 6.0].map(|x| vec![[x, 0.0]; 96 * 12]);
        let off_px = off_parabola_px((96, 12), [&left, &right, &left]).expect("all moves");
        assert!((off_px - 24.0 * CUBIC_REMAINDER).abs() < 1e-9, "{off_px}");
    }

    #[test]
    fn vectors_that_lead_far_out_of_the_image_are_passed_over() {
        for far in [[1e30, 0.0], [0.0, 3e38], [-1e30, -3e38], [f64::INFINITY, 0.0], [f64::NAN, 0.0]] {
            let field = vec![far; 8 * 6];
            assert_eq!(off_parabola_px((8, 6), [&field, &field, &field]), None, "{far:?}");
        }
    }
}
