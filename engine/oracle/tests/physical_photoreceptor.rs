//! The physical pixel's photoreceptor: the oracle's solution against a plain integration of the equations, and the
//! model's integrator, which kernels will have, against the oracle's.

use esaac_model::physical::noise::corner_hz;
use esaac_model::physical::photoreceptor::{Drive, Photoreceptor, advance};
use esaac_oracle::physical::response::Response;

/// Error that the model allows its integrator, nepers.
const INTEGRATOR_ERROR_LOG: f64 = 0.01;

/// `a` and `y` relative to the level at the start, after a sub-step, by the classical Runge-Kutta method on the
/// equations as they stand.
fn runge_kutta(state: Photoreceptor, drive: &Drive) -> [f64; 2] {
    let Drive { start_per_s, change_log, duration_s, second_pole_per_s } = *drive;
    let fastest = start_per_s * change_log.max(0.0).exp() * (1.0 + state.excess).recip().max(1.0);
    let steps = ((fastest + second_pole_per_s) * duration_s * 60.0).ceil().max(2000.0);
    let step_s = duration_s / steps;
    let slope = |t_s: f64, [a, y]: [f64; 2]| {
        let level = change_log * t_s / duration_s;
        [start_per_s * (level.exp() - a.exp()), second_pole_per_s * (a - y)]
    };
    let along = |[a, y]: [f64; 2], [da, dy]: [f64; 2], h: f64| [a + h * da, y + h * dy];
    let mut at = [-state.excess.ln_1p(), state.lag_log];
    for i in 0..steps as u64 {
        let t_s = i as f64 * step_s;
        let k1 = slope(t_s, at);
        let k2 = slope(t_s + 0.5 * step_s, along(at, k1, 0.5 * step_s));
        let k3 = slope(t_s + 0.5 * step_s, along(at, k2, 0.5 * step_s));
        let k4 = slope(t_s + step_s, along(at, k3, step_s));
        let mean = |i: usize| (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0;
        at = along(at, [mean(0), mean(1)], step_s);
    }
    at
}

/// Sub-steps of 1 ms from dim to bright light and slow to fast second poles: still, ramps and edges, settled or not.
fn cases() -> Vec<(Photoreceptor, Drive)> {
    let mut cases = Vec::new();
    for start_per_s in [5.0, 100.0, 1e3, 2e4] {
        for second_pole_per_s in [200.0, 1e3, 8e3] {
            for change_log in [0.0, 0.2, -0.2, 1.0, -1.0, 2.3, -2.3] {
                for behind_log in [0.0_f64, 0.3, -0.3, 2.3, -2.3] {
                    for share in [0.3, 1.0] {
                        let lag_log = -share * behind_log;
                        let state = Photoreceptor { excess: behind_log.exp_m1(), lag_log };
                        let drive = Drive { start_per_s, change_log, duration_s: 1e-3, second_pole_per_s };
                        cases.push((state, drive));
                    }
                }
            }
        }
    }
    cases
}

#[test]
fn oracle_solves_the_differential_equations() {
    let mut worst: f64 = 0.0;
    for (state, drive) in cases() {
        let [a, y] = runge_kutta(state, &drive);
        let response = Response::solve(state, &drive);
        let (end, point) = (response.end(), response.at(drive.duration_s));
        let errors = [
            drive.change_log - end.excess.ln_1p() - a,
            drive.change_log + end.lag_log - y,
            (point.first_per_s / (drive.start_per_s * a.exp())).ln(),
            // The phase is the integral of w_1, which is what the light drives less what the node gains.
            (point.phase - (drive.charge() - (a + state.excess.ln_1p()))) / drive.charge().max(1.0),
        ];
        worst = errors.into_iter().fold(worst, |worst, error| worst.max(error.abs()));
        assert!(worst < 1e-11, "{state:?} {drive:?}: {errors:?}");
    }
}

#[test]
fn where_a_sub_step_is_cut_makes_no_difference() {
    for (state, drive) in cases().into_iter().step_by(7) {
        let whole = Response::solve(state, &drive);
        let (mut cut, mut rest) = (state, drive);
        for left in (1..=5).rev() {
            let (part, after) = rest.split(1.0 / f64::from(left));
            cut = Response::solve(cut, &part).end();
            rest = after;
        }
        assert!((cut.lag_log - whole.end().lag_log).abs() < 1e-11, "{state:?} {drive:?}");
        assert!((cut.excess / whole.end().excess - 1.0).abs() < 1e-10 || cut.excess.abs() < 1e-11);
    }
}

#[test]
fn model_integrator_is_within_a_hundredth_of_a_neper() {
    let mut worst: f64 = 0.0;
    for (state, drive) in cases() {
        let exact = Response::solve(state, &drive);
        let (end, phase) = advance(state, &drive);
        let lag = (end.lag_log - exact.end().lag_log).abs();
        let behind = (end.excess.ln_1p() - exact.end().excess.ln_1p()).abs();
        let phase = (phase - exact.at(drive.duration_s).phase).abs();
        worst = worst.max(lag).max(behind).max(phase);
        assert!(worst < INTEGRATOR_ERROR_LOG, "{state:?} {drive:?}: {lag} {behind} {phase}");
    }
}

#[test]
fn still_light_after_a_step_has_the_closed_form() {
    let (excess, rate) = (f64::exp(1.5) - 1.0, 300.0);
    let drive = Drive { start_per_s: rate, change_log: 0.0, duration_s: 0.05, second_pole_per_s: 4000.0 };
    let response = Response::solve(Photoreceptor { excess, lag_log: -1.5 }, &drive);
    for t_s in [0.0, 1e-4, 3e-3, 0.02, 0.05] {
        let behind = (excess * f64::exp(-rate * t_s)).ln_1p();
        let first_per_s = rate * f64::exp(-behind);
        assert!((response.at(t_s).first_per_s / first_per_s - 1.0).abs() < 1e-10, "{t_s}");
    }
}

#[test]
fn ripple_falls_as_two_poles_do() {
    // A ripple of 1% around still light, in sub-steps of a 64th of its period, after the transient.
    for (first_per_s, second_per_s) in [(50.0, 7600.0), (2000.0, 7600.0), (7600.0, 7600.0), (1e6, 7600.0)] {
        for share in [0.3, 1.0, 2.0] {
            let omega = share * std::f64::consts::TAU * corner_hz(first_per_s, second_per_s);
            let step_s = std::f64::consts::TAU / omega / 64.0;
            let level = |i: u32| 0.01 * (std::f64::consts::TAU * f64::from(i) / 64.0).sin();
            let (mut state, mut shown) = (Photoreceptor::default(), Vec::new());
            for i in 0..64 * 12 {
                let drive = Drive {
                    start_per_s: first_per_s * level(i).exp(),
                    change_log: level(i + 1) - level(i),
                    duration_s: step_s,
                    second_pole_per_s: second_per_s,
                };
                state = Response::solve(state, &drive).end();
                shown.push(level(i + 1) + state.lag_log);
            }
            let last = &shown[shown.len() - 64..];
            let (high, low) = last.iter().fold((f64::MIN, f64::MAX), |(h, l), &v| (h.max(v), l.min(v)));
            let gain = (high - low) / 0.02;
            let pole = |rate: f64| 1.0 + (omega / rate).powi(2);
            let exact = (pole(first_per_s) * pole(second_per_s)).sqrt().recip();
            assert!(
                (gain / exact - 1.0).abs() < 0.01,
                "{first_per_s} {second_per_s} {share}: {gain} {exact}"
            );
        }
    }
}
