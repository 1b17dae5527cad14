//! The rig file of `esaac serve`: cameras, image formats and rings.

use crate::pixel_notes;
use crate::scene_light::{SCENE_LIGHT, SceneLight};
use crate::sensor_base::with_changes;
use crate::sensor_flags::sensor_file;
use crate::unread_flags::{of_file, why_unread};
use anyhow::{Context, Result, ensure};
use esaac_engine::{CameraConfig, GeometryConfig};
use esaac_interop::{CameraTerms, DEFAULT_INSTANCES, DEFAULT_SLOTS, wire};
use esaac_model::paths::{Intrinsics, Projection};
use esaac_model::presets::preset;
use esaac_model::{DepthFormat, HdrFormat, IdFormat, MotionFormat, Profile, SensorModel};
use serde::Deserialize;
use std::path::Path;

/// The file's structure.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RigFile {
    camera: Vec<CameraEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraEntry {
    /// Preset, or a sensor file beside this one.
    sensor: String,
    profile: Option<String>,
    #[serde(default)]
    parameters: toml::Table,
    #[serde(default = "default_hdr")]
    hdr: HdrFormat,
    motion: Option<MotionFormat>,
    depth: Option<DepthFormat>,
    ids: Option<IdFormat>,
    /// Lens of depth and poses.
    lens: Option<LensEntry>,
    /// Most instances that may have poses.
    instances: Option<u32>,
    #[serde(default = "default_slots")]
    slots: u32,
    #[serde(default)]
    late: Late,
}

/// A lens. What is left out is as of a lens with square pixels whose axis goes through the middle of the image.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LensEntry {
    #[serde(default)]
    projection: Projection,
    fx: f64,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
}

/// What happens to frames that come faster than the engine simulates them.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Late {
    /// The producer waits.
    #[default]
    Lossless,
    /// Newer frames replace them.
    Latest,
}

fn default_hdr() -> HdrFormat {
    HdrFormat::F16x4
}

fn default_slots() -> u32 {
    DEFAULT_SLOTS
}

/// Each instance takes memory and time of every frame.
const MAX_INSTANCES: u32 = 4096;

/// The cameras of a rig, and what the service offers to their producers.
#[derive(Clone, Debug, Default)]
pub struct RigPlan {
    /// For the engine.
    pub cameras: Vec<CameraConfig>,
    /// For the link.
    pub terms: Vec<CameraTerms>,
    /// By camera: what is assumed of a physical pixel and its light. Empty without a rig file.
    pub notes: Vec<Vec<String>>,
    /// What of the rig file does nothing, and why.
    pub warnings: Vec<String>,
}

/// A sensor of a rig file.
struct RigSensor {
    sensor: SensorModel,
    light_is_given: bool,
    /// The keys of its sensor file, if it has one.
    file_keys: toml::Table,
}

impl RigPlan {
    /// Reads a rig file.
    pub fn read(path: &Path) -> Result<Self> {
        let name = path.display();
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read rig file {name}"))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        RigPlan::parse(&text, folder).with_context(|| format!("rig file {name}"))
    }

    fn parse(text: &str, folder: &Path) -> Result<Self> {
        let file: RigFile = toml::from_str(text)?;
        ensure!(!file.camera.is_empty(), "it has no [[camera]]");
        let mut plan = RigPlan::default();
        for (number, entry) in (0_u32..).zip(file.camera) {
            let at_camera = || format!("camera {number}");
            let RigSensor { sensor, light_is_given, file_keys } =
                entry.sensor(folder).with_context(at_camera)?;
            plan.notes.push(pixel_notes::of(&sensor, light_is_given, pixel_notes::BY_KEYS));
            let camera = entry.camera(number, sensor).with_context(at_camera)?;
            plan.push(camera, entry.slots, matches!(entry.late, Late::Latest));
            plan.terms[number as usize].max_instances = entry.instances.unwrap_or(DEFAULT_INSTANCES);
            let unread = entry.unread(&plan.cameras[number as usize].sensor, &file_keys);
            plan.warnings.extend(unread.into_iter().map(|text| format!("camera {number}: {text}")));
        }
        Ok(plan)
    }

    /// Adds a camera. Its sensor gets the synthesis that `auto` is for its images, for reports to tell.
    pub fn push(&mut self, mut camera: CameraConfig, slots: u32, latest: bool) {
        // A camera that is `rigid` by `auto` can do without poses; one that was asked for it cannot.
        self.terms.push(CameraTerms { slots, latest, ..(&camera).into() });
        let synthesis = &mut camera.sensor.synthesis;
        *synthesis = synthesis.resolve(camera.geometry.is_some(), camera.motion.is_some());
        self.cameras.push(camera);
    }

    /// Sensors of the cameras.
    #[must_use]
    pub fn sensors(&self) -> Vec<SensorModel> {
        self.cameras.iter().map(|camera| camera.sensor.clone()).collect()
    }
}

impl CameraEntry {
    fn camera(&self, number: u32, sensor: SensorModel) -> Result<CameraConfig> {
        let geometry = self.geometry(&sensor)?;
        Ok(CameraConfig { sensor, camera: number, hdr: self.hdr, motion: self.motion, geometry })
    }

    /// Depth, ids and lens, if the camera takes depth.
    fn geometry(&self, sensor: &SensorModel) -> Result<Option<GeometryConfig>> {
        let (most, instances) = (MAX_INSTANCES, self.instances.unwrap_or_default());
        ensure!(instances <= most, "{instances} instances, expected at most {most}");
        let Some(depth) = self.depth else {
            ensure!(
                self.ids.is_none() && self.lens.is_none() && self.instances.is_none(),
                "ids, lens and instances are of use with `depth` alone"
            );
            return Ok(None);
        };
        let lens = self.lens.context("depth without a lens, expected `lens = { fx = ... }`, in pixels")?;
        let middle_px = |pixels: u32| 0.5 * (f64::from(pixels) - 1.0);
        let (cx, cy) = (
            lens.cx.unwrap_or_else(|| middle_px(sensor.width)),
            lens.cy.unwrap_or_else(|| middle_px(sensor.height)),
        );
        let lens = Intrinsics::new(lens.projection, lens.fx, lens.fy.unwrap_or(lens.fx), cx, cy)?;
        Ok(Some(GeometryConfig { depth, ids: self.ids, lens }))
    }

    /// What of its parameters and of its sensor file does nothing.
    fn unread(&self, sensor: &SensorModel, file_keys: &toml::Table) -> Vec<String> {
        let (light, own): (Vec<&str>, Vec<&str>) =
            self.parameters.keys().map(String::as_str).partition(|name| is_light(name));
        // Of light, `lux_per_unit` is what the sensor reads.
        let why = |name: &str| why_unread(if light.contains(&name) { "lux_per_unit" } else { name }, sensor);
        let told = |name: &str| Some(format!("`{name}` does nothing: {}", why(name)?));
        let in_file = file_keys.keys().map(String::as_str).filter(|key| !own.contains(key));
        let of_file = of_file(in_file, sensor).map(|text| format!("{}: {text}", self.sensor));
        light.iter().chain(&own).filter_map(|name| told(name)).chain(of_file).collect()
    }

    fn sensor(&self, folder: &Path) -> Result<RigSensor> {
        let most = wire::MAX_SLOTS;
        ensure!((1..=most).contains(&self.slots), "{} slots, expected 1 to {most}", self.slots);
        let (base, file_keys) = match preset(&self.sensor) {
            Some(sensor) => (sensor, toml::Table::new()),
            None => sensor_file(&self.sensor, folder)?,
        };
        let profile = |name: &String| -> Result<Profile> {
            toml::Value::String(name.clone())
                .try_into()
                .with_context(|| format!("unknown profile `{name}`, expected clean, noisy or paper"))
        };
        let text = |value: &toml::Value| match value {
            toml::Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        let light = SceneLight {
            values: SCENE_LIGHT.map(|(name, ..)| self.parameters.get(name).map(text)),
            are_flags: false,
        };
        let parameters: Vec<(&str, String)> = self
            .parameters
            .iter()
            .filter(|(name, _)| !is_light(name))
            .map(|(name, value)| (name.as_str(), text(value)))
            .collect();
        let mut sensor = with_changes(base, self.profile.as_ref().map(profile).transpose()?, &parameters)?;
        let has_lux = self.parameters.contains_key("lux_per_unit");
        let has_unit = light.apply(&mut sensor, has_lux)?;
        sensor.validate()?;
        let light_is_given = has_unit || has_lux || file_keys.contains_key("lux_per_unit");
        Ok(RigSensor { sensor, light_is_given, file_keys })
    }
}

fn is_light(name: &str) -> bool {
    SCENE_LIGHT.iter().any(|(known, ..)| *known == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Intensity;

    #[test]
    fn cameras_are_presets_or_files_with_profile_and_parameters_over_them() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("mine.toml"), "width = 20\nheight = 10\n").unwrap();
        let text = r#"
            [[camera]]
            sensor = "davis240"
            profile = "noisy"
            motion = "f32x4"
            [camera.parameters]
            intensity = "bayer_rggb"
            contrast_on = 0.25

            [[camera]]
            sensor = "mine.toml"
            hdr = "f32x4"
            slots = 5
            late = "latest"
            [camera.parameters]
            synthesis = "linear"
        "#;
        let plan = RigPlan::parse(text, folder.path()).unwrap();
        let first = &plan.cameras[0];
        assert_eq!((first.sensor.width, first.sensor.intensity), (240, Intensity::BayerRggb));
        assert_eq!((first.sensor.contrast_on, first.motion), (0.25, Some(MotionFormat::F32x4)));
        assert!(first.sensor.shot_noise_rate_hz > 0.0);
        assert_eq!((plan.terms[0].slots, plan.terms[0].latest), (3, false));
        assert_eq!((plan.terms[1].slots, plan.terms[1].latest), (5, true));
        assert_eq!((plan.cameras[1].sensor.height, plan.cameras[1].camera), (10, 1));
        assert_eq!(
            (first.sensor.name.as_str(), plan.cameras[1].sensor.name.as_str()),
            ("davis240", "custom")
        );
    }

    #[test]
    fn the_physical_pixel_is_that_of_the_preset() {
        let text = "[[camera]]\nsensor = \"hd\"\nprofile = \"clean\"\n[camera.parameters]\ndark_lux = 0.5\n\
                    pixel = \"physical\"";
        let plan = RigPlan::parse(text, Path::new("/nonesuch")).unwrap();
        let mut expected = esaac_model::presets::preset_with_physical_pixel("hd").unwrap();
        Profile::Clean.apply(&mut expected);
        expected.dark_lux = 0.5;
        expected.synthesis = plan.cameras[0].sensor.synthesis;
        assert_eq!(plan.cameras[0].sensor, expected);
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("log.toml"), preset("hd").unwrap().to_toml()).unwrap();
        let plan = RigPlan::parse(&text.replace("\"hd\"", "\"log.toml\""), folder.path()).unwrap();
        assert_eq!(plan.cameras[0].sensor, expected, "a file of that name");
    }

    #[test]
    fn a_unit_and_a_lens_give_the_light_as_on_the_command_line() {
        let lux = |parameters: &str| {
            let text = format!(
                "[[camera]]\nsensor = \"hd\"\n[camera.parameters]\npixel = \"physical\"\n{parameters}"
            );
            let plan = RigPlan::parse(&text, Path::new("/nonesuch"))?;
            anyhow::Ok(plan.cameras[0].sensor.lux_per_unit)
        };
        let nits = lux("scene_unit = \"luminance\"\nf_number = 2").unwrap();
        assert!((nits - 0.9 * std::f64::consts::PI / 16.0).abs() < 1e-12, "{nits}");
        let dim = "scene_unit = \"radiance\"\nf_number = 4.0\nlens_transmission = 0.45\nluminous_efficacy = 100\n\
                   exposure_gain = 2.0";
        assert!((lux(dim).unwrap() / nits - 6.25).abs() < 1e-9);
        for (parameters, part) in [
            ("f_number = 2", "`f_number` is given without `scene_unit`, expected both"),
            ("scene_unit = \"luminance\"", "`scene_unit` is given without `f_number`, expected both"),
            ("scene_unit = \"luminance\"\nf_number = \"wide\"", "`f_number` is `wide`, expected a number"),
            ("scene_unit = \"nits\"\nf_number = 2", "expected luminance (cd/m2) or radiance"),
            (
                "scene_unit = \"luminance\"\nf_number = 2\nlux_per_unit = 3.0",
                "`lux_per_unit` are given, expected one",
            ),
        ] {
            let error = format!("{:#}", lux(parameters).unwrap_err());
            assert!(error.contains("camera 0") && error.contains(part), "{parameters}: {error}");
        }
    }

    #[test]
    fn what_is_assumed_of_a_physical_pixel_is_told() {
        let notes = |sensor: &str, parameters: &str| {
            let text = format!("[[camera]]\nsensor = \"{sensor}\"\n[camera.parameters]\n{parameters}");
            RigPlan::parse(&text, Path::new("/nonesuch")).unwrap().notes.remove(0)
        };
        let physical = "pixel = \"physical\"\n";
        let vga = notes("vga", physical);
        assert!(
            vga.len() == 2 && vga[0].ends_with("by `lux_per_unit`, or by `scene_unit` and `f_number`"),
            "{vga:?}"
        );
        assert!(notes("hd", &format!("{physical}lux_per_unit = 100.0")).is_empty());
        assert!(notes("hd", &format!("{physical}scene_unit = \"luminance\"\nf_number = 2")).is_empty());
        assert!(notes("vga", "").is_empty(), "a log pixel");
    }

    #[test]
    fn keys_that_do_nothing_are_told() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("mine.toml"), "dark_lux = 0.5\ntemperature_c = 40\n").unwrap();
        let warnings = |parameters: &str| {
            let text = format!("[[camera]]\nsensor = \"mine.toml\"\n[camera.parameters]\n{parameters}");
            RigPlan::parse(&text, folder.path()).unwrap().warnings
        };
        let told = warnings("noise_gain = 0.5\nscene_unit = \"luminance\"\nf_number = 2\naps_bits = 10");
        let starts = [
            "camera 0: `f_number` does nothing: it is for --pixel physical alone",
            "camera 0: `scene_unit` does nothing",
            "camera 0: `aps_bits` does nothing: --aps-exposure-ns is 0",
            "camera 0: `noise_gain` does nothing",
            "camera 0: mine.toml: `dark_lux`, `temperature_c` do nothing: for a physical pixel alone",
        ];
        assert!(
            told.len() == 5 && told.iter().zip(starts).all(|(text, start)| text.starts_with(start)),
            "{told:#?}"
        );
        assert!(warnings("pixel = \"physical\"\nnoise_gain = 0.5").is_empty());
    }

    #[test]
    fn depth_comes_with_a_lens() {
        let plan = |more: &str| {
            RigPlan::parse(&format!("[[camera]]\nsensor = \"davis346\"\n{more}"), Path::new("/nonesuch"))
        };
        let whole = plan(
            "depth = \"f32\"\nids = \"u16\"\ninstances = 12\n\
             lens = { projection = \"fisheye\", fx = 100.0, fy = 101.0, cx = 2.0, cy = 3.0 }\n\
             [camera.parameters]\nsynthesis = \"rigid\"",
        )
        .unwrap();
        let lens = Intrinsics::fisheye(100.0, 101.0, 2.0, 3.0).unwrap();
        let geometry = Some(GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U16), lens });
        assert_eq!((whole.cameras[0].geometry, whole.terms[0].images.geometry), (geometry, geometry));
        assert_eq!((whole.terms[0].max_instances, whole.terms[0].requires_geometry), (12, true));
        let short = plan("depth = \"f32\"\nlens = { fx = 250.0 }\n[camera.parameters]\nsynthesis = \"auto\"")
            .unwrap();
        let lens = Intrinsics::pinhole(250.0, 250.0, 172.5, 129.5).unwrap();
        assert_eq!(
            short.cameras[0].geometry,
            Some(GeometryConfig { depth: DepthFormat::F32, ids: None, lens })
        );
        assert_eq!((short.terms[0].max_instances, short.terms[0].requires_geometry), (256, false));
        let error = |more: &str| format!("{:#}", plan(more).unwrap_err());
        assert!(error("depth = \"f32\"").contains("depth without a lens"));
        assert!(error("ids = \"u32\"").contains("with `depth` alone"));
        assert!(error("lens = { fx = 250.0 }").contains("with `depth` alone"));
        assert!(error("instances = 12").contains("instances are of use with `depth` alone"));
        assert!(error("depth = \"f16\"\nlens = { fx = 250.0 }").contains("f32"));
        assert!(error("depth = \"f32\"\nlens = { fx = -1.0 }").contains("fx is -1"));
        assert!(error("depth = \"f32\"\nlens = { fx = 1.0, f = 2.0 }").contains("unknown field `f`"));
        assert!(error("instances = 5000").contains("expected at most 4096"));
    }

    #[test]
    fn mistakes_are_named() {
        let error = |text: &str| format!("{:#}", RigPlan::parse(text, Path::new("/nonesuch")).unwrap_err());
        assert!(error("").contains("camera"));
        assert!(error("camera = []").contains("no [[camera]]"));
        assert!(error("[[camera]]\nsensor = \"davis\"").contains("davis346"));
        assert!(error("[[camera]]\nsensor = \"davis240\"\nslot = 3").contains("slot"));
        assert!(error("[[camera]]\nsensor = \"davis240\"\nslots = 99").contains("expected 1 to 16"));
        assert!(error("[[camera]]\nsensor = \"davis240\"\nprofile = \"loud\"").contains("noisy"));
        assert!(error("[[camera]]\nsensor = \"davis240\"\n[camera.parameters]\nwidht = 3").contains("widht"));
        assert!(error("[[camera]]\nsensor = \"davis240\"\nlate = \"never\"").contains("lossless"));
    }
}
