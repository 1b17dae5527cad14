//! Stage `plan`: how many sub-steps each block of pixels gets.

use crate::ingest::{Image, plane_of};
use crate::synthesize::rigid::Rigid;
use esaac_model::substeps::{
    BLOCK_PX, BlockActivity, BlockTexture, by_error, motion_on_way_px, needed_motion_px, needed_on_way_px,
    substep_count,
};
use esaac_model::synthesis::is_usable;
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

/// What a frame says about the sub-steps of each block, where they are by error.
#[derive(Clone, Debug, PartialEq)]
pub enum Needs {
    /// Motion as the number of sub-steps needs it, pixels, of synthesis `motion`.
    Motion(Vec<f64>),
    /// Texture, of synthesis `rigid`.
    Texture(Vec<BlockTexture>),
}

impl Needs {
    fn motion_px(&self) -> Option<&[f64]> {
        match self {
            Needs::Motion(motion_px) => Some(motion_px),
            Needs::Texture(_) => None,
        }
    }

    fn texture(&self) -> Option<&[BlockTexture]> {
        match self {
            Needs::Motion(_) => None,
            Needs::Texture(texture) => Some(texture),
        }
    }
}

/// Chooses the sub-steps of every block in the interval between two frames, `interval_ns` long. Ignores motion vectors
/// that are not usable, and all motion if the synthesis uses none. With synthesis `rigid`, a block's own motion
/// counts along paths, and vectors only where a frame shows no surface. `needs` is what [`needs`] says of both frames.
#[must_use]
pub fn plan(
    sensor: &SensorModel,
    start: &Image,
    end: &Image,
    interval_ns: u32,
    rigid: Option<&Rigid<'_>>,
    passing_px: Option<&[f64]>,
    needs: [Option<&Needs>; 2],
) -> Plan {
    if sensor.synthesis == Synthesis::None {
        return Plan::uniform(sensor, 1);
    }
    let needed = needs.map(|needs| needs.and_then(Needs::motion_px));
    let textures = needs.map(|needs| needs.and_then(Needs::texture));
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
                let valid = is_usable([dx, dy]);
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
            let around: Vec<usize> = (by.saturating_sub(1)..=(by + 1).min(blocks_y - 1))
                .flat_map(|ny| {
                    (bx.saturating_sub(1)..=(bx + 1).min(blocks_x - 1)).map(move |nx| ny * blocks_x + nx)
                })
                .collect();
            let index = by * blocks_x + bx;
            let mut around_px = around.iter().map(|&near| motion_px[near]).fold(0.0, f64::max);
            let mut change = if needed[1].is_none() || has_invalid[index] { change_log[index] } else { 0.0 };
            if let Some(rigid) = rigid {
                let needed_px = needed_along_paths(sensor, rigid, textures, (index, &around), interval_ns);
                let way = rigid.way(index);
                around_px = around_px.max(motion_on_way_px(way, needed_px, change, interval_ns));
                if needed_px.is_some() {
                    change = 0.0;
                }
            }
            if let Some(passing_px) = passing_px {
                around_px = around_px.max(passing_px[index]);
            }
            substeps.push(substep_count(sensor, around_px, change, f64::from(interval_ns)));
        }
    }
    Plan { blocks_x, substeps }
}

fn blocks(sensor: &SensorModel) -> (usize, usize) {
    (sensor.width.div_ceil(BLOCK_PX) as usize, sensor.height.div_ceil(BLOCK_PX) as usize)
}

/// Motion of block `own` as its number of sub-steps needs it for the textures `around` it; `None` if it is by speed.
fn needed_along_paths(
    sensor: &SensorModel,
    rigid: &Rigid<'_>,
    textures: [Option<&[BlockTexture]>; 2],
    (own, around): (usize, &[usize]),
    interval_ns: u32,
) -> Option<f64> {
    let textures = [textures[0]?, textures[1]?];
    if rigid.is_passed_by_silhouette(own) || (0..2).any(|key| rigid.has_silhouette(key, own)) {
        return None;
    }
    let needed_px = (0..2).flat_map(|key| {
        let smooth = around.iter().filter(move |&&near| !rigid.has_silhouette(key, near));
        smooth.map(move |&near| needed_on_way_px(sensor, textures[key][near], rigid.way(own), interval_ns))
    });
    Some(needed_px.fold(0.0, f64::max))
}

/// What a frame says about its blocks' sub-steps; `None` if they are not by error. `interval_ns` is the length of the
/// interval that ends at the frame, 0 if it is a camera's first and has no frame before.
#[must_use]
pub fn needs(sensor: &SensorModel, before: Option<&Image>, frame: &Image, interval_ns: u32) -> Option<Needs> {
    if !by_error(sensor) {
        return None;
    }
    if sensor.synthesis == Synthesis::Rigid {
        return Some(Needs::Texture(textures(sensor, frame)));
    }
    needed_motion(sensor, before, frame, interval_ns).map(Needs::Motion)
}

/// Log intensity of a frame's planes.
fn logs(sensor: &SensorModel, image: &Image) -> Vec<Vec<f64>> {
    let log = |plane: Vec<f64>| plane.iter().map(|s| (s + sensor.log_offset).ln()).collect();
    image.planes(sensor.intensity).into_iter().map(log).collect()
}

/// First differences of a frame's levels at a pixel, along x and y, and second ones, `xx`, `xy` and `yy`. Beyond the
/// image it repeats its border.
fn differences(levels: &[f64], (width, height): (usize, usize), pixel: usize) -> ([f64; 2], [f64; 3]) {
    let (x, y) = ((pixel % width) as i64, (pixel / width) as i64);
    let log = |dx: i64, dy: i64| {
        let at = [(x + dx).clamp(0, width as i64 - 1), (y + dy).clamp(0, height as i64 - 1)];
        levels[at[1] as usize * width + at[0] as usize]
    };
    let first = [(log(1, 0) - log(-1, 0)) / 2.0, (log(0, 1) - log(0, -1)) / 2.0];
    let mixed = (log(1, 1) - log(-1, 1) - log(1, -1) + log(-1, -1)) / 4.0;
    let second = [log(-1, 0) - 2.0 * log(0, 0) + log(1, 0), mixed, log(0, -1) - 2.0 * log(0, 0) + log(0, 1)];
    (first, second)
}

/// Block of a pixel.
fn block_of(pixel: usize, width: usize) -> usize {
    let block = BLOCK_PX as usize;
    pixel / width / block * width.div_ceil(block) + pixel % width / block
}

/// Texture of each block, as kernels keep it.
fn textures(sensor: &SensorModel, frame: &Image) -> Vec<BlockTexture> {
    let (blocks_x, blocks_y) = blocks(sensor);
    let mut textures = vec![BlockTexture::default(); blocks_x * blocks_y];
    for levels in logs(sensor, frame) {
        for pixel in 0..levels.len() {
            let (first, second) = differences(&levels, (frame.width, frame.height), pixel);
            let block = &mut textures[block_of(pixel, frame.width)];
            *block = block.max(BlockTexture::of_pixel(first, second));
        }
    }
    textures.into_iter().map(BlockTexture::kept).collect()
}

/// Motion of each block of a frame as its number of sub-steps needs it, pixels; `None` without motion vectors.
fn needed_motion(
    sensor: &SensorModel,
    before: Option<&Image>,
    frame: &Image,
    interval_ns: u32,
) -> Option<Vec<f64>> {
    let motion = frame.motion.as_ref()?;
    let (own, before) = (logs(sensor, frame), before.map(|before| logs(sensor, before)));
    let (blocks_x, blocks_y) = blocks(sensor);
    let mut activity = vec![BlockActivity::default(); blocks_x * blocks_y];
    for (pixel, &[dx, dy]) in motion.iter().enumerate() {
        let block = &mut activity[block_of(pixel, frame.width)];
        if let Some(before) = &before {
            let plane = plane_of(sensor.intensity, pixel % frame.width, pixel / frame.width);
            block.change_log = block.change_log.max((own[plane][pixel] - before[plane][pixel]).abs());
        }
        if !is_usable([dx, dy]) {
            continue;
        }
        block.motion_px = block.motion_px.max(dx.hypot(dy));
        for levels in &own {
            let ([x, y], [xx, xy, yy]) = differences(levels, (frame.width, frame.height), pixel);
            block.bend_log = block.bend_log.max((xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy).abs());
            block.slope_log = block.slope_log.max((x * dx + y * dy).abs());
        }
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
