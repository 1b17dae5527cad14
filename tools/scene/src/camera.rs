//! The camera's path, and the measurements of an inertial unit fixed to the camera.
//!
//! World: right-handed, z up, metres. Body and image: x right, y down, z forward.

use crate::jet::Jet;
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// Standard gravity as used by the scenes, m/s^2.
pub const GRAVITY_M_S2: f64 = 9.81;

/// Yaw, pitch and roll of a level camera that looks along world y, radians.
const AHEAD: [f64; 3] = [0.25 * TAU, 0.0, 0.0];

/// Speed of the orbit's clock relative to the scene's.
const ORBIT_PACE: f64 = 1.7;

/// Frequencies of a shaken camera: yaw and sideways, pitch and up.
pub const SHAKE_HZ: [f64; 2] = [9.0, 11.0];

/// Amplitude of a shaken camera's position, metres.
const SHAKE_M: f64 = 0.02;

/// The camera's pose at an instant, with exact derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraState {
    /// Position in the world, metres.
    pub position_m: DVec3,
    /// Velocity in the world, m/s.
    pub velocity_m_s: DVec3,
    /// Acceleration in the world, m/s^2.
    pub acceleration_m_s2: DVec3,
    /// Rotation from body to world; columns are right, down and forward.
    pub world_from_body: DMat3,
    /// Angular rate in body axes, rad/s.
    pub angular_rate_rad_s: DVec3,
}

/// An exact inertial sample, body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Specific force, m/s^2. At rest it is 9.81 upwards.
    pub specific_force_m_s2: DVec3,
    /// Angular rate, rad/s.
    pub angular_rate_rad_s: DVec3,
}

/// A camera's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraPath {
    /// At rest at the origin, level, looking along world y.
    Fixed,
    /// Orbit around the flight scene, looking inwards, with the sway of a hand-held flight.
    Orbit,
    /// At rest in the orbit's pose of one time.
    Frozen {
        /// Time of the pose on the orbit, seconds.
        at_s: f64,
    },
    /// Shaken about the orbit's pose of one time, each axis at its frequency of [`SHAKE_HZ`].
    Shaken {
        /// Time of the pose on the orbit, seconds.
        at_s: f64,
        /// Amplitude of yaw, radians.
        yaw_rad: f64,
        /// Amplitude of pitch, radians.
        pitch_rad: f64,
    },
    /// From the origin at constant velocity, level, looking along world y.
    Track {
        /// Velocity, m/s.
        velocity_m_s: DVec3,
    },
}

impl CameraPath {
    /// Pose and derivatives at `t_s` seconds.
    #[must_use]
    pub fn state(self, t_s: f64) -> CameraState {
        match self {
            CameraPath::Fixed => pose([Jet::default(); 3], AHEAD.map(Jet::constant)),
            CameraPath::Orbit => {
                let (position, angles) = orbit(Jet::time(t_s));
                pose(position, angles)
            }
            CameraPath::Frozen { at_s } => {
                let (position, angles) = orbit(Jet::constant(at_s));
                pose(position, angles)
            }
            CameraPath::Shaken { at_s, yaw_rad, pitch_rad } => {
                let (mut position, mut angles) = orbit(Jet::constant(at_s));
                let phase = |hz: f64| Jet::time((t_s * hz).fract() / hz) * (TAU * hz);
                let [sideways, up] = SHAKE_HZ.map(phase);
                position[0] = position[0] + sideways.cos() * SHAKE_M;
                position[2] = position[2] + up.cos() * SHAKE_M;
                angles[0] = angles[0] + sideways.sin() * yaw_rad;
                angles[1] = angles[1] + up.sin() * pitch_rad;
                pose(position, angles)
            }
            CameraPath::Track { velocity_m_s } => {
                let t = Jet::time(t_s);
                pose(velocity_m_s.to_array().map(|v| t * v), AHEAD.map(Jet::constant))
            }
        }
    }
}

impl CameraState {
    /// Measurements of an ideal inertial unit at the camera's centre.
    #[must_use]
    pub fn imu(&self) -> ImuSample {
        let up = DVec3::new(0.0, 0.0, GRAVITY_M_S2);
        ImuSample {
            specific_force_m_s2: self.world_from_body.transpose() * (self.acceleration_m_s2 + up),
            angular_rate_rad_s: self.angular_rate_rad_s,
        }
    }
}

/// Position and angles on the orbit, as [`pose`] takes them.
fn orbit(time: Jet) -> ([Jet; 3], [Jet; 3]) {
    let t = time * ORBIT_PACE;
    let angle = t * 0.21 + (t * 0.83).sin() * 0.09 + -1.95;
    let radius = (t * 0.37).sin() * 0.7 + 6.6;
    let position =
        [angle.cos() * radius, angle.sin() * radius, (t * 0.61).sin() * 0.35 + (t * 2.9).sin() * 0.02 + 1.75];
    let yaw = angle + (t * 0.47).sin() * 0.13 + (t * 3.7).sin() * 0.012 + std::f64::consts::PI;
    let pitch = (t * 0.61 + 0.5).sin() * 0.04 + (t * 4.3).sin() * 0.011 + -0.055;
    let roll = (t * 0.53).sin() * 0.07 + (t * 3.1).cos() * 0.01;
    (position, [yaw, pitch, roll])
}

/// Pose from position and yaw (about z), pitch (up) and roll (about the view axis), radians.
fn pose(position: [Jet; 3], [yaw, pitch, roll]: [Jet; 3]) -> CameraState {
    let (sin_yaw, cos_yaw) = yaw.value.sin_cos();
    let (sin_pitch, cos_pitch) = pitch.value.sin_cos();
    let (sin_roll, cos_roll) = roll.value.sin_cos();
    let forward = DVec3::new(cos_yaw * cos_pitch, sin_yaw * cos_pitch, sin_pitch);
    let level_right = DVec3::new(sin_yaw, -cos_yaw, 0.0);
    let level_down = forward.cross(level_right);
    let right = level_right * cos_roll + level_down * sin_roll;
    let world_from_body = DMat3::from_cols(right, forward.cross(right), forward);
    let rate_world = DVec3::Z * yaw.rate + level_right * pitch.rate + forward * roll.rate;
    CameraState {
        position_m: DVec3::from_array(position.map(|c| c.value)),
        velocity_m_s: DVec3::from_array(position.map(|c| c.rate)),
        acceleration_m_s2: DVec3::from_array(position.map(|c| c.acceleration)),
        world_from_body,
        angular_rate_rad_s: world_from_body.transpose() * rate_world,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Step of the numeric differentiation, seconds.
    const STEP_S: f64 = 5e-4;
    /// Error of the numeric differentiation: step squared times third derivatives, plus rounding over step squared.
    const TOLERANCE: f64 = 5e-6;

    #[test]
    fn at_rest_the_force_is_gravity_upwards() {
        for path in [CameraPath::Fixed, CameraPath::Frozen { at_s: 3.0 }] {
            let state = path.state(12.0);
            let imu = state.imu();
            assert!((imu.specific_force_m_s2.length() - GRAVITY_M_S2).abs() < 1e-12);
            assert_eq!(imu.angular_rate_rad_s, DVec3::ZERO);
            assert_eq!(state, path.state(99.0));
        }
        let force = CameraPath::Fixed.state(0.0).imu().specific_force_m_s2;
        assert!((force - DVec3::new(0.0, -GRAVITY_M_S2, 0.0)).length() < 1e-12, "up is -y: {force}");
    }

    #[test]
    fn imu_agrees_with_numeric_differentiation_of_the_pose() {
        let shaken = CameraPath::Shaken { at_s: 1.0, yaw_rad: 0.05, pitch_rad: 0.04 };
        // Third and fourth derivatives of the shake grow with powers of its frequency.
        let cases = [(CameraPath::Orbit, STEP_S, TOLERANCE), (shaken, 0.1 * STEP_S, 2e-4)];
        for (path, step_s, tolerance) in cases {
            for k in 0..200 {
                let t_s = 0.31 * f64::from(k);
                let [before, now, after] = [-step_s, 0.0, step_s].map(|dt_s| path.state(t_s + dt_s));
                let velocity = (after.position_m - before.position_m) / (2.0 * step_s);
                assert!((velocity - now.velocity_m_s).length() < tolerance);
                let acceleration =
                    (after.position_m - 2.0 * now.position_m + before.position_m) / (step_s * step_s);
                let force = now.world_from_body.transpose() * (acceleration + DVec3::Z * GRAVITY_M_S2);
                let imu = now.imu();
                assert!((force - imu.specific_force_m_s2).length() < tolerance, "{path:?} {t_s}");
                let derivative = (after.world_from_body - before.world_from_body) * (0.5 / step_s);
                let skew = now.world_from_body.transpose() * derivative;
                let rate = DVec3::new(skew.y_axis.z, skew.z_axis.x, skew.x_axis.y);
                assert!((rate - imu.angular_rate_rad_s).length() < tolerance, "{path:?} {t_s}");
            }
        }
    }

    #[test]
    fn rotation_is_proper() {
        let rotation = CameraPath::Orbit.state(5.0).world_from_body;
        assert!((rotation.determinant() - 1.0).abs() < 1e-12);
        assert!((rotation * rotation.transpose() - DMat3::IDENTITY).x_axis.length() < 1e-12);
    }
}
