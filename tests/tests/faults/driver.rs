//! Runs a rig through the operations, and recovers after a fault as a user would.

use crate::operations::{Operation, delayed, depth_and_ids, flashing, lens, operations, scene, sequences};
use crate::strike::Faults;
use esaac_engine::{
    CameraConfig, EngineError, FrameBytes, FrameInput, HeldPackets, PacketPlace, Rig, RigOptions, SubmitHooks,
};
use esaac_model::{HdrFormat, Packet, SensorModel};
use esaac_tests::device::{DEVICE, alone, assert_silent};
use esaac_tests::frames::Sequence;
use esaac_tests::geometry::geometry;

pub const OPTIONS: RigOptions = RigOptions {
    keep_substeps: false,
    stage_times: false,
    initial_events: 64,
    packets: PacketPlace::InPlace,
    packet_ring: 2,
    policy: None,
};

pub fn rig_of(sensors: &[SensorModel; 2]) -> Result<Rig, EngineError> {
    let config = |camera: usize| CameraConfig {
        sensor: sensors[camera].clone(),
        camera: camera as u32,
        hdr: HdrFormat::F32x4,
        motion: None,
        geometry: (camera == 0).then(|| geometry(lens())),
    };
    Rig::with_options(&DEVICE, &[config(0), config(1)], OPTIONS)
}

/// A step's packets and APS frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Given {
    pub packets: Vec<Packet>,
    aps: Vec<u16>,
}

pub fn given(held: &HeldPackets) -> Given {
    Given {
        packets: (0..held.len()).map(|camera| held.view(camera).to_packet()).collect(),
        aps: held.aps_pixels(0).to_vec(),
    }
}

/// Where a driver can go on.
#[derive(Clone)]
pub struct Station {
    pub sensors: [SensorModel; 2],
    pub frame: usize,
    pub instances: Option<u32>,
    pub saved: Vec<u8>,
}

/// A rig and its progress through the operations.
pub struct Driver {
    pub rig: Rig,
    pub sequences: [Sequence; 2],
    pub sensors: [SensorModel; 2],
    pub frame: usize,
    /// Instances of the first camera's poses, if it has any.
    pub instances: Option<u32>,
    /// The state after the last operation.
    pub saved: Vec<u8>,
    /// The last step's packets, held while the next one runs.
    pub held: Option<(HeldPackets, Given)>,
    /// What the caller does between the halves of a step; `None` to step in one call.
    pub meanwhile: Option<fn(&mut Rig)>,
}

impl Driver {
    pub fn new() -> Self {
        let sensors = [flashing(), delayed()];
        let rig = rig_of(&sensors).expect("a rig of two small cameras");
        let saved = rig.save().expect("a state");
        let sequences = sequences();
        Driver { rig, sequences, sensors, frame: 0, instances: None, saved, held: None, meanwhile: None }
    }

    /// A driver that goes on from a saved state.
    pub fn at(station: &Station) -> Self {
        let rig = rig_of(&station.sensors).expect("a rig of two small cameras");
        let Station { sensors, frame, instances, saved } = station.clone();
        let sequences = sequences();
        let mut driver =
            Driver { rig, sequences, sensors, frame, instances, saved, held: None, meanwhile: None };
        driver.make_anew();
        driver
    }

    /// Runs an operation. A step returns its packets.
    pub fn run(&mut self, operation: &Operation) -> Result<Option<Given>, EngineError> {
        match operation {
            Operation::Step => {
                let (depth, ids) = depth_and_ids();
                for (camera, sequence) in self.sequences.iter().enumerate() {
                    let hdr = &sequence.frames[self.frame].hdr;
                    let bytes = FrameBytes { hdr, depth: Some(&depth), ids: Some(&ids), motion: None };
                    self.rig.upload(camera, &bytes)?;
                }
                let t_ns = self.sequences[0].frames[self.frame].t_ns;
                let tick = match self.meanwhile {
                    None => self.rig.step(&[t_ns, t_ns])?,
                    Some(meanwhile) => {
                        let frames = [Some(FrameInput { t_ns, inputs: None }); 2];
                        self.rig.submit_frames(&frames, &SubmitHooks::default())?;
                        meanwhile(&mut self.rig);
                        self.rig.wait()?
                    }
                };
                let held = tick.hold().expect("packets are in place");
                let now = given(&held);
                if let Some((held, before)) = self.held.replace((held, now.clone())) {
                    assert_eq!(given(&held), before, "packets that are held stay as they were");
                }
                self.frame += 1;
                Ok(Some(now))
            }
            Operation::Change(camera, sensor) => {
                self.rig.set_sensor(*camera, (**sensor).clone())?;
                self.sensors[*camera] = (**sensor).clone();
                Ok(None)
            }
            Operation::Scene(instances) => {
                self.rig.set_scene(0, scene(*instances))?;
                self.instances = Some(*instances);
                Ok(None)
            }
            Operation::Reset(camera) => self.rig.reset(*camera).map(|()| None),
        }
    }

    /// Replaces a lost rig by a new one, restored to the state saved last.
    fn make_anew(&mut self) {
        self.rig = rig_of(&self.sensors).expect("a new rig");
        self.rig.restore(&self.saved).expect("the state saved last");
        // Poses are input, as images are.
        if let Some(instances) = self.instances {
            self.rig.set_scene(0, scene(instances)).expect("poses of its lens");
        }
    }

    /// Runs an operation while `faults` may strike, and recovers as a user would. The result is that of an undisturbed
    /// run.
    pub fn run_with(&mut self, operation: &Operation, faults: &Faults) -> Option<Given> {
        let first = faults.strike(|| self.run(operation));
        if let Err(error) = &first {
            let says_lost = matches!(error, EngineError::Lost { .. });
            assert_eq!(says_lost, self.rig.lost().is_some(), "{operation:?}: {error}");
        }
        let is_lost = self.rig.lost().is_some();
        if is_lost {
            let refused = self.rig.reset(0).expect_err("a lost rig refuses everything");
            assert!(matches!(refused, EngineError::Lost { .. }), "{refused}");
            self.make_anew();
        }
        let given = match first {
            Ok(given) if !is_lost => given,
            first => {
                if let Ok(Some(_)) = first {
                    // The tick succeeded and a later call failed. The restored state is that before the tick.
                    self.frame -= 1;
                }
                let again = self.run(operation).unwrap_or_else(|e| panic!("{operation:?}, again: {e}"));
                if let Ok(Some(first)) = first {
                    assert!(again.as_ref() == Some(&first), "the same step gives the same");
                }
                again
            }
        };
        self.saved = faults.strike(|| self.rig.save()).unwrap_or_else(|error| {
            assert!(self.rig.lost().is_none(), "saving changes nothing: {error}");
            self.rig.save().expect("a state")
        });
        given
    }
}

/// Results of the steps when nothing fails.
pub fn undisturbed() -> Vec<Given> {
    let mut driver = Driver::new();
    let given: Vec<Given> =
        operations().iter().filter_map(|operation| driver.run(operation).expect("no fault")).collect();
    let events: usize = given.iter().flat_map(|step| &step.packets).map(Packet::len).sum();
    assert!(events > 20_000, "{events} events");
    given
}

#[test]
fn the_operations_grow_overflow_merge_and_defer() {
    let _alone = alone();
    let mut driver = Driver::new();
    let mut seen = [false; 4];
    for operation in &operations() {
        driver.run(operation).expect("no fault");
        let tick = driver.rig.last_tick();
        seen[0] |= tick.diagnostics.iter().any(|d| d.regrown > 0);
        seen[1] |= tick.diagnostics[1].deferred_events > 0;
        seen[2] |= tick.aps[0].is_some() && tick.aps_pixels(0).iter().any(|&value| value > 0);
        // More events of one time than `sort` can sort.
        let times = tick.view(0).t_offset_ns;
        seen[3] |= times.last().is_some_and(|last| times.iter().filter(|&t| t == last).count() > 2048);
    }
    assert_eq!(seen, [true; 4], "growth, deferred events, APS, packets for `merge`");
    drop(driver);
    assert_silent();
}
