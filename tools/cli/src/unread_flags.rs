//! Flags and keys of files that were given and do nothing, because the chosen pixel or effect does not read them.

use crate::sensor_flags::{SensorFlags, flag};
use crate::warnings::Warnings;
use esaac_model::{PARAMETERS, Pixel, ReadoutKind, SensorModel, SubstepPolicy, Synthesis, Taps};

/// Parameters that only the log pixel reads.
const LOG: [&str; 2] = ["shot_noise_rate_hz", "log_offset"];

/// How the model's list marks parameters that only the physical pixel reads.
const PHYSICAL_MARK: &str = "Physical: ";

/// Why APS frames go nowhere.
pub(crate) const APS_NEEDS: &str = "APS frames leave by --ros on or --record alone";

/// Warns of flags, and of keys of the sensor file, that `sensor`, which they made, does not read. Its synthesis is the
/// one that is used.
pub fn warn_of_sensor(
    warnings: &mut Warnings,
    flags: &SensorFlags,
    file_keys: &toml::Table,
    sensor: &SensorModel,
) {
    let of_flags = of_sensor(flags, sensor);
    of_flags.iter().for_each(|(flag, why)| warn(warnings, flag, why));
    let given = |key: &str| flags.explicit.iter().any(|(name, _)| *name == key);
    let keys = file_keys.keys().map(String::as_str).filter(|key| !given(key));
    if let Some(text) = of_file(keys, sensor) {
        warnings.tell(format_args!("{}: {text}", flags.sensor.as_deref().unwrap_or_default()));
    }
}

/// Warns of flags of APS frames, if these are simulated and go nowhere.
pub fn warn_of_aps(warnings: &mut Warnings, flags: &SensorFlags, sensor: &SensorModel) {
    let of_aps = |name: &str| name.starts_with("aps_") || name == "white_level" && !has_shot_noise(sensor);
    for (name, _) in flags.explicit.iter().filter(|(name, _)| sensor.aps_exposure_ns > 0 && of_aps(name)) {
        warn(warnings, &flag(name), APS_NEEDS);
    }
}

/// Warns of a flag that does nothing.
pub fn warn(warnings: &mut Warnings, flag: &str, why: &str) {
    warnings.tell(format_args!("--{flag} does nothing: {why}"));
}

/// What to tell of a sensor file's keys that a log pixel does not read, if they say something. Those of effects that are
/// off are in every file that `esaac sensors --toml` prints.
pub(crate) fn of_file<'a>(keys: impl Iterator<Item = &'a str>, sensor: &SensorModel) -> Option<String> {
    let unread = |key: &&str| is_physical(key) && sensor.pixel == Pixel::Log && is_changed(key, sensor);
    let unread: Vec<String> = keys.filter(unread).map(|key| format!("`{key}`")).collect();
    let verb = if unread.len() == 1 { "does" } else { "do" };
    (!unread.is_empty()).then(|| {
        format!("{} {verb} nothing: for a physical pixel alone, and this is a log pixel", unread.join(", "))
    })
}

/// Whether a parameter has not its default.
pub(crate) fn is_changed(parameter: &str, sensor: &SensorModel) -> bool {
    let value = |sensor: &SensorModel| toml::Table::try_from(sensor).ok()?.remove(parameter);
    value(sensor) != value(&SensorModel::default())
}

fn is_physical(parameter: &str) -> bool {
    PARAMETERS.iter().any(|known| known.name == parameter && known.about.starts_with(PHYSICAL_MARK))
}

fn has_shot_noise(sensor: &SensorModel) -> bool {
    sensor.pixel == Pixel::Log && sensor.shot_noise_rate_hz > 0.0
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
    // Until it is known what `auto` is, it may be any.
    let no_paths = matches!(sensor.synthesis, Synthesis::Linear | Synthesis::Paper | Synthesis::None);
    let unread = match parameter {
        _ if is_physical(parameter) => (sensor.pixel == Pixel::Log, "it is for --pixel physical alone"),
        _ if LOG.contains(&parameter) => {
            (sensor.pixel == Pixel::Physical, "the physical pixel does not read it")
        }
        "flicker_hz" | "flicker_phase_deg" => (sensor.flicker_depth == 0.0, "--flicker-depth is 0"),
        "aps_start_ns" | "aps_gain" | "aps_bits" => (sensor.aps_exposure_ns == 0, "--aps-exposure-ns is 0"),
        "leak_spread_log" => (sensor.leak_rate_hz == 0.0, "--leak-rate-hz is 0"),
        "white_level" => (
            sensor.aps_exposure_ns == 0 && !has_shot_noise(sensor),
            "there are no APS frames and no shot noise",
        ),
        "substep_error_ns" if sensor.substep_policy == SubstepPolicy::Fixed => {
            (true, "--substep-policy is fixed")
        }
        "substep_error_ns" | "transfers" if no_paths => (true, "it is for synthesis motion and rigid alone"),
        "substep_error_ns" | "transfers" => (sensor.taps == Taps::Bilinear, "--taps is bilinear"),
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
        let detail = ["--transfers", "3", "--substep-error-ns", "10"];
        assert!(unread(&detail).is_empty(), "auto may come to any");
        for without in [["--taps", "bilinear"], ["--synthesis", "linear"], ["--synthesis", "none"]] {
            assert_eq!(unread(&[&detail[..], &without].concat()), ["transfers", "substep-error-ns"]);
        }
        let white = ["--white-level", "3"];
        assert_eq!(unread(&white), ["white-level"]);
        for with in [["--aps-exposure-ns", "1000"], ["--shot-noise-rate-hz", "1"]] {
            assert!(unread(&[&white[..], &with].concat()).is_empty());
        }
        let noise = ["--shot-noise-rate-hz", "1", "--pixel", "physical"];
        assert_eq!(unread(&[&white[..], &noise].concat()), ["shot-noise-rate-hz", "white-level"]);
        let spread = ["--leak-spread-log", "0.2", "--leak-rate-hz"];
        assert_eq!(unread(&[&spread[..], &["0"]].concat()), ["leak-spread-log"]);
        assert!(unread(&[&spread[..], &["-0.1", "--pixel", "physical"]].concat()).is_empty());
    }

    #[test]
    fn keys_of_a_physical_pixel_in_a_log_pixel_s_file_are_told() {
        let keys = ["contrast_on", "dark_lux", "noise_gain", "readout_event_ns", "temperature_c"];
        let log = SensorModel { dark_lux: 0.5, readout_event_ns: 5.0, ..SensorModel::default() };
        let told = of_file(keys.into_iter(), &log).unwrap();
        assert!(told.starts_with("`dark_lux` does nothing"), "{told}");
        let two = SensorModel { temperature_c: 40.0, ..log.clone() };
        assert!(
            of_file(keys.into_iter(), &two).unwrap().starts_with("`dark_lux`, `temperature_c` do nothing")
        );
        assert_eq!(of_file(keys.into_iter(), &SensorModel { pixel: Pixel::Physical, ..log }), None);
        assert_eq!(of_file(keys.into_iter(), &SensorModel::default()), None);
    }
}
