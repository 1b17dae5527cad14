//! Synthesis `motion`: warps both frames along the trajectory of the surface point that the pixel shows, in log
//! intensity (equations in [`esaac_model::synthesis`]).

use super::half_pel::HalfPelFrame;
use super::layers::{Layers, Levels};
use super::rigid::read::pixel_sample;
use super::sampling::Sampling;
use super::taps::bilinear;
use super::trajectory::{Warp, outside_px, warps};
use super::transfer::{Route, Way, transfer};
use crate::ingest::Image;
use esaac_model::synthesis::is_usable;
use esaac_model::synthesis::{EDGE_PX, EDGE_WEIGHT};
use esaac_model::{SensorModel, Taps};
use glam::DVec2;

/// Two frames prepared to be read along trajectories.
pub struct Motion {
    size: (usize, usize),
    log_offset: f64,
    warps: Vec<Warp>,
    /// Whether each pixel's own vector is finite.
    valid: Vec<bool>,
    planes: Planes,
    /// Where motions meet, unless a pixel has one surface by choice.
    layers: Option<Layers>,
}

/// The images that trajectories are read in, one pair per intensity plane.
enum Planes {
    /// Half-pel frames of the start and the end.
    Cubic(Vec<[HalfPelFrame; 2]>),
    /// Log intensities of the start and the end.
    Bilinear(Vec<[Vec<f64>; 2]>),
}

impl Motion {
    /// Prepares an interval. `ratio` is that of [`super::Gap::new`]. `history` comes from [`Motion::into_history`] of
    /// the previous interval, with the same `sampling`. Returns `None` if the frame at the end has no motion.
    #[must_use]
    pub fn new(
        sensor: &SensorModel,
        start: &Image,
        end: &Image,
        [start_planes, end_planes]: [&[Vec<f64>]; 2],
        ratio: Option<f64>,
        history: Option<Vec<HalfPelFrame>>,
        sampling: Sampling,
    ) -> Option<Self> {
        let motion = end.motion.as_ref()?;
        let size = (end.width, end.height);
        let warps = warps(size, motion, start.motion.as_deref(), ratio);
        let log = |plane: &[f64]| plane.iter().map(|s| (s + sensor.log_offset).ln()).collect::<Vec<f64>>();
        let planes = start_planes.iter().zip(end_planes).map(|(start, end)| [log(start), log(end)]);
        let planes = match sensor.taps {
            Taps::Bilinear => Planes::Bilinear(planes.collect()),
            Taps::Cubic => {
                let mut history = history.into_iter().flatten();
                let ways = [Way::ToStart, Way::ToEnd].into_iter().cycle();
                let routes: Vec<_> = (0..sensor.detail_transfers())
                    .zip(ways)
                    .map(|(number, way)| Route::new(size, motion, &warps, way, number == 0))
                    .collect();
                Planes::Cubic(
                    planes
                        .map(|logs| half_pel_frames(size, sampling, &routes, &logs, history.next()))
                        .collect(),
                )
            }
        };
        let valid = motion.iter().copied().map(is_usable).collect();
        let layers = (sensor.layers > 1)
            .then(|| Layers::new(size, motion, start.motion.as_deref(), ratio, sensor.layers));
        Some(Motion { size, log_offset: sensor.log_offset, warps, valid, planes, layers })
    }

    /// Prepares an interval of synthesis `rigid` for the pixels that have no path. `half_pels` are those of
    /// [`Rigid::half_pels`](super::rigid::Rigid::half_pels).
    #[must_use]
    pub fn without_paths(
        sensor: &SensorModel,
        start: &Image,
        end: &Image,
        ratio: Option<f64>,
        half_pels: &[[HalfPelFrame; 2]],
    ) -> Option<Self> {
        let motion = end.motion.as_ref()?;
        let size = (end.width, end.height);
        let at_pixels = |frame: &HalfPelFrame| -> Vec<f64> {
            (0..size.0 * size.1).map(|pixel| frame.samples()[pixel_sample(size, pixel)]).collect()
        };
        let planes = match sensor.taps {
            Taps::Bilinear => {
                Planes::Bilinear(half_pels.iter().map(|pair| pair.each_ref().map(at_pixels)).collect())
            }
            Taps::Cubic => Planes::Cubic(half_pels.to_vec()),
        };
        Some(Motion {
            size,
            log_offset: sensor.log_offset,
            warps: warps(size, motion, start.motion.as_deref(), ratio),
            valid: motion.iter().copied().map(is_usable).collect(),
            planes,
            layers: None,
        })
    }

    /// Intensity of plane `plane` at pixel `(x, y)` and `fraction` of the interval, scene units. `None` if the pixel's
    /// vector is invalid.
    #[must_use]
    pub fn sample(&self, plane: usize, x: usize, y: usize, fraction: f64) -> Option<f64> {
        let pixel = y * self.size.0 + x;
        if !self.valid[pixel] {
            return None;
        }
        if let Some(layers) = self.layers.as_ref().filter(|layers| layers.has(pixel)) {
            let levels = PlaneLevels { size: self.size, planes: &self.planes, plane, reader: [x, y] };
            if let Some(log) = layers.level(&levels, pixel, fraction) {
                return Some((log.exp() - self.log_offset).max(0.0));
            }
        }
        let [in_start, in_end] = self.warps[pixel].sources(x, y, fraction);
        let edge = |at: [f64; 2]| (1.0 - outside_px(self.size, at) / EDGE_PX).max(EDGE_WEIGHT);
        let (start_weight, end_weight) = ((1.0 - fraction) * edge(in_start), fraction * edge(in_end));
        let [start_log, end_log] = match &self.planes {
            Planes::Cubic(half_pel_frames) => {
                let [start, end] = &half_pel_frames[plane];
                [start.at(in_start, [x, y]), end.at(in_end, [x, y])]
            }
            Planes::Bilinear(logs) => {
                let [start, end] = &logs[plane];
                let read = |log: &[f64], [x, y]: [f64; 2]| bilinear(log, self.size, x, y);
                [read(start, in_start), read(end, in_end)]
            }
        };
        let log = (start_weight * start_log + end_weight * end_log) / (start_weight + end_weight);
        Some((log.exp() - self.log_offset).max(0.0))
    }

    /// Motion of what passes each block, row by row, pixels. `None` if pixels have one surface.
    #[must_use]
    pub fn passing_px(&self) -> Option<Vec<f64>> {
        self.layers.as_ref().map(|layers| layers.motion_px().collect())
    }

    /// The half-pel frames of the end, which the next interval improves. `None` with bilinear taps, which have none.
    #[must_use]
    pub fn into_history(self) -> Option<Vec<HalfPelFrame>> {
        match self.planes {
            Planes::Cubic(half_pel_frames) => Some(half_pel_frames.into_iter().map(|[_, end]| end).collect()),
            Planes::Bilinear(_) => None,
        }
    }
}

/// Levels of one intensity plane.
struct PlaneLevels<'a> {
    size: (usize, usize),
    planes: &'a Planes,
    plane: usize,
    /// The pixel that reads them.
    reader: [usize; 2],
}

impl Levels for PlaneLevels<'_> {
    fn at(&self, frame: usize, position: DVec2) -> f64 {
        match self.planes {
            Planes::Cubic(half_pels) => half_pels[self.plane][frame].at(position.to_array(), self.reader),
            Planes::Bilinear(logs) => bilinear(&logs[self.plane][frame], self.size, position.x, position.y),
        }
    }

    fn pixel(&self, frame: usize, x: i64, y: i64) -> f64 {
        let (x, y) = (x as usize, y as usize);
        match self.planes {
            Planes::Cubic(half_pels) => half_pels[self.plane][frame].entry(2 * x, 2 * y),
            Planes::Bilinear(logs) => logs[self.plane][frame][y * self.size.0 + x],
        }
    }
}

/// Half-pel frames of the start and the end, with one transfer for each route. The first transfer improves the end.
fn half_pel_frames(
    size: (usize, usize),
    sampling: Sampling,
    routes: &[Route],
    [start_log, end_log]: &[Vec<f64>; 2],
    history: Option<HalfPelFrame>,
) -> [HalfPelFrame; 2] {
    let start_alone = history.unwrap_or_else(|| HalfPelFrame::of_frame(size, sampling, start_log));
    let mut start = start_alone.clone();
    let mut end = HalfPelFrame::of_frame(size, sampling, end_log);
    for (turn, route) in routes.iter().enumerate() {
        if turn % 2 == 0 {
            end = transfer(size, end_log, &end, &start, route);
        } else {
            start = transfer(size, start_log, &start_alone, &end, route);
        }
    }
    [start, end]
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Intensity;

    const SIZE: (usize, usize) = (48, 24);

    /// A band-limited texture whose points are displaced by `path(frame)` pixels along x.
    fn image(sensor: &SensorModel, frame: f64, path: impl Fn(f64) -> f64) -> Image {
        let texture = |x: f64, y: f64| (0.9 * (1.4 * x).sin() + 0.4 * (0.5 * y + 0.8 * x).cos()).exp();
        let mut image = Image::black(sensor);
        for y in 0..SIZE.1 {
            for x in 0..SIZE.0 {
                image.rgb[y * SIZE.0 + x] = [texture(x as f64 - path(frame), y as f64); 3];
            }
        }
        image.motion = Some(vec![[path(frame - 1.0) - path(frame), 0.0]; SIZE.0 * SIZE.1]);
        image
    }

    fn sensor(taps: Taps) -> SensorModel {
        let (width, height) = (SIZE.0 as u32, SIZE.1 as u32);
        SensorModel { width, height, taps, intensity: Intensity::Gray, ..SensorModel::default() }
    }

    /// Mean error in log intensity away from the borders, over the third interval. With `bend` the frame at its start
    /// has motion too, which gives the curvature.
    fn error_log(sensor: &SensorModel, bend: bool, path: impl Fn(f64) -> f64 + Copy) -> f64 {
        let mut frames = [0.0, 1.0, 2.0, 3.0].map(|k| image(sensor, k, path));
        let mut motion: Option<Motion> = None;
        for k in 1..frames.len() {
            if !bend {
                frames[k - 1].motion = None;
            }
            let (start, end) = (&frames[k - 1], &frames[k]);
            let planes = [start, end].map(|image| image.planes(sensor.intensity));
            let history = motion.take().and_then(Motion::into_history);
            motion = Motion::new(
                sensor,
                start,
                end,
                [&planes[0], &planes[1]],
                Some(1.0),
                history,
                Sampling::ENGINE,
            );
        }
        let motion = motion.unwrap();
        let (mut sum, mut count) = (0.0, 0.0);
        for fraction in [0.25, 0.5, 0.75] {
            let exact = image(sensor, 2.0 + fraction, path);
            for y in 4..SIZE.1 - 4 {
                for x in 14..SIZE.0 - 14 {
                    let log = |s: f64| (s + sensor.log_offset).ln();
                    let sample = motion.sample(0, x, y, fraction).unwrap();
                    sum += (log(sample) - log(exact.rgb[y * SIZE.0 + x][0])).abs();
                    count += 1.0;
                }
            }
        }
        sum / count
    }

    #[test]
    fn a_moving_texture_is_found_in_both_frames() {
        let error = |taps| error_log(&sensor(taps), true, |t| 2.6 * t);
        let (cubic, bilinear) = (error(Taps::Cubic), error(Taps::Bilinear));
        // The texture's period is four and a half pixels, so short that the kernel matters.
        assert!(cubic < 0.25 * bilinear, "{cubic} {bilinear}");
    }

    #[test]
    fn accelerated_motion_follows_its_parabola() {
        let error = |bend| error_log(&sensor(Taps::Cubic), bend, |t| 1.5 * t + 0.87 * t * t);
        let (with, without) = (error(true), error(false));
        assert!(with < 0.3 * without, "{with} {without}");
    }

    #[test]
    fn an_invalid_vector_is_not_followed() {
        let sensor = sensor(Taps::Cubic);
        let [start, mut end] = [0.0, 1.0].map(|k| image(&sensor, k, |t| 2.0 * t));
        end.motion.as_mut().unwrap()[SIZE.0 * 7 + 9] = [f64::NAN, 0.0];
        let planes = [&start, &end].map(|image| image.planes(sensor.intensity));
        let motion =
            Motion::new(&sensor, &start, &end, [&planes[0], &planes[1]], None, None, Sampling::ENGINE)
                .unwrap();
        assert_eq!(motion.sample(0, 9, 7, 0.5), None);
        for (x, y) in [(8, 7), (10, 7), (9, 6), (9, 8), (11, 7)] {
            assert!(motion.sample(0, x, y, 0.5).unwrap().is_finite());
        }
    }

    #[test]
    fn a_still_texture_stays() {
        let sensor = sensor(Taps::Cubic);
        let still = image(&sensor, 0.0, |_| 0.0);
        let planes = still.planes(sensor.intensity);
        let motion =
            Motion::new(&sensor, &still, &still, [&planes, &planes], None, None, Sampling::ENGINE).unwrap();
        for (pixel, intensity) in planes[0].iter().enumerate() {
            let sample = motion.sample(0, pixel % SIZE.0, pixel / SIZE.0, 0.3).unwrap();
            assert!((sample / intensity - 1.0).abs() < 1e-14);
        }
    }
}
