//! Stage `plan`: how many sub-steps each block of pixels gets.

use crate::ingest::{Image, plane_of};
use crate::synthesize::rigid::Rigid;
use crate::synthesize::trajectory::is_valid;
use esaac_model::substeps::{BLOCK_PX, BlockActivity, by_error, needed_motion_px, substep_count};
use esaac_model::{SensorModel, Synthesis};

/// Sub-steps per block, for a whole image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Blocks in a row.
    pub blocks_x: usize,
    /// Sub-steps of each block, row-major.
    pub substeps: Vec<u32>,
}

impl Plan {
    /// The same count everywhere.
    #[must_use]
    pub fn uniform(sensor: &SensorModel, substeps: u32) -> Self {
        let (blocks_x, blocks_y) = blocks(sensor);
        Plan { blocks_x, substeps: vec![substeps; blocks_x * blocks_y] }
    }

    /// Sub-steps of pixel `(x, y)`.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> u32 {
        self.substeps[y / BLOCK_PX as usize * self.blocks_x + x / BLOCK_PX as usize]
    }
}

/// Chooses the sub-steps of every block in the interval between two frames, `interval_ns` long. Ignores motion vectors
/// with a non-finite component, and all motion if the synthesis uses none. With synthesis `rigid`, a block's own motion
/// counts along paths, and vectors only where a frame shows no surface. `needed` is what [`needed_motion`] says of both
/// frames.
#[must_use]
pub fn plan(
    sensor: &SensorModel,
    start: &Image,
    end: &Image,
    interval_ns: u32,
    rigid: Option<&Rigid<'_>>,
    passing_px: Option<&[f64]>,
    needed: [Option<&[f64]>; 2],
) -> Plan {
    if sensor.synthesis == Synthesis::None {
        return Plan::uniform(sensor, 1);
    }
    let uses_vectors = sensor.synthesis.follows_motion();
    let has_path = |key: usize, pixel: usize| rigid.is_some_and(|rigid| rigid.shows_surface(key, pixel));
    let (blocks_x, blocks_y) = blocks(sensor);
    let block = BLOCK_PX as usize;
    let (start_planes, end_planes) = (start.planes(sensor.intensity), end.planes(sensor.intensity));
    let mut motion_px = vec![0.0_f64; blocks_x * blocks_y];
    let mut change_log = vec![0.0_f64; blocks_x * blocks_y];
    let mut has_invalid = vec![false; blocks_x * blocks_y];
    for y in 0..end.height {
        for x in 0..end.width {
            let pixel = y * end.width + x;
            let index = y / block * blocks_x + x / block;
            let plane = plane_of(sensor.intensity, x, y);
            let log = |planes: &[Vec<f64>]| (planes[plane][pixel] + sensor.log_offset).ln();
            change_log[index] = change_log[index].max((log(&end_planes) - log(&start_planes)).abs());
            for (key, motion) in [&start.motion, &end.motion].into_iter().enumerate() {
                let Some(motion) = motion.as_ref().filter(|_| uses_vectors) else { continue };
                let [dx, dy] = motion[pixel];
                let valid = is_valid([dx, dy]);
                has_invalid[index] |= key == 1 && !valid;
                if valid && !has_path(key, pixel) && needed[key].is_none() {
                    motion_px[index] = motion_px[index].max(dx.hypot(dy));
                }
            }
        }
    }
    for needed in needed.into_iter().flatten() {
        for (motion_px, needed_px) in motion_px.iter_mut().zip(needed) {
            *motion_px = motion_px.max(*needed_px);
        }
    }
    let mut substeps = Vec::with_capacity(blocks_x * blocks_y);
    for by in 0..blocks_y {
        for bx in 0..blocks_x {
            let mut around_px = 0.0_f64;
            for ny in by.saturating_sub(1)..=(by + 1).min(blocks_y - 1) {
                for nx in bx.saturating_sub(1)..=(bx + 1).min(blocks_x - 1) {
                    around_px = around_px.max(motion_px[ny * blocks_x + nx]);
                }
            }
            if let Some(rigid) = rigid {
                around_px = around_px.max(rigid.motion_px()[by * blocks_x + bx]);
            }
            if let Some(passing_px) = passing_px {
                around_px = around_px.max(passing_px[by * blocks_x + bx]);
            }
            let index = by * blocks_x + bx;
            let change = if needed[1].is_none() || has_invalid[index] { change_log[index] } else { 0.0 };
            substeps.push(substep_count(sensor, around_px, change, f64::from(interval_ns)));
        }
    }
    Plan { blocks_x, substeps }
}

fn blocks(sensor: &SensorModel) -> (usize, usize) {
    (sensor.width.div_ceil(BLOCK_PX) as usize, sensor.height.div_ceil(BLOCK_PX) as usize)
}

/// Motion of each block of a frame as its number of sub-steps needs it, pixels; `None` if sub-steps are not by error.
/// `interval_ns` is the length of the interval that ends at the frame, 0 if it is a camera's first and has no frame before.
#[must_use]
pub fn needed_motion(
    sensor: &SensorModel,
    before: Option<&Image>,
    frame: &Image,
    interval_ns: u32,
) -> Option<Vec<f64>> {
    let motion = frame.motion.as_ref().filter(|_| by_error(sensor))?;
    let logs = |image: &Image| -> Vec<f64> {
        image.planes(sensor.intensity)[0].iter().map(|s| (s + sensor.log_offset).ln()).collect()
    };
    let (own, before) = (logs(frame), before.map(logs));
    let (width, height) = (frame.width as i64, frame.height as i64);
    let log = |x: i64, y: i64| own[(y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize];
    let (blocks_x, blocks_y) = blocks(sensor);
    let mut activity = vec![BlockActivity::default(); blocks_x * blocks_y];
    for (pixel, &[dx, dy]) in motion.iter().enumerate() {
        let (x, y) = (pixel as i64 % width, pixel as i64 / width);
        let block = &mut activity[y as usize / BLOCK_PX as usize * blocks_x + x as usize / BLOCK_PX as usize];
        if let Some(before) = &before {
            block.change_log = block.change_log.max((own[pixel] - before[pixel]).abs());
        }
        if !is_valid([dx, dy]) {
            continue;
        }
        let second_x = log(x - 1, y) - 2.0 * log(x, y) + log(x + 1, y);
        let second_y = log(x, y - 1) - 2.0 * log(x, y) + log(x, y + 1);
        let mixed = (log(x + 1, y + 1) - log(x - 1, y + 1) - log(x + 1, y - 1) + log(x - 1, y - 1)) / 4.0;
        let bend = second_x * dx * dx + 2.0 * mixed * dx * dy + second_y * dy * dy;
        let slope = (log(x + 1, y) - log(x - 1, y)) / 2.0 * dx + (log(x, y + 1) - log(x, y - 1)) / 2.0 * dy;
        block.motion_px = block.motion_px.max(dx.hypot(dy));
        block.bend_log = block.bend_log.max(bend.abs());
        block.slope_log = block.slope_log.max(slope.abs());
    }
    Some(activity.into_iter().map(|block| needed_motion_px(sensor, block, interval_ns)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor() -> SensorModel {
        let synthesis = Synthesis::Motion;
        SensorModel { width: 35, height: 17, substeps: 32, synthesis, ..SensorModel::default() }
    }

    fn still(sensor: &SensorModel) -> Image {
        Image { motion: Some(vec![[0.0; 2]; sensor.pixels()]), ..Image::black(sensor) }
    }

    #[test]
    fn motion_of_either_frame_reaches_one_block_around() {
        let sensor = sensor();
        for moving_end in [false, true] {
            let (mut start, mut end) = (still(&sensor), still(&sensor));
            let image = if moving_end { &mut end } else { &mut start };
            image.motion.as_mut().unwrap()[35 * 16 + 34] = [3.0, -4.0];
            let plan = plan(&sensor, &start, &end, 33_333_333, None, None, [None; 2]);
            assert_eq!(plan.blocks_x, 5);
            assert_eq!(plan.substeps, [1, 1, 1, 1, 1, 1, 1, 1, 10, 10, 1, 1, 1, 10, 10]);
            assert_eq!(plan.at(34, 16), 10);
        }
    }

    #[test]
    fn change_counts_in_its_own_block_only() {
        let sensor = SensorModel { width: 16, height: 8, log_offset: 1.0, ..sensor() };
        let (start, mut end) = (still(&sensor), still(&sensor));
        end.rgb[8] = [std::f64::consts::E - 1.0; 3];
        // sqrt(33.3 ms * 1 / (8 * 50 us)) = 9.13.
        assert_eq!(plan(&sensor, &start, &end, 33_333_333, None, None, [None; 2]).substeps, [1, 10]);
    }

    #[test]
    fn invalid_and_unused_motion_does_not_count() {
        let sensor = sensor();
        let (start, mut end) = (still(&sensor), still(&sensor));
        end.motion.as_mut().unwrap()[0] = [f64::NAN, 9.0];
        end.motion.as_mut().unwrap()[1] = [0.0, f64::INFINITY];
        assert!(
            plan(&sensor, &start, &end, 33_333_333, None, None, [None; 2]).substeps.iter().all(|&n| n == 1)
        );
        end.motion.as_mut().unwrap()[2] = [9.0, 0.0];
        let linear = SensorModel { synthesis: Synthesis::Linear, ..sensor.clone() };
        assert_eq!(plan(&sensor, &start, &end, 33_333_333, None, None, [None; 2]).at(0, 0), 18);
        assert_eq!(plan(&linear, &start, &end, 33_333_333, None, None, [None; 2]).at(0, 0), 1);
    }
}
