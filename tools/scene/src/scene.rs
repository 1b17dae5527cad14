//! A scene: objects, light and camera as functions of time.

use crate::camera::{CameraPath, CameraState};
use crate::object::{Object, Shape};
use crate::registry::SceneKind;
use crate::texture::{Layer, Wave};
use crate::view::{View, ViewLight, ViewObject, ViewShape, borders, horizon};
use glam::{DMat3, DVec3};

/// Light of a world scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting {
    /// Unit vector towards the sun, world axes.
    pub sun_direction: DVec3,
    /// Light of the sun.
    pub sun_rgb: DVec3,
    /// Ambient light from above.
    pub sky_rgb: DVec3,
    /// Ambient light from below.
    pub ground_rgb: DVec3,
    /// Glow around the sun.
    pub halo_rgb: DVec3,
    /// Sharpness of the glow: `exp(-sharpness (1 - cos angle))`.
    pub halo_sharpness: f64,
    /// Radiance of the sun's disc.
    pub disc_rgb: DVec3,
    /// Sharpness of the disc, as for the glow.
    pub disc_sharpness: f64,
    /// Colour of the haze.
    pub haze_rgb: DVec3,
    /// Distance after which the haze leaves 1/e of the light, metres.
    pub haze_m: f64,
    /// Light of the lamp at a distance of one metre.
    pub lamp_rgb: DVec3,
    /// Index of the object that is the lamp.
    pub lamp_object: usize,
}

/// A lamp that lights a card and blinks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Centre of its spot, pixels from the image's centre (z unused).
    pub centre_px: DVec3,
    /// Size of the spot, pixels.
    pub radius_px: f64,
    /// Factor added to the card's radiance at the centre when lit.
    pub rgb: DVec3,
    /// Blinks per second.
    pub rate_hz: f64,
    /// Steepness of switching on and off: larger is more abrupt.
    pub steepness: f64,
}

/// An analytic scene of a certain image size.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Which scene.
    pub kind: SceneKind,
    /// Image width, pixels.
    pub width_px: u32,
    /// Image height, pixels.
    pub height_px: u32,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// The camera's path.
    pub camera: CameraPath,
    /// Objects.
    pub objects: Vec<Object>,
    /// Light of the world.
    pub lighting: Lighting,
    /// Lamp of a card.
    pub lamp: Lamp,
    /// Factor of all radiance.
    pub exposure: f64,
    /// Time at which the scene's clock is stopped, seconds, if it is.
    pub frozen_at_s: Option<f64>,
}

impl Lighting {
    /// No light.
    pub const NONE: Lighting = Lighting {
        sun_direction: DVec3::Z,
        sun_rgb: DVec3::ZERO,
        sky_rgb: DVec3::ZERO,
        ground_rgb: DVec3::ZERO,
        halo_rgb: DVec3::ZERO,
        halo_sharpness: 1.0,
        disc_rgb: DVec3::ZERO,
        disc_sharpness: 1.0,
        haze_rgb: DVec3::ZERO,
        haze_m: 1.0,
        lamp_rgb: DVec3::ZERO,
        lamp_object: 0,
    };
}

impl Lamp {
    /// No lamp.
    pub const NONE: Lamp =
        Lamp { centre_px: DVec3::ZERO, radius_px: 1.0, rgb: DVec3::ZERO, rate_hz: 0.0, steepness: 1.0 };

    /// Brightness of the lamp at `t_s` seconds, 0 to 1.
    #[must_use]
    pub fn level(&self, t_s: f64) -> f64 {
        0.5 + 0.5 * (self.steepness * crate::texture::sin_turns(self.rate_hz * t_s)).tanh()
    }
}

/// Converts nanoseconds to seconds.
#[must_use]
pub fn seconds(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}

impl Scene {
    /// Linear R, G, B at a pixel (centres at whole numbers, y down) and time in seconds.
    #[must_use]
    pub fn radiance(&self, x_px: f64, y_px: f64, t_s: f64) -> [f64; 3] {
        self.view(t_s).radiance(x_px, y_px)
    }

    /// Position at `previous_t_s` less the position at `t_s` of the surface point that a pixel sees
    /// at `t_s`, pixels, y down.
    #[must_use]
    pub fn motion(&self, x_px: f64, y_px: f64, t_s: f64, previous_t_s: f64) -> [f64; 2] {
        let view = self.view(t_s);
        view.motion(&view.sample(x_px, y_px), &self.view(previous_t_s))
    }

    /// Distance along the view axis, metres; infinite for hills and sky.
    #[must_use]
    pub fn depth_m(&self, x_px: f64, y_px: f64, t_s: f64) -> f64 {
        self.view(t_s).sample(x_px, y_px).depth_m
    }

    /// The scene's own time.
    pub(crate) fn clock_s(&self, t_s: f64) -> f64 {
        self.frozen_at_s.unwrap_or(t_s)
    }

    /// Instance id of object `index`: 0 if it stands still in the world, else one more than its index.
    #[must_use]
    pub fn instance(&self, index: usize) -> u32 {
        if self.frozen_at_s.is_some() || self.objects[index].motion.is_still() { 0 } else { index as u32 + 1 }
    }

    /// The camera's pose and its derivatives at a time.
    #[must_use]
    pub fn camera_state(&self, t_s: f64) -> CameraState {
        self.camera.state(t_s)
    }

    /// The scene in camera axes at a time. Computing many pixels of one instant from one view saves work.
    #[must_use]
    pub fn view(&self, t_s: f64) -> View {
        let t_s = self.clock_s(t_s);
        let state = self.camera.state(t_s);
        let to_camera = state.world_from_body.transpose();
        let card = matches!(self.kind.family(), crate::registry::Family::Card);
        let to_camera = if card { DMat3::IDENTITY } else { to_camera };
        let camera_m = if card { DVec3::ZERO } else { state.position_m };
        let mut objects: Vec<ViewObject> = self
            .objects
            .iter()
            .enumerate()
            .map(|(id, object)| {
                let instance = self.instance(id);
                view_object((id, instance), object, t_s, to_camera, camera_m, self.focal_px)
            })
            .collect();
        let lamp_m = objects.get(self.lighting.lamp_object).map_or(DVec3::ZERO, |lamp| lamp.origin);
        let solids = objects
            .iter()
            .filter(|o| matches!(o.shape, ViewShape::Sphere { .. } | ViewShape::Panel { .. }))
            .count();
        crate::order::front_to_back(&mut objects[..solids]);
        View {
            width_px: self.width_px,
            height_px: self.height_px,
            focal_px: self.focal_px,
            objects,
            solids,
            light: ViewLight {
                up: to_camera * DVec3::Z,
                sun_direction: to_camera * self.lighting.sun_direction,
                lamp_m,
                lighting: self.lighting,
                card_lamp: self.lamp,
                card_lamp_level: self.lamp.level(t_s),
                exposure: self.exposure,
            },
        }
    }
}

fn view_object(
    (id, instance): (usize, u32),
    object: &Object,
    t_s: f64,
    to_camera: DMat3,
    camera_m: DVec3,
    focal_px: f64,
) -> ViewObject {
    let at_infinity = matches!(object.shape, Shape::Ridge { .. } | Shape::Sky);
    let (position, turn) = object.motion.pose(t_s);
    let rotation = to_camera * turn;
    let origin = if at_infinity { DVec3::ZERO } else { to_camera * (position - camera_m) };
    // The side of a flat object that is seen.
    let toward = if rotation.z_axis.dot(origin) < 0.0 { 1.0 } else { -1.0 };
    let normal = rotation.z_axis * toward;
    let shape = match object.shape {
        Shape::Sphere { radius_m } => ViewShape::Sphere { radius_m },
        Shape::Sheet { cut } => ViewShape::Sheet {
            normal,
            offset_m: normal.dot(origin),
            cut: cut.with_waves(|wave| turned_wave(wave, rotation, origin)),
        },
        Shape::Panel { half_m } => {
            let axes = [rotation.x_axis, rotation.y_axis];
            ViewShape::Panel {
                normal,
                offset_m: normal.dot(origin),
                axes,
                half_m,
                borders: borders(origin, axes, half_m, focal_px),
            }
        }
        Shape::Ground => {
            ViewShape::Ground { height_m: camera_m.z, horizon: horizon(to_camera * DVec3::Z, focal_px) }
        }
        Shape::Ridge { elevation, waves, amplitudes } => {
            ViewShape::Ridge { elevation, waves: waves.map(|w| turned_wave(w, rotation, origin)), amplitudes }
        }
        Shape::Sky => ViewShape::Sky,
        Shape::Card => ViewShape::Card,
    };
    ViewObject {
        id,
        instance,
        shape,
        origin,
        rotation,
        base_log: object.base_log,
        gradient_log: object.gradient_log,
        layers: object
            .layers
            .iter()
            .map(|layer| Layer { waves: layer.waves.map(|w| turned_wave(w, rotation, origin)), ..*layer })
            .collect(),
        finish: object.finish,
    }
}

/// Converts a wave from an object's axes to camera axes, and reduces its phase to -0.5 to 0.5 turns.
fn turned_wave(wave: Wave, rotation: DMat3, origin: DVec3) -> Wave {
    let frequency = rotation * wave.frequency;
    let phase = wave.phase_turns - frequency.dot(origin);
    Wave { frequency, phase_turns: phase - phase.round() }
}
