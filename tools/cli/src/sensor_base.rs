//! A sensor with a profile and single parameters, for the command line and rig files.

use anyhow::Result;
use esaac_model::{Profile, SensorError, SensorModel};

/// [`SensorModel::with_changes`], with the range of whole numbers that are too large for their type.
pub fn with_changes(
    sensor: SensorModel,
    profile: Option<Profile>,
    parameters: &[(&str, String)],
) -> Result<SensorModel> {
    Ok(sensor.with_changes(profile, parameters).map_err(with_range)?)
}

/// The error for a whole number that its parameter's type does not hold. The model tells ranges of numbers that it
/// holds, and the largest of those is out of range too.
fn with_range(error: SensorError) -> SensorError {
    let SensorError::Value { parameter, value, .. } = &error else { return error };
    let is_whole = value.replace('_', "").parse::<i128>().is_ok();
    let mut largest = SensorModel::default();
    if !is_whole || largest.set(parameter, &u32::MAX.to_string()).is_err() {
        return error;
    }
    match largest.validate() {
        Err(SensorError::Range { parameter, expected, .. }) => {
            SensorError::Range { parameter, expected, actual: value.clone() }
        }
        _ => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_number_that_is_too_large_for_its_type_is_told_the_range() {
        let error = |parameter: &str, value: &str| {
            let sensor = SensorModel::default();
            with_changes(sensor, None, &[(parameter, value.to_owned())]).unwrap_err().to_string()
        };
        let latency = error("latency_ns", "1000000000000");
        assert!(latency.contains("`latency_ns` is 1000000000000, expected at most 1000000000"), "{latency}");
        let huge = "9".repeat(30);
        assert!(error("refractory_ns", &huge).contains(&format!("is {huge}, expected 0 to 1000000000")));
        assert!(error("substeps", "-1").contains("`substeps` is -1, expected 1 to 64"));
        assert!(error("seed", "-1").contains("expected a whole number, from 0"));
        assert!(error("substeps", "3.5").contains("expected a whole number"));
        assert!(error("substep", "3").contains("unknown"));
        assert!(error("pixel", "quantum").contains("`pixel` cannot be `quantum`"));
    }
}
