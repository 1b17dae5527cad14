//! The rig file of `esaac serve`: cameras, image formats and rings.

use anyhow::{Context, Result, ensure};
use esaac_engine::CameraConfig;
use esaac_interop::{CameraTerms, Images, wire};
use esaac_model::presets::preset;
use esaac_model::{HdrFormat, MotionFormat, PRESETS, Profile, SensorModel};
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
    #[serde(default = "default_slots")]
    slots: u32,
    #[serde(default)]
    late: Late,
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

/// One slot for the producer to write, one for the engine to read, and one that waits.
pub const DEFAULT_SLOTS: u32 = 3;

/// The cameras of a rig, and what the service offers to their producers.
#[derive(Clone, Debug, Default)]
pub struct RigPlan {
    /// For the engine.
    pub cameras: Vec<CameraConfig>,
    /// For the link.
    pub terms: Vec<CameraTerms>,
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
            let camera = entry.resolve(folder).with_context(|| format!("camera {number}"))?;
            plan.push(
                CameraConfig { sensor: camera, camera: number, hdr: entry.hdr, motion: entry.motion },
                entry.slots,
                matches!(entry.late, Late::Latest),
            );
        }
        Ok(plan)
    }

    /// Adds a camera.
    pub fn push(&mut self, camera: CameraConfig, slots: u32, latest: bool) {
        let images = Images {
            width_px: camera.sensor.width,
            height_px: camera.sensor.height,
            hdr: camera.hdr,
            motion: camera.motion,
        };
        self.terms.push(CameraTerms { images, slots, latest });
        self.cameras.push(camera);
    }

    /// Sensors of the cameras.
    #[must_use]
    pub fn sensors(&self) -> Vec<SensorModel> {
        self.cameras.iter().map(|camera| camera.sensor.clone()).collect()
    }
}

impl CameraEntry {
    fn resolve(&self, folder: &Path) -> Result<SensorModel> {
        let most = wire::MAX_SLOTS;
        ensure!((1..=most).contains(&self.slots), "{} slots, expected 1 to {most}", self.slots);
        let mut sensor = match preset(&self.sensor) {
            Some(sensor) => sensor,
            None => {
                let path = folder.join(&self.sensor);
                let text = std::fs::read_to_string(&path).with_context(|| {
                    let names: Vec<&str> = PRESETS.iter().map(|p| p.name).collect();
                    format!("`{}` is neither a preset ({}) nor a sensor file", self.sensor, names.join(", "))
                })?;
                SensorModel::from_toml(&text).with_context(|| format!("sensor file {}", path.display()))?
            }
        };
        if let Some(name) = &self.profile {
            let profile: Profile = toml::Value::String(name.clone())
                .try_into()
                .with_context(|| format!("unknown profile `{name}`, expected clean, noisy or paper"))?;
            profile.apply(&mut sensor);
        }
        for (name, value) in &self.parameters {
            let value = match value {
                toml::Value::String(text) => text.clone(),
                other => other.to_string(),
            };
            sensor.set(name, &value)?;
        }
        sensor.validate()?;
        Ok(sensor)
    }
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
