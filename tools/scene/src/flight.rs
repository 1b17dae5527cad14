//! The flight scene: solids over tiled ground between hills at sunset, seen by an orbiting camera.

use crate::camera::CameraPath;
use crate::object::{Finish, Motion, Object, Shape};
use crate::registry::SceneKind;
use crate::scene::{Lamp, Lighting, Scene};
use crate::texture::{Layer, Profile, Wave};
use glam::{DMat3, DVec3};

/// Exposure of the `dark` scene.
const DARK_EXPOSURE: f64 = 1e-2;

/// Time at which the clock of the `still` scene is stopped, seconds.
const STILL_AT_S: f64 = 1.0;

/// Time of the pose about which the camera of the `shake` scene shakes, seconds.
const SHAKE_AT_S: f64 = 1.0;

/// Amplitude of that shake at the image's centre: right and down, pixels.
const SHAKE_PX: [f64; 2] = [9.0, 6.0];

/// Limit to it, radians, for images of a few pixels.
const SHAKE_MOST_RAD: f64 = 0.2;

/// Width of the sharpest tile edges, radians of phase.
const EDGE_RAD: f64 = 0.04;

pub(crate) fn scene(kind: SceneKind, width_px: u32, height_px: u32) -> Scene {
    let frozen_at_s = (kind == SceneKind::Still).then_some(STILL_AT_S);
    let focal_px = 0.8 * f64::from(width_px).max(f64::from(height_px) * 4.0 / 3.0);
    let camera = match kind {
        SceneKind::Still => CameraPath::Frozen { at_s: STILL_AT_S },
        SceneKind::Shake => CameraPath::Shaken {
            at_s: SHAKE_AT_S,
            yaw_rad: (SHAKE_PX[0] / focal_px).min(SHAKE_MOST_RAD),
            pitch_rad: (SHAKE_PX[1] / focal_px).min(SHAKE_MOST_RAD),
        },
        SceneKind::Flight | SceneKind::Dark => CameraPath::Orbit,
        other => unreachable!("`{}` has no camera here", other.name()),
    };
    let mut objects = spheres();
    objects.extend(panels());
    objects.push(ground());
    objects.extend(hills());
    objects.push(sky());
    Scene {
        kind,
        width_px,
        height_px,
        focal_px,
        camera,
        objects,
        lighting: lighting(focal_px),
        lamp: Lamp::NONE,
        exposure: if kind == SceneKind::Dark { DARK_EXPOSURE } else { 1.0 },
        frozen_at_s,
    }
}

fn lighting(focal_px: f64) -> Lighting {
    let disc_sharpness: f64 = 2500.0;
    Lighting {
        sun_direction: DVec3::new(0.62, 0.70, 0.33).normalize(),
        sun_rgb: DVec3::new(4.6, 2.9, 1.45),
        sky_rgb: DVec3::new(0.22, 0.33, 0.62),
        ground_rgb: DVec3::new(0.20, 0.13, 0.09),
        halo_rgb: DVec3::new(1.6, 0.85, 0.32),
        halo_sharpness: 9.0,
        disc_rgb: DVec3::new(420.0, 330.0, 220.0),
        disc_sharpness: 1.0 / (1.0 / disc_sharpness + 4.0 / (focal_px * focal_px)),
        haze_rgb: DVec3::new(0.60, 0.46, 0.44),
        haze_m: 120.0,
        lamp_rgb: DVec3::new(16.0, 6.0, 1.6),
        lamp_object: 0,
    }
}

fn spheres() -> Vec<Object> {
    let bands = |per_turn: f64, amplitude: [f64; 3]| square([0.0, 0.0, per_turn], 0.11, amplitude);
    vec![
        Object {
            layers: vec![
                sine([1.9, 1.1, -0.7], 0.2, [0.22, 0.30, 0.42]),
                sine([-1.2, 2.3, 1.6], 0.6, [0.16, 0.22, 0.3]),
            ],
            finish: Finish::GLOWING,
            ..sphere(
                0.42,
                Motion {
                    swings: [
                        (DVec3::new(1.15, 0.0, 0.22), 0.21, 0.05),
                        (DVec3::new(0.0, 1.15, 0.12), 0.21, 0.30),
                    ],
                    ..spinning(DVec3::new(0.35, -0.55, 2.35), DVec3::new(0.3, 0.2, 1.0), 0.25)
                },
                [46.0, 21.0, 6.5],
            )
        },
        Object {
            layers: vec![
                bands(1.05, [0.62, 0.16, -0.5]),
                square([0.8, 0.15, 0.0], 0.3, [0.25, -0.3, 0.2]),
                sine([2.1, 3.0, 1.3], 0.0, [0.14, 0.14, 0.14]),
                sine([-4.4, 3.1, 5.2], 0.4, [0.12, 0.12, 0.12]),
                sine([9.0, -7.0, 6.0], 0.9, [0.1, 0.1, 0.1]),
            ],
            finish: Finish::glossy(0.6, 90.0),
            ..sphere(
                1.12,
                spinning(DVec3::new(-0.35, 0.25, 1.22), DVec3::new(0.25, 0.1, 1.0), 0.14),
                [0.62, 0.22, 0.13],
            )
        },
        Object {
            layers: vec![
                product([1.3, 0.0, 0.4], [0.0, 1.3, -0.3], [0.5, 0.42, -0.1]),
                sine([3.3, -2.2, 4.1], 0.3, [0.1, 0.1, 0.1]),
                sine([8.1, 5.7, -6.3], 0.6, [0.1, 0.1, 0.12]),
            ],
            finish: Finish::glossy(0.45, 70.0),
            ..sphere(
                0.72,
                Motion {
                    swings: [(DVec3::new(0.0, 0.0, 0.28), 0.33, 0.0), (DVec3::ZERO, 0.0, 0.0)],
                    ..spinning(DVec3::new(2.35, -1.35, 1.15), DVec3::new(-0.4, 1.0, 0.3), 0.24)
                },
                [0.04, 0.38, 0.50],
            )
        },
        Object {
            layers: vec![
                bands(2.1, [0.0, 0.5, 0.62]),
                sine([5.5, 1.0, 2.5], 0.1, [0.12, 0.1, 0.08]),
                sine([-3.0, 9.5, 4.0], 0.5, [0.1, 0.1, 0.1]),
            ],
            finish: Finish::glossy(0.9, 140.0),
            ..sphere(
                0.52,
                Motion {
                    swings: [(DVec3::new(0.5, 0.35, 0.0), 0.27, 0.2), (DVec3::new(0.0, 0.0, 0.2), 0.6, 0.0)],
                    ..spinning(DVec3::new(-2.5, -1.75, 0.95), DVec3::new(1.0, 0.3, 0.2), 0.45)
                },
                [0.70, 0.22, 0.55],
            )
        },
        Object {
            layers: vec![
                product([1.6, 0.5, 0.0], [-0.5, 1.6, 0.6], [0.75, 0.7, 0.6]),
                sine([6.1, -5.0, 4.4], 0.2, [0.1, 0.1, 0.1]),
            ],
            finish: Finish::glossy(0.3, 60.0),
            ..sphere(
                0.6,
                Motion {
                    swings: [(DVec3::new(-0.3, 0.3, 0.0), 0.19, 0.0), (DVec3::ZERO, 0.0, 0.0)],
                    ..spinning(DVec3::new(1.35, 2.6, 0.8), DVec3::new(0.0, 0.6, 1.0), -0.33)
                },
                [0.55, 0.53, 0.5],
            )
        },
        Object {
            layers: vec![bands(3.2, [0.45, 0.3, -0.4]), sine([7.0, 7.0, -5.0], 0.2, [0.12, 0.12, 0.1])],
            finish: Finish::glossy(0.6, 80.0),
            ..sphere(
                0.3,
                Motion {
                    swings: [
                        (DVec3::new(1.75, 0.0, 0.35), 0.31, 0.0),
                        (DVec3::new(0.0, 1.75, 0.0), 0.31, 0.25),
                    ],
                    ..spinning(DVec3::new(-0.35, 0.25, 1.05), DVec3::new(0.7, 0.7, 0.4), 0.7)
                },
                [0.85, 0.55, 0.04],
            )
        },
        Object {
            layers: vec![
                bands(0.55, [-0.35, 0.2, 0.5]),
                product([0.5, 0.0, 0.5], [0.0, 0.6, 0.0], [0.2, 0.2, 0.2]),
            ],
            ..sphere(
                2.3,
                spinning(DVec3::new(-11.5, 9.5, 3.4), DVec3::new(0.3, 0.0, 1.0), 0.05),
                [0.5, 0.35, 0.3],
            )
        },
    ]
}

fn panels() -> Vec<Object> {
    let plaster = [
        sine([2.6, 1.1, 0.0], 0.0, [0.1, 0.1, 0.1]),
        sine([-4.9, 6.3, 0.0], 0.3, [0.09, 0.09, 0.09]),
        sine([13.0, 9.0, 0.0], 0.7, [0.1, 0.1, 0.1]),
    ];
    let with_plaster = |layer: Layer, second: Layer| {
        let mut layers = vec![layer, second];
        layers.extend(plaster);
        layers
    };
    vec![
        Object {
            layers: with_plaster(
                square([0.42, 0.42, 0.0], 0.0, [0.25, -0.55, -0.75]),
                sine([0.15, -0.1, 0.0], 0.2, [0.2, 0.1, 0.3]),
            ),
            ..panel([-3.1, 1.9], 25.0, [0.95, 1.35], [0.62, 0.34, 0.14])
        },
        Object {
            layers: with_plaster(
                product([0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [-0.85, 0.15, 0.55]),
                sine([0.1, 0.2, 0.0], 0.6, [0.1, 0.3, 0.1]),
            ),
            ..panel([3.6, 1.6], -62.0, [0.85, 1.05], [0.22, 0.40, 0.55])
        },
        Object {
            layers: with_plaster(
                square([0.0, 0.95, 0.0], 0.25, [0.75, 0.55, 0.2]),
                square([0.33, 0.0, 0.0], 0.1, [0.1, 0.2, 0.35]),
            ),
            ..panel([0.6, -3.3], 8.0, [1.0, 0.6], [0.34, 0.18, 0.10])
        },
        Object {
            layers: with_plaster(
                product([0.28, 0.0, 0.0], [0.0, 0.28, 0.0], [0.55, 0.45, -0.3]),
                square([0.75, 0.0, 0.0], 0.4, [0.2, 0.05, 0.25]),
            ),
            ..panel([-1.5, 13.5], 12.0, [5.2, 2.3], [0.40, 0.16, 0.36])
        },
        Object {
            layers: with_plaster(
                square([0.3, 0.3, 0.0], 0.4, [0.35, 0.5, -0.3]),
                square([0.0, 0.65, 0.0], 0.2, [0.1, 0.1, 0.3]),
            ),
            ..panel([13.0, -2.5], -74.0, [4.4, 2.7], [0.10, 0.40, 0.30])
        },
        Object {
            layers: with_plaster(
                product([0.22, 0.05, 0.0], [-0.05, 0.22, 0.0], [-0.2, 0.25, 0.5]),
                square([0.5, 0.0, 0.0], 0.15, [0.3, 0.15, 0.0]),
            ),
            ..panel([2.5, -14.0], 171.0, [5.5, 1.9], [0.5, 0.42, 0.3])
        },
        Object {
            layers: with_plaster(
                square([0.36, 0.0, 0.0], 0.4, [0.35, 0.1, 0.0]),
                product([0.0, 0.4, 0.0], [0.8, 0.0, 0.0], [0.15, 0.15, 0.3]),
            ),
            ..panel([-13.5, -4.0], 68.0, [3.6, 3.1], [0.42, 0.2, 0.16])
        },
    ]
}

fn ground() -> Object {
    Object {
        layers: vec![
            product([0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.62, 0.52, 0.36]),
            sine([0.031, 0.045, 0.0], 0.1, [0.22, 0.05, -0.18]),
            sine([-0.14, 0.09, 0.0], 0.5, [-0.12, 0.08, 0.1]),
            sine([1.37, 0.83, 0.0], 0.2, [0.1, 0.1, 0.1]),
            sine([-2.2, 3.1, 0.0], 0.8, [0.12, 0.12, 0.11]),
            sine([5.3, 4.1, 0.0], 0.4, [0.10, 0.10, 0.10]),
            sine([8.9, -6.1, 0.0], 0.6, [0.09, 0.09, 0.09]),
            sine([-9.7, 15.9, 0.0], 0.0, [0.12, 0.12, 0.12]),
        ],
        ..Object::plain(Shape::Ground, Motion::still(DVec3::ZERO), [0.30, 0.26, 0.23])
    }
}

fn hills() -> [Object; 2] {
    let wave = |x: f64, y: f64, phase_turns: f64| Wave { frequency: DVec3::new(x, y, 0.0), phase_turns };
    let near = Shape::Ridge {
        elevation: 0.030,
        waves: [wave(0.7, 0.4, 0.1), wave(-1.6, 1.9, 0.4), wave(4.1, 3.3, 0.7), wave(-9.0, 7.5, 0.2)],
        amplitudes: [0.022, 0.016, 0.007, 0.003],
    };
    let far = Shape::Ridge {
        elevation: 0.085,
        waves: [wave(0.5, -0.8, 0.3), wave(1.4, 1.6, 0.9), wave(-3.4, 4.6, 0.2), wave(8.5, 6.5, 0.6)],
        amplitudes: [0.035, 0.024, 0.012, 0.005],
    };
    let texture = [
        sine([14.0, -9.0, 30.0], 0.1, [0.1, 0.1, 0.09]),
        sine([-23.0, 17.0, 41.0], 0.5, [0.09, 0.09, 0.08]),
        sine([6.0, 11.0, 15.0], 0.3, [0.1, 0.08, 0.06]),
    ];
    [(near, [0.10, 0.11, 0.17]), (far, [0.30, 0.22, 0.29])].map(|(shape, rgb)| Object {
        layers: texture.to_vec(),
        finish: Finish::GLOWING,
        ..Object::plain(shape, Motion::still(DVec3::ZERO), rgb)
    })
}

fn sky() -> Object {
    Object {
        gradient_log: DVec3::new(-2.9, -1.9, -0.75),
        layers: vec![
            sine([0.9, 1.6, 5.0], 0.2, [0.16, 0.12, 0.07]),
            sine([2.3, -1.1, 11.0], 0.55, [0.14, 0.11, 0.07]),
            sine([-4.7, 3.9, 19.0], 0.8, [0.09, 0.08, 0.05]),
            sine([8.3, 6.1, 27.0], 0.35, [0.06, 0.05, 0.03]),
        ],
        finish: Finish::GLOWING,
        ..Object::plain(Shape::Sky, Motion::still(DVec3::ZERO), [0.92, 0.62, 0.52])
    }
}

fn sphere(radius_m: f64, motion: Motion, rgb: [f64; 3]) -> Object {
    Object::plain(Shape::Sphere { radius_m }, motion, rgb)
}

/// A panel standing on the ground, turned about the vertical.
fn panel([x, y]: [f64; 2], turned_degrees: f64, half_m: [f64; 2], rgb: [f64; 3]) -> Object {
    let upright = DMat3::from_cols(DVec3::X, DVec3::Z, -DVec3::Y);
    let motion = Motion {
        orientation: DMat3::from_rotation_z(turned_degrees.to_radians()) * upright,
        ..Motion::still(DVec3::new(x, y, half_m[1] + 0.04))
    };
    Object::plain(Shape::Panel { half_m }, motion, rgb)
}

fn spinning(centre: DVec3, axis: DVec3, spin_hz: f64) -> Motion {
    let spin_axis = axis.normalize();
    let orientation = DMat3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, spin_axis));
    // The texture's axis is tilted against the axis of rotation, so that bands wobble.
    let lean = DMat3::from_rotation_x(0.35);
    Motion { orientation: orientation * lean, spin_axis, spin_hz, ..Motion::still(centre) }
}

fn wave(frequency: [f64; 3], phase_turns: f64) -> Wave {
    Wave { frequency: DVec3::from_array(frequency), phase_turns }
}

fn sine(frequency: [f64; 3], phase_turns: f64, amplitude: [f64; 3]) -> Layer {
    Layer {
        waves: [wave(frequency, phase_turns), Wave::ONE],
        profile: Profile::Sine,
        amplitude: DVec3::from_array(amplitude),
    }
}

fn square(frequency: [f64; 3], phase_turns: f64, amplitude: [f64; 3]) -> Layer {
    Layer { profile: Profile::Square { edge_rad: EDGE_RAD }, ..sine(frequency, phase_turns, amplitude) }
}

/// A layer of tiles: the product of two square waves.
fn product(first: [f64; 3], second: [f64; 3], amplitude: [f64; 3]) -> Layer {
    Layer { waves: [wave(first, 0.0), wave(second, 0.0)], ..square(first, 0.0, amplitude) }
}
