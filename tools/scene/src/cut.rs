//! Sheets: planes cut to a form. Bars, leaves and blades hide much of what is behind them and little of it for long.
//!
//! A form is a function of the position on the plane. The distance from its border in pixels is that function over its
//! gradient on the screen, so borders are as soft as those of solids.

use crate::texture::{Footprint, Wave, coverage, sin_turns};
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// Blades of a propeller.
pub const BLADES: usize = 3;

/// Softness of the borders of leaves where they run flat: the squared gradient of the form is raised by this share of
/// its mean, so that the distance stays finite where two leaves touch.
pub const LEAF_SOFTNESS: f64 = 0.05;

/// Form of a sheet, in the plane z = 0 of its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cut {
    /// The whole endless plane.
    Whole,
    /// Endless parallel bars, one for each turn of the wave. Gaps are at least [`REACH_PX`](crate::view::REACH_PX) wide.
    Bars {
        /// Phase across the bars. A bar's middle is at a whole number of turns.
        wave: Wave,
        /// Width of a bar as a share of the distance from one to the next.
        share: f64,
    },
    /// Leaves: where a sum of waves is above a level.
    Leaves {
        /// The waves.
        waves: [Wave; 4],
        /// Amplitude of each.
        amplitudes: [f64; 4],
        /// The level.
        level: f64,
    },
    /// A propeller around the origin: [`BLADES`] rectangles, the first along x, and a disc over their roots.
    Blades {
        /// Half the width of a blade, metres.
        half_width_m: f64,
        /// Distance of the tips from the origin, metres.
        length_m: f64,
        /// Radius of the disc, metres.
        hub_m: f64,
    },
}

impl Cut {
    /// The form with its waves converted by `turned`, as from the sheet's axes to those of a camera.
    #[must_use]
    pub fn with_waves(self, turned: impl Fn(Wave) -> Wave) -> Cut {
        match self {
            Cut::Whole | Cut::Blades { .. } => self,
            Cut::Bars { wave, share } => Cut::Bars { wave: turned(wave), share },
            Cut::Leaves { waves, amplitudes, level } => {
                Cut::Leaves { waves: waves.map(turned), amplitudes, level }
            }
        }
    }

    /// Share of a pixel that the sheet covers. The waves are in the axes of `position`; `origin` and `rotation` say
    /// where the sheet is in them.
    #[must_use]
    pub fn coverage(&self, position: DVec3, footprint: &Footprint, origin: DVec3, rotation: DMat3) -> f64 {
        match *self {
            Cut::Whole => 1.0,
            Cut::Bars { wave, share } => {
                let turns = wave.frequency.dot(position) + wave.phase_turns;
                strip(turns - turns.round(), 0.5 * share, per_px(wave.frequency, footprint))
            }
            Cut::Leaves { waves, amplitudes, level } => {
                let mut height = -level;
                let (mut gx, mut gy, mut mean2) = (0.0, 0.0, 0.0);
                for (wave, amplitude) in waves.iter().zip(amplitudes) {
                    let turns = wave.frequency.dot(position) + wave.phase_turns;
                    height += amplitude * sin_turns(turns);
                    let (fx, fy) = (wave.frequency.dot(footprint.dx), wave.frequency.dot(footprint.dy));
                    let steepest = TAU * amplitude;
                    let slope = steepest * sin_turns(turns + 0.25);
                    gx += slope * fx;
                    gy += slope * fy;
                    mean2 += 0.5 * steepest * steepest * (fx * fx + fy * fy);
                }
                coverage(height / (gx * gx + gy * gy + LEAF_SOFTNESS * mean2).sqrt())
            }
            Cut::Blades { half_width_m, length_m, hub_m } => {
                let from_hub = position - origin;
                let radius_m = from_hub.length();
                let radial = from_hub / radius_m.max(1e-12 * hub_m);
                let mut clear = 1.0 - coverage((hub_m - radius_m) / per_px(radial, footprint).max(1e-12));
                for blade in 0..BLADES {
                    let (sin, cos) = (TAU * blade as f64 / BLADES as f64).sin_cos();
                    let along = rotation.x_axis * cos + rotation.y_axis * sin;
                    let across = rotation.y_axis * cos - rotation.x_axis * sin;
                    let reach_m = along.dot(from_hub);
                    let along_per_px = per_px(along, footprint);
                    let covered = strip(across.dot(from_hub), half_width_m, per_px(across, footprint))
                        * coverage(reach_m / along_per_px)
                        * coverage((length_m - reach_m) / along_per_px);
                    clear *= 1.0 - covered;
                }
                1.0 - clear
            }
        }
    }
}

/// Coverage of a strip `2 half` wide, `off` from its middle.
fn strip(off: f64, half: f64, per_px: f64) -> f64 {
    coverage((half - off) / per_px) * coverage((half + off) / per_px)
}

/// Largest change of `direction . position` from a pixel to another one pixel away.
fn per_px(direction: DVec3, footprint: &Footprint) -> f64 {
    direction.dot(footprint.dx).hypot(direction.dot(footprint.dy))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FACING: Footprint = Footprint { dx: DVec3::X, dy: DVec3::Y };

    fn covered(cut: Cut, x: f64, y: f64) -> f64 {
        cut.coverage(DVec3::new(x, y, 0.0), &FACING, DVec3::ZERO, DMat3::IDENTITY)
    }

    /// On a sheet with one unit a pixel, coverage summed over a row of pixels is the width of what they see.
    #[test]
    fn a_bar_is_as_wide_as_its_share_says() {
        let wave = Wave { frequency: DVec3::X / 50.0, phase_turns: 0.13 };
        for width_px in [1.2, 3.0, 9.0] {
            let bars = Cut::Bars { wave, share: width_px / 50.0 };
            let seen: f64 = (0..500).map(|x| covered(bars, f64::from(x), 7.0)).sum::<f64>() / 10.0;
            // The two borders multiply, which widens a bar narrower than they are soft.
            let expected = width_px / (1.0 - (-2.0 * width_px).exp());
            assert!((seen - expected).abs() < 1e-3, "{width_px}: {seen} {expected}");
            assert!(covered(bars, -0.13 * 50.0, 0.0) > 0.5, "a bar's middle belongs to the bar");
        }
    }

    #[test]
    fn leaves_end_where_the_sum_is_the_level_and_borders_are_a_pixel_wide() {
        let wave = |x: f64, y: f64| Wave { frequency: DVec3::new(x, y, 0.0), phase_turns: 0.0 };
        let waves = [wave(0.04, 0.01), wave(-0.02, 0.05), wave(0.03, -0.03), wave(0.05, 0.04)];
        let (amplitudes, level) = ([1.0, 0.9, 0.8, 0.5], 0.3);
        let leaves = Cut::Leaves { waves, amplitudes, level };
        let mut on_leaves = 0;
        for y in 0..100 {
            for x in 0..100 {
                let (x, y) = (f64::from(x), f64::from(y));
                let sum: f64 = waves
                    .iter()
                    .zip(amplitudes)
                    .map(|(w, a)| a * sin_turns(w.frequency.dot(DVec3::new(x, y, 0.0))))
                    .sum();
                let here = covered(leaves, x, y);
                assert_eq!(here >= 0.5, sum >= level, "({x}, {y})");
                let change = (covered(leaves, x + 1e-4, y) - here).hypot(covered(leaves, x, y + 1e-4) - here);
                assert!(change < 0.75e-4, "({x}, {y}): coverage changes by {change} in 1e-4 px");
                on_leaves += usize::from(here >= 0.5);
            }
        }
        assert!((2000..6000).contains(&on_leaves), "{on_leaves}");
    }

    #[test]
    fn a_propeller_is_the_same_after_a_third_of_a_turn() {
        let blades = Cut::Blades { half_width_m: 6.0, length_m: 50.0, hub_m: 9.0 };
        assert!(covered(blades, 0.0, 0.0) > 0.999 && covered(blades, 40.0, 0.0) > 0.999);
        assert!(covered(blades, -40.0, 0.0) < 1e-9 && covered(blades, 60.0, 0.0) < 1e-8);
        let (sin, cos) = (TAU / 3.0).sin_cos();
        for (x, y) in [(30.0, 5.0), (12.0, -6.5), (3.0, 2.0), (49.0, 6.0)] {
            let turned = covered(blades, cos * x - sin * y, sin * x + cos * y);
            assert!((turned - covered(blades, x, y)).abs() < 1e-9);
        }
    }
}
