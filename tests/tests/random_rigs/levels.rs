//! Compares levels and APS frames with the oracle's, which differ by roundings.

use crate::findings::Findings;
use crate::images::View;
use crate::judge::{Kind, Tally};
use crate::reference::{Run, Taken};
use esaac_model::{SensorModel, Synthesis, q24_to_log};
use esaac_oracle::Samples;
use esaac_tests::agreement::LEVEL_TOLERANCE_LOG;
use esaac_tests::run::Step;

/// How far a level may be from the oracle's, nepers.
pub fn level_tolerance_log(kind: Kind, run: &Run, view: &View) -> f64 {
    let is_rigid = run.iter().any(|taken| taken.sensor.synthesis == Synthesis::Rigid);
    match (kind, view.case.geometry) {
        (_, Some(geometry)) if is_rigid && geometry.fisheye => 1e-3,
        _ if is_rigid => 1e-4,
        _ => LEVEL_TOLERANCE_LOG,
    }
}

/// How exact a position is in single precision, pixels.
pub const POSITION_PX: f64 = 4e-6;

/// Four times that, as a frame fades out within a quarter of a pixel at the image's border. From one pixel to the next the
/// level may go from black to white.
const POSITION_TOLERANCE_PX: f64 = 4.0 * POSITION_PX;

/// For each pixel the span of all levels in it and in those around it.
fn spans_log(sensor: &SensorModel, samples: &Samples) -> Vec<f64> {
    let (width, height) = (sensor.width as usize, sensor.height as usize);
    let logs = |pixel: usize| samples.at(pixel).iter().map(|sample| (sample + sensor.dark_level()).ln());
    let span = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
        let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
        let around = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
        let logs: Vec<f64> = around.flat_map(logs).collect();
        logs.iter().copied().fold(f64::NEG_INFINITY, f64::max)
            - logs.iter().copied().fold(f64::INFINITY, f64::min)
    };
    (0..sensor.pixels()).map(span).collect()
}

/// Whether a level lies between what the oracle gives for positions as exact as the engine's.
fn lies_between(level: f64, expected: impl Iterator<Item = f64>, tolerance_log: f64) -> bool {
    let (low, high) = expected
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), other| (low.min(other), high.max(other)));
    (low - tolerance_log..=high + tolerance_log).contains(&level)
}

/// Levels that are far from the oracle's: how many, and the first of them (pixel, sub-step, both levels). Of a run, `place` is
/// that of the frame; `moved` are the same runs with other vectors ([`esaac_tests::agreement::moved_vectors`]). They are
/// asked for only where a level is far.
pub fn far_levels<'a>(
    (taken, place): (&Taken, usize),
    levels_q24: &[Vec<i32>],
    tolerance_log: f64,
    moved: &dyn Fn() -> &'a [Run],
    tally: &mut Tally,
) -> (usize, Vec<(usize, usize, f64, f64)>) {
    let (mut count, mut far) = (0, Vec::new());
    // The first frame of a run has no sub-steps.
    if taken.interval.substeps_per_block.is_empty() {
        return (count, far);
    }
    let samples = taken.interval.samples.as_ref().expect("runs keep samples");
    let dark_level = taken.sensor.dark_level();
    for (pixel, span_log) in spans_log(&taken.sensor, samples).into_iter().enumerate() {
        let tolerance_log = tolerance_log + POSITION_TOLERANCE_PX * span_log;
        for (index, (sample, levels)) in samples.at(pixel).iter().zip(&levels_q24[1..]).enumerate() {
            let (expected, actual) = ((sample + dark_level).ln(), q24_to_log(levels[pixel]));
            tally.levels += 1;
            // Of another number of sub-steps, other instants.
            let with_moved_vectors = || {
                let kept = |run: &'a Run| run[place].interval.samples.as_ref().expect("runs keep samples");
                let of_pixel = moved().iter().map(move |run| kept(run).at(pixel));
                let count = samples.at(pixel).len();
                of_pixel.filter(move |own| own.len() == count).map(move |own| (own[index] + dark_level).ln())
            };
            if (actual - expected).abs() > tolerance_log
                && !lies_between(actual, with_moved_vectors().chain([expected]), tolerance_log)
            {
                tally.far += 1;
                count += 1;
                if far.len() < 3 {
                    far.push((pixel, index, expected, actual));
                }
            }
        }
    }
    (count, far)
}

/// One count of sixteen bits is near the precision of an intensity in single precision.
pub fn check_aps(what: &str, taken: &Taken, step: &Step, kind: Kind, findings: &mut Findings) {
    let (expected, actual) = (&taken.interval.aps, step.aps.as_ref().map(|aps| &aps.pixels));
    findings.check(expected.is_some() == actual.is_some(), || {
        format!("{what}: an APS frame {}, expected {}", actual.is_some(), expected.is_some())
    });
    let (Some(expected), Some(actual)) = (expected, actual) else { return };
    let tolerance = 1 << taken.sensor.aps_bits.saturating_sub(14);
    let off = expected.iter().zip(actual).filter(|(a, b)| a.abs_diff(**b) > tolerance).count();
    let most = kind.most_in_a_run(taken.sensor.pixels());
    findings.check(off <= most, || format!("{what}: {off} pixels of the APS frame differ"));
}

#[test]
fn a_level_between_those_of_moved_vectors_is_explained_and_one_beyond_is_not() {
    let explained = |level: f64| lies_between(level, [0.3, 0.302, 0.2996].into_iter(), 1e-5);
    assert!(explained(0.3) && explained(0.3019) && explained(0.302_009) && explained(0.299_591));
    assert!(!explained(0.302_02) && !explained(0.299_58));
}
