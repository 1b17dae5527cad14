//! Runs the same frames through the engine and through the oracle.

use crate::device::{DEVICE, assert_silent};
use crate::frames::Sequence;
use esaac_engine::{ApsFrame, CameraConfig, Device, Diagnostics, FrameBytes, Rig, RigOptions};
use esaac_model::packet::Event;
use esaac_model::{Packet, SensorModel};
use esaac_oracle::{Interval, Oracle};
use std::sync::Arc;

/// Result of one camera in one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Events.
    pub packet: Packet,
    /// APS frame.
    pub aps: Option<ApsFrame>,
    /// Counts.
    pub diagnostics: Diagnostics,
    /// Log intensities, `[sub-step][pixel]`, Q7.24, if the rig keeps them.
    pub substeps_q24: Option<Vec<Vec<i32>>>,
}

/// A camera for a sequence.
#[must_use]
pub fn camera(sensor: &SensorModel, number: u32, sequence: &Sequence) -> CameraConfig {
    CameraConfig {
        sensor: sensor.clone(),
        camera: number,
        hdr: sequence.hdr,
        motion: sequence.motion,
        geometry: None,
    }
}

/// A rig of one camera.
#[must_use]
pub fn rig(sensor: &SensorModel, sequence: &Sequence, options: RigOptions) -> Rig {
    Rig::with_options(&DEVICE, &[camera(sensor, 0, sequence)], options)
        .unwrap_or_else(|e| panic!("a rig of {sensor:?}: {e}"))
}

/// Steps camera 0 of a rig of one camera.
pub fn step(rig: &mut Rig, sequence: &Sequence, index: usize) -> Step {
    let frame = &sequence.frames[index];
    rig.upload(0, &FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref(), ..FrameBytes::default() })
        .unwrap_or_else(|e| panic!("frame {index}: {e}"));
    let tick = rig.step(&[frame.t_ns]).unwrap_or_else(|e| panic!("frame {index}: {e}"));
    let (packet, aps, diagnostics) = (tick.packets[0].clone(), tick.aps[0].clone(), tick.diagnostics[0]);
    Step { packet, aps, diagnostics, substeps_q24: rig.substeps_q24(0) }
}

/// Whether a part of the last tick ran again, or `merge` did. The rig has time stamps between stages.
#[must_use]
pub fn ran_again(rig: &Rig) -> bool {
    rig.last_tick().stage_ns.iter().any(|&(stage, ns)| stage == "retry" && ns > 0)
}

/// Steps camera 0 of a rig of one camera through frames `range`.
pub fn steps(rig: &mut Rig, sequence: &Sequence, range: std::ops::Range<usize>) -> Vec<Step> {
    range.map(|index| step(rig, sequence, index)).collect()
}

/// Runs a whole sequence through a rig of one camera. Fails if the validation layer reports anything, up to the rig's
/// destruction.
#[must_use]
pub fn engine_with(sensor: &SensorModel, sequence: &Sequence, options: RigOptions) -> Vec<Step> {
    let mut rig = rig(sensor, sequence, options);
    let got = steps(&mut rig, sequence, 0..sequence.frames.len());
    drop(rig);
    assert_silent();
    got
}

/// As [`engine_with`], with default options.
#[must_use]
pub fn engine(sensor: &SensorModel, sequence: &Sequence) -> Vec<Step> {
    engine_with(sensor, sequence, RigOptions::default())
}

/// Runs several cameras in one rig, each at its own times until its frames end. Returns `[camera][frame]`. Cameras are
/// numbered from 0, also in random draws. Fails if the validation layer reports anything, up to the rig's destruction.
#[must_use]
pub fn engine_of_many(cameras: &[(SensorModel, Sequence)], options: RigOptions) -> Vec<Vec<Step>> {
    let numbered: Vec<_> = (0..)
        .zip(cameras)
        .map(|(number, (sensor, sequence))| (camera(sensor, number, sequence), sequence))
        .collect();
    let got = engine_of_many_on(&DEVICE, &numbered, options);
    assert_silent();
    got
}

/// As [`engine_of_many`], on the given device, with cameras that may have any number in random draws.
#[must_use]
pub fn engine_of_many_on(
    device: &Arc<Device>,
    cameras: &[(CameraConfig, &Sequence)],
    options: RigOptions,
) -> Vec<Vec<Step>> {
    let configs: Vec<CameraConfig> = cameras.iter().map(|(config, _)| config.clone()).collect();
    let mut rig = Rig::with_options(device, &configs, options).expect("a rig of several cameras");
    let mut got = vec![Vec::new(); cameras.len()];
    let longest = cameras.iter().map(|(_, sequence)| sequence.frames.len()).max().unwrap_or(0);
    for index in 0..longest {
        let mut times_ns = Vec::new();
        for (number, (_, sequence)) in cameras.iter().enumerate() {
            let frame = sequence.frames.get(index);
            if let Some(frame) = frame {
                rig.upload(
                    number,
                    &FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref(), ..FrameBytes::default() },
                )
                .unwrap_or_else(|e| panic!("camera {number}, frame {index}: {e}"));
            }
            times_ns.push(frame.map(|frame| frame.t_ns));
        }
        let tick = rig.step_some(&times_ns).unwrap_or_else(|e| panic!("frame {index}: {e}"));
        let steps: Vec<Step> = (0..cameras.len())
            .map(|number| Step {
                packet: tick.packets[number].clone(),
                aps: tick.aps[number].clone(),
                diagnostics: tick.diagnostics[number],
                substeps_q24: None,
            })
            .collect();
        for (number, step) in steps.into_iter().enumerate().filter(|(number, _)| times_ns[*number].is_some())
        {
            got[number].push(Step { substeps_q24: rig.substeps_q24(number), ..step });
        }
    }
    got
}

/// Runs a whole sequence through the oracle, with samples kept. `camera` is its number in random draws.
#[must_use]
pub fn oracle(sensor: &SensorModel, camera: u32, sequence: &Sequence) -> Vec<Interval> {
    let mut oracle = Oracle::new(sensor.clone(), camera).unwrap_or_else(|e| panic!("{sensor:?}: {e}"));
    oracle.keep_samples(true);
    (0..sequence.frames.len())
        .map(|index| {
            let frame = sequence.oracle_frame(index);
            oracle.step(&frame).unwrap_or_else(|e| panic!("frame {index}: {e}"))
        })
        .collect()
}

/// Events of all steps.
#[must_use]
pub fn events(steps: &[Step]) -> Vec<Event> {
    steps.iter().flat_map(|step| step.packet.iter()).collect()
}

/// Events of all intervals.
#[must_use]
pub fn oracle_events(intervals: &[Interval]) -> Vec<Event> {
    intervals.iter().flat_map(|interval| interval.packet.iter()).collect()
}
