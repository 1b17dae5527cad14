//! The photoreceptor over one sub-step, in the form that a float32 kernel can take.
//!
//! # First stage
//! With `v = e^(L - a)` the equation `da/dt = w_I - w_1`, `w_1 = w_I / v`, becomes linear: `dv/dt = v dL/dt - w_I (v - 1)`.
//! The excess `d = v - 1` obeys `dd/dt = -(w_I - dL/dt) d + dL/dt`. Over a sub-step of length `h` let `dL` be the change
//! of the level and `W = int w_I dt = w_I(start) h phi(dL)`, where `phi(x) = (e^x - 1) / x`. The exact solution is
//!
//! `d_1 = d_0 e^(dL - W) + q int_0^1 e^(-W z) (1 - q z)^-2 dz`, `q = 1 - e^-dL`,
//!
//! since `w_I` is linear in its own integral. [`step`] takes `w_I` as constant in the integral, at its mean, which is
//! exact for still light and for slow light alike: `d_1 = d_0 e^-K + dL phi(-K)`, `K = W - dL`.
//!
//! # Second stage
//! The lag `x = y - L` obeys `dx/dt = -w_2 (x + ln(1 + d)) - dL/dt`. Within the sub-step `d` is linear in `e^(-K t/h)`,
//! and so is `u`, which falls from 1 to 0. `ln(1 + d)` is taken as the parabola in `u` through its values at `u` = 1,
//! 1/2 and 0. Its convolution with the exponential of the second pole is closed.
//!
//! # Accuracy
//! A sub-step is cut into parts in which `|dL| <= `[`MAX_CHANGE_LOG`] and, while the node is more than
//! [`FAR_BEHIND_LOG`] behind, `W <= 1/2` ([`advance`]). The lag is then within .01 neper of the differential equations.
//!
//! # Single precision
//! `d` and `x` are small where the pixel has settled, and both forms multiply them by what remains of them. So
//! rounding does not gather, and nothing stalls in the dark, as it does in the form `v_1 = v_0 E + (1 - E)`: there a
//! change below half an ulp of `v` is lost, which leaves an error of `6e-8 / (w h)`. The level `L` stays in fixed
//! point; `y` is `L` plus the rounded lag. For a fast pixel `x` goes to 0 and `y` is `L` to the bit. [`phi`] needs
//! `expm1` or, where the language has none, a series for `|x| < .1`.

/// Largest change of the level that [`step`] takes at once, nepers.
pub const MAX_CHANGE_LOG: f64 = 0.2;

/// Lag of the first stage, nepers, beyond which a part is no longer than half the stage's time constant.
pub const FAR_BEHIND_LOG: f64 = 0.5;

/// Most parts of a sub-step: enough for a change of 12 nepers.
pub const MAX_PARTS: u32 = 64;

/// Least `v = 1 + d`: light that is less than a millionth of what the node shows counts as a millionth. In single
/// precision `1 + d` has no digits left below it. The node forgets how far it was behind long before it arrives.
const LEAST_RATIO: f64 = 1.0 / 1_048_576.0;

/// `(e^x - 1) / x`, 1 at 0.
#[must_use]
pub fn phi(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { x.exp_m1() / x }
}

/// The photoreceptor's state between sub-steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Photoreceptor {
    /// Excess `d = e^(L - a) - 1`: 0 when the first stage has settled, above 0 when it is behind a rise.
    pub excess: f64,
    /// Lag `x = y - L` of the second stage, nepers.
    pub lag_log: f64,
}

/// Light and speed over a part of a sub-step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Rate `w_I` at the part's start, per second.
    pub start_per_s: f64,
    /// Change of the level, nepers.
    pub change_log: f64,
    /// Length, seconds.
    pub duration_s: f64,
    /// The second pole, radians per second.
    pub second_pole_per_s: f64,
}

impl Drive {
    /// The integral `W` of the drive over the part.
    #[must_use]
    pub fn charge(&self) -> f64 {
        self.start_per_s * self.duration_s * phi(self.change_log)
    }

    /// The first part, of this share of the length, and what is left.
    #[must_use]
    pub fn split(&self, share: f64) -> (Drive, Drive) {
        let (change_log, duration_s) = (self.change_log * share, self.duration_s * share);
        let rest = Drive {
            start_per_s: self.start_per_s * change_log.exp(),
            change_log: self.change_log - change_log,
            duration_s: self.duration_s - duration_s,
            ..*self
        };
        (Drive { change_log, duration_s, ..*self }, rest)
    }
}

/// Share of what is left of a sub-step that the next part takes.
fn share(state: Photoreceptor, rest: &Drive) -> f64 {
    let for_change = 1.0 / (rest.change_log.abs() / MAX_CHANGE_LOG).ceil().max(1.0);
    let is_far = state.excess.ln_1p().abs() > FAR_BEHIND_LOG;
    if is_far { for_change.min(0.5 / rest.charge()) } else { for_change }
}

/// The state after one part, and the part's phase `P_1 = int w_1 dt`.
#[must_use]
pub fn step(state: Photoreceptor, drive: &Drive) -> (Photoreceptor, f64) {
    let change = drive.change_log;
    let charge = drive.charge();
    let decay = charge - change;
    let excess = (state.excess * (-decay).exp() + change * phi(-decay)).max(LEAST_RATIO - 1.0);
    let behind = |excess: f64| excess.ln_1p();
    let (from, middle, to) = (behind(state.excess), behind(0.5 * (state.excess + excess)), behind(excess));
    let second = drive.second_pole_per_s * drive.duration_s;
    let [kept, linear, square] = moments(second, decay);
    // The parabola through `to` at u = 0, `middle` at 1/2 and `from` at 1.
    let bend = 2.0 * (from + to - 2.0 * middle);
    let slope = 4.0 * middle - 3.0 * to - from;
    let pulled = to * (1.0 - kept) + slope * linear + bend * square;
    let lag_log = state.lag_log * kept - change * phi(-second) - pulled;
    // da/dt = w_I - w_1, so the phase is the charge less the rise of a = L - ln(1 + d).
    let phase = (charge - change + (to - from)).max(0.0);
    (Photoreceptor { excess, lag_log }, phase)
}

/// Weights of 1, `u` and `u^2` behind a pole that turns by `second` over the part: what it keeps of its start,
/// `e^-second`, and `int_0^1 second e^(-second (1 - s)) u(s)^n ds` for n = 1, 2, where `u` falls from 1 to 0 linearly
/// in `e^(-decay s)`.
fn moments(second: f64, decay: f64) -> [f64; 3] {
    let kept = (-second).exp();
    let fall = -(-decay).exp_m1();
    if fall.abs() < 0.03 {
        // Nearly linear in time: u = 1 - s.
        let linear = phi(-second) - kept;
        let square = if second < 0.5 {
            second * (1.0 / 3.0 - second * (0.25 - second * (0.1 - second / 36.0)))
        } else {
            (2.0 - kept * (second * (second + 2.0) + 2.0)) / (second * second)
        };
        return [kept, linear, square];
    }
    let passed = |rate: f64| second * (-rate.min(second)).exp() * phi(-(second - rate).abs());
    let (left, first, twice) = (1.0 - fall, passed(decay), passed(2.0 * decay));
    let linear = (first - left * (1.0 - kept)) / fall;
    let square = (twice - 2.0 * left * first + left * left * (1.0 - kept)) / (fall * fall);
    [kept, linear, square]
}

/// The state after a whole sub-step, and its phase: [`step`] over its parts.
#[must_use]
pub fn advance(state: Photoreceptor, drive: &Drive) -> (Photoreceptor, f64) {
    let (mut state, mut rest, mut phase) = (state, *drive, 0.0);
    for _ in 1..MAX_PARTS {
        let share = share(state, &rest);
        if share >= 1.0 {
            break;
        }
        let (part, after) = rest.split(share);
        let (next, turned) = step(state, &part);
        (state, rest, phase) = (next, after, phase + turned);
    }
    let (state, turned) = step(state, &rest);
    (state, phase + turned)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn still(start_per_s: f64, duration_s: f64) -> Drive {
        Drive { start_per_s, change_log: 0.0, duration_s, second_pole_per_s: 6000.0 }
    }

    #[test]
    fn still_light_is_exact_for_the_first_stage() {
        for (excess, turned) in [(-0.9, 0.3), (-0.9, 30.0), (0.5, 1e-4), (9.0, 2.0)] {
            let state = Photoreceptor { excess, lag_log: -f64::ln_1p(excess) };
            let (next, _) = advance(state, &still(turned / 0.01, 0.01));
            let exact = excess * f64::exp(-turned);
            assert!((next.excess - exact).abs() < 1e-12 * exact.abs().max(1e-3), "{excess} {turned}");
        }
    }

    #[test]
    fn a_settled_pixel_stays_settled_and_a_fast_one_follows() {
        let (next, phase) = advance(Photoreceptor::default(), &still(10.0, 0.1));
        assert_eq!((next, phase), (Photoreceptor::default(), 1.0));
        let fast = Drive { start_per_s: 1e12, change_log: 3.0, duration_s: 1e-3, second_pole_per_s: 1e12 };
        let (next, _) = advance(Photoreceptor::default(), &fast);
        assert!(next.lag_log.abs() < 1e-8, "{next:?}");
    }

    #[test]
    fn a_rise_is_faster_than_a_fall() {
        // A tenfold step within a microsecond, then a time constant of the bright side.
        let after = |change_log: f64| {
            let edge = Drive { start_per_s: 100.0, change_log, duration_s: 1e-6, second_pole_per_s: 1e7 };
            let (state, _) = advance(Photoreceptor::default(), &edge);
            let after = still(100.0 * change_log.exp(), 1e-3);
            1.0 + advance(state, &Drive { second_pole_per_s: 1e7, ..after }).0.lag_log / change_log
        };
        assert!(
            after(f64::ln(10.0)) > 5.0 * after(-f64::ln(10.0)),
            "share of the step that has been followed"
        );
    }

    #[test]
    fn a_blackout_of_any_depth_stays_finite() {
        for change_log in [-40.0, -20.0, 20.0, 40.0] {
            let drive = Drive { start_per_s: 1e4, change_log, duration_s: 1e-3, second_pole_per_s: 6000.0 };
            let (state, phase) = advance(Photoreceptor::default(), &drive);
            assert!(state.excess.is_finite() && state.excess > -1.0, "{change_log}: {state:?}");
            assert!(state.lag_log.is_finite() && phase.is_finite(), "{change_log}: {state:?} {phase}");
        }
    }
}
