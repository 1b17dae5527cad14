//! Textures: sums of band-limited layers in log radiance, functions of a position in space.
//!
//! A layer is the product of two waves. A wave is a sinusoid of the position, or that sinusoid shaped into a square
//! wave with edges of half-width [`EDGE_PX`] on the screen. A wave fades where its frequency on the screen comes near
//! [`CUTOFF_PER_PX`], so that sampling at pixel centres does not alias.

use glam::DVec3;
use std::f64::consts::TAU;

/// Half-width of every edge on the screen, pixels: an edge is `tanh(distance / EDGE_PX)`.
pub const EDGE_PX: f64 = 1.0;

/// Frequency on the screen at which a wave has faded to nothing, cycles per pixel.
pub const CUTOFF_PER_PX: f64 = 0.25;

/// A wave's phase as a function of position: `phase + frequency . position`, in turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Cycles per unit of position.
    pub frequency: DVec3,
    /// Phase at the origin, turns.
    pub phase_turns: f64,
}

/// How a wave turns its phase into a value of -1 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Profile {
    /// A sinusoid.
    Sine,
    /// A square wave with edges of this half-width in radians of phase, or [`EDGE_PX`] where that is wider.
    Square {
        /// Half-width, radians of phase.
        edge_rad: f64,
    },
}

/// One term of a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// The two factors; the second may be [`Wave::ONE`].
    pub waves: [Wave; 2],
    /// How both waves are shaped.
    pub profile: Profile,
    /// Log radiance (nepers) of R, G, B where the product of the waves is 1.
    pub amplitude: DVec3,
}

/// Change of a position from a pixel to its right and lower neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Per pixel to the right.
    pub dx: DVec3,
    /// Per pixel downwards.
    pub dy: DVec3,
}

impl Wave {
    /// The constant 1.
    pub const ONE: Wave = Wave { frequency: DVec3::ZERO, phase_turns: 0.25 };

    /// Value at a position.
    #[must_use]
    pub fn value(&self, profile: Profile, position: DVec3, footprint: &Footprint) -> f64 {
        let turns = self.frequency.dot(position) + self.phase_turns;
        let sine = sin_turns(turns);
        let (fx, fy) = (self.frequency.dot(footprint.dx), self.frequency.dot(footprint.dy));
        let frequency2 = fx * fx + fy * fy;
        let fade = (1.0 - frequency2 / (CUTOFF_PER_PX * CUTOFF_PER_PX)).max(0.0);
        let shaped = match profile {
            Profile::Sine => sine,
            Profile::Square { edge_rad } => {
                let screen = TAU * EDGE_PX;
                (sine / (edge_rad * edge_rad + screen * screen * frequency2).sqrt()).tanh()
            }
        };
        shaped * fade * fade
    }
}

impl Layer {
    /// Log radiance that this layer adds, R, G, B, nepers.
    #[must_use]
    pub fn log_rgb(&self, position: DVec3, footprint: &Footprint) -> DVec3 {
        let value = self.waves[0].value(self.profile, position, footprint)
            * self.waves[1].value(self.profile, position, footprint);
        self.amplitude * value
    }
}

/// Sine of an angle in turns.
#[must_use]
pub fn sin_turns(turns: f64) -> f64 {
    ((turns - turns.round()) * TAU).sin()
}

/// Coverage of a half-plane at a signed distance in pixels from its border, positive inside.
#[must_use]
pub fn coverage(distance_px: f64) -> f64 {
    1.0 / (1.0 + (-2.0 * distance_px / EDGE_PX).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waves_fade_before_they_alias() {
        let wave = Wave { frequency: DVec3::X, phase_turns: 0.25 };
        for profile in [Profile::Sine, Profile::Square { edge_rad: 0.01 }] {
            let at = |per_px: f64| {
                let footprint = Footprint { dx: DVec3::X * per_px, dy: DVec3::ZERO };
                wave.value(profile, DVec3::ZERO, &footprint)
            };
            assert!(at(1e-4) > 0.999);
            assert!(at(0.2) < 0.2 && at(0.2) > 0.0);
            assert_eq!(at(0.26), 0.0);
        }
    }

    #[test]
    fn coverage_is_a_partition() {
        for distance_px in [-20.0, -1.0, 0.0, 0.3, 5.0] {
            assert!((coverage(distance_px) + coverage(-distance_px) - 1.0).abs() < 1e-15);
        }
        assert_eq!(coverage(0.0), 0.5);
    }
}
