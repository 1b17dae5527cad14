//! Trajectories with curvature: frames at uneven times, on whose lengths it depends, and bends that leave the image.

use esaac_engine::RigOptions;
use esaac_model::{
    HdrFormat, Intensity, MotionFormat, SensorModel, SubstepPolicy, Synthesis, Taps, q24_to_log,
};
use esaac_scene::SceneKind;
use esaac_tests::agreement::LEVEL_TOLERANCE_LOG;
use esaac_tests::device::assert_silent;
use esaac_tests::frames::{Sequence, scene, times};
use esaac_tests::run::{engine_of_many, oracle};

const SIZE: (u32, u32) = (43, 29);

/// Intervals of 33, 17, 50 and 8 ms.
const TIMES_NS: [i64; 5] = [7, 33_000_007, 50_000_010, 100_000_001, 108_000_001];

fn sensor(taps: Taps) -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis: Synthesis::Motion,
        taps,
        intensity: Intensity::Luminance,
        substeps: 8,
        substep_policy: SubstepPolicy::Fixed,
        ..SensorModel::default()
    }
}

/// Compares each level of each interval with the oracle's, by both kinds of taps.
fn check_levels(frames: &Sequence) {
    let cameras = [Taps::Bilinear, Taps::Cubic].map(|taps| (sensor(taps), frames.clone()));
    let options = RigOptions { keep_substeps: true, ..RigOptions::default() };
    let runs = engine_of_many(&cameras, options);
    for ((sensor, frames), steps) in cameras.iter().zip(&runs) {
        for (index, (interval, step)) in oracle(sensor, 0, frames).iter().zip(steps).enumerate().skip(1) {
            let samples = interval.samples.as_ref().expect("runs keep samples");
            let levels_q24 = step.substeps_q24.as_ref().expect("the rig keeps them");
            let mut worst_log = 0.0_f64;
            for pixel in 0..sensor.pixels() {
                for (sample, levels) in samples.at(pixel).iter().zip(&levels_q24[1..]) {
                    let expected = (sample + sensor.log_offset).ln();
                    worst_log = worst_log.max((q24_to_log(levels[pixel]) - expected).abs());
                }
            }
            assert!(
                worst_log <= LEVEL_TOLERANCE_LOG,
                "{:?}, frame {index}: a level is off by {worst_log:.2e}, expected at most {LEVEL_TOLERANCE_LOG:.2e}",
                sensor.taps
            );
        }
    }
    assert_silent();
}

#[test]
fn levels_are_the_oracles_where_intervals_differ() {
    check_levels(&scene(SceneKind::Flight, SIZE, &TIMES_NS, HdrFormat::F32x4, MotionFormat::F32x2));
}

/// A surface that comes to rest at a pixel beside the border may have been outside the image in between.
#[test]
fn levels_are_the_oracles_where_a_bend_leaves_the_image() {
    // Motion of 12 px, then of none: a bend of 1.5 px in the second interval.
    let motions: [[f32; 2]; 9] = [
        [0.0, 0.0],
        [12.0, 0.0],
        [0.0, 0.0],
        [-12.0, 0.0],
        [0.0, 0.0],
        [0.0, 12.0],
        [0.0, 0.0],
        [0.0, -12.0],
        [0.0, 0.0],
    ];
    let times_ns = times(7, motions.len());
    let mut frames = scene(SceneKind::Flight, SIZE, &times_ns, HdrFormat::F32x4, MotionFormat::F32x2);
    for (frame, motion) in frames.frames.iter_mut().zip(motions) {
        let bytes: Vec<u8> = motion.into_iter().flat_map(f32::to_le_bytes).collect();
        frame.motion = Some(bytes.repeat((SIZE.0 * SIZE.1) as usize));
    }
    check_levels(&frames);
}
