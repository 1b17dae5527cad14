//! A rig: cameras that step together, with one submission per tick.
//!
//! Buffers are arenas, one for each purpose, in which every camera has its part. The values that differ from tick to
//! tick are data in `cameras`, so that recorded commands can be submitted again and again. They are recorded again only
//! when the change of a sensor changes which kernels run, or when buffers are replaced.
//!
//! A tick runs in [`machine`]: start reading there. Every change of a rig is a transaction. It computes and allocates
//! everything it needs, submits once, and only then changes the state on the host. If it fails before, nothing has
//! changed. If a tick fails after the device has begun it, the state on the device is half updated: the rig is *lost*.
//! A lost rig refuses steps, changes, saving and its input buffers with [`EngineError::Lost`]. What needs nothing new of
//! the device can still be read: results and times of the last tick, unless it is the one that failed; memory; statistics of
//! kernels.

mod arena;
mod code;
mod geometry;
mod held;
mod machine;
mod merge;
mod parameters;
mod record;
#[cfg(feature = "shaderc")]
mod reload;
mod represent;
mod results;
mod snapshot;
mod step;
mod tick;
mod timing;
mod transfer;

use crate::commands::Commands;
use crate::device::Device;
use crate::error::EngineError;
use crate::kernel::{BindingSet, KernelStatistics};
use crate::memory::{Buffer, MemoryUse};
use crate::policy::KernelPolicy;
use arena::{Arena, Move};
use ash::vk;
use bytemuck::cast_slice;
use esaac_layout::{self as layout, Camera, Counters, StateWord};
use esaac_model::{FrameError, HdrFormat, MotionFormat, SensorModel, Synthesis, frame};
use geometry::Place;
use gpu_allocator::MemoryLocation;
use results::Results;
use std::sync::Arc;
use std::time::Duration;
use timing::Timing;
use transfer::{Write, Writes};

pub use held::HeldPackets;
pub use represent::{Representation, Share};
pub use results::{ApsFrame, Diagnostics};
pub use tick::{PacketPlace, StageSpan, Tick};

/// A camera of a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraConfig {
    /// The sensor.
    pub sensor: SensorModel,
    /// Its number in random counters: two cameras with the same number and seed have the same noise.
    pub camera: u32,
    /// Format of its colour images.
    pub hdr: HdrFormat,
    /// Format of its motion images; `None` if it gets none.
    pub motion: Option<MotionFormat>,
}

/// Options of a rig; none of them changes an event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RigOptions {
    /// Keep every sub-step's log intensity for [`Rig::substeps_q24`]: for tests, at a cost.
    pub keep_substeps: bool,
    /// Take GPU time stamps between stages, which costs a microsecond or two each; else only around the whole tick.
    pub stage_times: bool,
    /// Initial capacity of the event buffers, events per camera; 0 for one and a half per pixel. The buffers grow as
    /// needed.
    pub initial_events: u32,
    /// Where the packets of a tick lie.
    pub packets: PacketPlace,
    /// Number of packet buffer sets that ticks write in turn; 0 for one. With [`PacketPlace::InPlace`], packets that
    /// are [held](Tick::hold) over the next `packet_ring - 1` ticks cost nothing. Packets that are held longer cost the
    /// next tick an allocation. Each set takes memory for the packets of all cameras.
    pub packet_ring: u32,
    /// How kernels are run; `None` for the policy that suits the device. Events are the same in any case.
    pub policy: Option<KernelPolicy>,
}

impl RigOptions {
    /// Number of packet sets, at least one.
    fn ring(&self) -> usize {
        self.packet_ring.max(1) as usize
    }
}

/// A frame in host memory, rows tightly packed.
#[derive(Clone, Copy, Debug)]
pub struct FrameBytes<'a> {
    /// Colour image.
    pub hdr: &'a [u8],
    /// Motion image, if the camera has a motion format.
    pub motion: Option<&'a [u8]>,
}

/// Buffers that a producer on the device writes a frame into, rows tightly packed.
#[derive(Clone, Copy)]
pub struct InputBuffers<'a> {
    /// Colour image.
    pub hdr: &'a Buffer,
    /// Motion image, if the camera has a motion format.
    pub motion: Option<&'a Buffer>,
}

/// A camera's frame for [`Rig::step_frames`].
#[derive(Clone, Copy)]
pub struct FrameInput<'a> {
    /// Time of the frame, nanoseconds.
    pub t_ns: i64,
    /// Buffers that hold the frame; `None` for the camera's own input buffers.
    pub inputs: Option<InputBuffers<'a>>,
}

/// Kinds of the descriptors that the kernels of a rig are bound to, slot by slot.
fn slots() -> Vec<vk::DescriptorType> {
    let mut slots = vec![vk::DescriptorType::STORAGE_BUFFER; layout::BINDINGS.len()];
    slots[layout::CAMERAS] = vk::DescriptorType::UNIFORM_BUFFER;
    slots.resize(slots.len() + layout::TEXELS.len(), vk::DescriptorType::UNIFORM_TEXEL_BUFFER);
    slots
}

/// One camera's state on the host.
struct CameraState {
    config: CameraConfig,
    place: Place,
    hdr: Buffer,
    motion: Option<Buffer>,
    /// Device addresses of the images that the current tick reads: colour, motion.
    inputs: [u64; 2],
    last_ns: Option<i64>,
    last_interval_ns: u32,
    epoch_ns: i64,
    /// Tiles with more sub-steps than this are first in the order of `cross`: somewhat more than the mean of the last
    /// tick.
    many_substeps: u32,
    frame_slot: u32,
    frames: u64,
    sequence: u64,
    changed: bool,
    /// Whether there may be pixels that never had a valid colour.
    may_be_unarmed: bool,
    /// Latest end of a refractory period that began before the parameter changed; no pixel is held longer.
    holds_until_ns: Option<i64>,
}

/// Kernels and their bindings.
struct Pipelines {
    /// A set of descriptors for each packet set.
    bindings: Arc<BindingSet>,
    code: code::Code,
    kernels: record::Kernels,
    specialised: record::SensorKernels,
    policy: KernelPolicy,
}

/// Recorded commands.
struct Recordings {
    /// The commands of a tick, for each packet set.
    ring: Vec<record::Recording>,
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
    pipelines: Pipelines,
    recordings: Recordings,
    /// The table of cameras, as the next submission reads it.
    parameters: Vec<Camera>,
    timing: Timing,
    results: Results,
    health: Health,
}

impl Rig {
    /// A rig with default options.
    pub fn new(device: &Arc<Device>, cameras: &[CameraConfig]) -> Result<Self, EngineError> {
        Rig::with_options(device, cameras, RigOptions::default())
    }

    /// A rig. Errors: a sensor that is not valid, `motion` or `paper` synthesis without a motion format, more cameras
    /// than `MAX_CAMERAS`, a camera too large for the device, no memory.
    pub fn with_options(
        device: &Arc<Device>,
        configs: &[CameraConfig],
        options: RigOptions,
    ) -> Result<Self, EngineError> {
        for (camera, config) in configs.iter().enumerate() {
            check_sensor(camera, &config.sensor, config.motion.is_some())?;
        }
        if configs.len() > layout::MAX_CAMERAS {
            return Err(EngineError::TooManyCameras { expected: layout::MAX_CAMERAS, actual: configs.len() });
        }
        let places = geometry::place(configs, options);
        let policy = options
            .policy
            .map_or_else(|| KernelPolicy::of(device), |policy| policy.validated(device.is_validated()));
        check_groups(device, policy, &places)?;
        let arena = Arena::new(device, &places, options)?;
        let mut cameras = Vec::with_capacity(configs.len());
        for (number, (config, place)) in configs.iter().zip(places).enumerate() {
            cameras.push(CameraState::new(device, number, config, place)?);
        }
        let bindings = BindingSet::with_sets(device, slots(), options.ring() as u32)?;
        let kernels = record::Kernels::new(policy, &cameras, &code::Code::default(), &bindings)?;
        let recording = |_| record::Recording::new(device);
        let mut rig = Rig {
            pipelines: Pipelines {
                bindings,
                code: code::Code::default(),
                kernels,
                specialised: record::SensorKernels::default(),
                policy,
            },
            recordings: Recordings {
                ring: (0..options.ring()).map(recording).collect::<Result<_, _>>()?,
                merging: Commands::new(device)?,
                representing: Commands::new(device)?,
            },
            parameters: vec![Camera::default(); cameras.len()],
            timing: Timing::new(device, options.stage_times)?,
            results: Results::new(configs),
            health: Health::Good,
            device: Arc::clone(device),
            options,
            cameras,
            arena,
            slices: None,
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

    /// A camera's current sensor.
    pub fn sensor(&self, camera: usize) -> Result<&SensorModel, EngineError> {
        Ok(&self.camera(camera)?.config.sensor)
    }

    /// Changes a camera's parameters, all but its size; the change takes effect with the next tick. On an error the
    /// camera keeps its parameters, and nothing has changed.
    pub fn set_sensor(&mut self, camera: usize, sensor: SensorModel) -> Result<(), EngineError> {
        self.check_health()?;
        let state = self.camera(camera)?;
        check_sensor(camera, &sensor, state.config.motion.is_some())?;
        let old = &state.config.sensor;
        let effects = old.change_to(&sensor);
        if effects.resizes {
            return Err(EngineError::SizeChange {
                camera,
                expected_width: old.width,
                expected_height: old.height,
                actual_width: sensor.width,
                actual_height: sensor.height,
            });
        }
        let mut places = self.places();
        let mut writes = Vec::new();
        if effects.resets_frames {
            places[camera] = places[camera].with_planes_of(&sensor);
            writes.push(fresh_counters(&state.place));
        }
        if effects.redraws_pixels {
            writes.push(pixel_draws(&state.place, &sensor, state.config.camera));
        }
        self.change(places, writes, &[])?;
        let state = &mut self.cameras[camera];
        let held_ns = state.last_ns.map(|ns| ns + i64::from(state.config.sensor.refractory_ns));
        state.config.sensor = sensor;
        state.changed = true;
        state.holds_until_ns = held_ns.max(state.holds_until_ns);
        if effects.resets_frames {
            state.forget();
        }
        Ok(())
    }

    /// Resets a camera: its next frame counts as its first. Deferred events are discarded, noise begins again, and
    /// packets keep counting.
    pub fn reset(&mut self, camera: usize) -> Result<(), EngineError> {
        self.check_health()?;
        let counters = fresh_counters(&self.camera(camera)?.place);
        self.change(self.places(), vec![counters], &[])?;
        self.cameras[camera].forget();
        Ok(())
    }

    /// Initialises the state on the device, as before any frame.
    fn clear(&mut self) -> Result<(), EngineError> {
        let mut writes = Vec::new();
        for c in &self.cameras {
            writes.push(fresh_counters(&c.place));
            writes.push(pixel_draws(&c.place, &c.config.sensor, c.config.camera));
        }
        let zeroed = [layout::BINS, layout::STATE, layout::BLOCKS];
        self.device.run_once(|commands| self.arena.record_zero(&self.device, commands, &zeroed))?;
        self.change(self.places(), writes, &[])
    }

    fn places(&self) -> Vec<Place> {
        self.cameras.iter().map(|c| c.place).collect()
    }

    /// Moves cameras to new places, zeroes buffers and writes into others, in one submission. `writes` and `zeroed` may
    /// name only buffers that do not move. On an error nothing has changed; but if the submission may still run, the
    /// rig is lost.
    fn change(
        &mut self,
        places: Vec<Place>,
        writes: Vec<Write>,
        zeroed: &[usize],
    ) -> Result<(), EngineError> {
        let before = self.places();
        let planned: Option<Move> =
            if places == before { None } else { Some(self.arena.plan(&self.device, &before, places)?) };
        let writes = Writes::new(&self.device, writes)?;
        let device = &self.device;
        let ran = device.run_once(|commands| {
            if let Some(planned) = &planned {
                self.arena.record_move(device, commands, &before, planned);
            }
            self.arena.record_zero(device, commands, zeroed);
            writes.record(device, commands, &self.arena);
        });
        if let Err(error) = ran {
            return Err(if error.leaves_work() { self.lose(error) } else { error });
        }
        if let Some(planned) = planned {
            self.arena.commit(&mut self.cameras, planned);
            self.recordings.unbind();
        }
        Ok(())
    }

    /// Why the rig is lost; `None` if it is not. A lost rig can only be closed. States saved before remain valid.
    #[must_use]
    pub fn lost(&self) -> Option<&EngineError> {
        match &self.health {
            Health::Good => None,
            Health::Lost { why } => Some(why),
        }
    }

    fn check_health(&self) -> Result<(), EngineError> {
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

    /// A camera's input buffers, for a producer on this device. The producer may write them whenever no tick runs.
    pub fn inputs(&self, camera: usize) -> Result<InputBuffers<'_>, EngineError> {
        self.check_health()?;
        let c = self.camera(camera)?;
        Ok(InputBuffers { hdr: &c.hdr, motion: c.motion.as_ref() })
    }

    /// Writes a frame from host memory into a camera's input buffers. An error if an image has the wrong size.
    pub fn upload(&mut self, camera: usize, frame: &FrameBytes<'_>) -> Result<(), EngineError> {
        let _zone = zone!("ingest");
        self.check_health()?;
        self.camera(camera)?;
        let c = &mut self.cameras[camera];
        let (sensor, number) = (&c.config.sensor, camera as u32);
        let size = (sensor.width, sensor.height);
        frame::check_size(number, "hdr", size, c.config.hdr.texel_bytes(), frame.hdr.len())?;
        if let Some(format) = c.config.motion {
            let given = frame.motion.unwrap_or_default().len();
            frame::check_size(number, "motion", size, format.texel_bytes(), given)?;
        }
        c.hdr.write(0, frame.hdr);
        if let (Some(buffer), Some(bytes)) = (&mut c.motion, frame.motion) {
            buffer.write(0, bytes);
        }
        Ok(())
    }

    /// The results of the last tick; empty before the first tick, and after a tick that was refused or failed. A rig
    /// that is lost after its last tick still shows it.
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
            for (purpose, buffer) in [("input hdr", Some(&c.hdr)), ("input motion", c.motion.as_ref())] {
                if let Some(buffer) = buffer {
                    uses.push(MemoryUse {
                        camera: Some(number),
                        purpose: purpose.to_owned(),
                        bytes: buffer.bytes(),
                        on_host: false,
                    });
                }
            }
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
    /// [`RigOptions::keep_substeps`], if there is no such camera, and if the rig is lost.
    #[must_use]
    pub fn substeps_q24(&self, camera: usize) -> Option<Vec<Vec<i32>>> {
        if !self.options.keep_substeps || camera >= self.cameras.len() || self.lost().is_some() {
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
        // A rig that is not lost has waited for all its submissions. `Device::retire` parks the objects of a lost one;
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
            config: config.clone(),
            place,
            inputs: [0; 2],
            last_ns: None,
            last_interval_ns: 0,
            epoch_ns: 0,
            many_substeps: 0,
            frame_slot: 0,
            frames: 0,
            sequence: 0,
            changed: true,
            may_be_unarmed: true,
            holds_until_ns: None,
        })
    }

    /// Makes the next frame count as the first.
    fn forget(&mut self) {
        self.last_ns = None;
        self.may_be_unarmed = true;
        self.holds_until_ns = None;
        self.frames = 0;
    }
}

/// The write that sets both of a camera's sets of counters to their initial values.
fn fresh_counters(place: &Place) -> Write {
    let fresh = [Counters { emitted_fit: u32::MAX, ..Counters::default() }; 2];
    let offset = place.first_element(layout::COUNTERS) * size_of::<Counters>() as u64;
    Write { slot: layout::COUNTERS, offset, bytes: cast_slice(&fresh).to_vec() }
}

/// The write of a camera's random draws that are made once per pixel: thresholds and leak, which lie one after the
/// other in `state`.
fn pixel_draws(place: &Place, sensor: &SensorModel, camera: u32) -> Write {
    let draws = sensor.pixel_draws(camera);
    let mut bytes = cast_slice(&draws.contrast_on_q24).to_vec();
    bytes.extend_from_slice(cast_slice(&draws.contrast_off_q24));
    bytes.extend_from_slice(cast_slice(&draws.leak_per_ns));
    let first = place.first_element(layout::STATE) + StateWord::ContrastOn as u64 * sensor.pixels() as u64;
    Write { slot: layout::STATE, offset: first * 4, bytes }
}

/// An error if a camera's dispatches are larger than the device allows.
fn check_groups(device: &Device, policy: KernelPolicy, places: &[Place]) -> Result<(), EngineError> {
    // The largest dispatch is that of `cross` with one workgroup per sub-tile.
    let of_a_tile = policy.cross_groups(false).max(policy.cross_groups(true));
    for (camera, place) in places.iter().enumerate() {
        let actual = place.tiles.saturating_mul(of_a_tile);
        if actual > device.most_groups() {
            let expected = device.most_groups();
            return Err(EngineError::TooManyGroups {
                camera,
                device: device.info().name.clone(),
                expected,
                actual,
            });
        }
    }
    Ok(())
}

fn check_sensor(camera: usize, sensor: &SensorModel, has_motion: bool) -> Result<(), EngineError> {
    sensor.validate().map_err(|source| EngineError::Sensor { camera, source })?;
    if has_motion || !sensor.synthesis.needs_motion() {
        return Ok(());
    }
    let synthesis = if sensor.synthesis == Synthesis::Paper { "paper" } else { "motion" };
    Err(FrameError::MissingMotion { camera: camera as u32, synthesis }.into())
}
