//! Scenes before an endless wall. Each has one thing that is hard to synthesise from key frames.
//!
//! Sizes and speeds are given in pixels, at 30 frames a second, so that a scene is as hard at any size of image.

use crate::camera::CameraPath;
use crate::cut::Cut;
use crate::object::{Finish, Motion, Object, Shape};
use crate::registry::SceneKind;
use crate::scene::{Lamp, Lighting, Scene};
use crate::texture::{Layer, Profile, Wave};
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// Frames a second that speeds refer to.
const RATE_HZ: f64 = 30.0;

/// Distance of the wall from the camera, metres.
const WALL_M: f64 = 12.0;

/// Width of poles and wires, pixels.
const POLE_PX: f64 = 1.2;

pub(crate) fn scene(kind: SceneKind, width_px: u32, height_px: u32) -> Scene {
    let focal_px = f64::from(width_px).max(f64::from(height_px) * 4.0 / 3.0);
    let place = Place { focal_px, size_px: f64::from(width_px.min(height_px)) };
    // The wall's motion on the screen: right and up, pixels a frame. It is the camera's, backwards.
    let (wall_px, mut objects) = match kind {
        SceneKind::Poles => ([-1.5, 0.2], poles(&place)),
        SceneKind::Foliage => ([-1.7, 0.0], foliage(&place)),
        SceneKind::Propeller => ([0.0, 0.0], vec![propeller(&place)]),
        SceneKind::Bounce => ([-3.5, 0.4], vec![]),
        other => unreachable!("`{}` has no wall here", other.name()),
    };
    let [right, up] = wall_px;
    let velocity_m_s = -place.metres(DVec3::new(right, 0.0, up) * RATE_HZ, WALL_M);
    if kind == SceneKind::Bounce {
        objects.push(ball(&place, velocity_m_s));
    }
    // What a propeller hides and uncovers shows best on a wall of small bright tiles.
    let (side_px, contrast) =
        if kind == SceneKind::Propeller { (9.0, [1.1, 1.0, 0.9]) } else { (17.0, [0.4, 0.35, 0.3]) };
    objects.push(wall(&place, side_px, contrast));
    Scene {
        kind,
        width_px,
        height_px,
        focal_px,
        camera: CameraPath::Track { velocity_m_s },
        objects,
        lighting: Lighting::NONE,
        lamp: Lamp::NONE,
        exposure: 1.0,
        frozen_at_s: None,
    }
}

/// Converts pixels to metres.
struct Place {
    focal_px: f64,
    /// The shorter side of the image.
    size_px: f64,
}

impl Place {
    fn metres(&self, way_px: DVec3, depth_m: f64) -> DVec3 {
        way_px * (depth_m / self.focal_px)
    }

    /// Depth at which what stands still moves `speed` times as fast on the screen as the wall.
    fn nearer(speed: f64) -> f64 {
        WALL_M / speed
    }

    /// A wave of this wavelength, right and up on the screen, on a surface that faces the camera.
    fn wave(&self, [right, up]: [f64; 2], phase_turns: f64, depth_m: f64) -> Wave {
        let per_px = DVec3::new(right, up, 0.0) / (right * right + up * up);
        Wave { frequency: per_px * (self.focal_px / depth_m), phase_turns }
    }

    fn sine(&self, wavelength_px: [f64; 2], phase_turns: f64, depth_m: f64, amplitude: [f64; 3]) -> Layer {
        Layer {
            waves: [self.wave(wavelength_px, phase_turns, depth_m), Wave::ONE],
            profile: Profile::Sine,
            amplitude: DVec3::from_array(amplitude),
        }
    }

    /// A layer of tiles with soft edges.
    fn tiles(&self, side_px: f64, depth_m: f64, amplitude: [f64; 3]) -> Layer {
        let waves = [[2.0 * side_px, 0.3 * side_px], [-0.3 * side_px, 2.0 * side_px]];
        Layer {
            waves: waves.map(|wavelength_px| self.wave(wavelength_px, 0.1, depth_m)),
            profile: Profile::Square { edge_rad: 0.1 },
            amplitude: DVec3::from_array(amplitude),
        }
    }
}

fn wall(place: &Place, side_px: f64, contrast: [f64; 3]) -> Object {
    Object {
        layers: vec![
            place.tiles(side_px, WALL_M, contrast),
            place.sine([51.0, 23.0], 0.3, WALL_M, [0.25, 0.15, 0.3]),
            place.sine([-9.0, 14.0], 0.7, WALL_M, [0.12, 0.14, 0.12]),
            place.sine([7.0, 6.0], 0.2, WALL_M, [0.10, 0.10, 0.12]),
            place.sine([-5.5, 4.0], 0.5, WALL_M, [0.08, 0.08, 0.08]),
        ],
        ..sheet(Cut::Whole, facing(DVec3::Y * WALL_M), [0.62, 0.5, 0.4])
    }
}

/// A row of poles: wavelength on the screen (right and up), speed as a multiple of the wall's, own speed on the screen
/// (right and up), colour.
type PoleRow = ([f64; 2], f64, [f64; 2], [f64; 3]);

/// Rows of poles and wires, from the nearest to the furthest. Those that stand still move on the screen with the
/// camera, the others as instances.
fn poles(place: &Place) -> Vec<Object> {
    let rows: [PoleRow; 5] = [
        ([83.0, 10.0], 8.6, [0.0, 0.0], [0.03, 0.03, 0.04]),
        ([9.0, 71.0], 7.0, [10.5, 7.0], [5.0, 4.6, 4.2]),
        ([61.0, -19.0], 6.0, [0.0, 0.0], [3.5, 3.8, 4.2]),
        ([-47.0, 7.0], 5.0, [14.0, 0.0], [0.04, 0.03, 0.03]),
        ([53.0, 2.0], 3.4, [0.0, 0.0], [0.05, 0.06, 0.05]),
    ];
    let row = |(index, (spacing_px, speed, own_px, rgb)): (usize, PoleRow)| {
        let depth_m = Place::nearer(speed);
        let [right, up] = own_px;
        let motion = Motion {
            velocity: place.metres(DVec3::new(right, 0.0, up) * RATE_HZ, depth_m),
            ..facing(DVec3::Y * depth_m)
        };
        let wave = place.wave(spacing_px, 0.2 * index as f64, depth_m);
        let share = POLE_PX / spacing_px[0].hypot(spacing_px[1]);
        let layers = vec![place.sine([13.0, 29.0], 0.1, depth_m, [0.2, 0.2, 0.2])];
        Object { layers, ..sheet(Cut::Bars { wave, share }, motion, rgb) }
    };
    rows.into_iter().enumerate().map(row).collect()
}

/// Leaves that stand still, behind them sunlit ones on a twig that sways, and more that stand still.
fn foliage(place: &Place) -> Vec<Object> {
    let leaves = |depth_m: f64, turned: f64, level: f64, motion: Motion, rgb: [f64; 3]| {
        let wave = |wavelength_px: [f64; 2], phase_turns: f64| {
            let [right, up] = wavelength_px;
            let (sin, cos) = turned.sin_cos();
            place.wave([cos * right - sin * up, sin * right + cos * up], phase_turns, depth_m)
        };
        let waves =
            [wave([9.0, 3.0], 0.1), wave([-6.0, 8.0], 0.4), wave([3.0, 12.0], 0.7), wave([8.0, -5.0], 0.9)];
        let layers = vec![
            place.sine([11.0, 31.0], 0.2, depth_m, [0.3, 0.25, 0.3]),
            place.sine([-9.0, 6.0], 0.6, depth_m, [0.2, 0.2, 0.2]),
            place.sine([5.0, 7.0], 0.4, depth_m, [0.15, 0.15, 0.15]),
        ];
        Object {
            layers,
            ..sheet(Cut::Leaves { waves, amplitudes: [1.0, 1.0, 0.8, 0.7], level }, motion, rgb)
        }
    };
    let near_m = Place::nearer(8.0 / 1.7);
    let twig_m = Place::nearer(6.0 / 1.7);
    let sway = |way_px: [f64; 2], hz: f64, turns: f64| {
        (place.metres(DVec3::new(way_px[0], 0.0, way_px[1]), twig_m), hz, turns)
    };
    let twig = Motion {
        swings: [sway([9.0, 2.0], 1.3, 0.1), sway([-1.0, 9.0], 1.9, 0.6)],
        ..facing(DVec3::Y * twig_m)
    };
    vec![
        leaves(near_m, 0.0, 1.2, facing(DVec3::Y * near_m), [0.22, 0.28, 0.15]),
        leaves(twig_m, 2.0, 1.3, twig, [1.0, 1.2, 0.6]),
    ]
}

/// A propeller whose axis is turned away from the camera by a sixth of a right angle.
fn propeller(place: &Place) -> Object {
    let depth_m = 0.5 * WALL_M;
    let metres = |share: f64| share * place.size_px * depth_m / place.focal_px;
    let hub = facing(DVec3::new(metres(0.03), depth_m, metres(-0.02)));
    let lean = DMat3::from_rotation_z(TAU / 24.0);
    let orientation = lean * hub.orientation;
    let motion =
        Motion { orientation, spin_axis: orientation.z_axis, spin_hz: 18.0 / 360.0 * RATE_HZ, ..hub };
    let cut = Cut::Blades { half_width_m: metres(0.12), length_m: metres(0.7), hub_m: metres(0.1) };
    Object {
        layers: vec![
            place.sine([23.0, 9.0], 0.1, depth_m, [0.45, 0.4, 0.35]),
            place.sine([-8.0, 12.0], 0.4, depth_m, [0.4, 0.4, 0.4]),
        ],
        ..sheet(cut, motion, [0.42, 0.34, 0.3])
    }
}

/// A ball that keeps up with the camera. Its spin is that of the wall's motion, so that nothing but the bounce sets it
/// apart from a plain turning solid.
fn ball(place: &Place, velocity_m_s: DVec3) -> Object {
    let depth_m = 0.4 * WALL_M;
    let metres = |px: f64| px * depth_m / place.focal_px;
    let radius_m = metres(0.24 * place.size_px);
    let motion = Motion {
        velocity: velocity_m_s,
        swings: [(DVec3::X * metres(0.25 * place.size_px), 0.6, 0.1), (DVec3::ZERO, 0.0, 0.0)],
        bounce: (DVec3::Z * metres(BOUNCE_PX), BOUNCE_HZ, 0.4),
        spin_axis: DVec3::new(0.3, 1.0, 0.2).normalize(),
        spin_hz: 0.9,
        ..facing(DVec3::new(0.0, depth_m, metres(-0.05 * place.size_px)))
    };
    let wave = |turns: [f64; 3], phase_turns: f64| Wave {
        frequency: DVec3::from_array(turns) / radius_m,
        phase_turns,
    };
    let layer = |turns: [f64; 3], phase_turns: f64, profile: Profile, amplitude: [f64; 3]| Layer {
        waves: [wave(turns, phase_turns), Wave::ONE],
        profile,
        amplitude: DVec3::from_array(amplitude),
    };
    Object {
        layers: vec![
            layer([0.3, 0.9, 0.1], 0.1, Profile::Square { edge_rad: 0.1 }, [0.5, 0.45, 0.3]),
            layer([1.3, -0.4, 0.9], 0.3, Profile::Sine, [0.3, 0.25, 0.3]),
            layer([-0.8, 0.6, 1.7], 0.7, Profile::Sine, [0.2, 0.2, 0.2]),
        ],
        finish: Finish::GLOWING,
        ..object(Shape::Sphere { radius_m }, motion, [1.4, 0.5, 0.2])
    }
}

/// Height of the ball's bounce, pixels: with [`BOUNCE_HZ`], 18 px a frame at the bounce.
const BOUNCE_PX: f64 = 12.0;

/// Bounces a second. Frames are not a multiple of them, so each bounce comes at another time of its interval.
const BOUNCE_HZ: f64 = 11.0;

/// At rest at `centre`, x right and y up for a camera that looks along world y.
fn facing(centre: DVec3) -> Motion {
    Motion { orientation: DMat3::from_cols(DVec3::X, DVec3::Z, -DVec3::Y), ..Motion::still(centre) }
}

fn sheet(cut: Cut, motion: Motion, rgb: [f64; 3]) -> Object {
    object(Shape::Sheet { cut }, motion, rgb)
}

fn object(shape: Shape, motion: Motion, rgb: [f64; 3]) -> Object {
    Object { finish: Finish::GLOWING, ..Object::plain(shape, motion, rgb) }
}
