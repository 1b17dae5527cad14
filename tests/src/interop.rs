//! Both ends of the link in one process: a producer that uploads frames into slots, and an engine that checks what
//! arrives by checksums computed on its device.

#![expect(unsafe_code, reason = "copies between buffers are recorded by hand")]

use crate::device::{DEVICE, OTHER_SIDE};
use crate::frames::{Frame, Sequence, scene, times};
use crate::run::camera;
use esaac_engine::ash::vk;
use esaac_engine::{Buffer, CameraConfig, Commands, Device, InputBuffers, Kernel, MemoryLocation, Rig};
use esaac_interop::{
    CameraTerms, Copies, Images, InteropError, Planes, Producer, ProducerOptions, Server, ServerOptions,
    Service,
};
use esaac_model::paths::SceneMotion;
use esaac_model::{HdrFormat, MotionFormat, SensorModel};
use esaac_scene::SceneKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The device of the other side of a link.
#[must_use]
pub fn other_device() -> Arc<Device> {
    Arc::clone(&OTHER_SIDE)
}

/// Waits until `is_so` returns true.
///
/// # Panics
/// After ten seconds; `what` names the condition.
#[track_caller]
pub fn until(what: &str, is_so: impl Fn() -> bool) {
    let started = Instant::now();
    while !is_so() {
        assert!(started.elapsed() < Duration::from_secs(10), "{what}: not in ten seconds");
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// A path for a socket, in a temporary folder of its own.
pub struct Place {
    folder: TempDir,
}

impl Default for Place {
    fn default() -> Self {
        Place { folder: tempfile::tempdir().expect("a temporary folder") }
    }
}

impl Place {
    /// Path of the socket.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        self.folder.path().join("engine.sock")
    }
}

/// Number of images that producers send in turn.
pub const IMAGES: usize = 12;

/// [`IMAGES`] images of the flight scene for a sensor, with motion.
#[must_use]
pub fn flight(sensor: &SensorModel) -> Sequence {
    let size = (sensor.width, sensor.height);
    scene(SceneKind::Flight, size, &times(0, IMAGES), HdrFormat::F16x4, MotionFormat::F32x4)
}

/// Images of a flight forth and back, which can repeat without a jump.
#[must_use]
pub fn there_and_back(sensor: &SensorModel, count: usize) -> Sequence {
    let there = times(0, count / 2 + 1);
    let back = there[1..there.len() - 1].iter().rev();
    // The motion of a round's first image leads back to its last.
    let mut round = vec![there[1]];
    round.extend(there.iter().chain(back));
    let size = (sensor.width, sensor.height);
    let mut sequence = scene(SceneKind::Flight, size, &round, HdrFormat::F16x4, MotionFormat::F32x4);
    sequence.frames.remove(0);
    sequence
}

/// A service of several cameras, numbered in order.
#[must_use]
pub fn service(
    path: &Path,
    cameras: &[(SensorModel, &Sequence)],
    latest: bool,
    options: ServerOptions,
) -> Service {
    let configs: Vec<CameraConfig> =
        (0..).zip(cameras).map(|(number, (sensor, sequence))| camera(sensor, number, sequence)).collect();
    let rig = Rig::new(&DEVICE, &configs).expect("a rig");
    let terms: Vec<CameraTerms> =
        configs.iter().map(|config| CameraTerms { latest, ..config.into() }).collect();
    Service::open(rig, path, &terms, options).expect("a service")
}

/// Options that allow every means of sharing memory, also on a software driver.
#[must_use]
pub fn trusting() -> ServerOptions {
    ServerOptions { trusts_producers: true, ..ServerOptions::default() }
}

/// A server without a rig, for tests of what happens before the first frame.
pub fn server(path: &Path, config: &CameraConfig, options: ServerOptions) -> Result<Server, InteropError> {
    Server::open(&DEVICE, path, &[config.into()], options)
}

/// A producer that uploads frames.
pub struct Uploader {
    device: Arc<Device>,
    /// The link.
    pub producer: Producer,
    staging: Planes<Buffer>,
    commands: Commands,
}

impl Uploader {
    /// Connects a camera.
    pub fn connect(
        device: &Arc<Device>,
        path: &Path,
        options: &ProducerOptions,
    ) -> Result<Self, InteropError> {
        let producer = Producer::connect(device, path, options)?;
        let staging = producer.client().images().bytes().map(|&bytes| {
            device
                .allocate("upload", bytes, vk::BufferUsageFlags::empty(), MemoryLocation::CpuToGpu)
                .expect("a frame's bytes")
        });
        Ok(Uploader { device: Arc::clone(device), producer, staging, commands: Commands::new(device)? })
    }

    /// Writes a frame into a free slot and announces it with time `t_ns`.
    pub fn send(&mut self, frame: &Frame, t_ns: i64) -> Result<(), InteropError> {
        let slot = self.upload(Planes::of(&frame.hdr, frame.motion.as_deref()))?;
        self.producer.publish(slot, t_ns, COPIES)
    }

    /// As [`Uploader::send`], with depth, ids and poses where the camera takes them.
    pub fn send_scene(
        &mut self,
        images: Planes<&[u8]>,
        t_ns: i64,
        scene: &SceneMotion,
    ) -> Result<(), InteropError> {
        let slot = self.upload(images)?;
        self.producer.publish_scene(slot, t_ns, COPIES, scene)
    }

    /// Writes those images of a frame that the camera takes into a free slot.
    fn upload(&mut self, frame: Planes<&[u8]>) -> Result<u32, InteropError> {
        let slot = self.producer.slot()?;
        let given = [Some(frame.hdr), frame.motion, frame.depth, frame.ids];
        let taken = self.taken(given);
        for (staging, bytes) in self.staging.iter_mut().zip(&taken) {
            if let Some(bytes) = bytes {
                staging.write(0, bytes);
            }
        }
        let (device, commands) = (&self.device, &self.commands);
        let images = self.producer.client().images();
        let written = |(staging, bytes): (_, &Option<&[u8]>)| bytes.map(|_| staging);
        let sources: Vec<Option<&Buffer>> = self.staging.iter().zip(&taken).map(written).collect();
        self.producer.write(slot, |place, hooks| {
            let record = |commands| match place.images() {
                None => {
                    let InputBuffers { hdr, motion, depth, ids } = place.inputs();
                    let targets = [Some(hdr), motion, depth, ids].into_iter().flatten();
                    for (source, target) in sources.iter().zip(targets) {
                        let Some(source) = source else { continue };
                        let region = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: target.bytes() }];
                        // SAFETY: `commands` is being recorded; both buffers live until it has run.
                        unsafe {
                            device.raw().cmd_copy_buffer(commands, source.raw(), target.raw(), &region);
                        };
                    }
                }
                Some(targets) => {
                    for (source, target) in sources.iter().zip(targets.iter()) {
                        let Some(source) = source else { continue };
                        render_to_image(device, commands, source, *target, images);
                    }
                }
            };
            // SAFETY: the last submission was waited for, and this one is, below; meanwhile the slot is ours.
            unsafe { commands.record(record) }?;
            device.run_with_hooks(commands, hooks)
        })?;
        Ok(slot)
    }

    /// Of what is given for each image, that of images that the camera takes.
    fn taken<'a>(&self, given: [Option<&'a [u8]>; 4]) -> Vec<Option<&'a [u8]>> {
        self.staging.as_ref().paired(given).iter().map(|(_, bytes)| *bytes).collect()
    }
}

/// What the uploader makes of each frame.
const COPIES: Copies = Copies { device: 1, host: 1 };

/// Records a copy of tightly packed rows to an image, in place of a renderer's drawing.
fn render_to_image(
    device: &Device,
    commands: vk::CommandBuffer,
    source: &Buffer,
    target: vk::Image,
    images: &Images,
) {
    let region = [vk::BufferImageCopy::default()
        .image_subresource(vk::ImageSubresourceLayers {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            layer_count: 1,
            ..vk::ImageSubresourceLayers::default()
        })
        .image_extent(vk::Extent3D { width: images.width_px, height: images.height_px, depth: 1 })];
    let layout = vk::ImageLayout::GENERAL;
    // SAFETY: `commands` is being recorded; both live until it has run, and the source holds the image.
    unsafe { device.raw().cmd_copy_buffer_to_image(commands, source.raw(), target, layout, &region) };
}

/// Computes checksums of buffers on the device under test.
pub struct Checksum {
    kernel: Kernel,
    sums: Buffer,
}

impl Default for Checksum {
    fn default() -> Self {
        let words = esaac_kernels::words(include_bytes!(concat!(env!("OUT_DIR"), "/checksum.spv")));
        // SAFETY: the build script has compiled it; it has two buffers and a word of push constants.
        let kernel =
            unsafe { Kernel::new(&DEVICE, "checksum", &words, 2, 4, &[]) }.expect("a kernel that builds");
        let sums = DEVICE
            .allocate("sums", 8, vk::BufferUsageFlags::empty(), MemoryLocation::GpuToCpu)
            .expect("eight bytes");
        Checksum { kernel, sums }
    }
}

impl Checksum {
    /// Checksum of the first `bytes` of a buffer.
    pub fn of(&mut self, buffer: &Buffer, bytes: usize) -> [u32; 2] {
        let words = (bytes / 4) as u32;
        self.sums.write(0, &[0_u32; 2]);
        // SAFETY: the last submission was waited for.
        unsafe { self.kernel.bind(&[buffer, &self.sums]) };
        DEVICE
            .run_once(|commands| {
                // SAFETY: both buffers live until the submission is waited for, and hold what the kernel reads and
                // writes.
                unsafe { self.kernel.record(commands, &words.to_le_bytes(), [words.div_ceil(64), 1, 1]) };
                let barrier = [vk::MemoryBarrier2::default()
                    .src_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
                    .src_access_mask(vk::AccessFlags2::SHADER_STORAGE_WRITE)
                    .dst_stage_mask(vk::PipelineStageFlags2::HOST)
                    .dst_access_mask(vk::AccessFlags2::HOST_READ)];
                let info = vk::DependencyInfo::default().memory_barriers(&barrier);
                // SAFETY: `commands` is being recorded on this device.
                unsafe { DEVICE.raw().cmd_pipeline_barrier2(commands, &info) };
            })
            .expect("a sum");
        let sums = self.sums.read::<u32>(0, 2);
        [sums[0], sums[1]]
    }
}
