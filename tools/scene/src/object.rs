//! Objects of a scene: shape, motion, texture and finish.

use crate::cut::Cut;
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
    /// A part of the plane z = 0, seen from z > 0 or z < 0.
    Sheet {
        /// Which part.
        cut: Cut,
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
    /// The sky, behind everything. Positions on it are unit directions.
    Sky,
    /// An image plane one metre away; positions on it are pixels from the image's centre.
    Card,
}

/// A rigid motion: the centre drifts, swings and bounces, the object turns steadily.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Mean position, metres (pixels for a card).
    pub centre: DVec3,
    /// Steady velocity, per second.
    pub velocity: DVec3,
    /// Sinusoids of the position: amplitude, frequency in Hz and phase in turns.
    pub swings: [(DVec3, f64, f64); 2],
    /// Parabolas of the position from one bounce to the next: height, bounces a second and phase in turns.
    pub bounce: (DVec3, f64, f64),
    /// Orientation at time 0.
    pub orientation: DMat3,
    /// Axis of rotation, world axes.
    pub spin_axis: DVec3,
    /// Turns per second.
    pub spin_hz: f64,
}

/// How a surface reflects light: one factor for each of the scene's lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// Ambient light.
    pub ambient: f64,
    /// The sun.
    pub sun: f64,
    /// The lamp.
    pub lamp: f64,
    /// Emission. With 1 the texture is the radiance.
    pub emission: f64,
    /// Strength of the haze between camera and surface.
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
    /// Motion.
    pub motion: Motion,
    /// Log (nepers) of the mean albedo or radiance, R, G, B.
    pub base_log: DVec3,
    /// Change of `base_log` towards the zenith, nepers. Only the sky has one.
    pub gradient_log: DVec3,
    /// Texture, at most [`MAX_LAYERS`] layers.
    pub layers: Vec<Layer>,
    /// How the surface reflects light.
    pub finish: Finish,
}

impl Object {
    /// A matt object of one colour, linear RGB, without texture.
    #[must_use]
    pub fn plain(shape: Shape, motion: Motion, rgb: [f64; 3]) -> Self {
        Object {
            shape,
            motion,
            base_log: DVec3::from_array(rgb.map(f64::ln)),
            gradient_log: DVec3::ZERO,
            layers: Vec::new(),
            finish: Finish::MATT,
        }
    }
}

/// Largest number of layers per object.
pub const MAX_LAYERS: usize = 8;

impl Motion {
    /// An object at rest at `centre`.
    #[must_use]
    pub fn still(centre: DVec3) -> Motion {
        Motion {
            centre,
            velocity: DVec3::ZERO,
            swings: [(DVec3::ZERO, 0.0, 0.0); 2],
            bounce: (DVec3::ZERO, 0.0, 0.0),
            orientation: DMat3::IDENTITY,
            spin_axis: DVec3::Z,
            spin_hz: 0.0,
        }
    }

    /// Origin (metres) and rotation to world axes at `t_s` seconds.
    #[must_use]
    pub fn pose(&self, t_s: f64) -> (DVec3, DMat3) {
        let swing: DVec3 = self
            .swings
            .iter()
            .map(|&(amplitude, hz, turns)| amplitude * (TAU * (hz * t_s + turns)).sin())
            .sum();
        let (height, bounce_hz, turns) = self.bounce;
        let since_bounce = (bounce_hz * t_s + turns).rem_euclid(1.0);
        let bounce = height * (4.0 * since_bounce * (1.0 - since_bounce));
        let turn = DMat3::from_axis_angle(self.spin_axis, TAU * (self.spin_hz * t_s).fract());
        (self.centre + self.velocity * t_s + swing + bounce, turn * self.orientation)
    }

    /// Whether the pose is the same at all times.
    #[must_use]
    pub fn is_still(&self) -> bool {
        let rests = |(way, hz, _): (DVec3, f64, f64)| way == DVec3::ZERO || hz == 0.0;
        self.velocity == DVec3::ZERO
            && self.swings.into_iter().all(rests)
            && rests(self.bounce)
            && self.spin_hz == 0.0
    }
}

impl Finish {
    /// A matt surface that reflects every light.
    pub const MATT: Finish = Finish {
        ambient: 1.0,
        sun: 1.0,
        lamp: 1.0,
        emission: 0.0,
        haze: 1.0,
        gloss: 0.0,
        gloss_sharpness: 1.0,
    };

    /// A surface that emits light and reflects none.
    pub const GLOWING: Finish = Finish {
        ambient: 0.0,
        sun: 0.0,
        lamp: 0.0,
        emission: 1.0,
        haze: 0.0,
        gloss: 0.0,
        gloss_sharpness: 1.0,
    };

    /// A matt surface with a highlight.
    #[must_use]
    pub fn glossy(gloss: f64, gloss_sharpness: f64) -> Finish {
        Finish { gloss, gloss_sharpness, ..Finish::MATT }
    }
}
