//! `esaac demo`: renders a built-in scene, simulates it, compares the events with the exact ones and draws an
//! overview.

mod caption;
mod collected;
mod picture;
mod run;

use crate::arguments::CommonArguments;
use crate::interrupt::{self, Interrupt};
use crate::kernel_source::{KernelArguments, KernelSource};
use crate::link_report::LinkReport;
use crate::outcome::Outcome;
use crate::overview::{self, Instant};
use crate::report::{MemoryReport, Report};
use crate::ros::{Published, RosArguments, RosMode, RosOutput};
use crate::run_record::RunRecord;
use crate::scene_argument::scene_parser;
use crate::sensor_flags::SensorFlags;
use crate::warnings::Warnings;
use crate::whole_argument::whole;
use crate::{accuracy, colour, device_choice, output_file, pixel_notes, stderr, unread_flags};
use anyhow::Result;
use caption::caption;
use esaac_formats::event_file::write_npz;
use esaac_model::presets::preset;
use esaac_model::{HdrFormat, Intensity, MotionFormat, SensorModel};
use esaac_scene::{SceneKind, render_cpu};
use picture::colours;
use run::Run;
use std::path::PathBuf;

/// Rate of the rendered frames.
pub const RATE_HZ: f64 = 30.0;

/// Formats of the rendered images.
const HDR: HdrFormat = HdrFormat::F16x4;
const MOTION: MotionFormat = MotionFormat::F32x2;

/// Arguments of `demo`.
#[derive(clap::Args, Clone, Debug)]
pub struct DemoArguments {
    /// Scene to render
    #[arg(long, value_name = "NAME", default_value = "flight", value_parser = scene_parser())]
    pub scene: SceneKind,
    /// Frames to render
    #[arg(long, default_value_t = 21, value_parser = whole(2, 100_000))]
    pub frames: u32,
    /// Folder for overview.png, events.npz and report.json
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub out: PathBuf,
    /// Render in this process instead of a second one
    #[arg(long)]
    pub in_process: bool,
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

/// Runs the command.
pub fn run(arguments: &DemoArguments, common: &CommonArguments) -> Result<Outcome> {
    let mut kernels = KernelSource::open(&arguments.kernels)?;
    let out = &arguments.out;
    output_file::make_folder(out)?;
    let [picture, events, json] = ["overview.png", "events.npz", "report.json"].map(|name| out.join(name));
    for path in [&picture, &events, &json] {
        output_file::check(path)?;
    }
    let mut warnings = Warnings::default();
    let (sensors, notes) = sensors(arguments, &mut warnings)?;
    let run = Run::new(arguments, &sensors);
    // First, so that subscribers have found the topics before the first packet.
    let ros = RosOutput::open(&arguments.ros, RosMode::Auto, run.ros_cameras(), &mut warnings)?;
    let device = device_choice::open(common)?;
    let simulated = if arguments.in_process {
        run.in_process(&device, &mut kernels, arguments, ros)?
    } else {
        run.over_the_link(&device, &mut kernels, arguments, common, ros)?
    };
    device_choice::check_validation(&device)?;

    let record = &simulated.record;
    let intervals = record.submit_to_packet_ns.len();
    let expected = run.times_ns.len() - 1;
    let interrupted = interrupt::tell(intervals, expected);
    let input = format!("scene {}, {} frames at {RATE_HZ} Hz", arguments.scene.name(), intervals + 1);
    let info = device_choice::report(device.info());
    let mut report = Report::new(input, info, &sensors, record);
    (report.intervals_expected, report.interrupted) = (Some(expected), interrupted);
    report.cameras.iter_mut().for_each(|camera| camera.notes.clone_from(&notes));
    report.warnings = warnings;
    let span_ns = (run.times_ns[0], run.times_ns[intervals]);
    report.simulated_ns = span_ns.1 - span_ns.0;
    report.set_memory(simulated.memory);
    report.link = simulated.link;
    report.ros = simulated.ros.summary;
    if simulated.sensors_changed {
        stderr::line("the sensors changed during the run: no comparison with exact events");
    }
    if intervals == 0 {
        let is_recorded = report.ros.as_ref().is_some_and(|ros| ros.recorded() > 0);
        let recording = arguments.ros.record.iter().filter(|_| is_recorded);
        report.files = recording.map(|path| path.display().to_string()).collect();
        return Ok(report.outcome(common.json)?.with_recording(simulated.ros.recorded));
    }
    // The comparison takes as long as the run: who interrupts one does not wait for it.
    let compared = !(simulated.sensors_changed || interrupted);
    for (camera, sensor) in sensors.iter().enumerate().filter(|_| compared) {
        let events = &record.cameras[camera].events;
        let stop = || simulated.interrupt.came();
        let compared = accuracy::against_exact(&run.scene, sensor, events, span_ns, stop);
        if compared.is_none() {
            stderr::line("interrupted: no comparison with exact events");
            report.interrupted = true;
            break;
        }
        report.cameras[camera].accuracy = compared;
    }
    let recording = arguments.ros.record.as_ref();
    // A run that was interrupted early has no frame to show.
    let picture = (!simulated.instants.is_empty()).then_some(&picture);
    report.files = picture
        .into_iter()
        .chain([&events, &json])
        .chain(recording)
        .map(|path| path.display().to_string())
        .collect();

    if let Some(picture) = picture {
        let size = (sensors[0].width as usize, sensors[0].height as usize);
        let overview = overview::draw(&caption(&report, arguments.scene), size, &simulated.instants);
        output_file::write(picture, |out| overview.write_png(out))?;
    }
    output_file::write(&events, |out| write_npz(out, &record.cameras[0].events, &sensors[0].to_toml()))?;
    report.warn_of_losses();
    let text = report.to_json()?;
    output_file::write(&json, |out| Ok(out.write_all(text.as_bytes())?))?;
    Ok(report.outcome(common.json)?.with_recording(simulated.ros.recorded))
}

/// The chosen sensor, and the same with the other kind of intensity (colour or gray). Both have APS frames
/// unless the flags set the exposure. With what is assumed of them.
fn sensors(arguments: &DemoArguments, warnings: &mut Warnings) -> Result<([SensorModel; 2], Vec<String>)> {
    let resolved = arguments.sensor.resolve(preset("davis346").expect("a preset"))?;
    let notes = pixel_notes::of(&resolved.sensor, resolved.light_is_given, pixel_notes::BY_FLAGS);
    let mut sensor = resolved.sensor;
    // Before a scene of its size is drawn.
    sensor.validate()?;
    let given = |name: &str| arguments.sensor.explicit.iter().any(|(parameter, _)| *parameter == name);
    if sensor.aps_exposure_ns == 0 && !given("aps_exposure_ns") {
        sensor.aps_exposure_ns = 10_000_000;
        if !given("aps_start_ns") {
            // The exposure ends with the frame, so that both have the same stamp.
            sensor.aps_start_ns = (1e9 / RATE_HZ).ceil() as u32 - sensor.aps_exposure_ns;
        }
    }
    if !given("aps_gain") {
        let frame = render_cpu(&arguments.scene.scene(sensor.width, sensor.height), 0, None, HDR, MOTION);
        let gain = colour::exposure(colours(&frame.hdr).map(colour::luminance)) * APS_KEY;
        let gain = f64::from(gain) * sensor.white_level / sensor.exposure_gain;
        // Three digits are enough, and easy to read in the sensor's file.
        sensor.aps_gain = format!("{gain:.2e}").parse::<f64>()?.clamp(1e-6, 1e6);
    }
    sensor.validate()?;
    // The frames have motion vectors.
    sensor.synthesis = sensor.synthesis.resolve(false, true);
    unread_flags::warn_of_sensor(warnings, &arguments.sensor, &resolved.file_keys, &sensor);
    let intensity = match sensor.intensity {
        Intensity::BayerRggb => Intensity::Luminance,
        _ => Intensity::BayerRggb,
    };
    Ok(([sensor.clone(), SensorModel { intensity, ..sensor }], notes))
}

/// Brightness of the APS frame relative to middle gray's.
const APS_KEY: f32 = 1.2;

/// The results of a run.
struct Simulated {
    record: RunRecord,
    sensors_changed: bool,
    link: LinkReport,
    ros: Published,
    memory: Vec<MemoryReport>,
    instants: Vec<Instant>,
    interrupt: Interrupt,
}
