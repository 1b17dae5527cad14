//! Unoccluded pixels of synthesis `rigid`: which they are, and what they show.

use super::input::changed;
use super::levels::{LEVEL_TOLERANCE_LOG, SIZE, sensor};
use esaac_engine::{CameraConfig, KernelPolicy, Rig, RigOptions};
use esaac_layout::LEVEL_ROW_WORDS;
use esaac_model::substeps::BLOCK_PX;
use esaac_model::{SensorModel, Taps};
use esaac_oracle::synthesize::rigid::{Rigid, Sample};
use esaac_scene::SceneKind;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::geometry::Rendered;

const SCENES: [SceneKind; 4] = [SceneKind::Flight, SceneKind::Shake, SceneKind::Propeller, SceneKind::Bounce];

/// Share of unoccluded pixels below which a scene says nothing about them: images this small are full of silhouettes.
const LEAST_UNOCCLUDED: f64 = 0.1;

/// Share of the samples of unoccluded pixels that all candidates would change.
const DIFFERING_SHARE: f64 = 1e-3;

/// Share of the pixels that the engine may tell otherwise than the oracle: those on a limit, by rounding.
const OTHERWISE: f64 = 1e-3;

/// The interval between the last two of these frames, as the oracle sees it.
fn oracle(rendered: &Rendered) -> Rigid<'_> {
    let [.., before, last] = &rendered.frames[..] else { panic!("two frames at least") };
    let planes = [before, last].map(|frame| frame.planes(&sensor()));
    let inputs = [before.input(SIZE, &planes[0]), last.input(SIZE, &planes[1])];
    Rigid::new(&rendered.scene, inputs, sensor().log_offset, (Taps::Cubic, 1), None)
}

/// Whether the engine took each pixel of a camera for unoccluded in the last tick; none where it made no levels. The words
/// are those of `glsl/levels.glsl` and `glsl/unoccluded.glsl`.
fn found(rig: &Rig) -> Vec<Option<bool>> {
    let [levels, level_words] = ["levels", "level_words"].map(|name| rig.words(0, name).expect("a camera"));
    let (tile_blocks, block_px, row_words) = (4, BLOCK_PX as usize, LEVEL_ROW_WORDS as usize);
    let (no_row, unoccluded) = ((1 << 24) - 1, 0x00ff_ffff);
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let across = width.div_ceil(block_px).div_ceil(tile_blocks);
    (0..width * height)
        .map(|pixel| {
            let (x, y) = (pixel % width, pixel / width);
            let (column, row) = (x / block_px, y / block_px);
            let block = (row * across + column / tile_blocks) * tile_blocks + column % tile_blocks;
            let word = level_words[block];
            assert!(word < 0xffff_fffe, "the tile has found room");
            let first = (word & 0x7fff_ffff) >> 7;
            let place = y % block_px * block_px + x % block_px;
            (word & 0x7f > 1).then(|| {
                first == no_row || levels[first as usize * row_words + place] & unoccluded == unoccluded
            })
        })
        .collect()
}

/// What the kernels for GPUs find, in the interval between the last two of these frames.
fn found_by_gpus(rendered: &Rendered) -> Vec<Option<bool>> {
    // So few events that no tile runs again: its levels would take the place of others.
    let sensor = SensorModel { contrast_on: 2.0, contrast_off: 2.0, ..sensor() };
    let options = RigOptions { policy: Some(KernelPolicy::gpu()), ..RigOptions::default() };
    let camera = CameraConfig { motion: None, ..rendered.camera(&sensor) };
    let mut rig = Rig::with_options(&DEVICE, &[camera], options).expect("a rig");
    rig.set_scene(0, rendered.scene.clone()).expect("poses of its lens");
    for frame in &rendered.frames {
        rig.upload(0, &frame.bytes()).expect("a frame that fits");
        rig.step(&[frame.t_ns]).expect("a frame in time");
    }
    let found = found(&rig);
    drop(rig);
    assert_silent();
    found
}

/// A wall that is nearer in the last frame, though no pose says that it has moved. It has no silhouettes, so no block
/// has a list.
#[test]
fn pixels_that_change_their_surface_are_not_unoccluded_where_nothing_passes() {
    let mut rendered = Rendered::of(SceneKind::Flight, SIZE, 3);
    let pixels = SIZE.0 as usize * SIZE.1 as usize;
    for (frame, depth_m) in rendered.frames.iter_mut().zip([4.0_f32, 4.0, 2.0]) {
        *frame = changed(frame, |_, depth, id| (*depth, *id) = (depth_m, 0));
    }
    let found = found_by_gpus(&rendered);
    assert!(found.iter().flatten().count() > pixels / 2, "its levels are made");
    assert!(found.iter().flatten().all(|&unoccluded| !unoccluded));
    assert!(oracle(&rendered).unoccluded_pixels().iter().all(Option::is_none));
}

#[test]
fn the_gpus_kernels_find_the_oracles_unoccluded_pixels() {
    for kind in SCENES {
        let rendered = Rendered::of(kind, SIZE, 3);
        let found = found_by_gpus(&rendered);
        let oracle = oracle(&rendered);
        let (mut told, mut otherwise) = (0, 0);
        for (found, expected) in found.iter().zip(oracle.unoccluded_pixels()) {
            told += usize::from(found.is_some());
            otherwise += usize::from(found.is_some_and(|found| found != expected.is_some()));
        }
        let unoccluded = found.iter().filter(|&&found| found == Some(true)).count();
        println!("{kind:?}: {unoccluded} of {told} pixels are unoccluded, {otherwise} otherwise");
        assert!(unoccluded as f64 > LEAST_UNOCCLUDED * told as f64 && unoccluded < told, "{kind:?}");
        assert!(otherwise as f64 <= OTHERWISE * told as f64, "{kind:?}: {otherwise} of {told}");
    }
}

/// Unoccluded pixels skip the looks at their candidates, but that changes next to nothing: all that they read lies inside
/// one surface.
#[test]
fn unoccluded_pixels_show_what_all_their_candidates_would() {
    let sensor = sensor();
    let size = (SIZE.0 as usize, SIZE.1 as usize);
    for kind in SCENES {
        let rendered = Rendered::of(kind, SIZE, 3);
        let rigid = oracle(&rendered);
        let unoccluded: Vec<usize> =
            (0..size.0 * size.1).filter(|&pixel| rigid.unoccluded_pixels()[pixel].is_some()).collect();
        let share = unoccluded.len() as f64 / (size.0 * size.1) as f64;
        assert!(share > LEAST_UNOCCLUDED && share < 1.0, "{kind:?}: {share}");
        let (mut samples, mut far) = (0, 0);
        for fraction in [0.1, 0.25, 0.4, 0.55, 0.7, 0.85] {
            let instant = rigid.instant(fraction);
            for pixel in &unoccluded {
                let (x, y) = (pixel % size.0, pixel / size.0);
                let log = |sample: Sample| (sample.intensity().expect("a path") + sensor.log_offset).ln();
                let [own, all] =
                    [rigid.sample(&instant, 0, x, y), rigid.composite(&instant, 0, x, y)].map(log);
                samples += 1;
                far += usize::from((own - all).abs() > LEVEL_TOLERANCE_LOG);
            }
        }
        println!("{kind:?}: {share:.2} of the pixels, {far} of {samples} samples differ");
        assert!(far as f64 <= DIFFERING_SHARE * samples as f64, "{kind:?}: {far} of {samples} samples");
    }
}
