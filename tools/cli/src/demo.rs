//! `esaac demo`: a built-in scene rendered, simulated, measured against its exact events and drawn.

use crate::arguments::CommonArguments;
use crate::event_file::write_npz;
use crate::frame_folder::frame_time_ns;
use crate::kernel_source::{KernelArguments, KernelSource};
use crate::link_report::LinkReport;
use crate::outcome::Outcome;
use crate::overview::{self, Caption, Instant};
use crate::pace::Pace;
use crate::render_process::RenderProcess;
use crate::report::{MemoryReport, Report};
use crate::rig_file::{DEFAULT_SLOTS, RigPlan};
use crate::ros::{self, RosArguments, RosMode, RosOutput};
use crate::run_record::RunRecord;
use crate::sensor_flags::SensorFlags;
use crate::{accuracy, colour, device_choice, output_file, progress, report};
use anyhow::{Context, Result, ensure};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use esaac_engine::ash::vk;
use esaac_engine::{ApsFrame, Buffer, CameraConfig, Device, InputBuffers, MemoryLocation, Rig, Tick};
use esaac_interop::{ServerOptions, Service};
use esaac_model::presets::preset;
use esaac_model::{DepthFormat, HdrFormat, Intensity, MotionFormat, SensorModel};
use esaac_ros::{CameraPlan, Summary};
use esaac_scene::renderer::{Renderer, Targets};
use esaac_scene::{Scene, SceneKind, render_cpu};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Rate of the rendered frames.
pub const RATE_HZ: f64 = 30.0;

/// Rows of the overview.
const INSTANTS: usize = 4;

/// Formats of what is rendered.
const HDR: HdrFormat = HdrFormat::F16x4;
const MOTION: MotionFormat = MotionFormat::F32x2;

/// Arguments of `demo`.
#[derive(clap::Args, Clone, Debug)]
pub struct DemoArguments {
    /// Scene to render
    #[arg(long, value_name = "NAME", default_value = "flight", value_parser = scene_parser())]
    pub scene: SceneKind,
    /// Frames to render
    #[arg(long, default_value_t = 21, value_parser = clap::value_parser!(u32).range(2..=100_000))]
    pub frames: u32,
    /// Folder for overview.png, events.npz and report.json
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub out: PathBuf,
    /// Render in this process instead of in another
    #[arg(long)]
    pub in_process: bool,
    /// Wait for the wall clock, so that one can watch
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

/// Scenes by name, with what each shows.
pub fn scene_parser() -> impl TypedValueParser<Value = SceneKind> {
    PossibleValuesParser::new(SceneKind::ALL.map(|kind| PossibleValue::new(kind.name()).help(kind.about())))
        .try_map(|name| name.parse::<SceneKind>())
}

/// Runs the command.
pub fn run(arguments: &DemoArguments, common: &CommonArguments) -> Result<Outcome> {
    let mut kernels = KernelSource::open(&arguments.kernels)?;
    let out = &arguments.out;
    std::fs::create_dir_all(out).with_context(|| format!("cannot make folder {}", out.display()))?;
    let [picture, events, json] = ["overview.png", "events.npz", "report.json"].map(|name| out.join(name));
    for path in [&picture, &events, &json] {
        output_file::check(path)?;
    }
    let sensors = sensors(arguments)?;
    let run = Run::new(arguments, &sensors);
    // Before all that takes time, so that subscribers have found the topics when the first packet comes.
    let ros = RosOutput::open(&arguments.ros, RosMode::Auto, run.ros_cameras())?;
    let device = device_choice::open(common)?;
    let simulated = if arguments.in_process {
        run.in_process(&device, &mut kernels, arguments, ros)?
    } else {
        run.over_the_link(&device, &mut kernels, arguments, common, ros)?
    };
    device_choice::check_validation(&device)?;

    let record = &simulated.record;
    let input = format!("scene {}, {} frames at {RATE_HZ} Hz", arguments.scene.name(), run.times_ns.len());
    let info = device_choice::report(device.info());
    let mut report = Report::new(input, info, &sensors, record);
    let span_ns = (run.times_ns[0], run.times_ns[run.times_ns.len() - 1]);
    report.simulated_ns = span_ns.1 - span_ns.0;
    report.set_memory(simulated.memory);
    report.link = simulated.link;
    report.ros = simulated.ros;
    if simulated.sensors_changed {
        eprintln!("sensors were changed as it ran: there are no exact events to compare with");
    }
    for (camera, sensor) in sensors.iter().enumerate().filter(|_| !simulated.sensors_changed) {
        let events = &record.cameras[camera].events;
        report.cameras[camera].accuracy = Some(accuracy::against_exact(&run.scene, sensor, events, span_ns));
    }
    let recording = arguments.ros.record.as_ref();
    report.files = [&picture, &events, &json]
        .into_iter()
        .chain(recording)
        .map(|path| path.display().to_string())
        .collect();

    let size = (sensors[0].width as usize, sensors[0].height as usize);
    let overview = overview::draw(&caption(&report, arguments.scene), size, &simulated.instants);
    output_file::write(&picture, |out| overview.write_png(out))?;
    output_file::write(&events, |out| write_npz(out, &record.cameras[0].events, &sensors[0].to_toml()))?;
    let text = report.to_json()?;
    output_file::write(&json, |out| Ok(out.write_all(text.as_bytes())?))?;
    report.outcome(common.json)
}

/// The sensor asked for, with an APS frame unless its exposure was given, and its colour or gray twin.
fn sensors(arguments: &DemoArguments) -> Result<[SensorModel; 2]> {
    let mut sensor = arguments.sensor.resolve(preset("davis346").expect("a preset"))?.sensor;
    let given = |name: &str| arguments.sensor.explicit.iter().any(|(parameter, _)| *parameter == name);
    if sensor.aps_exposure_ns == 0 && !given("aps_exposure_ns") {
        sensor.aps_exposure_ns = 10_000_000;
        if !given("aps_start_ns") {
            // It ends with the frame, so that both have one stamp.
            sensor.aps_start_ns = (1e9 / RATE_HZ).ceil() as u32 - sensor.aps_exposure_ns;
        }
    }
    if !given("aps_gain") {
        let frame = render_cpu(&arguments.scene.scene(sensor.width, sensor.height), 0, None, HDR, MOTION);
        let gain = colour::exposure(colours(&frame.hdr).map(colour::luminance)) * APS_KEY;
        let gain = f64::from(gain) * sensor.white_level / sensor.exposure_gain;
        // Three digits do, and read better in the sensor's file.
        sensor.aps_gain = format!("{gain:.2e}").parse::<f64>()?.clamp(1e-6, 1e6);
    }
    sensor.validate()?;
    let intensity = match sensor.intensity {
        Intensity::BayerRggb => Intensity::Luminance,
        Intensity::Gray | Intensity::Luminance => Intensity::BayerRggb,
    };
    Ok([sensor.clone(), SensorModel { intensity, ..sensor }])
}

/// Brightness of the APS frame relative to middle gray's.
const APS_KEY: f32 = 1.2;

struct Run<'a> {
    scene: Scene,
    sensors: &'a [SensorModel; 2],
    times_ns: Vec<i64>,
    /// Frames that the overview shows.
    shown: Vec<usize>,
}

struct Simulated {
    record: RunRecord,
    sensors_changed: bool,
    link: LinkReport,
    ros: Option<Summary>,
    memory: Vec<MemoryReport>,
    instants: Vec<Instant>,
}

impl<'a> Run<'a> {
    fn new(arguments: &DemoArguments, sensors: &'a [SensorModel; 2]) -> Self {
        let frames = arguments.frames as usize;
        let mut shown: Vec<usize> = (1..=INSTANTS).map(|i| ((frames - 1) * i / INSTANTS).max(1)).collect();
        shown.dedup();
        Run {
            scene: arguments.scene.scene(sensors[0].width, sensors[0].height),
            sensors,
            times_ns: (0..frames).map(|k| frame_time_ns(k, RATE_HZ)).collect(),
            shown,
        }
    }

    fn plan(&self) -> RigPlan {
        let mut plan = RigPlan::default();
        for (camera, sensor) in (0..).zip(self.sensors) {
            let config = CameraConfig { sensor: sensor.clone(), camera, hdr: HDR, motion: Some(MOTION) };
            plan.push(config, DEFAULT_SLOTS, false);
        }
        plan
    }

    /// What is published of each camera: all that the scene knows.
    fn ros_cameras(&self) -> Vec<CameraPlan> {
        let (scene, sensors) = (&self.scene, self.sensors);
        let plan = |sensor: &SensorModel| {
            let name = if sensor.intensity == Intensity::BayerRggb { "bayer" } else { "gray" };
            CameraPlan {
                intrinsics: Some(ros::centred(scene.focal_px, scene.width_px, scene.height_px)),
                image: true,
                depth: true,
                imu: true,
                ..ros::camera(name.to_owned(), sensor)
            }
        };
        sensors.iter().map(plan).collect()
    }

    /// Renders into the rig's own buffers.
    fn in_process(
        &self,
        device: &Arc<Device>,
        kernels: &mut KernelSource,
        arguments: &DemoArguments,
        ros: RosOutput,
    ) -> Result<Simulated> {
        let mut rig = Rig::with_options(device, &self.plan().cameras, report::rig_options())?;
        kernels.load(&mut rig)?;
        let mut renderer = Renderer::new(device, self.scene.clone(), HDR, MOTION)?;
        let mut collected = Collected::new(self, device, ros)?;
        let mut pace = Pace::new(arguments.real_time);
        let progress = progress::bar(self.times_ns.len());
        for (index, &t_ns) in self.times_ns.iter().enumerate() {
            pace.wait(t_ns);
            let previous_ns = index.checked_sub(1).map(|before| self.times_ns[before]);
            for camera in 0..rig.len() {
                let InputBuffers { hdr, motion, .. } = rig.inputs(camera)?;
                renderer.render(t_ns, previous_ns, Targets { hdr, motion, depth: None })?;
            }
            kernels.refresh(&mut rig, &progress);
            collected.change_sensors(&mut rig);
            collected.add(self, index, &rig.step(&[t_ns; 2])?)?;
            progress.inc(1);
        }
        progress.finish_and_clear();
        let frames = (self.times_ns.len() * rig.len()) as u64;
        collected.finish(LinkReport::in_process(frames), MemoryReport::of(&rig))
    }

    /// Has another process render into shared memory, as `esaac serve` and `esaac render` do.
    fn over_the_link(
        &self,
        device: &Arc<Device>,
        kernels: &mut KernelSource,
        arguments: &DemoArguments,
        common: &CommonArguments,
        ros: RosOutput,
    ) -> Result<Simulated> {
        let plan = self.plan();
        let mut rig = Rig::with_options(device, &plan.cameras, report::rig_options())?;
        kernels.load(&mut rig)?;
        let folder = tempfile::tempdir().context("no folder for the socket")?;
        let socket = folder.path().join("engine.sock");
        // Both cameras' frames are of the same instants.
        let options = ServerOptions { gather: PATIENCE, ..ServerOptions::default() };
        let mut service = Service::open(rig, &socket, &plan.terms, options)
            .context("two processes cannot share this device's memory; --in-process needs none")?;
        let mut renderer = RenderProcess::start(&socket, arguments, device, common)?;
        let mut collected = Collected::new(self, device, ros)?;
        let mut pace = Pace::new(arguments.real_time);
        let progress = progress::bar(self.times_ns.len());
        for (index, &t_ns) in self.times_ns.iter().enumerate() {
            pace.wait(t_ns);
            kernels.refresh(service.rig_mut(), &progress);
            collected.change_sensors(service.rig_mut());
            loop {
                if let Some(tick) = service.tick(LOOK)? {
                    ensure!(
                        tick.t_ns == [Some(t_ns); 2],
                        "frame {index} came at {:?} ns, expected {t_ns} for both cameras",
                        tick.t_ns
                    );
                    collected.add(self, index, &tick.tick)?;
                    break;
                }
                renderer.check_alive(&service.server().notices())?;
            }
            progress.inc(1);
        }
        progress.finish_and_clear();
        renderer.finish()?;
        collected.finish(LinkReport::of(service.server()), MemoryReport::of(service.rig()))
    }

    fn instant(&self, t_ns: i64, picture: &Picture, tick: &Tick<'_>) -> Instant {
        let bayer =
            self.sensors.iter().position(|s| s.intensity == Intensity::BayerRggb).expect("one of two");
        Instant {
            t_ns,
            rgb: colours(picture.hdr.read(0, picture.pixels * HDR.texel_bytes())).collect(),
            aps: tick.aps[1 - bayer].as_ref().map(aps_levels),
            gray: tick.packets[1 - bayer].clone(),
            bayer: tick.packets[bayer].clone(),
            depth_m: picture.depth.read(0, picture.pixels).to_vec(),
        }
    }
}

/// How long the link waits between looks whether the renderer lives.
const LOOK: Duration = Duration::from_millis(100);

/// How long one camera's frame waits for the other's.
const PATIENCE: Duration = Duration::from_secs(60);

/// What a run gathers tick by tick.
struct Collected {
    renderer: Renderer,
    picture: Picture,
    record: RunRecord,
    sensors: [SensorModel; 2],
    sensors_changed: bool,
    ros: RosOutput,
    exposure: Option<f32>,
    instants: Vec<Instant>,
}

impl Collected {
    fn new(run: &Run<'_>, device: &Arc<Device>, ros: RosOutput) -> Result<Self> {
        Ok(Collected {
            renderer: Renderer::new(device, run.scene.clone(), HDR, MOTION)?,
            picture: Picture::new(device, &run.scene)?,
            record: RunRecord::new(run.sensors.len()),
            sensors: run.sensors.clone(),
            sensors_changed: false,
            ros,
            exposure: None,
            instants: Vec::new(),
        })
    }

    fn change_sensors(&mut self, rig: &mut Rig) {
        self.sensors_changed |= self.ros.change_sensors(rig, &mut self.sensors);
    }

    fn add(&mut self, run: &Run<'_>, index: usize, tick: &Tick<'_>) -> Result<()> {
        if index > 0 {
            self.record.add_tick(tick)?;
        }
        let t_ns = run.times_ns[index];
        if run.shown.contains(&index) || self.ros.is_open() {
            self.picture.render(&mut self.renderer, t_ns)?;
        }
        self.publish(run, index, tick);
        if run.shown.contains(&index) {
            self.instants.push(run.instant(t_ns, &self.picture, tick));
        }
        Ok(())
    }

    /// Everything of a frame, to ROS 2; the first frame has no packet yet.
    fn publish(&mut self, run: &Run<'_>, index: usize, tick: &Tick<'_>) {
        if !self.ros.is_open() {
            return;
        }
        let Picture { pixels, hdr, depth } = &self.picture;
        let hdr = hdr.read(0, pixels * HDR.texel_bytes());
        let exposure =
            *self.exposure.get_or_insert_with(|| colour::exposure(colours(hdr).map(colour::luminance)));
        let rgb: Vec<u8> = colours(hdr).flat_map(|c| colour::tone_map(c, exposure)).collect();
        let t_ns = run.times_ns[index];
        let imu = |t_ns: i64| {
            let sample = run.scene.camera_state(esaac_scene::scene::seconds(t_ns)).imu();
            [sample.angular_rate_rad_s.to_array(), sample.specific_force_m_s2.to_array()]
        };
        let samples = index.checked_sub(1).map(|i| ros::imu_samples(run.times_ns[i], t_ns, imu));
        self.ros.tick(t_ns, |out| {
            for (camera, sensor) in self.sensors.iter().enumerate() {
                if let Some(samples) = &samples {
                    ros::add_camera(out, camera, sensor, &tick.packets[camera], tick.aps[camera].as_ref());
                    out.imu(camera, samples);
                }
                out.rgb(camera, |pixels| pixels.extend_from_slice(&rgb));
                out.depth(camera, depth.read(0, *pixels));
            }
        });
    }

    fn finish(self, link: LinkReport, memory: Vec<MemoryReport>) -> Result<Simulated> {
        let ros = self.ros.finish()?;
        Ok(Simulated {
            record: self.record,
            sensors_changed: self.sensors_changed,
            link,
            ros,
            memory,
            instants: self.instants,
        })
    }
}

/// Colour and depth of a frame where the host can read them.
struct Picture {
    pixels: usize,
    hdr: Buffer,
    depth: Buffer,
}

impl Picture {
    fn new(device: &Arc<Device>, scene: &Scene) -> Result<Self> {
        let pixels = scene.width_px as usize * scene.height_px as usize;
        let allocate = |name: &str, texel_bytes: usize| {
            let bytes = (pixels * texel_bytes) as u64;
            device.allocate(name, bytes, vk::BufferUsageFlags::empty(), MemoryLocation::GpuToCpu)
        };
        Ok(Picture {
            pixels,
            hdr: allocate("overview colour", HDR.texel_bytes())?,
            depth: allocate("overview depth", DepthFormat::F32.texel_bytes())?,
        })
    }

    fn render(&mut self, renderer: &mut Renderer, t_ns: i64) -> Result<()> {
        let targets = Targets { hdr: &self.hdr, motion: None, depth: Some(&self.depth) };
        Ok(renderer.render(t_ns, None, targets)?)
    }
}

fn colours(hdr: &[u8]) -> impl Iterator<Item = [f32; 3]> + '_ {
    let pixels = hdr.len() / HDR.texel_bytes();
    (0..pixels).map(|i| HDR.decode(hdr, i).map(|v| v as f32))
}

fn aps_levels(aps: &ApsFrame) -> Vec<f32> {
    let full = ((1_u32 << aps.bits) - 1) as f32;
    aps.pixels.iter().map(|&p| f32::from(p) / full).collect()
}

fn caption(report: &Report, scene: SceneKind) -> Caption {
    let sensor = &report.cameras[0].sensor;
    let [one, two] = [0, 1].map(|camera| thousands(report.cameras[camera].events));
    Caption {
        title: format!(
            "EsaacSim: {} \u{d7}{}, {}",
            sensor.name.to_uppercase(),
            sensor.substeps,
            scene.name()
        ),
        subtitle: format!(
            "{}\u{d7}{} px, {RATE_HZ} Hz frames, {one} and {two} events in {:.2} s, {:.2} ms GPU time per \
             interval on {}",
            sensor.width,
            sensor.height,
            report.simulated_ns as f64 * 1e-9,
            report.gpu.median_ns as f64 * 1e-6,
            report.device.name
        ),
    }
}

/// Digits in groups of three.
fn thousands(count: u64) -> String {
    let digits = count.to_string();
    let groups: Vec<&str> = digits
        .as_bytes()
        .rchunks(3)
        .rev()
        .map(|group| std::str::from_utf8(group).expect("digits are ASCII"))
        .collect();
    groups.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped_from_the_right() {
        assert_eq!([0, 999, 1000, 1_234_567].map(thousands), ["0", "999", "1 000", "1 234 567"]);
    }
}
