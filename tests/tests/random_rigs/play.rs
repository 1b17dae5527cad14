//! Plays a case on the engine.

use crate::case::{Case, Change, Refusal};
use crate::findings::Findings;
use crate::images::View;
use esaac_engine::{CameraConfig, FrameBytes, KernelPolicy, KernelSet, Rig, RigOptions};
use esaac_model::{SensorModel, Synthesis};
use esaac_tests::device::DEVICE;
use esaac_tests::run::Step;

/// For each tick, each camera's result; `None` for a camera without a frame.
pub type Steps = Vec<Vec<Option<Step>>>;

/// What a run gives.
pub struct Played {
    pub steps: Steps,
    /// The synthesis that each camera had at the end.
    pub synthesis: Vec<Synthesis>,
    /// What is said of poses.
    pub warnings: Vec<Option<String>>,
}

fn rig(views: &[&View], sensors: &[SensorModel], options: RigOptions) -> Rig {
    let configs: Vec<CameraConfig> =
        views.iter().zip(sensors).map(|(view, sensor)| view.config(sensor)).collect();
    let options = RigOptions { policy: options.policy.map(on_this_device), ..options };
    let mut rig = Rig::with_options(&DEVICE, &configs, options).expect("a rig of valid cameras");
    for (number, view) in views.iter().enumerate() {
        if view.case.geometry.is_some() {
            rig.set_scene(number, view.poses.clone()).expect("poses of its lens");
        }
    }
    rig
}

/// GPUs run their own kernels alone: those of the software driver are for no other device.
///
/// The software driver silently ends all loops of a thread after 65 535 rounds, so that a bus must leave its rest earlier.
fn on_this_device(policy: KernelPolicy) -> KernelPolicy {
    if !DEVICE.is_software() {
        return match policy.kernels {
            KernelSet::Gpu => policy,
            KernelSet::SoftwareDriver => KernelPolicy { resting: policy.resting, ..KernelPolicy::gpu() },
        };
    }
    KernelPolicy { readout_rounds: KernelPolicy::software_driver().readout_rounds, ..policy }
}

/// Plays a case from the beginning to the end. Then, if `saves`, it goes back to where it was saved, and must go on as it
/// did.
pub fn play(
    case: &Case,
    views: &[&View],
    options: RigOptions,
    saves: bool,
    findings: &mut Findings,
) -> Played {
    let sensors: Vec<SensorModel> = case.cameras.iter().map(|camera| camera.sensor.clone()).collect();
    let mut rig = rig(views, &sensors, options);
    let mut last_ns = vec![None; views.len()];
    let mut steps = Vec::new();
    let mut saved = None;
    for tick in 0..case.ticks.len() {
        if saves && tick == case.saving.tick {
            let state = rig.save().expect("a rig that is well");
            findings.check(state == rig.save().expect("a rig that is well"), || {
                format!("tick {tick}: saving twice gives other bytes")
            });
            saved = Some((state, last_ns.clone()));
        }
        steps.push(play_tick(case, views, &mut rig, tick, &mut last_ns, findings));
    }
    let cameras = 0..views.len();
    let synthesis = cameras.clone().map(|camera| rig.synthesis(camera).expect("a camera")).collect();
    let warnings = cameras.map(|camera| rig.convention_warning(camera).expect("a camera")).collect();
    if let Some((state, mut last_ns)) = saved {
        let first = case.saving.tick;
        let sensors: Vec<SensorModel> =
            (0..views.len()).map(|camera| case.sensors(camera)[first].clone()).collect();
        if case.saving.into_the_same_rig {
            for (camera, sensor) in sensors.iter().enumerate() {
                rig.set_sensor(camera, sensor.clone()).expect("a sensor that it had");
            }
        } else {
            rig = self::rig(views, &sensors, options);
        }
        rig.restore(&state).expect("a state of such a rig");
        for (tick, expected) in steps.iter().enumerate().skip(first) {
            let again = play_tick(case, views, &mut rig, tick, &mut last_ns, findings);
            let what = format!("tick {tick}, after a restore");
            same(&what, expected, &again, findings);
        }
    }
    Played { steps, synthesis, warnings }
}

/// Findings where two runs gave different results.
pub fn same(what: &str, expected: &[Option<Step>], actual: &[Option<Step>], findings: &mut Findings) {
    for (camera, pair) in expected.iter().zip(actual).enumerate() {
        let (Some(expected), Some(actual)) = pair else {
            findings.check(pair.0.is_none() && pair.1.is_none(), || {
                format!("{what}: camera {camera} has a frame")
            });
            continue;
        };
        findings.check(expected.packet == actual.packet, || {
            let first = expected.packet.iter().zip(actual.packet.iter()).find(|(a, b)| a != b);
            let [one, other] = [expected, actual].map(|step| (step.packet.len(), step.packet.dropped));
            format!("{what}: camera {camera} sends another packet: {one:?} and {other:?}, {first:?}")
        });
        findings
            .check(expected.aps == actual.aps, || format!("{what}: camera {camera} has another APS frame"));
        // Whether a block may be skipped depends on what a rig knows of frames before: it has other sub-steps then.
        let skips = |step: &Step| step.diagnostics.skipped_blocks;
        let substeps = |step: &Step| step.diagnostics.substeps;
        findings.check(skips(expected) != skips(actual) || substeps(expected) == substeps(actual), || {
            format!("{what}: camera {camera} has {} and {} sub-steps", substeps(expected), substeps(actual))
        });
        let counts = |step: &Step| {
            let d = step.diagnostics;
            [
                d.invalid_pixels,
                d.invalid_motion,
                d.unarmed_pixels,
                d.overrun_pixels,
                d.deferred_events,
                d.dropped_events,
                d.lost_events,
                d.capped_events,
                d.without_depth,
                d.without_poses,
                d.without_lens,
                d.unseen_samples,
            ]
        };
        findings.check(counts(expected) == counts(actual), || {
            format!("{what}: camera {camera} counts {:?} and {:?}", expected.diagnostics, actual.diagnostics)
        });
    }
}

fn play_tick(
    case: &Case,
    views: &[&View],
    rig: &mut Rig,
    tick: usize,
    last_ns: &mut [Option<i64>],
    findings: &mut Findings,
) -> Vec<Option<Step>> {
    let of_tick = &case.ticks[tick];
    for change in &of_tick.changes {
        match change {
            Change::Reset(camera) => {
                rig.reset(*camera).expect("a camera");
                last_ns[*camera] = None;
            }
            Change::Sensor(camera, sensor) => {
                rig.set_sensor(*camera, (**sensor).clone())
                    .unwrap_or_else(|e| panic!("tick {tick}, camera {camera}: {e}"));
                if rig.is_at_start(*camera).expect("a camera") {
                    last_ns[*camera] = None;
                }
            }
            Change::Refused(camera, refusal) => {
                let accepted = accepts(views, rig, *camera, *refusal, last_ns);
                findings
                    .check(!accepted, || format!("tick {tick}, camera {camera}: {refusal:?} is accepted"));
            }
        }
    }
    let times_ns: Vec<Option<i64>> =
        of_tick.frames.iter().map(|frame| frame.map(|frame| frame.t_ns)).collect();
    for (camera, view) in views.iter().enumerate() {
        if let Some(images) = &view.frames[tick] {
            rig.upload(camera, &view.bytes(images))
                .unwrap_or_else(|e| panic!("tick {tick}, camera {camera}: {e}"));
        }
    }
    rig.step_some(&times_ns).unwrap_or_else(|e| panic!("tick {tick}: {e}"));
    for (last_ns, t_ns) in last_ns.iter_mut().zip(&times_ns) {
        *last_ns = t_ns.or(*last_ns);
    }
    let results = (0..views.len()).map(|camera| result(rig, camera, times_ns[camera].is_some(), findings));
    results.collect()
}

/// A camera's result in the last tick.
fn result(rig: &Rig, camera: usize, has_frame: bool, findings: &mut Findings) -> Option<Step> {
    let tick = rig.last_tick();
    let packet = tick.view(camera).to_packet();
    if !has_frame {
        findings.check(packet.is_empty(), || format!("camera {camera} sends events without a frame"));
        return None;
    }
    let aps = tick.aps[camera]
        .clone()
        .map(|frame| esaac_engine::ApsFrame { pixels: tick.aps_pixels(camera).to_vec(), ..frame });
    let diagnostics = tick.diagnostics[camera];
    Some(Step { packet, aps, diagnostics, substeps_q24: rig.substeps_q24(camera) })
}

/// Whether the engine takes what it must refuse.
fn accepts(views: &[&View], rig: &mut Rig, camera: usize, refusal: Refusal, last_ns: &[Option<i64>]) -> bool {
    let view = views[camera];
    let Some(images) = view.frames.iter().flatten().next() else { return false };
    let whole = view.bytes(images);
    match refusal {
        Refusal::ShortImage => {
            let hdr = &whole.hdr[..whole.hdr.len() - 1];
            rig.upload(camera, &FrameBytes { hdr, ..whole }).is_ok()
        }
        Refusal::NoMotion => rig.upload(camera, &FrameBytes { motion: None, ..whole }).is_ok(),
        Refusal::OtherSize => {
            let sensor = rig.sensor(camera).expect("a camera").clone();
            rig.set_sensor(camera, SensorModel { width: sensor.width + 1, ..sensor }).is_ok()
        }
        Refusal::SameTime => {
            // A camera at its start takes any time.
            if last_ns[camera].is_none() {
                return false;
            }
            let mut times_ns = vec![None; views.len()];
            times_ns[camera] = last_ns[camera];
            rig.step_some(&times_ns).is_ok()
        }
    }
}

/// As [`play`], each camera in a rig of its own.
pub fn play_alone(case: &Case, views: &[&View], options: RigOptions, findings: &mut Findings) -> Played {
    let mut together =
        Played { steps: vec![Vec::new(); case.ticks.len()], synthesis: Vec::new(), warnings: Vec::new() };
    for (camera, view) in views.iter().enumerate() {
        let alone = play(&case.alone(camera), &[view], options, false, findings);
        for (all, mut own) in together.steps.iter_mut().zip(alone.steps) {
            all.append(&mut own);
        }
        together.synthesis.extend(alone.synthesis);
        together.warnings.extend(alone.warnings);
    }
    together
}
