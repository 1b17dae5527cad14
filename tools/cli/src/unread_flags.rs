//! Flags that were given and do nothing, because the chosen pixel or effect does not read them.

use crate::sensor_flags::{SensorFlags, flag};
use crate::stderr;
use esaac_model::{PARAMETERS, Pixel, ReadoutKind, SensorModel, SubstepPolicy, Synthesis};

/// Parameters that only the log pixel reads.
const LOG: [&str; 2] = ["shot_noise_rate_hz", "log_offset"];

/// How the model's list marks parameters that only the physical pixel reads.
const PHYSICAL_MARK: &str = "Physical: ";

/// Warns of flags that `sensor`, which they made, does not read. Its synthesis is the one that is used.
pub fn warn_of_sensor(flags: &SensorFlags, sensor: &SensorModel) {
    of_sensor(flags, sensor).iter().for_each(|(flag, why)| warn(flag, why));
}

/// Warns of a flag that does nothing.
pub fn warn(flag: &str, why: &str) {
    stderr::line(format_args!("warning: --{flag} does nothing: {why}"));
}

fn of_sensor(flags: &SensorFlags, sensor: &SensorModel) -> Vec<(String, &'static str)> {
    let mut unread: Vec<(String, &'static str)> = Vec::new();
    if sensor.pixel == Pixel::Log {
        let light = flags.light.given();
        unread.extend(light.map(|name| (flag(name), "it is for --pixel physical alone")));
    }
    let parameters = flags.explicit.iter().map(|(name, _)| *name);
    unread.extend(parameters.filter_map(|name| Some((flag(name), why_unread(name, sensor)?))));
    unread
}

/// Why `sensor` does not read a parameter, if it does not.
pub(crate) fn why_unread(parameter: &str, sensor: &SensorModel) -> Option<&'static str> {
    let is_physical =
        PARAMETERS.iter().any(|known| known.name == parameter && known.about.starts_with(PHYSICAL_MARK));
    let unread = match parameter {
        _ if is_physical => (sensor.pixel == Pixel::Log, "it is for --pixel physical alone"),
        _ if LOG.contains(&parameter) => {
            (sensor.pixel == Pixel::Physical, "the physical pixel does not read it")
        }
        "flicker_hz" | "flicker_phase_deg" => (sensor.flicker_depth == 0.0, "--flicker-depth is 0"),
        "aps_start_ns" | "aps_gain" | "aps_bits" => (sensor.aps_exposure_ns == 0, "--aps-exposure-ns is 0"),
        "substep_error_ns" => (sensor.substep_policy == SubstepPolicy::Fixed, "--substep-policy is fixed"),
        "readout_row_ns" if sensor.readout == ReadoutKind::Fifo => (true, "it is for --readout rows alone"),
        "readout_cap_period_ns" if sensor.readout != ReadoutKind::None => {
            (sensor.readout_cap_events == 0, "--readout-cap-events is 0")
        }
        "layers" => (sensor.synthesis != Synthesis::Motion, "it is for synthesis motion alone"),
        _ => (parameter.starts_with("readout_") && sensor.readout == ReadoutKind::None, "--readout is none"),
    };
    unread.0.then_some(unread.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::tests::simulate;

    #[test]
    fn flags_of_another_pixel_or_of_an_effect_that_is_off_are_told() {
        let unread = |flags: &[&str]| -> Vec<String> {
            let flags = simulate(flags).sensor;
            let sensor = flags.resolve(SensorModel::default()).unwrap().sensor;
            of_sensor(&flags, &sensor).into_iter().map(|(flag, _)| flag).collect()
        };
        let light = ["--scene-unit", "luminance", "--f-number", "2", "--dark-lux", "0.1"];
        assert_eq!(unread(&light), ["scene-unit", "f-number", "dark-lux"]);
        assert_eq!(unread(&["--lux-per-unit", "3", "--leak-rate-hz", "1"]), ["lux-per-unit"]);
        assert!(unread(&[&light[..], &["--pixel", "physical"]].concat()).is_empty());
        let noise = ["--shot-noise-rate-hz", "1", "--log-offset", "0.1"];
        assert!(unread(&noise).is_empty());
        assert_eq!(
            unread(&[&noise[..], &["--pixel", "physical"]].concat()),
            ["shot-noise-rate-hz", "log-offset"]
        );
        let off = ["--flicker-hz", "100", "--readout-row-ns", "5", "--aps-bits", "10"];
        assert_eq!(unread(&off), ["flicker-hz", "readout-row-ns", "aps-bits"]);
        let on = ["--flicker-depth", "0.1", "--readout", "rows", "--aps-exposure-ns", "1000"];
        assert!(unread(&[&off[..], &on].concat()).is_empty());
        let fifo = ["--readout", "fifo", "--readout-row-ns", "100", "--readout-event-ns", "5"];
        assert_eq!(unread(&fifo), ["readout-row-ns"]);
        let period = ["--readout", "rows", "--readout-row-ns", "5", "--readout-cap-period-ns", "9000"];
        assert_eq!(unread(&period), ["readout-cap-period-ns"]);
        assert!(unread(&[&period[..], &["--readout-cap-events", "10"]].concat()).is_empty());
        let substeps = ["--substep-error-ns", "10", "--layers", "3"];
        let other = ["--substep-policy", "fixed", "--synthesis", "rigid"];
        assert_eq!(unread(&[&substeps[..], &other].concat()), ["layers", "substep-error-ns"]);
        assert!(unread(&[&substeps[..], &["--synthesis", "motion"]].concat()).is_empty());
    }
}
