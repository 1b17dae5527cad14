//! Scenes on an image plane: patterns in pixels.

use crate::camera::CameraPath;
use crate::object::{Finish, Motion, Object, Shape};
use crate::registry::SceneKind;
use crate::scene::{Lamp, Lighting, Scene};
use crate::texture::{Layer, Profile, Wave};
use glam::DVec3;

/// Velocity of the edges, pixels per second.
pub const EDGE_VELOCITY_PX_S: [f64; 2] = [150.0, 60.0];

/// Log amplitude of the sinusoid, nepers: radiance goes from `exp(-1)` to `exp(1)`.
pub const SINUSOID_AMPLITUDE_LOG: f64 = 1.0;

/// Wavelength of the sinusoid, pixels.
pub const SINUSOID_WAVELENGTH_PX: f64 = 40.0;

/// Velocity of the sinusoid, pixels per second.
pub const SINUSOID_VELOCITY_PX_S: [f64; 2] = [90.0, 36.0];

pub(crate) fn scene(kind: SceneKind, width_px: u32, height_px: u32) -> Scene {
    let mut lamp = Lamp::NONE;
    let (base_log, velocity, layers) = match kind {
        SceneKind::Edge => {
            let layer = Layer {
                profile: Profile::Square { edge_rad: 0.0 },
                ..sine([0.0099, 0.0041], 0.1, DVec3::splat(0.9))
            };
            (DVec3::new(-0.7, -0.75, -0.8), EDGE_VELOCITY_PX_S, vec![layer])
        }
        SceneKind::Sinusoid => {
            let direction = [0.6_f64.cos(), 0.6_f64.sin()];
            let frequency = direction.map(|c| c / SINUSOID_WAVELENGTH_PX);
            let layer = sine(frequency, 0.0, DVec3::splat(SINUSOID_AMPLITUDE_LOG));
            (DVec3::ZERO, SINUSOID_VELOCITY_PX_S, vec![layer])
        }
        SceneKind::Hdr => {
            let layers = vec![
                sine([0.0080, 0.0035], 0.0, DVec3::new(6.6, 6.5, 6.3)),
                sine([-0.0060, 0.0140], 0.3, DVec3::new(1.7, 1.8, 1.9)),
                sine([0.0210, 0.0130], 0.7, DVec3::new(0.9, 1.0, 1.1)),
            ];
            (DVec3::splat(10.0_f64.ln()), [55.0, -30.0], layers)
        }
        SceneKind::Lamp => {
            let size_px = f64::from(width_px.min(height_px));
            lamp = Lamp {
                centre_px: DVec3::new(0.15, -0.1, 0.0) * size_px,
                radius_px: 0.3 * size_px,
                rgb: DVec3::new(30.0, 21.0, 11.0),
                rate_hz: 4.0,
                steepness: 3.0,
            };
            let tiles = Layer {
                waves: [wave([0.021, 0.004], 0.1), wave([-0.004, 0.021], 0.2)],
                profile: Profile::Square { edge_rad: 0.05 },
                amplitude: DVec3::new(0.35, 0.3, 0.2),
            };
            let layers = vec![tiles, sine([0.06, 0.11], 0.4, DVec3::splat(0.12))];
            (DVec3::new(-1.9, -1.7, -1.4), [0.0, 0.0], layers)
        }
        other => unreachable!("`{}` has no card here", other.name()),
    };
    let [vx, vy] = velocity;
    Scene {
        kind,
        width_px,
        height_px,
        focal_px: f64::from(width_px.max(1)),
        camera: CameraPath::Fixed,
        objects: vec![Object {
            shape: Shape::Card,
            motion: Motion { velocity: DVec3::new(vx, vy, 0.0), ..Motion::still(DVec3::ZERO) },
            base_log,
            gradient_log: DVec3::ZERO,
            layers,
            finish: Finish::GLOWING,
        }],
        lighting: Lighting::NONE,
        lamp,
        exposure: 1.0,
        frozen_at_s: None,
    }
}

fn wave([fx, fy]: [f64; 2], phase_turns: f64) -> Wave {
    Wave { frequency: DVec3::new(fx, fy, 0.0), phase_turns }
}

fn sine(frequency_per_px: [f64; 2], phase_turns: f64, amplitude: DVec3) -> Layer {
    Layer { waves: [wave(frequency_per_px, phase_turns), Wave::ONE], profile: Profile::Sine, amplitude }
}
