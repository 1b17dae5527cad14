//! The hazard of still noise against first passages: of paths where they are frequent, and by clusters where not.

use crate::case::{Case, FIRST_PER_S};
use crate::path::{Path, STEPS};
use esaac_model::physical::noise::hazard_per_s;
use std::f64::consts::TAU;

fn still(poles: f64) -> Case {
    Case { poles, held: 0.0, distance: 0.0, slope: 0.0 }
}

/// Rate at which paths come to a level, per second, if each must first come back to 0 to count again.
fn first_passages_per_s(case: &Case, distance: f64, span_s: f64) -> f64 {
    let mut path = Path::settled(case, STEPS, 11);
    let level_log = distance * case.sigma_log();
    let (mut passages, mut watched_s, mut watches) = (0.0, 0.0, path.second_log < 0.0);
    for _ in 0..(span_s / path.step_s) as u64 {
        path.step();
        if watches {
            watched_s += path.step_s;
        }
        if watches && path.second_log >= level_log {
            (passages, watches) = (passages + 1.0, false);
        } else if path.second_log <= 0.0 {
            watches = true;
        }
    }
    passages / watched_s
}

/// The same for far-off levels. Upward crossings have Rice's rate. They come in clusters, and each cluster has one last
/// crossing: one after which the noise comes to 0 before it crosses again. At a crossing the slope is Rayleigh distributed.
fn clusters_per_s(case: &Case, distance: f64, paths: u32) -> f64 {
    let second_per_s = case.second_per_s();
    let level_log = distance * case.sigma_log();
    let slope_per_s = case.sigma_log() * (FIRST_PER_S * second_per_s).sqrt();
    let mut last = 0_u32;
    for number in 0..paths {
        let share = (f64::from(number) + 0.5) / f64::from(paths);
        let slope_per_s = slope_per_s * (-2.0 * share.ln()).sqrt();
        // The second stage's slope is w_2 times how far it is behind the node.
        let mut path =
            Path::starting_at(case, [level_log + slope_per_s / second_per_s, level_log], 48.0, number);
        let mut is_above = true;
        last += loop {
            path.step();
            let was_above = std::mem::replace(&mut is_above, path.second_log >= level_log);
            if is_above && !was_above {
                break 0;
            }
            if path.second_log <= 0.0 {
                break 1;
            }
        };
    }
    let crossings_per_s = (FIRST_PER_S * second_per_s).sqrt() / TAU * (-0.5 * distance * distance).exp();
    crossings_per_s * f64::from(last) / f64::from(paths)
}

#[test]
fn hazard_is_the_rate_of_first_passages() {
    for poles in [1.0, 5.0, 20.0] {
        let case = still(poles);
        let ratio = |distance: f64, passages_per_s: f64| {
            hazard_per_s(distance, FIRST_PER_S, case.second_per_s()) / passages_per_s
        };
        // Some 4000 passages. The other ratios have deviations of 1% at most.
        let counted = ratio(3.0, first_passages_per_s(&case, 3.0, 40_000.0 / poles));
        assert!((counted - 1.0).abs() < 0.05, "{poles}: {counted}");
        for distance in [3.0, 3.5, 4.0, 5.0] {
            let clusters = ratio(distance, clusters_per_s(&case, distance, 20_000));
            println!("{poles}, {distance} deviations: {clusters:.3}, counted {counted:.3}");
            assert!((clusters - 1.0).abs() < 0.04, "{poles}, {distance} deviations: {clusters}");
        }
    }
}
