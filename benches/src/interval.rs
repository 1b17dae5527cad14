//! What an interval costs: `cargo bench -p esaac-benches --bench interval -- [--json]`.
//!
//! Cameras fly through the analytic scene, rendered on the same device; the rig's own GPU time stamps
//! give the stages, the host's clock the time from submit to packet. Every row repeats its own first
//! half and second half, so that a difference between rows can be held against the spread within one.

use anyhow::Result;
use clap::Parser;
use esaac_engine::{
    Buffer, CameraConfig, Device, DeviceChoice, Kernel, MemoryLocation, Rig, RigOptions, Validation,
};
use esaac_model::presets::preset;
use esaac_model::{HdrFormat, Intensity, MotionFormat, Profile, SensorModel, SubstepPolicy, Synthesis, Taps};
use esaac_scene::{Renderer, SceneKind, Targets};
use serde::Serialize;
use std::sync::Arc;

#[derive(Parser)]
#[command(about = "Time and memory of an interval, per sensor, sub-steps and effect")]
struct Arguments {
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Intervals measured in each row
    #[arg(long, default_value_t = 60)]
    intervals: usize,
    /// Only rows whose name contains this
    #[arg(long, default_value = "")]
    only: String,
    /// Print what the driver tells about each row's kernels instead of times
    #[arg(long)]
    statistics: bool,
    /// Device index
    #[arg(long)]
    device: Option<usize>,
    /// Set by `cargo bench`
    #[arg(long, hide = true)]
    bench: bool,
}

/// Intervals before measuring: first dispatches compile, buffers grow.
const WARM_UP: usize = 8;

const FRAME_NS: i64 = 33_333_333;

const FORMATS: (HdrFormat, MotionFormat) = (HdrFormat::F16x4, MotionFormat::F32x2);

struct Case {
    name: String,
    sensor: SensorModel,
    cameras: usize,
    scene: SceneKind,
}

#[derive(Serialize)]
struct Row {
    name: String,
    cameras: usize,
    gpu_us: f64,
    gpu_halves_us: [f64; 2],
    stages_us: Vec<(&'static str, f64)>,
    submit_to_packet_p50_us: f64,
    submit_to_packet_p99_us: f64,
    events_per_interval: f64,
    events_per_pixel: f64,
    substeps_per_block: f64,
    device_mb: f64,
    host_mb: f64,
}

fn noisy(name: &str) -> SensorModel {
    let mut sensor = preset(name).expect("a preset");
    Profile::Noisy.apply(&mut sensor);
    sensor
}

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    let mut add = |name: String, sensor: SensorModel, cameras, scene| {
        cases.push(Case { name, sensor, cameras, scene });
    };
    for sensor in ["dvs128", "davis240", "atis", "davis346", "genx320"] {
        for substeps in [8, 16, 32] {
            for (mode, intensity) in [("gray", Intensity::Gray), ("bayer", Intensity::BayerRggb)] {
                let model = SensorModel { substeps, intensity, ..noisy(sensor) };
                add(format!("{sensor} x{substeps} {mode}"), model, 1, SceneKind::Flight);
            }
        }
    }
    // What a processor can do at 30 Hz.
    let davis = preset("davis346").expect("a preset");
    let bilinear = |s: &SensorModel| SensorModel { taps: Taps::Bilinear, ..s.clone() };
    add("davis346 clean".into(), davis.clone(), 1, SceneKind::Flight);
    let two = |s: &SensorModel| SensorModel { transfers: 2, ..s.clone() };
    add("davis346 clean two transfers".into(), two(&davis), 1, SceneKind::Flight);
    add("davis346 clean bilinear".into(), bilinear(&davis), 1, SceneKind::Flight);
    add("davis346 noisy bilinear".into(), bilinear(&noisy("davis346")), 1, SceneKind::Flight);
    let base = noisy("genx320");
    let clean = preset("genx320").expect("a preset");
    // Beside the rows of one, `genx320 x32 gray` and `genx320 x32 bayer`.
    for (mode, intensity) in [("gray", Intensity::Gray), ("bayer", Intensity::BayerRggb)] {
        let model = SensorModel { substeps: 32, intensity, ..two(&base) };
        add(format!("genx320 two transfers {mode}"), model, 1, SceneKind::Flight);
    }
    let fixed = |s: &SensorModel| SensorModel { substep_policy: SubstepPolicy::Fixed, ..s.clone() };
    add("genx320 fixed x32 noisy".into(), fixed(&base), 1, SceneKind::Flight);
    add("genx320 fixed x32 clean".into(), fixed(&clean), 1, SceneKind::Flight);
    let quiet = SensorModel { contrast_on: 4.0, contrast_off: 4.0, ..fixed(&clean) };
    add("genx320 fixed x32 quiet".into(), quiet, 1, SceneKind::Flight);
    add("genx320 clean".into(), clean.clone(), 1, SceneKind::Flight);
    let one = |change: &dyn Fn(&mut SensorModel)| {
        let mut sensor = clean.clone();
        change(&mut sensor);
        sensor
    };
    add("genx320 + mismatch".into(), one(&|s| s.contrast_mismatch = 0.05), 1, SceneKind::Flight);
    add("genx320 + refractory".into(), one(&|s| s.refractory_ns = 500_000), 1, SceneKind::Flight);
    add("genx320 + leak".into(), one(&|s| s.leak_rate_hz = 0.1), 1, SceneKind::Flight);
    add("genx320 + shot".into(), one(&|s| s.shot_noise_rate_hz = 5.0), 1, SceneKind::Flight);
    add("genx320 + latency".into(), one(&|s| s.latency_ns = 100_000), 1, SceneKind::Flight);
    add("genx320 + aps".into(), one(&|s| s.aps_exposure_ns = 10_000_000), 1, SceneKind::Flight);
    add("genx320 linear".into(), one(&|s| s.synthesis = Synthesis::Linear), 1, SceneKind::Flight);
    add("genx320 still clean".into(), clean.clone(), 1, SceneKind::Still);
    add("genx320 still noisy".into(), base.clone(), 1, SceneKind::Still);
    add("vga x32".into(), noisy("vga"), 1, SceneKind::Flight);
    add("hd x32".into(), noisy("hd"), 1, SceneKind::Flight);
    add("8 x vga x32".into(), noisy("vga"), 8, SceneKind::Flight);
    add("8 x davis346 x32".into(), noisy("davis346"), 8, SceneKind::Flight);
    cases
}

fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

fn quantile(values: &mut [f64], q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q).round() as usize]
}

/// Keeps the GPU busy between ticks: one that idles lowers its clock, and what is then measured is the
/// clock.
struct Heater {
    kernel: Kernel,
    rounds: u32,
    _sink: Buffer,
}

impl Heater {
    fn new(device: &Arc<Device>) -> Result<Self> {
        let words = esaac_kernels::words(include_bytes!(concat!(env!("OUT_DIR"), "/heat.spv")));
        let sink = device.allocate("heat", 16, Default::default(), MemoryLocation::GpuOnly)?;
        let kernel = Kernel::new(device, "heat", &words, 1, 4, &[])?;
        kernel.bind(&[&sink]);
        // A processor has no clock to keep up, and all of its time is wanted.
        let rounds = if device.info().kind == "software" { 0 } else { 100_000 };
        Ok(Heater { kernel, rounds, _sink: sink })
    }

    fn run(&self, device: &Arc<Device>) -> Result<()> {
        if self.rounds > 0 {
            device.run_once(|commands| {
                self.kernel.record(commands, &self.rounds.to_ne_bytes(), [1024, 1, 1]);
            })?;
        }
        Ok(())
    }
}

fn measure(device: &Arc<Device>, heater: &Heater, case: &Case, intervals: usize) -> Result<Row> {
    let row = measure_once(device, heater, case, intervals, false)?;
    let staged = measure_once(device, heater, case, intervals / 2, true)?;
    Ok(Row { stages_us: staged.stages_us, ..row })
}

fn configs(case: &Case) -> Vec<CameraConfig> {
    let (hdr, motion) = FORMATS;
    (0..case.cameras as u32)
        .map(|camera| CameraConfig { sensor: case.sensor.clone(), camera, hdr, motion: Some(motion) })
        .collect()
}

fn print_statistics(device: &Arc<Device>, case: &Case) -> Result<()> {
    let mut rig = Rig::new(device, &configs(case))?;
    rig.step(&vec![0; case.cameras])?;
    println!("{}", case.name);
    for (stage, told) in rig.kernel_statistics()? {
        let told: Vec<String> = told.iter().map(|(name, value)| format!("{name} {value}")).collect();
        println!("  {stage:<8} {}", told.join(", "));
    }
    Ok(())
}

fn measure_once(
    device: &Arc<Device>,
    heater: &Heater,
    case: &Case,
    intervals: usize,
    stage_times: bool,
) -> Result<Row> {
    let (width, height) = (case.sensor.width, case.sensor.height);
    let (hdr, motion) = FORMATS;
    let mut rig =
        Rig::with_options(device, &configs(case), RigOptions { stage_times, ..RigOptions::default() })?;
    let mut renderer = Renderer::new(device, case.scene.scene(width, height), hdr, motion)?;
    let mut gpu = Vec::new();
    let mut wall = Vec::new();
    let mut stages: Vec<(&'static str, Vec<f64>)> = Vec::new();
    let (mut events, mut substeps) = (0.0, 0.0);
    for frame in 0..=(WARM_UP + intervals) as i64 {
        let (t_ns, previous) = (frame * FRAME_NS, (frame > 0).then(|| (frame - 1) * FRAME_NS));
        for camera in 0..case.cameras {
            let inputs = rig.inputs(camera)?;
            renderer.render(
                t_ns,
                previous,
                Targets { hdr: inputs.hdr, motion: inputs.motion, depth: None },
            )?;
        }
        heater.run(device)?;
        let tick = rig.step(&vec![t_ns; case.cameras])?;
        if frame as usize <= WARM_UP {
            continue;
        }
        stages.resize_with(tick.stage_ns.len(), || ("", Vec::new()));
        for (stage, &(name, ns)) in stages.iter_mut().zip(tick.stage_ns) {
            stage.0 = name;
            stage.1.push(ns as f64 / 1e3);
        }
        gpu.push(tick.gpu_ns() as f64 / 1e3);
        wall.push(tick.submit_to_packet_ns as f64 / 1e3);
        events += tick.packets.iter().map(|p| p.len() as f64).sum::<f64>();
        substeps += tick.diagnostics.iter().map(|d| d.substeps as f64).sum::<f64>();
    }
    let count = intervals as f64;
    let blocks = f64::from(width.div_ceil(8) * height.div_ceil(8)) * case.cameras as f64;
    let bytes = |on_host: bool| {
        rig.memory().iter().filter(|m| m.on_host == on_host).map(|m| m.bytes).sum::<u64>() as f64 / 1e6
    };
    let (first, second) = gpu.split_at(intervals / 2);
    Ok(Row {
        name: case.name.clone(),
        cameras: case.cameras,
        gpu_halves_us: [median(&mut first.to_vec()), median(&mut second.to_vec())],
        gpu_us: median(&mut gpu),
        stages_us: stages.into_iter().map(|(name, mut us)| (name, median(&mut us))).collect(),
        submit_to_packet_p50_us: median(&mut wall),
        submit_to_packet_p99_us: quantile(&mut wall, 0.99),
        events_per_interval: events / count,
        events_per_pixel: events / count / (case.sensor.pixels() * case.cameras) as f64,
        substeps_per_block: substeps / count / blocks,
        device_mb: bytes(false),
        host_mb: bytes(true),
    })
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let choice = arguments.device.map_or(DeviceChoice::Best, DeviceChoice::Index);
    let device = Device::open(choice, Validation::Off)?;
    let cases: Vec<Case> = cases().into_iter().filter(|c| c.name.contains(&arguments.only)).collect();
    let heater = Heater::new(&device)?;
    let bar = indicatif::ProgressBar::new(cases.len() as u64);
    let mut rows = Vec::new();
    if !arguments.json {
        println!(
            "{}, {}; medians of {} intervals",
            device.info().name,
            device.info().driver,
            arguments.intervals
        );
    }
    if arguments.statistics {
        return cases.iter().try_for_each(|case| print_statistics(&device, case));
    }
    for case in &cases {
        let row = measure(&device, &heater, case, arguments.intervals)?;
        if !arguments.json {
            let stages: Vec<String> =
                row.stages_us.iter().map(|(name, us)| format!("{name} {us:.1}")).collect();
            bar.suspend(|| {
                println!(
                    "{:<26} gpu {:>8.1} us ({:.1} / {:.1}) | {} | packet p50 {:.0} p99 {:.0} us | {:.0} events, {:.2} a px, {:.1} sub-steps | {:.1} MB + {:.1} host",
                    row.name, row.gpu_us, row.gpu_halves_us[0], row.gpu_halves_us[1], stages.join(" "),
                    row.submit_to_packet_p50_us, row.submit_to_packet_p99_us, row.events_per_interval,
                    row.events_per_pixel, row.substeps_per_block, row.device_mb, row.host_mb
                );
            });
        }
        rows.push(row);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if arguments.json {
        println!("{}", serde_json::to_string_pretty(&rows)?);
    }
    Ok(())
}
