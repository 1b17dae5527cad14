//! A sensor from what it begins with, a profile and single parameters, for the command line and rig files.

use anyhow::Result;
use esaac_model::{Pixel, Profile, SensorError, SensorModel};

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
    pub fn with(self, profile: Option<Profile>, parameters: &[(&str, String)]) -> Result<SensorModel> {
        let mut sensor = match self {
            SensorBase::Preset(sensor) if asks_for_physical(parameters)? => sensor.with_preset_pixel(),
            SensorBase::Preset(sensor) | SensorBase::File(sensor) => sensor,
        };
        if let Some(profile) = profile {
            profile.apply(&mut sensor);
        }
        for (parameter, value) in parameters {
            sensor.set(parameter, value).map_err(|error| with_range(error, parameter, value))?;
        }
        Ok(sensor)
    }
}

/// The error for a whole number that its parameter's type does not hold. The model tells ranges of numbers that it
/// holds, and the largest of those is out of range too.
fn with_range(error: SensorError, parameter: &str, value: &str) -> SensorError {
    let is_whole = value.replace('_', "").parse::<i128>().is_ok();
    let mut largest = SensorModel::default();
    if !is_whole || largest.set(parameter, &u32::MAX.to_string()).is_err() {
        return error;
    }
    match largest.validate() {
        Err(SensorError::Range { parameter, expected, .. }) => {
            SensorError::Range { parameter, expected, actual: value.to_owned() }
        }
        _ => error,
    }
}

fn asks_for_physical(parameters: &[(&str, String)]) -> Result<bool> {
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
    fn a_whole_number_that_is_too_large_for_its_type_is_told_the_range() {
        let error = |parameter: &str, value: &str| {
            let base = SensorBase::File(SensorModel::default());
            base.with(None, &[(parameter, value.to_owned())]).unwrap_err().to_string()
        };
        let latency = error("latency_ns", "1000000000000");
        assert!(latency.contains("`latency_ns` is 1000000000000, expected at most 1000000000"), "{latency}");
        let huge = "9".repeat(30);
        assert!(error("refractory_ns", &huge).contains(&format!("is {huge}, expected 0 to 1000000000")));
        assert!(error("substeps", "-1").contains("`substeps` is -1, expected 1 to 64"));
        assert!(error("seed", "-1").contains("expected a whole number, from 0"));
        assert!(error("substeps", "3.5").contains("expected a whole number"));
        assert!(error("substep", "3").contains("unknown"));
    }

    #[test]
    fn a_preset_that_is_asked_for_the_physical_pixel_has_its_sensors_numbers() {
        let hd = || preset("hd").unwrap();
        let physical = [("dark_lux", "0.5".to_owned()), ("pixel", "physical".to_owned())];
        let sensor = SensorBase::Preset(hd()).with(None, &physical).unwrap();
        assert_eq!(sensor, SensorModel { dark_lux: 0.5, ..hd().with_preset_pixel() });
        assert_ne!(sensor.response_e_per_lux_s, SensorModel::default().response_e_per_lux_s);
        let quiet = SensorBase::Preset(hd()).with(Some(Profile::Clean), &physical).unwrap();
        assert_eq!((quiet.noise_gain, quiet.refractory_ns), (0.0, 0));
        let file = SensorBase::File(hd()).with(None, &physical).unwrap();
        assert_eq!(file, SensorModel { dark_lux: 0.5, pixel: Pixel::Physical, ..hd() });
        assert!(SensorBase::Preset(hd()).with(None, &[("pixel", "quantum".to_owned())]).is_err());
    }
}
