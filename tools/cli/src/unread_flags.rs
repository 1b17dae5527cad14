//! Flags that were given and do nothing, because the chosen pixel or effect does not read them.

use crate::frame_folder::FrameFolder;
use crate::motion_convention::MotionConvention;
use crate::sensor_flags::{SensorFlags, flag};
use crate::simulate::SimulateArguments;
use crate::stderr;
use esaac_model::{PARAMETERS, Pixel, ReadoutKind, SensorModel};

/// Parameters that only the log pixel reads.
const LOG: [&str; 2] = ["shot_noise_rate_hz", "log_offset"];

/// How the model's list marks parameters that only the physical pixel reads.
const PHYSICAL_MARK: &str = "Physical: ";

/// Warns of flags that `sensor`, which they made, does not read.
pub fn warn_of_sensor(flags: &SensorFlags, sensor: &SensorModel) {
    of_sensor(flags, sensor).iter().for_each(|(flag, why)| warn(flag, why));
}

/// Warns of flags that the frames of a folder do not need.
pub fn warn_of_folder(arguments: &SimulateArguments, folder: &FrameFolder) {
    let (has_poses, has_motion) = (folder.scene.is_some(), folder.layout.motion.is_some());
    of_folder(arguments, has_poses, has_motion).iter().for_each(|(flag, why)| warn(flag, why));
}

fn warn(flag: &str, why: &str) {
    stderr::line(format_args!("warning: --{flag} does nothing: {why}"));
}

fn of_sensor(flags: &SensorFlags, sensor: &SensorModel) -> Vec<(String, &'static str)> {
    let mut unread: Vec<(String, &'static str)> = Vec::new();
    if sensor.pixel == Pixel::Log {
        let light = flags.light.given();
        unread.extend(light.map(|name| (name.to_owned(), "it is for --pixel physical alone")));
    }
    let parameters = flags.explicit.iter().map(|(name, _)| *name);
    unread.extend(parameters.filter_map(|name| Some((flag(name), why_unread(name, sensor)?))));
    unread
}

/// Why `sensor` does not read a parameter, if it does not.
fn why_unread(parameter: &str, sensor: &SensorModel) -> Option<&'static str> {
    let is_physical =
        PARAMETERS.iter().any(|known| known.name == parameter && known.about.starts_with(PHYSICAL_MARK));
    let unread = match parameter {
        _ if is_physical => (sensor.pixel == Pixel::Log, "it is for --pixel physical alone"),
        _ if LOG.contains(&parameter) => {
            (sensor.pixel == Pixel::Physical, "the physical pixel does not read it")
        }
        "flicker_hz" | "flicker_phase_deg" => (sensor.flicker_depth == 0.0, "--flicker-depth is 0"),
        "aps_start_ns" | "aps_gain" | "aps_bits" => (sensor.aps_exposure_ns == 0, "--aps-exposure-ns is 0"),
        _ => (parameter.starts_with("readout_") && sensor.readout == ReadoutKind::None, "--readout is none"),
    };
    unread.0.then_some(unread.1)
}

fn of_folder(
    arguments: &SimulateArguments,
    has_poses: bool,
    has_motion: bool,
) -> Vec<(&'static str, &'static str)> {
    let (no_poses, no_motion) = ("the folder has no poses", "the frames have no motion vectors");
    let turns = arguments.motion_convention != MotionConvention::default();
    [
        (!has_poses && arguments.depth_channel.is_some(), "depth-channel", no_poses),
        (!has_poses && arguments.id_channel.is_some(), "id-channel", no_poses),
        (!has_motion && turns, "motion-convention", no_motion),
        (!has_motion && arguments.motion_y.is_some(), "motion-y", no_motion),
    ]
    .into_iter()
    .filter_map(|(is_unread, flag, why)| is_unread.then_some((flag, why)))
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command_line::{Arguments, Command};
    use clap::Parser;

    fn simulate(flags: &[&str]) -> SimulateArguments {
        let words = [&["esaac", "simulate", "in"], flags].concat();
        match Arguments::try_parse_from(words).unwrap().command {
            Command::Simulate(simulate) => *simulate,
            other => panic!("{other:?}"),
        }
    }

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
    }

    #[test]
    fn flags_of_channels_that_are_not_used_are_told() {
        let flags =
            simulate(&["--depth-channel", "Z", "--id-channel", "id", "--motion-convention", "negated"]);
        let unread = |has_poses, has_motion| -> Vec<&str> {
            of_folder(&flags, has_poses, has_motion).into_iter().map(|(flag, _)| flag).collect()
        };
        assert_eq!(unread(false, false), ["depth-channel", "id-channel", "motion-convention"]);
        assert!(unread(true, true).is_empty());
        let plain = simulate(&["--motion-convention", "previous"]);
        assert!(of_folder(&plain, false, false).is_empty());
        assert_eq!(of_folder(&simulate(&["--motion-y", "up"]), false, false)[0].0, "motion-y");
    }
}
