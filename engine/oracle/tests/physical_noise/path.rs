//! A path of the noise, drawn in steps far shorter than the poles' time constants. The oracle draws no path: it has a
//! hazard. So this is what its noise is held against. It knows the poles and the charge, and nothing else of the model.

use crate::case::{CHARGE_E, Case, FIRST_PER_S};
use esaac_model::physical::noise::correlation;
use esaac_model::random::philox4x32_10;
use std::f64::consts::TAU;

/// Steps in a time constant of the faster pole, where nothing needs more.
pub const STEPS: f64 = 12.0;

/// White noise through both poles.
pub struct Path {
    /// Noise of the photodiode's node, nepers.
    pub first_log: f64,
    /// Noise behind the second pole, nepers.
    pub second_log: f64,
    /// Length of a step, seconds.
    pub step_s: f64,
    kept: [f64; 2],
    /// Standard deviation of what a step adds to the node, nepers.
    new_log: f64,
    normals: Normals,
}

impl Path {
    /// A path that has this noise, in `steps` steps a time constant of the faster pole. Paths of other numbers are
    /// independent.
    pub fn starting_at(case: &Case, [first_log, second_log]: [f64; 2], steps: f64, number: u32) -> Self {
        let step_s = 1.0 / (steps * FIRST_PER_S.max(case.second_per_s()));
        let kept = [FIRST_PER_S, case.second_per_s()].map(|pole_per_s| (-pole_per_s * step_s).exp());
        // The node's variance is 1 / N_e.
        let new_log = ((1.0 - kept[0] * kept[0]) / CHARGE_E).sqrt();
        let normals = Normals { path: number, counter: 0, left: Vec::new() };
        Path { first_log, second_log, step_s, kept, new_log, normals }
    }

    /// A path that has no noise at first and runs until e^-10 of that is left, in `steps` steps a time constant of the
    /// faster pole.
    pub fn settled(case: &Case, steps: f64, number: u32) -> Self {
        let mut path = Path::starting_at(case, [0.0; 2], steps, number);
        let slowest_per_s = FIRST_PER_S.min(case.second_per_s());
        for _ in 0..(10.0 / (slowest_per_s * path.step_s)).ceil() as u64 {
            path.step();
        }
        path
    }

    /// Moves the noise on by a step.
    pub fn step(&mut self) {
        let before = self.first_log;
        self.first_log = self.kept[0] * before + self.new_log * self.normals.next();
        // The second stage follows the node's mean over the step.
        let mean = 0.5 * (before + self.first_log);
        self.second_log = mean + self.kept[1] * (self.second_log - mean);
    }
}

/// Normal deviates by Box-Muller, none of which the oracle draws.
struct Normals {
    path: u32,
    counter: u32,
    left: Vec<f64>,
}

impl Normals {
    fn next(&mut self) -> f64 {
        if let Some(deviate) = self.left.pop() {
            return deviate;
        }
        let words = philox4x32_10([self.counter, u32::MAX, self.path, 0], [99, 0]);
        self.counter += 1;
        let units = words.map(|word| (f64::from(word) + 0.5) / 4_294_967_296.0);
        for pair in units.chunks(2) {
            let radius = (-2.0 * pair[0].ln()).sqrt();
            let (sine, cosine) = (TAU * pair[1]).sin_cos();
            self.left.extend([radius * sine, radius * cosine]);
        }
        self.left.pop().expect("four new ones")
    }
}

fn still(poles: f64) -> Case {
    Case { poles, held: 0.0, distance: 0.0, slope: 0.0 }
}

#[test]
fn paths_have_the_variance_and_the_correlation_of_the_model() {
    for poles in [0.2, 1.0, 5.0, 20.0] {
        let case = still(poles);
        let (mut squares, mut products, mut count) = ([0.0; 2], [0.0; 3], [0.0; 2]);
        // Lags of about .2, 1 and 3 time constants of the first pole.
        let steps_later = [0.2, 1.0, 3.0].map(|lag| (lag * STEPS * poles.max(1.0)).ceil() as usize);
        let mut step_s = 0.0;
        for number in 0..100 {
            let mut path = Path::settled(&case, STEPS, number);
            step_s = path.step_s;
            let seen: Vec<[f64; 2]> = (0..(60.0 / step_s) as u64)
                .map(|_| {
                    path.step();
                    [path.first_log, path.second_log]
                })
                .collect();
            let pairs = seen.len() - steps_later[2];
            for stage in 0..2 {
                squares[stage] += seen.iter().map(|noise| noise[stage] * noise[stage]).sum::<f64>();
            }
            for (product, later) in products.iter_mut().zip(steps_later) {
                *product += (0..pairs).map(|i| seen[i][1] * seen[i + later][1]).sum::<f64>();
            }
            count = [count[0] + seen.len() as f64, count[1] + pairs as f64];
        }
        let [first, second] = squares.map(|sum| sum / count[0]);
        // The node's variance is 1 / N_e at any pole. Both have deviations of 1%.
        assert!((first * CHARGE_E - 1.0).abs() < 0.03, "{poles}: {first}");
        assert!((second / case.sigma_log().powi(2) - 1.0).abs() < 0.03, "{poles}: {second}");
        for (product, later) in products.into_iter().zip(steps_later) {
            let turned = later as f64 * step_s * FIRST_PER_S;
            let (seen, model) = (product / count[1] / second, correlation(turned, turned * poles));
            assert!((seen - model).abs() < 0.02, "{poles}, after {turned}: {seen}, by the model {model}");
        }
    }
}

#[test]
fn paths_have_the_spectrum_of_two_poles() {
    for poles in [1.0, 5.0, 20.0] {
        let case = still(poles);
        for share in [0.5, 1.0, poles, 3.0 * poles] {
            let omega = share * FIRST_PER_S;
            let mut path = Path::settled(&case, STEPS, 7);
            // Windows of 16 periods, which fade in and out so that slower noise does not leak into them.
            let steps = (16.0 * TAU / (omega * path.step_s)).round();
            let windows = 800;
            let mut power = 0.0;
            for _ in 0..windows {
                let (mut sine, mut cosine, mut energy) = (0.0, 0.0, 0.0);
                for i in 0..steps as u64 {
                    path.step();
                    let window = 1.0 - (TAU * i as f64 / steps).cos();
                    let (s, c) = (omega * i as f64 * path.step_s).sin_cos();
                    sine += window * s * path.second_log;
                    cosine += window * c * path.second_log;
                    energy += window * window;
                }
                power += (sine * sine + cosine * cosine) * path.step_s / energy;
            }
            let density = power / f64::from(windows);
            let pole = |rate_per_s: f64| 1.0 + (omega / rate_per_s).powi(2);
            let exact = 2.0 / (CHARGE_E * FIRST_PER_S) / (pole(FIRST_PER_S) * pole(case.second_per_s()));
            // A window's power is exponentially distributed, so their mean has a deviation of 3.5%.
            assert!(
                (density / exact - 1.0).abs() < 0.12,
                "{poles}, at {omega} per s: {density}, expected {exact}"
            );
        }
    }
}
