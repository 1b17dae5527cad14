//! A rig: cameras that step together, one submission a tick.
//!
//! Buffers are arenas, one per purpose, in which every camera has its part; what differs from tick to
//! tick is data in `cameras`, so that the recorded commands are submitted again and again. They are
//! recorded anew only when a camera's effects change which kernels run, or when event buffers grow.

mod arena;
mod code;
mod collect;
mod merge;
mod parameters;
mod record;
#[cfg(feature = "shaderc")]
mod reload;
mod represent;
mod snapshot;
mod step;
mod tick;

use crate::commands::Commands;
use crate::device::Device;
use crate::error::EngineError;
use crate::kernel::{BindingSet, KernelStatistics};
use crate::memory::{Buffer, MemoryUse};
use crate::profile::GpuZones;
use crate::timing::{Fence, StageTimer};
use arena::Arena;
use ash::vk;
use esaac_model::layout::{self, Camera, StateWord};
use esaac_model::{
    FrameError, HdrFormat, MotionFormat, Packet, SensorModel, Synthesis, frame, log_to_q24, q24_to_log,
    random,
};
use gpu_allocator::MemoryLocation;
use parameters::Permutation;
use std::collections::BTreeSet;
use std::sync::Arc;

pub use collect::{ApsFrame, Diagnostics};
pub use represent::{Representation, Share};
pub use tick::{PacketPlace, StageSpan, Tick};

/// A camera of a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraConfig {
    /// What it is.
    pub sensor: SensorModel,
    /// Its number in random counters: two cameras with one number and one seed have one noise.
    pub camera: u32,
    /// Format of its colour images.
    pub hdr: HdrFormat,
    /// Format of its motion images, if it gets any.
    pub motion: Option<MotionFormat>,
}

/// What a rig does beyond its work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RigOptions {
    /// Keep every sub-step's log intensity for [`Rig::substeps_q24`]: for tests, at a cost.
    pub keep_substeps: bool,
    /// Take GPU time stamps between stages, which costs a microsecond or two each; else of the whole
    /// tick only.
    pub stage_times: bool,
    /// Events that fit at first, per camera; 0 for one and a half a pixel. The buffers grow by
    /// themselves.
    pub initial_events: u32,
    /// Where packets are taken from.
    pub packets: PacketPlace,
}

/// A frame in host memory, rows tightly packed.
#[derive(Clone, Copy, Debug)]
pub struct FrameBytes<'a> {
    /// Colour.
    pub hdr: &'a [u8],
    /// Motion, if the camera gets it.
    pub motion: Option<&'a [u8]>,
}

/// Buffers that a producer on the device writes a frame into, rows tightly packed.
#[derive(Clone, Copy)]
pub struct InputBuffers<'a> {
    /// Colour.
    pub hdr: &'a Buffer,
    /// Motion, if the camera gets it.
    pub motion: Option<&'a Buffer>,
}

/// A camera's frame for [`Rig::step_frames`].
#[derive(Clone, Copy)]
pub struct FrameInput<'a> {
    /// Its time.
    pub t_ns: i64,
    /// Where it lies; `None` for the camera's own input buffers.
    pub inputs: Option<InputBuffers<'a>>,
}

/// What the kernels of a rig are bound to, slot by slot.
fn slots() -> Vec<vk::DescriptorType> {
    let mut slots = vec![vk::DescriptorType::STORAGE_BUFFER; layout::BINDINGS.len()];
    slots[layout::CAMERAS] = vk::DescriptorType::UNIFORM_BUFFER;
    slots.resize(slots.len() + layout::TEXELS.len(), vk::DescriptorType::UNIFORM_TEXEL_BUFFER);
    slots
}

/// One camera's life on the host.
struct CameraState {
    config: CameraConfig,
    place: arena::Place,
    hdr: Buffer,
    motion: Option<Buffer>,
    /// Device addresses of the images that the tick under way reads: colour, motion.
    inputs: [u64; 2],
    last_ns: Option<i64>,
    last_interval_ns: u32,
    epoch_ns: i64,
    /// Sub-steps of a strip beyond which `cross` takes it first: of the last tick, somewhat more than the mean.
    many_substeps: u32,
    parity: u32,
    frames: u64,
    sequence: u64,
    changed: bool,
    /// Whether there may be pixels that never had a valid colour.
    may_be_unarmed: bool,
    /// No pixel is held longer by a refractory period that is no more.
    holds_until_ns: Option<i64>,
}

/// Cameras that step together.
pub struct Rig {
    device: Arc<Device>,
    options: RigOptions,
    cameras: Vec<CameraState>,
    arena: Arena,
    bindings: Arc<BindingSet>,
    code: code::Code,
    kernels: record::Kernels,
    specialised: record::Specialised,
    commands: Commands,
    again: Commands,
    merging: Commands,
    representing: Commands,
    slices: Option<Buffer>,
    recorded: Option<Vec<Permutation>>,
    recorded_again: bool,
    addresses_known_to_the_layer: BTreeSet<u64>,
    timer: StageTimer,
    fence: Fence,
    parameters: Vec<Camera>,
    packets: Vec<Packet>,
    events: Vec<u32>,
    aps: Vec<Option<ApsFrame>>,
    diagnostics: Vec<Diagnostics>,
    stage_ns: Vec<(&'static str, u64)>,
    gpu_zones: GpuZones,
    submit_to_packet_ns: u64,
}

impl Rig {
    /// A rig with default options.
    pub fn new(device: &Arc<Device>, cameras: &[CameraConfig]) -> Result<Self, EngineError> {
        Rig::with_options(device, cameras, RigOptions::default())
    }

    /// A rig. Every sensor is validated; `motion` and `paper` synthesis need a motion format.
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
        let places = arena::place(configs, options);
        let arena = Arena::new(device, &places, options)?;
        let mut cameras = Vec::with_capacity(configs.len());
        for (number, (config, place)) in configs.iter().zip(places).enumerate() {
            let input = |image: &str, texel_bytes: usize| {
                device.allocate(
                    &format!("camera {number} {image}"),
                    (config.sensor.pixels() * texel_bytes) as u64,
                    vk::BufferUsageFlags::empty(),
                    MemoryLocation::CpuToGpu,
                )
            };
            cameras.push(CameraState {
                hdr: input("hdr", config.hdr.texel_bytes())?,
                motion: config.motion.map(|m| input("motion", m.texel_bytes())).transpose()?,
                config: config.clone(),
                place,
                inputs: [0; 2],
                last_ns: None,
                last_interval_ns: 0,
                epoch_ns: 0,
                many_substeps: 0,
                parity: 0,
                frames: 0,
                sequence: 0,
                changed: true,
                may_be_unarmed: true,
                holds_until_ns: None,
            });
        }
        let bindings = BindingSet::with_kinds(device, slots())?;
        bindings.bind(arena.shown());
        let count = cameras.len();
        let mut rig = Rig {
            kernels: record::Kernels::new(device, &cameras, &code::Code::default(), &bindings)?,
            code: code::Code::default(),
            specialised: record::Specialised::default(),
            commands: Commands::new(device)?,
            again: Commands::new(device)?,
            merging: Commands::new(device)?,
            representing: Commands::new(device)?,
            slices: None,
            recorded: None,
            recorded_again: false,
            addresses_known_to_the_layer: BTreeSet::new(),
            timer: StageTimer::new(device, record::STAMPS + 2)?,
            fence: Fence::new(device)?,
            parameters: vec![Camera::default(); count],
            packets: cameras
                .iter()
                .map(|c| Packet {
                    width_px: c.config.sensor.width,
                    height_px: c.config.sensor.height,
                    ..Packet::default()
                })
                .collect(),
            events: vec![0; count],
            aps: vec![None; count],
            diagnostics: vec![Diagnostics::default(); count],
            stage_ns: if options.stage_times {
                record::STAGES.iter().copied().chain(["again"]).map(|stage| (stage, 0)).collect()
            } else {
                vec![("tick", 0)]
            },
            gpu_zones: GpuZones::default(),
            submit_to_packet_ns: 0,
            device: Arc::clone(device),
            options,
            cameras,
            arena,
            bindings,
        };
        rig.arena.clear(&rig.device)?;
        for camera in 0..count {
            rig.upload_static_draws(camera)?;
        }
        Ok(rig)
    }

    /// The device that it runs on.
    #[must_use]
    pub fn device(&self) -> &Arc<Device> {
        &self.device
    }

    /// Cameras.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cameras.len()
    }

    /// Whether it has none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cameras.is_empty()
    }

    /// A camera's sensor as it is now.
    pub fn sensor(&self, camera: usize) -> Result<&SensorModel, EngineError> {
        Ok(&self.camera(camera)?.config.sensor)
    }

    /// Changes a camera's parameters from the next tick on, all but its size.
    pub fn set_sensor(&mut self, camera: usize, sensor: SensorModel) -> Result<(), EngineError> {
        let has_motion = self.camera(camera)?.config.motion.is_some();
        check_sensor(camera, &sensor, has_motion)?;
        let state = &mut self.cameras[camera];
        let old = std::mem::replace(&mut state.config.sensor, sensor);
        let new = &state.config.sensor;
        if (new.width, new.height) != (old.width, old.height) {
            let error = EngineError::SizeChange {
                camera,
                expected_width: old.width,
                expected_height: old.height,
                actual_width: new.width,
                actual_height: new.height,
            };
            state.config.sensor = old;
            return Err(error);
        }
        state.changed = true;
        state.holds_until_ns =
            state.last_ns.map(|last_ns| last_ns + i64::from(old.refractory_ns)).max(state.holds_until_ns);
        let statics = |s: &SensorModel| {
            (s.seed, [s.contrast_on, s.contrast_off, s.contrast_mismatch, s.leak_rate_hz, s.leak_spread_log])
        };
        // Planes hold ln(S + log_offset) of what the camera saw: other units, another start.
        let planes = |s: &SensorModel| {
            (s.intensity, s.log_offset.to_bits(), s.exposure_gain.to_bits(), parameters::needs_lattice(s))
        };
        let (draws_change, planes_change) = (statics(new) != statics(&old), planes(new) != planes(&old));
        if planes_change {
            self.reset(camera)?;
            if self.arena.fit_planes(&self.device, &mut self.cameras, camera)? {
                self.record_again()?;
            }
        }
        if draws_change { self.upload_static_draws(camera) } else { Ok(()) }
    }

    /// Buffers for a producer on this device; they are free whenever no tick is under way.
    pub fn inputs(&self, camera: usize) -> Result<InputBuffers<'_>, EngineError> {
        let c = self.camera(camera)?;
        Ok(InputBuffers { hdr: &c.hdr, motion: c.motion.as_ref() })
    }

    /// Writes a frame from host memory into a camera's input buffers.
    pub fn upload(&mut self, camera: usize, frame: &FrameBytes<'_>) -> Result<(), EngineError> {
        let _zone = zone!("ingest");
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

    /// Events in each packet of the last tick.
    #[must_use]
    pub fn events(&self) -> &[u32] {
        &self.events
    }

    /// APS frames of the last tick.
    #[must_use]
    pub fn aps(&self) -> &[Option<ApsFrame>] {
        &self.aps
    }

    /// What the last tick counted.
    #[must_use]
    pub fn diagnostics(&self) -> &[Diagnostics] {
        &self.diagnostics
    }

    /// GPU time of all stages of the last tick.
    #[must_use]
    pub fn gpu_ns(&self) -> u64 {
        self.stage_ns.iter().map(|(_, ns)| ns).sum()
    }

    /// From the call of submit to the packets in the last tick.
    #[must_use]
    pub fn submit_to_packet_ns(&self) -> u64 {
        self.submit_to_packet_ns
    }

    /// Whether a camera's next frame is its first.
    pub fn is_at_start(&self, camera: usize) -> Result<bool, EngineError> {
        Ok(self.camera(camera)?.last_ns.is_none())
    }

    /// Takes the events of the last tick's packets, without a copy; their headers stay. Only of
    /// [`PacketPlace::Owned`] are there any to take.
    pub fn take_packets(&mut self) -> Vec<Packet> {
        let take = |packet: &mut Packet| Packet {
            x: std::mem::take(&mut packet.x),
            y: std::mem::take(&mut packet.y),
            t_offset_ns: std::mem::take(&mut packet.t_offset_ns),
            polarity: std::mem::take(&mut packet.polarity),
            ..*packet
        };
        self.packets.iter_mut().map(take).collect()
    }

    /// Forgets what a camera saw: its next frame is its first. Noise goes on where it was.
    pub fn reset(&mut self, camera: usize) -> Result<(), EngineError> {
        self.camera(camera)?;
        self.arena.clear_counters(&self.device, self.cameras[camera].place.slot)?;
        let c = &mut self.cameras[camera];
        c.last_ns = None;
        c.may_be_unarmed = true;
        c.holds_until_ns = None;
        c.frames = 0;
        Ok(())
    }

    /// Memory in use, per camera and purpose.
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

    /// What the driver tells about each compiled kernel of the last tick's sensors, by stage; see
    /// [`crate::Kernel::statistics`].
    pub fn kernel_statistics(&self) -> Result<Vec<(&'static str, KernelStatistics)>, EngineError> {
        self.kernels_by_stage().map(|(stage, kernel)| Ok((stage, kernel.statistics()?))).collect()
    }

    /// Log intensity (Q7.24) at the end of each sub-step of the last interval, `[sub-step][pixel]`, as
    /// far as the block of the pixel has sub-steps; only with [`RigOptions::keep_substeps`].
    #[must_use]
    pub fn substeps_q24(&self, camera: usize) -> Option<Vec<Vec<i32>>> {
        if !self.options.keep_substeps || camera >= self.cameras.len() {
            return None;
        }
        let pixels = self.cameras[camera].config.sensor.pixels();
        let samples = &self.arena.buffers[layout::SAMPLES];
        let all = esaac_model::substeps::MAX_SUBSTEPS as usize + 1;
        let first = camera * all * self.arena.samples_pixels;
        Some((0..all).map(|i| samples.read::<i32>(first + i * pixels, pixels).to_vec()).collect())
    }

    fn camera(&self, camera: usize) -> Result<&CameraState, EngineError> {
        self.cameras
            .get(camera)
            .ok_or(EngineError::NoSuchCamera { expected: self.cameras.len(), actual: camera })
    }

    /// What is drawn once a pixel: thresholds and leak.
    fn upload_static_draws(&mut self, camera: usize) -> Result<(), EngineError> {
        let c = &self.cameras[camera];
        let s = &c.config.sensor;
        let pixels = s.pixels();
        let mut words = vec![0_u32; 3 * pixels];
        let (on, rest) = words.split_at_mut(pixels);
        let (off, leak) = rest.split_at_mut(pixels);
        let nominal_on = q24_to_log(log_to_q24(s.contrast_on));
        for pixel in 0..pixels {
            let key = random::PixelKey { seed: s.seed, camera: c.config.camera, pixel: pixel as u32 };
            let c_on =
                random::threshold_log(key, random::Stream::ContrastOn, s.contrast_on, s.contrast_mismatch);
            let c_off =
                random::threshold_log(key, random::Stream::ContrastOff, s.contrast_off, s.contrast_mismatch);
            on[pixel] = log_to_q24(c_on) as u32;
            off[pixel] = log_to_q24(c_off) as u32;
            leak[pixel] = parameters::leak_per_ns(
                s.leak_rate_hz * nominal_on * random::leak_factor(key, s.leak_spread_log),
            );
        }
        let first = c.place.state_base as usize + StateWord::ContrastOn as usize * pixels;
        self.arena.upload(&self.device, layout::STATE, first as u64 * 4, bytemuck::cast_slice(&words))
    }
}

fn check_sensor(camera: usize, sensor: &SensorModel, has_motion: bool) -> Result<(), EngineError> {
    sensor.validate().map_err(|source| EngineError::Sensor { camera, source })?;
    let synthesis = match sensor.synthesis {
        Synthesis::Motion => "motion",
        Synthesis::Paper => "paper",
        Synthesis::Linear | Synthesis::None => return Ok(()),
    };
    if has_motion {
        Ok(())
    } else {
        Err(FrameError::MissingMotion { camera: camera as u32, synthesis }.into())
    }
}
