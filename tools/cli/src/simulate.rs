//! `esaac simulate`: turns a folder of OpenEXR frames into an event file.

use crate::arguments::CommonArguments;
use crate::event_output::EventOutput;
use crate::frame_channels::AskedChannels;
use crate::frame_folder::{FolderOptions, FrameFolder};
use crate::interrupt::{self, Interrupt};
use crate::kernel_source::{KernelArguments, KernelSource};
use crate::link_report::LinkReport;
use crate::motion_convention::{MotionConvention, VerticalAxis};
use crate::outcome::Outcome;
use crate::pace::Pace;
use crate::rate_argument::rate;
use crate::report::{KeyRate, MemoryReport, Report};
use crate::ros::{self, RosArguments, RosMode, RosOutput};
use crate::run_record::RunRecord;
use crate::scene_check::SceneCheck;
use crate::sensor_flags::{ResolvedSensor, SensorFlags};
use crate::synthesis_choice::SynthesisChoice;
use crate::warnings::Warnings;
use crate::{colour, device_choice, output_file, pixel_notes, progress, report, stderr, unread_flags};
use anyhow::{Result, ensure};
use bytemuck::{cast_slice, pod_collect_to_vec as cast_to_vec};
use esaac_engine::{CameraConfig, Device, FrameBytes, GeometryConfig, Representation, Rig};
use esaac_formats::exr_frame::FrameLayout;
use esaac_model::input::InputCheck;
use esaac_model::paths::SceneMotion;
use esaac_model::{CUSTOM, DepthFormat, IdFormat, SensorModel, Synthesis};
use esaac_ros::CameraPlan;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

/// Arguments of `simulate`.
#[derive(clap::Args, Clone, Debug)]
pub struct SimulateArguments {
    /// Folder of OpenEXR frames
    pub input: PathBuf,
    /// Event file to write, as its name ends: .npz, .raw (EVT3) or .aedat4
    #[arg(long, value_name = "FILE", default_value = "events.npz")]
    pub out: PathBuf,
    /// Key frames per second [default: key_rate_hz of sequence.json, else 30]
    #[arg(long, value_name = "HZ", value_parser = rate, allow_negative_numbers = true)]
    pub rate: Option<f64>,
    /// Names of the key frames; may contain *, ? and [...] [default: key_*.exr, else *.exr]
    #[arg(long, value_name = "PATTERN")]
    pub frames: Option<String>,
    /// Channels of linear red, green and blue, by whole names or their ends after a dot [default: R,G,B, else Blender's]
    #[arg(long, value_name = "R,G,B")]
    pub colour_channels: Option<NameList<3>>,
    /// Channels of motion [default: motion.X,motion.Y, else Blender's]
    #[arg(long, value_name = "X,Y")]
    pub motion_channels: Option<NameList<2>>,
    /// Meaning of a motion vector [default: blender for Blender's vector pass, else previous]
    #[arg(long, value_enum)]
    pub motion_convention: Option<MotionConvention>,
    /// Direction of a motion vector's y [default: follows from the convention]
    #[arg(long, value_enum)]
    pub motion_y: Option<VerticalAxis>,
    /// Channel of depth, metres [default: depth.Z, else Blender's, if the folder has poses]
    #[arg(long, value_name = "NAME")]
    pub depth_channel: Option<String>,
    /// Channel of instance ids, whole numbers [default: id, else Blender's, if the folder has poses]
    #[arg(long, value_name = "NAME")]
    pub id_channel: Option<String>,
    /// Also write the instance that each event shows (array `id` of .npz), and publish it where ROS 2 is on; needs ids, depth
    /// and poses
    #[arg(long)]
    pub event_ids: bool,
    /// Simulate at the wall clock's speed, so that you can watch
    #[arg(long)]
    pub real_time: bool,
    /// ROS 2.
    #[command(flatten)]
    pub ros: RosArguments,
    /// Sensor parameters.
    #[command(flatten)]
    pub sensor: SensorFlags,
    /// Kernels.
    #[command(flatten)]
    pub kernels: KernelArguments,
}

/// `N` names, separated by commas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NameList<const N: usize>(pub [String; N]);

impl<const N: usize> FromStr for NameList<N> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names: Vec<String> = text.split(',').map(str::to_owned).collect();
        let count = names.len();
        let names =
            names.try_into().map_err(|_| format!("{count} names, expected {N} with commas between"))?;
        Ok(NameList(names))
    }
}

/// Runs the command.
pub fn run(arguments: &SimulateArguments, common: &CommonArguments) -> Result<Outcome> {
    let mut kernels = KernelSource::open(&arguments.kernels)?;
    let resolved =
        arguments.sensor.resolve(SensorModel { name: CUSTOM.to_owned(), ..SensorModel::default() })?;
    let notes = pixel_notes::of(&resolved.sensor, resolved.light_is_given, pixel_notes::BY_FLAGS);
    let events = EventOutput::new(&arguments.out)?;
    let recording = arguments.ros.record.as_deref();
    let outputs: Vec<&Path> = [arguments.out.as_path()].into_iter().chain(recording).collect();
    output_file::check_apart(&outputs, &[])?;
    let folder = FrameFolder::open(&arguments.input, &arguments.folder_options())?;
    let mut sensor = fit(&resolved, &folder)?;
    sensor.validate()?;
    events.check_size(&sensor)?;
    let mut warnings = Warnings::default();
    let (has_poses, has_motion) = (folder.scene.is_some(), folder.layout.motion.is_some());
    for (flag, why) in flags_of_frames(arguments, has_poses, has_motion) {
        unread_flags::warn(&mut warnings, flag, why);
    }
    let check = SceneCheck::of(&folder)?;
    let choice = SynthesisChoice::new(sensor.synthesis, &folder, check.as_ref())?;
    sensor.synthesis = choice.used;
    unread_flags::warn_of_sensor(&mut warnings, &arguments.sensor, &resolved.file_keys, &sensor);
    if arguments.event_ids {
        check_event_ids(&sensor, &folder)?;
        events.check_ids()?;
    }

    let lens = folder.scene.as_ref().map(|scene| *scene.motion.lens());
    let depth = folder.layout.depth.is_some();
    let event_ids = arguments.event_ids;
    let camera =
        CameraPlan { image: true, depth, event_ids, ..ros::camera("camera_0".to_owned(), &sensor, lens) };
    let mut ros = RosOutput::open(&arguments.ros, RosMode::Off, vec![camera], &mut warnings)?;
    if !ros.is_open() {
        unread_flags::warn_of_aps(&mut warnings, &arguments.sensor, &sensor);
    }
    let device = device_choice::open(common)?;
    let pace = Pace::new(arguments.real_time);
    let mut input_check = InputCheck::new(&sensor, folder.layout.hdr, folder.layout.motion)
        .advising(choice.advice)
        .with_grain(&sensor);
    let source = Source { geometry: geometry(&folder, &choice), folder: &folder };
    let asked = Asked { sensor: &sensor, event_ids };
    let (record, memory, last) =
        simulate(&device, &source, &asked, &mut kernels, &mut ros, pace, &mut input_check)?;
    device_choice::check_validation(&device)?;
    if last != sensor {
        stderr::line("the sensor changed during the run: files and report have the last one");
        sensor = last;
    }

    let intervals = record.submit_to_packet_ns.len();
    let expected = folder.paths.len() - 1;
    let interrupted = interrupt::tell(intervals, expected);
    let camera = &record.cameras[0];
    // Without an interval an old file stays.
    let has_events = intervals > 0;
    if has_events {
        events.write(&camera.events, &sensor)?;
    }
    let input = arguments.input.display().to_string();
    let info = device_choice::report(device.info());
    let mut report = Report::new(input, info, std::slice::from_ref(&sensor), &record);
    (report.intervals_expected, report.interrupted) = (Some(expected), interrupted);
    report.simulated_ns = folder.time_ns(intervals);
    report.key_rate = Some(KeyRate { hz: folder.rate_hz, from: folder.rate_from });
    report.cameras[0].notes = notes;
    report.set_memory(memory);
    // The host decodes a frame and copies it into the engine's buffers.
    report.link = LinkReport { host_copies: 1.0, ..LinkReport::in_process(intervals as u64 + 1) };
    let published = ros.finish();
    // The first frame is recorded before there is an interval.
    let is_recorded = published.summary.as_ref().is_some_and(|summary| summary.recorded() > 0);
    report.ros = published.summary;
    let of_poses: Vec<String> = check
        .iter()
        .flat_map(|check| [choice.warning(check), choice.coarse_warning(check)])
        .flatten()
        .collect();
    let left_out = choice.left_out.clone();
    report.synthesis = Some(choice);
    report.poses = check.map(|check| check.report);
    report.input_check = input_check.report();
    let of_input = report.input_check.as_ref().and_then(|check| check.warning.clone());
    let of_camera =
        camera.frame_warning.iter().chain(&camera.path_warning).chain(&camera.light_warnings).cloned();
    let of_frames = folder.warnings.clone();
    let of_frames = of_frames.into_iter().chain(left_out).chain(of_poses).chain(of_input);
    warnings.tell_all(of_frames.chain(of_camera));
    let written = outputs.iter().zip([has_events, is_recorded]).filter(|(_, is_written)| *is_written);
    report.files = written.map(|(path, _)| path.display().to_string()).collect();
    report.warnings = warnings;
    report.warn_of_losses();
    let mut outcome = report.outcome(common.json)?.with_recording(published.recorded);
    if events.is_standard_output() {
        stderr::line(std::mem::take(&mut outcome.text).trim_end());
    }
    Ok(outcome)
}

impl SimulateArguments {
    fn folder_options(&self) -> FolderOptions {
        FolderOptions {
            pattern: self.frames.clone(),
            rate_hz: self.rate,
            channels: AskedChannels {
                colour: self.colour_channels.clone().map(|names| names.0),
                motion: self.motion_channels.clone().map(|names| names.0),
                depth: self.depth_channel.clone(),
                ids: self.id_channel.clone(),
            },
            motion_convention: self.motion_convention,
            motion_y: self.motion_y,
        }
    }
}

/// The sensor for these frames: it has their size.
fn fit(resolved: &ResolvedSensor, folder: &FrameFolder) -> Result<SensorModel> {
    let mut sensor = resolved.sensor.clone();
    let FrameLayout { width_px, height_px, .. } = folder.layout;
    match &resolved.size_from {
        None => (sensor.width, sensor.height) = (width_px, height_px),
        Some(origin) => ensure!(
            (sensor.width, sensor.height) == (width_px, height_px),
            "{origin} has {}x{} px but the frames in {} have {width_px}x{height_px} px; leave the size to the \
             frames or render them in the sensor's",
            sensor.width,
            sensor.height,
            folder.paths[0].parent().unwrap_or(&folder.paths[0]).display()
        ),
    }
    Ok(sensor)
}

/// The frames, and what the engine gets of their geometry.
struct Source<'a> {
    folder: &'a FrameFolder,
    geometry: Option<(GeometryConfig, SceneMotion)>,
}

/// What the engine gets of the folder's geometry for exact paths: its format, and the poses that are followed.
fn geometry(folder: &FrameFolder, choice: &SynthesisChoice) -> Option<(GeometryConfig, SceneMotion)> {
    let scene = folder.scene.as_ref().filter(|_| choice.used == Synthesis::Rigid)?;
    let ids = folder.layout.ids.as_ref().map(|_| IdFormat::U32);
    let mut motion = scene.motion.clone();
    scene.motion.ids().filter(|&id| !choice.trust.follows(id)).for_each(|id| motion.remove(id));
    Some((GeometryConfig { depth: DepthFormat::F32, ids, lens: *motion.lens() }, motion))
}

/// What is simulated.
struct Asked<'a> {
    sensor: &'a SensorModel,
    event_ids: bool,
}

/// Fails unless the frames tell the instances of events.
fn check_event_ids(sensor: &SensorModel, folder: &FrameFolder) -> Result<()> {
    ensure!(
        sensor.synthesis == Synthesis::Rigid,
        "--event-ids needs synthesis `rigid`, and this is `{}`: give depth, ids and poses",
        sensor.synthesis.name()
    );
    ensure!(
        folder.layout.ids.is_some(),
        "--event-ids needs instance ids, and the frames have no channel of them"
    );
    Ok(())
}

/// Simulates the frames. The sensor that comes back is the one at the end: ROS parameters may have changed it.
fn simulate(
    device: &Arc<Device>,
    Source { folder, geometry }: &Source<'_>,
    &Asked { sensor, event_ids }: &Asked<'_>,
    kernels: &mut KernelSource,
    ros: &mut RosOutput,
    mut pace: Pace,
    input_check: &mut InputCheck,
) -> Result<(RunRecord, Vec<MemoryReport>, SensorModel)> {
    let layout = &folder.layout;
    let camera = CameraConfig {
        sensor: sensor.clone(),
        camera: 0,
        hdr: layout.hdr,
        motion: layout.motion,
        geometry: geometry.as_ref().map(|(config, _)| *config),
    };
    let mut rig = Rig::with_options(device, &[camera], report::rig_options())?;
    let (mut sensors, mut changed) = ([sensor.clone()], false);
    kernels.load(&mut rig)?;
    if let Some((_, scene)) = geometry {
        rig.set_scene(0, scene.clone())?;
    }
    let mut record = RunRecord::new(1);
    let mut exposure = None;
    // Until here a signal ends the process at once, and nothing is lost.
    let interrupt = Interrupt::watch()?;
    let progress = progress::bar(folder.paths.len());
    for (index, images) in folder.decode().into_iter().enumerate() {
        if interrupt.came() {
            break;
        }
        let images = images?;
        input_check.add(folder.time_ns(index), &images.hdr, images.motion.as_deref());
        let [depth, ids] = [images.depth.as_deref().map(cast_slice), images.ids.as_deref().map(cast_slice)];
        let frame = FrameBytes { hdr: &images.hdr, motion: images.motion.as_deref(), depth, ids };
        rig.upload(0, &frame)?;
        kernels.refresh(&mut rig, &progress);
        pace.wait(folder.time_ns(index));
        changed |= ros.change_sensors(&mut rig, &mut sensors);
        let tick = rig.step(&[folder.time_ns(index)])?;
        if index > 0 {
            record.add_tick(&tick)?;
        }
        let told = &mut record.cameras[0];
        if told.frame_warning.is_none() {
            told.frame_warning = rig.frame_warning(0)?;
        }
        if told.path_warning.is_none() {
            told.path_warning = rig.path_warning(0)?;
        }
        let ids: Option<Vec<i64>> = match event_ids && index > 0 {
            true => Some(cast_to_vec(&rig.represent_to_host(Representation::EventIds)?)),
            false => None,
        };
        let tick = rig.last_tick();
        ros.tick(folder.time_ns(index), |out| {
            let colours = || (0..sensor.pixels()).map(|i| layout.hdr.decode(frame.hdr, i).map(|v| v as f32));
            let exposure =
                *exposure.get_or_insert_with(|| colour::exposure(colours().map(colour::luminance)));
            if index > 0 {
                ros::add_camera(out, 0, &sensors[0], &tick, ids.as_deref());
            }
            out.rgb(0, |pixels| pixels.extend(colours().flat_map(|c| colour::tone_map(c, exposure))));
            if let Some((depth_m, scene)) = images.depth.as_deref().zip(folder.scene.as_ref()) {
                out.depth(0, &ros::depth_along_axis(scene.motion.lens(), depth_m, sensor.width));
            }
        });
        if let Some(ids) = ids {
            record.cameras[0].add_ids(&ids);
        }
        ros.show_cameras(&record, &rig)?;
        progress.inc(1);
    }
    progress.finish_and_clear();
    ros.show_cameras_now(&record, &rig)?;
    let (expected, actual) = (folder.paths.len(), record.submit_to_packet_ns.len() + 1);
    ensure!(interrupt.came() || actual == expected, "decoding stopped after {actual} frames of {expected}");
    record.take_light(&rig)?;
    let [mut last] = sensors;
    if changed {
        last.synthesis = rig.synthesis(0)?;
    }
    Ok((record, MemoryReport::of(&rig), last))
}

/// Flags about frames that were given and do nothing, and why.
fn flags_of_frames(
    arguments: &SimulateArguments,
    has_poses: bool,
    has_motion: bool,
) -> Vec<(&'static str, &'static str)> {
    let (no_poses, no_motion) = ("the folder has no poses", "the frames have no motion vectors");
    let turns = arguments.motion_convention.is_some_and(|asked| asked != MotionConvention::default());
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
pub(crate) mod tests {
    use super::*;
    use crate::command_line::{Arguments, Command};
    use clap::Parser;

    /// Arguments as the command line has them.
    pub(crate) fn simulate(flags: &[&str]) -> SimulateArguments {
        let words = [&["esaac", "simulate", "in"], flags].concat();
        match Arguments::try_parse_from(words).unwrap().command {
            Command::Simulate(simulate) => *simulate,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn flags_of_channels_that_are_not_used_are_told() {
        let flags =
            simulate(&["--depth-channel", "Z", "--id-channel", "id", "--motion-convention", "negated"]);
        let unread = |has_poses, has_motion| -> Vec<&str> {
            flags_of_frames(&flags, has_poses, has_motion).into_iter().map(|(flag, _)| flag).collect()
        };
        assert_eq!(unread(false, false), ["depth-channel", "id-channel", "motion-convention"]);
        assert!(unread(true, true).is_empty());
        let plain = simulate(&["--motion-convention", "previous"]);
        assert!(flags_of_frames(&plain, false, false).is_empty());
        assert_eq!(flags_of_frames(&simulate(&["--motion-y", "up"]), false, false)[0].0, "motion-y");
    }
}
