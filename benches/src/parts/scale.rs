//! Time against the amount of work: cameras, pixels, sub-steps, events, motion, noise, moving share of the image.

use super::representations;
use super::sensors::{clean, noisy, stages};
use crate::amount::Amount;
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::measure::{Run, Stand, Timing};
use crate::plot::{Axes, Series, draw};
use crate::scenes::{Feed, Pattern};
use crate::statistics::order;
use crate::throw::Throw;
use anyhow::Result;
use esaac_engine::{PacketPlace, RigOptions};
use esaac_model::{SensorModel, SubstepPolicy, Synthesis};
use esaac_scene::SceneKind;
use serde::Serialize;

/// Measurements in which one quantity grows and the others stay.
#[derive(Serialize)]
struct Sweep {
    name: &'static str,
    unit: &'static str,
    points: Vec<Point>,
    /// Exponent of the time over the last half of the points; 1 means proportional.
    exponent: Option<f64>,
}

#[derive(Serialize)]
struct Point {
    value: f64,
    #[serde(flatten)]
    timing: Timing,
    stages_us: Vec<(&'static str, f64)>,
}

struct Case {
    value: f64,
    sensor: SensorModel,
    cameras: usize,
    feed: Kind,
    packets: PacketPlace,
}

enum Kind {
    Scene(SceneKind),
    Pattern(Pattern),
    Throw(Throw),
}

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let mut document = Document::new("Scale");
    document.say(
        "One thing grows, the rest stays. `cameras` and `pixels`: profile `noisy`, scene `flight`. The others: \
         clean sensor, a log-sinusoid that moves to the right, thresholds and wavelength set so that events or \
         motion alone grow; whole columns of it cross at the same instants, which is the hardest to sort. `dense` \
         is a clean sensor with ever lower thresholds on `flight` (1280x720; `smaller`: 640x480); packets go to the \
         host, whose bus then bounds `sort`, or stay on the device. `still noise` and `still cameras` (of 64x64) see a still scene, without noise \
         at 0, else with profile `noisy` and this rate of shot noise. `environments` are images of 64x64, profile \
         `noisy`, in each of which a sixteenth moves by 2 px; packets stay on the device. With `rigid` and `linear` a \
         board moves by 1.2 px before a still wall. `moving share, physical` has the preset's physical pixel with its \
         noise. The exponent is that of time over the last half of the points (1: proportional, 0: does not matter). \
         Stages are stamped, which costs a microsecond each.",
    );
    let mut sweeps = Vec::new();
    for (name, unit, cases) in cases(laboratory).into_iter().filter(|(name, ..)| laboratory.wants(name)) {
        let points = laboratory.rows(name, cases, |case| {
            let Run { timing, stages_us, .. } = measure(laboratory, &case)?;
            Ok(Point { value: case.value, timing, stages_us })
        })?;
        let tail: Vec<_> =
            points[points.len() / 2..].iter().map(|p| (p.value, p.timing.gpu_us.median)).collect();
        sweeps.push(Sweep { name, unit, exponent: order(&tail).map(|o| -o), points });
    }
    for sweep in &sweeps {
        show(&mut document, sweep)?;
    }
    let mut readable = Vec::new();
    if laboratory.wants(READABLE) {
        readable =
            laboratory.rows(READABLE, readable_cases(laboratory), |case| until_readable(laboratory, case))?;
        show_readable(&mut document, &readable);
    }
    let mut represented = Vec::new();
    if laboratory.wants(representations::NAME) {
        represented = representations::measure(laboratory)?;
        representations::show(&mut document, &represented);
    }
    let figures =
        serde_json::json!({ "sweeps": sweeps, "readable": readable, "representations": represented });
    Ok(Outcome { figures, document })
}

/// Name of the sweep over readable packets, for `--only`.
const READABLE: &str = "readable";

/// How long after its submission a tick's packets can be read.
#[derive(Serialize)]
struct Readable {
    cameras: usize,
    packets: &'static str,
    gpu_us: f64,
    submit_to_packet_us: f64,
    ratio: f64,
    million_events: f64,
}

fn readable_cases(laboratory: &Laboratory) -> Vec<(usize, PacketPlace)> {
    let cameras = if laboratory.is_software() { [1, 2] } else { [8, 64] };
    let places = [PacketPlace::InPlace, PacketPlace::Owned];
    cameras.iter().flat_map(|&cameras| places.map(|place| (cameras, place))).collect()
}

fn until_readable(laboratory: &Laboratory, (cameras, packets): (usize, PacketPlace)) -> Result<Readable> {
    let sensor = noisy(if laboratory.is_software() { "dvs128" } else { "vga" });
    let feed = laboratory.scene(SceneKind::Flight, (sensor.width, sensor.height))?;
    let options = RigOptions { packets, ..RigOptions::default() };
    let mut stand = Stand::new(laboratory, &sensor, cameras, FORMATS, feed, options)?;
    let amount = laboratory.amount();
    let timing = stand.run(Amount { frames: 11 + amount.warm_up, keep: 0, ..amount })?.timing;
    let (gpu_us, packet_us) = (timing.gpu_us.median, timing.packet_us.median);
    Ok(Readable {
        cameras,
        packets: if packets == PacketPlace::Owned { "owned" } else { "in place" },
        gpu_us,
        submit_to_packet_us: packet_us,
        ratio: packet_us / gpu_us,
        million_events: timing.events * 1e-6,
    })
}

fn show_readable(document: &mut Document, rows: &[Readable]) {
    document.heading(READABLE);
    document.say("From the submission of a tick to packets that can be read: in place, or copied out.");
    let head =
        cells!["cameras", "packets", "GPU us", "submit to packet us", "ratio", "million events a tick"];
    let row = |r: &Readable| {
        cells![
            r.cameras,
            r.packets,
            short(r.gpu_us),
            short(r.submit_to_packet_us),
            short(r.ratio),
            short(r.million_events)
        ]
    };
    document.table(&std::iter::once(head).chain(rows.iter().map(row)).collect::<Vec<_>>());
}

/// Size of the patterns.
fn pattern_size(laboratory: &Laboratory) -> (u32, u32) {
    if laboratory.is_software() { (160, 120) } else { (640, 480) }
}

fn cases(laboratory: &Laboratory) -> Vec<(&'static str, &'static str, Vec<Case>)> {
    let software = laboratory.is_software();
    let quick = laboratory.options().quick;
    let flight = |value: f64, sensor: SensorModel, cameras| Case {
        value,
        sensor,
        cameras,
        feed: Kind::Scene(SceneKind::Flight),
        packets: PacketPlace::Owned,
    };
    let cameras: &[usize] = match (software, quick) {
        (true, _) => &[1, 2, 4],
        (false, true) => &[1, 4, 16, 64],
        (false, false) => &[1, 2, 4, 8, 16, 32, 64, 128, 256],
    };
    let camera = noisy(if software { "dvs128" } else { "davis346" });
    let on_paths = SensorModel { synthesis: Synthesis::Rigid, ..camera.clone() };
    let cameras_rigid = if quick || software { &cameras[..cameras.len() - 1] } else { &cameras[..7] };
    let cameras_rigid = cameras_rigid.iter().map(|&n| flight(n as f64, on_paths.clone(), n)).collect();
    let cameras = cameras.iter().map(|&n| flight(n as f64, camera.clone(), n)).collect();
    let sizes: &[(u32, u32)] = match (software, quick) {
        (true, true) => &[(80, 60), (160, 120), (320, 240)],
        (true, false) => &[(80, 60), (160, 120), (320, 240), (640, 480)],
        (false, _) => &[(160, 120), (320, 240), (640, 480), (1280, 720), (1920, 1080), (3840, 2160)],
    };
    let sized = |&(width, height): &(u32, u32)| {
        let sensor = SensorModel { width, height, ..noisy("vga") };
        flight(f64::from(width) * f64::from(height), sensor, 1)
    };
    let size = pattern_size(laboratory);
    let base = SensorModel { width: size.0, height: size.1, ..clean("vga") };
    let pattern = Pattern { size, motion_px: 4.0, moving: 1.0, moving_columns: 1.0, wavelength_px: 48.0 };
    let on_pattern = |value: f64, sensor: SensorModel, pattern: Pattern| Case {
        value,
        sensor,
        cameras: 1,
        feed: Kind::Pattern(pattern),
        packets: PacketPlace::Owned,
    };
    let fixed = |substeps: u32| {
        let sensor = SensorModel { substeps, substep_policy: SubstepPolicy::Fixed, ..base.clone() };
        on_pattern(f64::from(substeps), sensor, pattern)
    };
    // With an amplitude of 1, the log intensity of a pixel rises by 2 and falls by 2 in each wavelength: 4 in all.
    let rise_log = 4.0 * 1.0 * pattern.motion_px / pattern.wavelength_px;
    let eventful = |wanted: f64| {
        let contrast = if wanted == 0.0 { 5.0 } else { rise_log / wanted };
        let sensor = SensorModel { contrast_on: contrast, contrast_off: contrast, ..base.clone() };
        on_pattern(wanted, sensor, pattern)
    };
    // The wavelength grows with the motion, so the number of events is the same at each speed.
    let moved = |motion_px: f64| {
        let wavelength_px = 12.0 * motion_px.max(1.0);
        let contrast = rise_log * (motion_px / pattern.motion_px).clamp(0.1, 1.0);
        let sensor = SensorModel { contrast_on: contrast, contrast_off: contrast, ..base.clone() };
        on_pattern(motion_px, sensor, Pattern { motion_px, wavelength_px, ..pattern })
    };
    let dense_sizes = if software { [(160, 120), (80, 60)] } else { [(1280, 720), (640, 480)] };
    let dense = |wanted: f64, (width, height): (u32, u32), packets: PacketPlace| {
        // In this scene a threshold of .2 gives some .4 events a pixel.
        let contrast = 0.2 * 0.4 / wanted;
        let sensor =
            SensorModel { width, height, contrast_on: contrast, contrast_off: contrast, ..clean("hd") };
        Case { packets, ..flight(wanted, sensor, 1) }
    };
    let densities: &[f64] = if quick { &[0.5, 2.0, 20.0] } else { &[0.5, 1.0, 2.0, 5.0, 10.0, 20.0] };
    let denser = |size, packets| densities.iter().map(|&wanted| dense(wanted, size, packets)).collect();
    let substeps: &[u32] = if quick { &[1, 8, 64] } else { &[1, 2, 4, 8, 16, 32, 64] };
    let wanted: &[f64] = if quick { &[0.0, 2.0, 20.0] } else { &[0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0] };
    let motions_px: &[f64] = if quick { &[0.0, 4.0, 30.0] } else { &[0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0] };
    let shares: &[f64] = if quick { &[0.0, 0.25, 1.0] } else { &[0.0, 0.1, 0.25, 0.5, 0.75, 1.0] };
    // Noise that leaves few pixels without an event for long, and the same in many small images.
    let still = |value: f64, (width, height): (u32, u32), cameras: usize| {
        let own = if value == 0.0 { clean("vga") } else { noisy("vga") };
        let sensor = SensorModel { width, height, shot_noise_rate_hz: value, ..own };
        Case { value, sensor, cameras, feed: Kind::Scene(SceneKind::Still), packets: PacketPlace::Owned }
    };
    // The share of rows that move, with the preset's physical pixel and its noise.
    let physical = |moving: f64| {
        let sensor = SensorModel { width: size.0, height: size.1, ..clean("vga").with_preset_pixel() };
        on_pattern(100.0 * moving, sensor, Pattern { moving, ..pattern })
    };
    let noises_hz: &[f64] = if quick { &[0.0, 5.0] } else { &[0.0, 0.1, 1.0, 5.0, 20.0] };
    let small_cameras = if software { 2 } else { 256 };
    let environment = |&cameras: &usize| {
        let size = (64, 64);
        let pattern = Pattern { size, motion_px: 2.0, moving: 0.25, moving_columns: 0.25, ..pattern };
        let sensor = SensorModel { width: size.0, height: size.1, ..noisy("vga") };
        let case = on_pattern(cameras as f64, sensor, pattern);
        Case { cameras, packets: PacketPlace::OnDevice, ..case }
    };
    let posed = |synthesis: Synthesis| {
        move |&cameras: &usize| {
            let size = (64, 64);
            let sensor = SensorModel { width: size.0, height: size.1, synthesis, ..noisy("vga") };
            let feed = Kind::Throw(Throw { size, motion_px: 1.2 });
            Case { value: cameras as f64, sensor, cameras, feed, packets: PacketPlace::OnDevice }
        }
    };
    let environments: &[usize] = if software { &[1, 4] } else { &[64, 256] };
    let share = |moving: f64| on_pattern(100.0 * moving, base.clone(), Pattern { moving, ..pattern });
    vec![
        ("cameras", "cameras", cameras),
        ("cameras, rigid", "cameras", cameras_rigid),
        ("pixels", "pixels", sizes.iter().map(sized).collect()),
        ("sub-steps", "N, fixed", substeps.iter().copied().map(fixed).collect()),
        ("events", "events wanted a pixel", wanted.iter().copied().map(eventful).collect()),
        ("motion", "px a frame", motions_px.iter().copied().map(moved).collect()),
        ("dense", "events wanted a pixel", denser(dense_sizes[0], PacketPlace::Owned)),
        ("dense on device", "events wanted a pixel", denser(dense_sizes[0], PacketPlace::OnDevice)),
        ("dense on device, smaller", "events wanted a pixel", denser(dense_sizes[1], PacketPlace::OnDevice)),
        ("still noise", "Hz of shot noise", noises_hz.iter().map(|&hz| still(hz, size, 1)).collect()),
        (
            "still cameras",
            "Hz of shot noise",
            noises_hz.iter().map(|&hz| still(hz, (64, 64), small_cameras)).collect(),
        ),
        ("environments", "environments", environments.iter().map(environment).collect()),
        ("environments, rigid", "environments", environments.iter().map(posed(Synthesis::Rigid)).collect()),
        ("environments, linear", "environments", environments.iter().map(posed(Synthesis::Linear)).collect()),
        ("moving share", "% of rows", shares.iter().copied().map(share).collect()),
        ("moving share, physical", "% of rows", shares.iter().copied().map(physical).collect()),
    ]
}

fn measure(laboratory: &Laboratory, case: &Case) -> Result<Run> {
    let size = (case.sensor.width, case.sensor.height);
    let feed = match &case.feed {
        Kind::Scene(kind) => laboratory.scene(*kind, size)?,
        Kind::Pattern(pattern) => Feed::Pattern(*pattern),
        Kind::Throw(throw) => Feed::Throw(*throw),
    };
    let options = RigOptions { stage_times: true, packets: case.packets, ..RigOptions::default() };
    let mut stand = Stand::new(laboratory, &case.sensor, case.cameras, FORMATS, feed, options)?;
    let amount = laboratory.amount();
    // Time fewer frames of many cameras: rendering for hundreds of cameras takes longer than the measurement.
    let timed = if case.cameras > 16 { 10 } else { amount.frames - 1 - amount.warm_up };
    let amount = Amount { frames: 1 + amount.warm_up + timed, ..amount };
    stand.run(amount)
}

fn show(document: &mut Document, sweep: &Sweep) -> Result<()> {
    document.heading(sweep.name);
    let curve = |of: &dyn Fn(&Timing) -> f64| sweep.points.iter().map(|p| (p.value, of(&p.timing))).collect();
    let logarithmic = matches!(sweep.unit, "cameras" | "pixels" | "N, fixed" | "environments");
    let title = format!("Time against {}", sweep.name);
    let axes =
        Axes { title: &title, x: sweep.unit, y: "GPU time, us", logarithmic: (logarithmic, logarithmic) };
    let series = [
        Series::curve("GPU time", curve(&|t| t.gpu_us.median)),
        Series::curve("floor", curve(&|t| t.floor_us)),
    ];
    let file = format!("scale_{}", sweep.name.replace([' ', '-'], "_").replace(',', ""));
    document.plot(&file, &title, draw(axes, &series)?);
    let head = cells![
        sweep.unit,
        "GPU us",
        "floor us",
        "events a px",
        "sub-steps a block",
        "ns an event",
        "packet p50 us",
        "stages, us"
    ];
    let row = |p: &Point| {
        let t = &p.timing;
        let an_event = 1e3 * t.gpu_us.median / t.events;
        cells![
            short(p.value),
            short(t.gpu_us.median),
            short(t.floor_us),
            short(t.events_per_pixel),
            short(t.substeps_per_block),
            short(an_event),
            short(t.packet_us.median),
            stages(&p.stages_us)
        ]
    };
    document.table(&std::iter::once(head).chain(sweep.points.iter().map(row)).collect::<Vec<_>>());
    if let Some(exponent) = sweep.exponent {
        document.say(&format!("Exponent over the last half: {exponent:.2}."));
    }
    Ok(())
}
