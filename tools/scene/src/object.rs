//! What a scene consists of.

use crate::texture::{Layer, Wave};
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// Geometry of an object, in its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A sphere around the origin.
    Sphere {
        /// Radius, metres.
        radius_m: f64,
    },
    /// A rectangle in the plane z = 0.
    Panel {
        /// Half its extent along x and y, metres.
        half_m: [f64; 2],
    },
    /// The infinite plane z = 0 of the world, seen from above.
    Ground,
    /// A range of hills at infinity. Positions on it are unit directions.
    Ridge {
        /// Sine of its mean elevation.
        elevation: f64,
        /// Waves around the horizon.
        waves: [Wave; 4],
        /// Amplitude of each wave, sine of elevation.
        amplitudes: [f64; 4],
    },
    /// Everything behind. Positions on it are unit directions.
    Sky,
    /// An image plane one metre away; positions on it are pixels from the image's centre.
    Card,
}

/// A rigid motion: a swinging, drifting centre and a steady turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Mean position, metres (pixels for a card).
    pub centre: DVec3,
    /// Steady velocity, per second.
    pub velocity: DVec3,
    /// Sinusoids of the position: amplitude, frequency in Hz and phase in turns.
    pub swings: [(DVec3, f64, f64); 2],
    /// Orientation at time 0.
    pub orientation: DMat3,
    /// Axis of the turn in the world.
    pub spin_axis: DVec3,
    /// Turns per second.
    pub spin_hz: f64,
}

/// How a surface answers light. Factors of the scene's lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// Ambient light.
    pub ambient: f64,
    /// The sun.
    pub sun: f64,
    /// The lamp.
    pub lamp: f64,
    /// Light of its own: 1 makes the texture the radiance.
    pub emission: f64,
    /// Haze between camera and surface.
    pub haze: f64,
    /// Strength of the sun's highlight.
    pub gloss: f64,
    /// Sharpness of the highlight.
    pub gloss_sharpness: f64,
}

/// One object.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Geometry.
    pub shape: Shape,
    /// Path.
    pub motion: Motion,
    /// Log (nepers) of the mean albedo or radiance, R, G, B.
    pub base_log: DVec3,
    /// Change of `base_log` towards the zenith; only the sky has one.
    pub gradient_log: DVec3,
    /// Texture, at most [`MAX_LAYERS`] layers.
    pub layers: Vec<Layer>,
    /// Answer to light.
    pub finish: Finish,
}

/// Layers per object.
pub const MAX_LAYERS: usize = 8;

impl Motion {
    /// At rest.
    #[must_use]
    pub fn still(centre: DVec3) -> Motion {
        Motion {
            centre,
            velocity: DVec3::ZERO,
            swings: [(DVec3::ZERO, 0.0, 0.0); 2],
            orientation: DMat3::IDENTITY,
            spin_axis: DVec3::Z,
            spin_hz: 0.0,
        }
    }

    /// Origin and axes in the world at `t_s` seconds.
    #[must_use]
    pub fn pose(&self, t_s: f64) -> (DVec3, DMat3) {
        let swing: DVec3 = self
            .swings
            .iter()
            .map(|&(amplitude, hz, turns)| amplitude * (TAU * (hz * t_s + turns)).sin())
            .sum();
        let turn = DMat3::from_axis_angle(self.spin_axis, TAU * (self.spin_hz * t_s).fract());
        (self.centre + self.velocity * t_s + swing, turn * self.orientation)
    }
}

impl Finish {
    /// Dull, lit by everything.
    pub const MATT: Finish = Finish {
        ambient: 1.0,
        sun: 1.0,
        lamp: 1.0,
        emission: 0.0,
        haze: 1.0,
        gloss: 0.0,
        gloss_sharpness: 1.0,
    };

    /// Light of its own only.
    pub const GLOWING: Finish = Finish {
        ambient: 0.0,
        sun: 0.0,
        lamp: 0.0,
        emission: 1.0,
        haze: 0.0,
        gloss: 0.0,
        gloss_sharpness: 1.0,
    };

    /// Matt with a highlight.
    #[must_use]
    pub fn glossy(gloss: f64, gloss_sharpness: f64) -> Finish {
        Finish { gloss, gloss_sharpness, ..Finish::MATT }
    }
}
