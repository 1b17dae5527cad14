//! A rig: cameras that step together, with one submission per tick.
//!
//! Buffers are arenas, one for each purpose, in which every camera has its part. The values that differ from tick to
//! tick are data in `cameras`, so that recorded commands can be submitted again and again. They are recorded again only
//! when the change of a sensor changes which kernels run, or when buffers are replaced.
//!
//! A tick begins in [`submit`] and ends in [`machine`]: start reading there. Every change of a rig is a transaction. It computes and allocates
//! everything it needs, submits once, and only then changes the state on the host. If it fails before, nothing has
//! changed. If a tick fails after the device has begun it, the state on the device is half updated: the rig is *lost*.
//! A lost rig refuses steps, changes, saving and its input buffers with [`EngineError::Lost`]. What needs nothing new of
//! the device can still be read: results and times of the last tick, unless it is the one that failed; memory; statistics of
//! kernels.

mod arena;
mod bus;
mod changes;
mod code;
mod config;
mod conventions;
mod density;
mod detail_transfer;
mod event_ids;
mod fresh;
mod geometry;
mod held;
mod input;
mod kernels;
mod layers;
mod light;
mod look;
mod machine;
mod merge;
mod parameters;
mod passes;
mod permutation;
mod poses;
mod prepare;
mod queue;
mod record;
mod recording;
mod reload;
mod represent;
mod rest;
mod results;
mod scene;
mod sensor;
mod snapshot;
mod stamps;
mod step;
mod submit;
mod synthesize;
mod tick;
mod timing;
mod transfer;

use crate::commands::Commands;
use crate::device::Device;
use crate::devices::FLOAT64;
use crate::error::EngineError;
use crate::kernel::{BindingSet, KernelStatistics, SlotKind};
use crate::memory::{Buffer, MemoryUse};
use crate::policy::{KernelPolicy, Resting};
use arena::Arena;
use ash::vk;
use config::{check_groups, check_rows, check_sensor};
use density::Density;
use esaac_layout::{self as layout, Camera};
use esaac_model::paths::SceneMotion;
use esaac_model::paths::conventions::PoseCheck;
use esaac_model::paths::spacing::SpacingWatch;
use esaac_model::physical::Illuminances;
use esaac_model::{SensorModel, Synthesis};
use geometry::Place;
use gpu_allocator::MemoryLocation;
use input::Addresses;
use passes::Passes;
use poses::PosesBy;
use queue::{QueueLength, SecondRun};
use rest::{PassedIntervals, RestChoice};
use results::Results;
use scene::Instances;
use std::sync::Arc;
use std::time::Duration;
use submit::Submitted;
use timing::Timing;

pub use config::{CameraConfig, GeometryConfig, MOST_PACKET_SETS, RigOptions};
pub use held::HeldPackets;
pub use input::{FrameBytes, FrameInput, InputBuffers};
pub use represent::{Representation, Share};
pub use results::{ApsFrame, Diagnostics};
pub use sensor::places_in_rig;
pub use tick::{PacketPlace, StageSpan, Tick};

/// Kinds of the descriptors that the kernels of a rig are bound to, slot by slot. What only the kernel `poses` reads is left
/// out where that never runs: the software driver has 32 storage buffers, some of which the validation layer takes.
fn slots(works_out_poses: bool) -> Vec<SlotKind> {
    let kind = |slot: usize| match slot {
        layout::TRACKS | layout::SEGMENTS if !works_out_poses => None,
        slot if layout::is_table(slot) => Some(vk::DescriptorType::UNIFORM_BUFFER),
        _ => Some(vk::DescriptorType::STORAGE_BUFFER),
    };
    let mut slots: Vec<_> = (0..layout::BINDINGS.len()).map(kind).collect();
    slots.resize(slots.len() + layout::TEXELS.len(), Some(vk::DescriptorType::UNIFORM_TEXEL_BUFFER));
    slots
}

/// One camera's state on the host.
struct CameraState {
    config: CameraConfig,
    place: Place,
    /// Where what has left the bus lies; without elements if there has been no bus.
    outlet: Place,
    /// Whether the last tick's packet lies there.
    sends_from_outlet: bool,
    hdr: Buffer,
    motion: Option<Buffer>,
    depth: Option<Buffer>,
    ids: Option<Buffer>,
    /// The images that the current tick reads.
    inputs: Addresses,
    /// Rows of instances; the poses of the next steps.
    instances: Instances,
    scene: Option<SceneMotion>,
    /// Whether the device still has what the last tick knew of its paths, and the host which instances they are of.
    has_paths: bool,
    /// The synthesis that was asked for.
    asked: Synthesis,
    /// Whether its poses predict its motion vectors.
    check: PoseCheck,
    /// Whether its poses are close enough in time.
    spacing: SpacingWatch,
    /// Light on the focal plane, for physical pixels.
    light: Illuminances,
    /// Length of its longest interval.
    longest_interval_ns: u32,
    /// Whether the next frame's motion vectors lead to the last frame.
    vectors_span: bool,
    last_ns: Option<i64>,
    last_interval_ns: u32,
    /// Start of the last interval. A reset keeps it: there is still the packet of that interval.
    last_start_ns: i64,
    /// Up to when its last packet is complete. A reset keeps it.
    complete_ns: Option<i64>,
    epoch_ns: i64,
    /// Tiles with more sub-steps than this are first in the order of `cross`: somewhat more than the mean of the last
    /// tick.
    many_substeps: u32,
    frame_slot: u32,
    frames: u64,
    sequence: u64,
    changed: bool,
    /// Intervals that pixels at rest have passed over; `None` if every pixel was walked in the last one.
    rested: Option<PassedIntervals>,
    /// Surfaces that a pixel may show, if that is left to the scene.
    layers_for_scene: u32,
    /// Whether there may be pixels that never had a valid colour.
    may_be_unarmed: bool,
    /// Latest end of a refractory period that began before the parameter changed; no pixel is held longer.
    holds_until_ns: Option<i64>,
    /// Events before the bus that wait for a later packet.
    deferred_events: u32,
    /// The frame, by its `sequence`, whose light was last looked at: a step that is refused and tried again looks once.
    lit: Option<u64>,
}

/// Kernels and their bindings.
struct Pipelines {
    /// A set of descriptors for each packet set.
    bindings: Arc<BindingSet>,
    code: code::Code,
    kernels: kernels::Kernels,
    specialised: kernels::SensorKernels,
    policy: KernelPolicy,
}

/// Recorded commands.
struct Recordings {
    /// The commands of a tick, for each packet set.
    ring: Vec<recording::Recording>,
    merging: Commands,
    representing: Commands,
}

/// Whether a rig can go on.
enum Health {
    Good,
    /// Its state on the device is half updated, or may still be in use.
    Lost {
        why: Arc<EngineError>,
    },
}

/// How long a lost rig that is being closed waits for the device. After that, memory that the device may still use is
/// kept until the device is closed.
const CLOSING: Duration = Duration::from_secs(2);

/// Cameras that step together.
pub struct Rig {
    device: Arc<Device>,
    options: RigOptions,
    cameras: Vec<CameraState>,
    arena: Arena,
    /// Table of packets for kernels that make [representations](Representation) of them.
    slices: Option<Buffer>,
    /// What `event_ids` reads besides: ids of rows, and lists of blocks.
    event_ids: Option<Buffer>,
    pipelines: Pipelines,
    recordings: Recordings,
    /// The table of cameras, as the next submission reads it.
    parameters: Vec<Camera>,
    /// Scenes that were replaced. They are freed while the device works.
    past_scenes: Vec<SceneMotion>,
    /// The length of the event queues of `cross`.
    queue: QueueLength,
    /// The second run of `cross` in a tick.
    second_run: SecondRun,
    density: Density,
    passes: Passes,
    /// Whether pixels rest.
    rest: RestChoice,
    /// Who works out poses.
    poses_by: PosesBy,
    timing: Timing,
    results: Results,
    /// The step that was submitted, until somebody waits for it.
    submitted: Option<Submitted>,
    health: Health,
}

impl Rig {
    /// A rig with default options.
    pub fn new(device: &Arc<Device>, cameras: &[CameraConfig]) -> Result<Self, EngineError> {
        Rig::with_options(device, cameras, RigOptions::default())
    }

    /// A rig. Errors: a sensor that is not valid, `motion` or `paper` synthesis without a motion format, `rigid` without
    /// a geometry, more cameras than `MAX_CAMERAS`, a camera too large for the device, options that no rig can have, no
    /// memory.
    pub fn with_options(
        device: &Arc<Device>,
        configs: &[CameraConfig],
        options: RigOptions,
    ) -> Result<Self, EngineError> {
        options.check()?;
        let asked: Vec<Synthesis> = configs.iter().map(|config| config.sensor.synthesis).collect();
        let configs: Vec<CameraConfig> = configs
            .iter()
            .map(|config| CameraConfig { sensor: config.resolved(&config.sensor), ..config.clone() })
            .collect();
        let configs = &configs[..];
        for (camera, config) in configs.iter().enumerate() {
            check_sensor(camera, &config.sensor, config)?;
        }
        check_rows(configs.iter().map(|config| &config.sensor))?;
        let places = geometry::place(configs, options);
        let policy = options
            .policy
            .map_or_else(|| KernelPolicy::of(device), |policy| policy.validated(device.validation()));
        // A pixel at rest has no sub-steps to keep.
        let resting = if options.keep_substeps { Resting::Never } else { policy.resting };
        let device_tracks = if device.info().has(FLOAT64) { policy.device_tracks } else { u32::MAX };
        let policy = KernelPolicy { resting, device_tracks, ..policy };
        check_groups(device, policy, &places)?;
        let arena = Arena::new(device, &places, options, policy)?;
        let mut cameras = Vec::with_capacity(configs.len());
        let (places, outlets) = places.split_at(configs.len());
        for (number, config) in configs.iter().enumerate() {
            cameras.push(CameraState {
                asked: asked[number],
                outlet: outlets[number],
                ..CameraState::new(device, number, config, places[number])?
            });
        }
        let has_poses = configs.iter().any(|config| config.geometry.is_some());
        let slots = slots(has_poses && policy.device_tracks < u32::MAX);
        let bindings = BindingSet::with_sets(device, slots, options.ring() as u32)?;
        let kernels = kernels::Kernels::new(policy, &cameras, &code::Code::default(), &bindings)?;
        let recording = |_| recording::Recording::new(device);
        let mut rig = Rig {
            pipelines: Pipelines {
                bindings,
                code: code::Code::default(),
                kernels,
                specialised: kernels::SensorKernels::default(),
                policy,
            },
            recordings: Recordings {
                ring: (0..options.ring()).map(recording).collect::<Result<_, _>>()?,
                merging: Commands::new(device)?,
                representing: Commands::new(device)?,
            },
            parameters: vec![Camera::default(); cameras.len()],
            past_scenes: Vec::new(),
            queue: QueueLength::default(),
            second_run: SecondRun::default(),
            density: Density::default(),
            passes: Passes::default(),
            rest: RestChoice::new(policy.resting),
            poses_by: PosesBy::default(),
            timing: Timing::new(device, options.stage_times)?,
            results: Results::new(configs),
            submitted: None,
            health: Health::Good,
            device: Arc::clone(device),
            options,
            cameras,
            arena,
            slices: None,
            event_ids: None,
        };
        rig.clear()?;
        Ok(rig)
    }

    /// The device that the rig runs on.
    #[must_use]
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Number of cameras.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cameras.len()
    }

    /// Whether it has no cameras.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cameras.is_empty()
    }

    /// A camera's current sensor. Its synthesis is what `auto` has chosen by the camera's images; [`Rig::synthesis`] also
    /// tells whether its poses are followed.
    pub fn sensor(&self, camera: usize) -> Result<&SensorModel, EngineError> {
        Ok(&self.camera(camera)?.config.sensor)
    }

    /// Why the rig is lost; `None` if it is not. A lost rig can only be closed. States saved before remain valid.
    #[must_use]
    pub fn lost(&self) -> Option<&EngineError> {
        match &self.health {
            Health::Good => None,
            Health::Lost { why } => Some(why),
        }
    }

    /// Whether the cameras are at rest and the rig can go on.
    fn check_ready(&self) -> Result<(), EngineError> {
        self.check_lost()?;
        if self.submitted.is_some() { Err(EngineError::Submitted) } else { Ok(()) }
    }

    fn check_lost(&self) -> Result<(), EngineError> {
        match &self.health {
            Health::Good => Ok(()),
            Health::Lost { why } => Err(EngineError::Lost { why: Arc::clone(why) }),
        }
    }

    /// Marks the rig as lost; returns the error that reports it. Results of a tick before remain valid.
    fn lose(&mut self, why: EngineError) -> EngineError {
        let why = match why {
            EngineError::Lost { why } => why,
            why => Arc::new(why),
        };
        self.health = Health::Lost { why: Arc::clone(&why) };
        EngineError::Lost { why }
    }

    /// The results of the last tick; empty before the first tick, after a tick that was refused or failed, and while one is
    /// submitted. A rig that is lost after its last tick still shows it.
    #[must_use]
    pub fn last_tick(&self) -> Tick<'_> {
        Tick::of(self)
    }

    /// Takes the last tick's packets out of the rig, without a copy; the rig keeps the headers. Only packets of
    /// [`PacketPlace::Owned`] have events to take.
    pub fn take_packets(&mut self) -> Vec<esaac_model::Packet> {
        self.results.take_packets()
    }

    /// Whether a camera's next frame counts as its first.
    pub fn is_at_start(&self, camera: usize) -> Result<bool, EngineError> {
        Ok(self.camera(camera)?.last_ns.is_none())
    }

    /// Memory in use, by camera and purpose.
    #[must_use]
    pub fn memory(&self) -> Vec<MemoryUse> {
        let mut uses = self.arena.memory(&self.cameras);
        for (number, c) in self.cameras.iter().enumerate() {
            for (purpose, buffer) in [
                ("input hdr", Some(&c.hdr)),
                ("input motion", c.motion.as_ref()),
                ("input depth", c.depth.as_ref()),
                ("input ids", c.ids.as_ref()),
            ] {
                if let Some(buffer) = buffer {
                    uses.push(MemoryUse {
                        camera: Some(number),
                        purpose: purpose.to_owned(),
                        bytes: buffer.bytes(),
                        on_host: buffer.on_host(),
                    });
                }
            }
        }
        if let Some(buffer) = &self.event_ids {
            uses.push(MemoryUse {
                camera: None,
                purpose: "event_ids".to_owned(),
                bytes: buffer.bytes(),
                on_host: buffer.on_host(),
            });
        }
        uses
    }

    /// The driver's statistics of each kernel that the rig has compiled, by stage; see [`crate::Kernel::statistics`].
    /// A lost rig tells them too.
    pub fn kernel_statistics(&self) -> Result<Vec<(&'static str, KernelStatistics)>, EngineError> {
        self.kernels_by_stage().map(|(stage, kernel)| Ok((stage, kernel.statistics()?))).collect()
    }

    /// Log intensity (Q7.24) at the interval's start and at the end of each sub-step of the last interval,
    /// `[sub-step][pixel]`. Entries beyond the sub-steps of a pixel's block are meaningless. `None` without
    /// [`RigOptions::keep_substeps`], if there is no such camera, if the rig is lost, and while a step is submitted.
    #[must_use]
    pub fn substeps_q24(&self, camera: usize) -> Option<Vec<Vec<i32>>> {
        if !self.options.keep_substeps || camera >= self.cameras.len() || self.check_ready().is_err() {
            return None;
        }
        let pixels = self.cameras[camera].config.sensor.pixels();
        let samples = self.arena.buffer(layout::SAMPLES);
        let all = esaac_model::substeps::MAX_SUBSTEPS as usize + 1;
        let first = camera * all * self.arena.samples_pixels;
        Some((0..all).map(|i| samples.read::<i32>(first + i * pixels, pixels).to_vec()).collect())
    }

    fn camera(&self, camera: usize) -> Result<&CameraState, EngineError> {
        self.cameras
            .get(camera)
            .ok_or(EngineError::NoSuchCamera { expected: self.cameras.len(), actual: camera })
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        if let Some(submitted) = self.submitted.take()
            && let Err(error) = self.timing.wait()
        {
            submitted.abandon();
            self.lose(error);
        }
        // Now a rig that is not lost has waited for all its submissions. `Device::retire` parks the objects of a lost one;
        // if the device finishes soon, their memory is free for a new rig.
        if self.lost().is_some() {
            self.device.settle(CLOSING);
        }
    }
}

impl CameraState {
    fn new(
        device: &Arc<Device>,
        number: usize,
        config: &CameraConfig,
        place: Place,
    ) -> Result<Self, EngineError> {
        let input = |image: &str, texel_bytes: usize| {
            let bytes = (config.sensor.pixels() * texel_bytes) as u64;
            let name = format!("camera {number} {image}");
            device.allocate(&name, bytes, vk::BufferUsageFlags::empty(), MemoryLocation::CpuToGpu)
        };
        Ok(CameraState {
            hdr: input("hdr", config.hdr.texel_bytes())?,
            motion: config.motion.map(|m| input("motion", m.texel_bytes())).transpose()?,
            depth: config.geometry.map(|g| input("depth", g.depth.texel_bytes())).transpose()?,
            ids: config
                .geometry
                .and_then(|g| g.ids)
                .map(|ids| input("ids", ids.texel_bytes()))
                .transpose()?,
            config: config.clone(),
            place,
            outlet: Place::default(),
            sends_from_outlet: false,
            inputs: Addresses::default(),
            instances: Instances::new(),
            scene: None,
            has_paths: false,
            asked: config.sensor.synthesis,
            check: PoseCheck::default(),
            spacing: SpacingWatch::default(),
            light: Illuminances::default(),
            longest_interval_ns: 0,
            vectors_span: true,
            last_ns: None,
            last_interval_ns: 0,
            last_start_ns: 0,
            complete_ns: None,
            epoch_ns: 0,
            many_substeps: 0,
            frame_slot: 0,
            frames: 0,
            sequence: 0,
            changed: true,
            rested: None,
            layers_for_scene: 1,
            may_be_unarmed: true,
            holds_until_ns: None,
            deferred_events: 0,
            lit: None,
        })
    }

    /// First event of the last tick's packet in the packet's arrays.
    fn packet_base(&self) -> u32 {
        if self.sends_from_outlet { self.outlet.event_base } else { self.place.event_base }
    }

    /// Whether a hold may end in the next interval that began before the refractory period changed.
    fn may_end_old_holds(&self) -> bool {
        self.last_ns < self.holds_until_ns
    }

    /// Whether events of earlier intervals may wait for the next packet.
    fn may_have_waiting(&self) -> bool {
        sensor::delays(&self.config.sensor) || self.deferred_events > 0
    }

    /// Makes the next frame count as the first.
    fn forget(&mut self) {
        self.last_ns = None;
        self.rested = None;
        self.layers_for_scene = 1;
        self.may_be_unarmed = true;
        self.holds_until_ns = None;
        self.deferred_events = 0;
        self.frames = 0;
        self.check = PoseCheck::default();
        // No surface names a row any more. A scene has no more instances than there were rows.
        self.instances = Instances::new();
        self.has_paths = false;
        self.apply_trust();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::STORAGE_BUFFERS;

    #[test]
    fn a_suitable_device_has_as_many_storage_buffers_as_a_rig_is_bound_to() {
        let storage = Some(vk::DescriptorType::STORAGE_BUFFER);
        let bound = slots(false).into_iter().filter(|kind| *kind == storage).count();
        assert_eq!(bound, STORAGE_BUFFERS.1 as usize);
        assert!(STORAGE_BUFFERS.0.starts_with(&format!("{bound} ")), "{}", STORAGE_BUFFERS.0);
    }
}
