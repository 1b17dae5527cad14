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

/// How exact a position is in single precision, pixels: 4e-6, and four times that, as a frame fades out within a quarter of
/// a pixel at the image's border. From one pixel to the next the level may go from black to white.
const POSITION_TOLERANCE_PX: f64 = 16e-6;

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

/// Levels that are far from the oracle's: how many, and the first of them (pixel, sub-step, both levels).
pub fn far_levels(
    taken: &Taken,
    levels_q24: &[Vec<i32>],
    tolerance_log: f64,
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
            if (actual - expected).abs() > tolerance_log {
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
