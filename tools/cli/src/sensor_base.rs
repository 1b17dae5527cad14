//! A sensor from what it begins with, a profile and single parameters, for the command line and rig files.

use anyhow::Result;
use esaac_model::{Pixel, Profile, SensorModel};

/// What a sensor begins with.
#[derive(Clone, Debug, PartialEq)]
pub enum SensorBase {
    /// A preset, which knows the numbers of its sensor's physical pixel too.
    Preset(SensorModel),
    /// A sensor file, which states all that it wants to.
    File(SensorModel),
}

impl SensorBase {
    /// Applies the profile, then the parameters in their order. If these ask a preset for the physical pixel, it takes
    /// the numbers of that sensor's before anything else.
    pub fn with(self, profile: Option<Profile>, parameters: &[(&str, &str)]) -> Result<SensorModel> {
        let mut sensor = match self {
            SensorBase::Preset(sensor) if asks_for_physical(parameters)? => sensor.with_preset_pixel(),
            SensorBase::Preset(sensor) | SensorBase::File(sensor) => sensor,
        };
        if let Some(profile) = profile {
            profile.apply(&mut sensor);
        }
        for (parameter, value) in parameters {
            sensor.set(parameter, value)?;
        }
        Ok(sensor)
    }
}

fn asks_for_physical(parameters: &[(&str, &str)]) -> Result<bool> {
    let mut named = SensorModel::default();
    for (parameter, value) in parameters.iter().filter(|(parameter, _)| *parameter == "pixel") {
        named.set(parameter, value)?;
    }
    Ok(named.pixel == Pixel::Physical)
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::presets::preset;

    #[test]
    fn a_preset_that_is_asked_for_the_physical_pixel_has_its_sensors_numbers() {
        let hd = || preset("hd").unwrap();
        let physical = [("dark_lux", "0.5"), ("pixel", "physical")];
        let sensor = SensorBase::Preset(hd()).with(None, &physical).unwrap();
        assert_eq!(sensor, SensorModel { dark_lux: 0.5, ..hd().with_preset_pixel() });
        assert_ne!(sensor.response_e_per_lux_s, SensorModel::default().response_e_per_lux_s);
        let quiet = SensorBase::Preset(hd()).with(Some(Profile::Clean), &physical).unwrap();
        assert_eq!((quiet.noise_gain, quiet.refractory_ns), (0.0, 0));
        let file = SensorBase::File(hd()).with(None, &physical).unwrap();
        assert_eq!(file, SensorModel { dark_lux: 0.5, pixel: Pixel::Physical, ..hd() });
        assert!(SensorBase::Preset(hd()).with(None, &[("pixel", "quantum")]).is_err());
    }
}
