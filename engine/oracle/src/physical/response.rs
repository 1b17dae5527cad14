//! The photoreceptor over one sub-step, as the solution of its differential equations at any instant. Nothing here is
//! shared with the model's integrator, which is held against it.
//!
//! The first stage has an exact solution as an integral ([`excess_after`]). Its lag is represented by polynomials over
//! **pieces** as short as that needs. The second stage follows from a piece's polynomial in closed form.

use esaac_model::physical::photoreceptor::{Drive, Photoreceptor, phi};

/// Largest error of a piece's polynomial at its check points, nepers.
const PIECE_ERROR_LOG: f64 = 1e-11;

/// Largest change of the level in a piece, nepers. The quadrature of [`excess_after`] is exact to rounding up to it.
const PIECE_CHANGE_LOG: f64 = 0.25;

/// Least `1 + d`: light that is less than this part of what the node shows counts as this part. Below it f64 has too few
/// digits left of `1 + d`.
pub const LEAST_RATIO: f64 = 1e-12;

/// Nodes and weights of the Gauss-Legendre quadrature of order 16 on [0, 1].
const GAUSS: [[f64; 2]; 8] = [
    [0.019_855_071_751_231_912, 0.050_614_268_145_188_53],
    [0.101_666_761_293_186_64, 0.111_190_517_226_687_21],
    [0.237_233_795_041_835_5, 0.156_853_322_938_943_44],
    [0.408_282_678_752_175_1, 0.181_341_891_689_180_83],
    [0.591_717_321_247_824_8, 0.181_341_891_689_180_83],
    [0.762_766_204_958_164_5, 0.156_853_322_938_943_44],
    [0.898_333_238_706_813_4, 0.111_190_517_226_687_21],
    [0.980_144_928_248_768_1, 0.050_614_268_145_188_53],
];

/// What the rest of the pixel needs of the photoreceptor at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Change of the level since the sub-step's start, nepers.
    pub change_log: f64,
    /// Lag `y - L`, nepers.
    pub lag_log: f64,
    /// Slope of the output `y`, nepers per second.
    pub slope_per_s: f64,
    /// Rate `w_1` of the first stage, per second.
    pub first_per_s: f64,
    /// Phase `P_1` since the sub-step's start.
    pub phase: f64,
}

/// Part of a sub-step in which `ln(1 + d)` is a polynomial of degree 4.
#[derive(Clone, Copy, Debug)]
struct Piece {
    from_s: f64,
    span_s: f64,
    /// Coefficients of `ln(1 + d)` in the piece's fraction.
    behind: [f64; 5],
    lag_log: f64,
    phase: f64,
}

/// The photoreceptor over a sub-step.
#[derive(Clone, Debug)]
pub struct Response {
    drive: Drive,
    /// Slope of the level, nepers per second.
    slope_per_s: f64,
    pieces: Vec<Piece>,
    end: Photoreceptor,
}

impl Response {
    /// Solves the sub-step.
    #[must_use]
    pub fn solve(state: Photoreceptor, drive: &Drive) -> Self {
        let slope_per_s = drive.change_log / drive.duration_s;
        let mut response = Response { drive: *drive, slope_per_s, pieces: Vec::new(), end: state };
        let (mut from_s, mut excess, mut lag_log, mut phase) = (0.0, state.excess, state.lag_log, 0.0);
        let longest_s = match slope_per_s.abs() {
            0.0 => drive.duration_s,
            slope => drive.duration_s.min(PIECE_CHANGE_LOG / slope),
        };
        // A settled pixel moves with the light. Another one begins at the pace of its first stage.
        let settled = state.excess.abs() < 1e-9;
        let mut span_s = if settled { longest_s } else { longest_s.min(1.0 / drive.start_per_s.max(1e-9)) };
        while from_s < drive.duration_s {
            let last = from_s + span_s >= drive.duration_s;
            span_s = if last { drive.duration_s - from_s } else { span_s };
            let Some((behind, excess_at_end)) = response.fit(excess, from_s, span_s) else {
                span_s *= 0.5;
                continue;
            };
            let piece = Piece { from_s, span_s, behind, lag_log, phase };
            let end = response.within(&piece, span_s);
            (excess, lag_log, phase) = (excess_at_end, end.lag_log, end.phase);
            response.pieces.push(piece);
            from_s = if last { drive.duration_s } else { from_s + span_s };
            span_s = (2.0 * span_s).min(longest_s);
        }
        response.end = Photoreceptor { excess, lag_log };
        response
    }

    /// The photoreceptor at the sub-step's end.
    #[must_use]
    pub fn end(&self) -> Photoreceptor {
        self.end
    }

    /// The photoreceptor `t_s` seconds after the sub-step's start.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Point {
        let after = self.pieces.partition_point(|piece| piece.from_s <= t_s);
        let piece = &self.pieces[after.max(1) - 1];
        self.within(piece, t_s - piece.from_s)
    }

    /// Rate that the light drives, `t_s` seconds after the sub-step's start.
    fn drive_per_s(&self, t_s: f64) -> f64 {
        self.drive.start_per_s * (self.slope_per_s * t_s).exp()
    }

    fn within(&self, piece: &Piece, t_s: f64) -> Point {
        let second_per_s = self.drive.second_pole_per_s;
        let fraction = t_s / piece.span_s;
        let behind = polynomial(&piece.behind, fraction);
        let change_log = self.slope_per_s * t_s;
        let drive_per_s = self.drive_per_s(piece.from_s);
        let turned = second_per_s * t_s;
        let lag_log = piece.lag_log * (-turned).exp()
            - change_log * phi(-turned)
            - filtered(&piece.behind, second_per_s * piece.span_s, fraction);
        // w_1 = w_I - da/dt, and a = L - ln(1 + d).
        let phase =
            piece.phase + drive_per_s * t_s * phi(change_log) - change_log + (behind - piece.behind[0]);
        Point {
            change_log: self.slope_per_s * (piece.from_s + t_s),
            lag_log,
            // dy/dt = w_2 (a - y), and a = L - ln(1 + d).
            slope_per_s: -second_per_s * (behind + lag_log),
            first_per_s: self.drive_per_s(piece.from_s + t_s) * (-behind).exp(),
            phase,
        }
    }

    /// The polynomial of `ln(1 + d)` over a piece and the excess at its end, or `None` if the piece is too long for it.
    fn fit(&self, excess: f64, from_s: f64, span_s: f64) -> Option<([f64; 5], f64)> {
        let after = |excess: f64, at: f64, share: f64| {
            let change_log = self.slope_per_s * span_s * share;
            let start_per_s = self.drive_per_s(from_s + at * span_s);
            let charge = start_per_s * span_s * share * phi(change_log);
            excess_after(excess, charge, change_log).max(LEAST_RATIO - 1.0)
        };
        let mut nodes = [excess; 5];
        for i in 1..5 {
            nodes[i] = after(nodes[i - 1], 0.25 * (i - 1) as f64, 0.25);
        }
        let behind = interpolate(nodes.map(f64::ln_1p));
        let fits = [(0, 0.125), (3, 0.875)].into_iter().all(|(node, at)| {
            let exact = after(nodes[node], 0.25 * node as f64, 0.125).ln_1p();
            let rounding = 1e-15 / (1.0 + nodes[node]);
            (polynomial(&behind, at) - exact).abs() <= PIECE_ERROR_LOG * (1.0 + exact.abs()) + rounding
        });
        // Below this the values differ by rounding only.
        let shortest = self.drive_per_s(from_s) * span_s < 1e-9;
        (fits || shortest).then_some((behind, nodes[4]))
    }
}

/// The excess after the charge `W` and a change of the level: the exact solution (see the model's `photoreceptor`).
#[must_use]
pub fn excess_after(excess: f64, charge: f64, change_log: f64) -> f64 {
    let q = -(-change_log).exp_m1();
    let kept = excess * (change_log - charge).exp();
    if q == 0.0 {
        return kept;
    }
    // Panels of two time constants each; what lies forty of them back is forgotten.
    let panels = (charge / 2.0).ceil().clamp(1.0, 20.0);
    let width = (1.0 / panels).min(2.0 / charge);
    let mut sum = 0.0;
    for panel in 0..panels as u32 {
        for [node, weight] in GAUSS {
            let z = (f64::from(panel) + node) * width;
            sum += weight * (-charge * z).exp() / ((1.0 - q * z) * (1.0 - q * z));
        }
    }
    kept + q * sum * width
}

/// `int_0^s Y e^(-Y (s - r)) p(r) dr`: a polynomial behind a pole.
fn filtered(p: &[f64; 5], pole: f64, s: f64) -> f64 {
    if pole <= 4.0 {
        let integrand = |r: f64| (-pole * (s - r)).exp() * polynomial(p, r);
        return pole * s * GAUSS.iter().map(|[node, weight]| weight * integrand(node * s)).sum::<f64>();
    }
    // u' = Y (p - u) has the polynomial solution u_k = p_k - (k + 1) u_(k+1) / Y. What starts elsewhere decays to it.
    let mut u = *p;
    for k in (0..4).rev() {
        u[k] -= (k + 1) as f64 * u[k + 1] / pole;
    }
    polynomial(&u, s) - u[0] * (-pole * s).exp()
}

fn polynomial(coefficients: &[f64; 5], s: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * s + coefficient)
}

/// The polynomial through values at 0, 1/4, 1/2, 3/4 and 1 (Newton's forward differences).
fn interpolate(values: [f64; 5]) -> [f64; 5] {
    let mut differences = values;
    for order in 1..5 {
        for i in (order..5).rev() {
            differences[i] -= differences[i - 1];
        }
    }
    let [f0, f1, f2, f3, f4] = differences;
    [
        f0,
        4.0 * (f1 - f2 / 2.0 + f3 / 3.0 - f4 / 4.0),
        16.0 * (f2 / 2.0 - f3 / 2.0 + 11.0 * f4 / 24.0),
        64.0 * (f3 / 6.0 - f4 / 4.0),
        256.0 * f4 / 24.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_passes_through_its_values() {
        let values = [1.0, -2.0, 0.5, 3.0, 7.0];
        let p = interpolate(values);
        for (i, value) in values.into_iter().enumerate() {
            assert!((polynomial(&p, 0.25 * i as f64) - value).abs() < 1e-12);
        }
    }

    #[test]
    fn both_forms_of_the_filtered_polynomial_agree() {
        let p = [0.3, -1.0, 0.5, 0.2, -0.1];
        for s in [0.1, 0.7, 1.0] {
            let (below, above) = (filtered(&p, 4.0, s), filtered(&p, 4.0 + 1e-9, s));
            assert!((below - above).abs() < 2e-9, "{s}: {below} {above}");
        }
    }
}
