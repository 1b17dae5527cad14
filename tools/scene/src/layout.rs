//! The view in the shader's memory layout. The structs match those of `glsl/render.comp` field for field.

use crate::cut::Cut;
use crate::object::MAX_LAYERS as LAYERS_PER_OBJECT;
use crate::texture::{Layer, Profile, Wave};
use crate::view::{View, ViewObject, ViewShape};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Largest number of objects in the shader's buffer.
pub const MAX_OBJECTS: usize = 24;

/// Largest number of layers in the shader's buffer.
pub const MAX_LAYERS: usize = MAX_OBJECTS * LAYERS_PER_OBJECT;

/// Bit of `formats[2]`: motion is written.
pub const WRITES_MOTION: u32 = 1;

/// Bit of `formats[2]`: depth is written.
pub const WRITES_DEPTH: u32 = 2;

/// Bit of `formats[2]`: instance ids are written.
pub const WRITES_IDS: u32 = 4;

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct LayerData {
    waves: [[f32; 4]; 2],
    amplitude: [f32; 4],
}

#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct ObjectData {
    kind: [u32; 4],
    origin: [f32; 4],
    normal: [f32; 4],
    axes: [[f32; 4]; 2],
    borders: [[f32; 4]; 4],
    heights: [f32; 4],
    base: [f32; 4],
    gradient: [f32; 4],
    finish: [f32; 4],
    gloss: [f32; 4],
    delta: [[f32; 4]; 3],
}

/// The shader's input for one frame.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ViewData {
    size: [u32; 4],
    formats: [u32; 4],
    camera: [f32; 4],
    up: [f32; 4],
    sun_direction: [f32; 4],
    lamp_m: [f32; 4],
    sun_rgb: [f32; 4],
    sky_rgb: [f32; 4],
    ground_rgb: [f32; 4],
    halo: [f32; 4],
    disc: [f32; 4],
    haze: [f32; 4],
    lamp_rgb: [f32; 4],
    card_lamp: [f32; 4],
    card_rgb: [f32; 4],
    objects: [ObjectData; MAX_OBJECTS],
    layers: [LayerData; MAX_LAYERS],
}

const _: () = assert!(size_of::<LayerData>() == 48 && size_of::<ObjectData>() == 272);
const _: () = assert!(size_of::<ViewData>() == 15 * 16 + MAX_OBJECTS * 272 + MAX_LAYERS * 48);

impl ViewData {
    /// Fills the struct from a view, with motion towards `previous`. `formats` are those that the shader reads.
    pub fn fill(&mut self, view: &View, previous: Option<&View>, formats: [u32; 3]) {
        let light = &view.light;
        let lighting = &light.lighting;
        let [hdr, motion, writes] = formats;
        self.size = [view.width_px, view.height_px, view.objects.len() as u32, view.solids as u32];
        self.formats = [hdr, motion, writes, 0];
        self.camera = [
            view.focal_px as f32,
            (1.0 / view.focal_px) as f32,
            (0.5 * f64::from(view.width_px - 1)) as f32,
            (0.5 * f64::from(view.height_px - 1)) as f32,
        ];
        self.up = vec4(light.up, 0.0);
        self.sun_direction = vec4(light.sun_direction, 0.0);
        self.lamp_m = vec4(light.lamp_m, 0.0);
        self.sun_rgb = vec4(lighting.sun_rgb, 0.0);
        self.sky_rgb = vec4(lighting.sky_rgb, 0.0);
        self.ground_rgb = vec4(lighting.ground_rgb, 0.0);
        self.halo = vec4(lighting.halo_rgb, lighting.halo_sharpness);
        self.disc = vec4(lighting.disc_rgb, lighting.disc_sharpness);
        self.haze = vec4(lighting.haze_rgb, 1.0 / lighting.haze_m);
        self.lamp_rgb = vec4(lighting.lamp_rgb, 0.0);
        let lamp = &light.card_lamp;
        let per_radius2 = 1.0 / (lamp.radius_px * lamp.radius_px);
        self.card_lamp =
            [lamp.centre_px.x, lamp.centre_px.y, per_radius2, light.card_lamp_level].map(|v| v as f32);
        self.card_rgb = vec4(lamp.rgb, light.exposure);
        let mut layers = 0;
        for (index, object) in view.objects.iter().enumerate() {
            self.objects[index] = object_data(view, index, object, previous, layers);
            for layer in &object.layers {
                self.layers[layers] = layer_data(layer);
                layers += 1;
            }
        }
    }
}

fn object_data(
    view: &View,
    index: usize,
    object: &ViewObject,
    previous: Option<&View>,
    first_layer: usize,
) -> ObjectData {
    let mut data = ObjectData::zeroed();
    let (shape, size) = match object.shape {
        ViewShape::Sphere { radius_m } => (0, radius_m),
        ViewShape::Panel { normal, offset_m, axes, half_m, borders } => {
            data.normal = vec4(normal, 0.0);
            data.axes = [vec4(axes[0], half_m[0]), vec4(axes[1], half_m[1])];
            data.borders = borders.map(|b| vec4(b, 0.0));
            (1, offset_m)
        }
        ViewShape::Sheet { normal, offset_m, cut } => {
            data.normal = vec4(normal, 0.0);
            (sheet_data(&mut data, object, cut), offset_m)
        }
        ViewShape::Ground { height_m, horizon } => {
            data.borders[0] = vec4(horizon, 0.0);
            (2, height_m)
        }
        ViewShape::Ridge { elevation, waves, amplitudes } => {
            data.borders = waves.map(wave_data);
            data.heights = amplitudes.map(|a| a as f32);
            (3, elevation)
        }
        ViewShape::Sky => (4, 0.0),
        ViewShape::Card => (5, 0.0),
    };
    data.kind = [shape, first_layer as u32, object.layers.len() as u32, object.instance];
    data.origin = vec4(object.origin, size);
    data.base = vec4(object.base_log, 0.0);
    data.gradient = vec4(object.gradient_log, 0.0);
    let finish = &object.finish;
    data.finish = [finish.ambient, finish.sun, finish.lamp, finish.emission].map(|v| v as f32);
    data.gloss = [finish.haze, finish.gloss, finish.gloss_sharpness, 0.0].map(|v| v as f32);
    if let Some(previous) = previous {
        let displacement = view.displacement(index, previous);
        let rows = displacement.matrix_minus_one.transpose();
        let shift = displacement.shift;
        data.delta = [vec4(rows.x_axis, shift.x), vec4(rows.y_axis, shift.y), vec4(rows.z_axis, shift.z)];
    }
    data
}

/// Fills in what a sheet's form needs and returns its number in the shader.
fn sheet_data(data: &mut ObjectData, object: &ViewObject, cut: Cut) -> u32 {
    match cut {
        Cut::Whole => 6,
        Cut::Bars { wave, share } => {
            data.borders[0] = wave_data(wave);
            data.heights[0] = share as f32;
            7
        }
        Cut::Leaves { waves, amplitudes, level } => {
            data.borders = waves.map(wave_data);
            data.heights = amplitudes.map(|a| a as f32);
            data.normal[3] = level as f32;
            8
        }
        Cut::Blades { half_width_m, length_m, hub_m } => {
            data.axes = [vec4(object.rotation.x_axis, half_width_m), vec4(object.rotation.y_axis, length_m)];
            data.normal[3] = hub_m as f32;
            9
        }
    }
}

fn layer_data(layer: &Layer) -> LayerData {
    let edge_rad = match layer.profile {
        Profile::Sine => -1.0,
        Profile::Square { edge_rad } => edge_rad,
    };
    LayerData { waves: layer.waves.map(wave_data), amplitude: vec4(layer.amplitude, edge_rad) }
}

fn wave_data(wave: Wave) -> [f32; 4] {
    vec4(wave.frequency, wave.phase_turns)
}

fn vec4(v: DVec3, w: f64) -> [f32; 4] {
    [v.x as f32, v.y as f32, v.z as f32, w as f32]
}
