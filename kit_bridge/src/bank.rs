//! A bank: one rig, and the buffers that CUDA copies its cameras' frames into. A rig holds a limited number of
//! cameras. If there are more, they are spread over several banks, which step at the same time.

use crate::error::Fault;
use crate::image::Place;
use crate::pack::{Texel, Tiles};
use esaac_engine::MAX_CAMERAS;
use esaac_engine::{
    CameraConfig, Device, FrameBytes, FrameInput, InputBuffers, Rig, RigOptions, SubmitHooks,
};
use esaac_interop::cuda::{CudaBuffer, CudaLink};
use esaac_model::SensorModel;
use std::ops::Range;
use std::sync::Arc;

/// Formats of a camera's colour and motion images.
pub type Format = (Texel, Option<Texel>);

/// The images of a step.
pub struct Frames {
    /// One entry for all cameras of a tiled renderer, else one for each camera; `None` for a camera without a frame.
    pub images: Vec<Option<(Tiles, Option<Tiles>)>>,
    /// Whether the one entry is for all cameras.
    pub tiled: bool,
}

impl Frames {
    /// A camera's images, and its index among them.
    pub fn of(&self, camera: usize) -> Option<(&Tiles, Option<&Tiles>, usize)> {
        let (at, index) = if self.tiled { (0, camera) } else { (camera, 0) };
        self.images[at].as_ref().map(|(hdr, motion)| (hdr, motion.as_ref(), index))
    }
}

/// Buffers that CUDA copies whole images to: colour and motion.
type Copied = [Option<CudaBuffer>; 2];

/// Cameras in one rig.
pub struct Bank {
    /// The rig.
    pub rig: Rig,
    /// Numbers of its cameras among all cameras.
    pub cameras: Range<usize>,
    copied: Vec<Copied>,
    scratch: Vec<u8>,
}

/// How often frames were copied.
#[derive(Clone, Copy, Debug, Default)]
pub struct Copies {
    /// Images that passed through the host.
    pub host: u64,
    /// Copies on the device.
    pub device: u64,
}

impl Bank {
    /// Banks for cameras of these sensors and formats.
    pub fn all(
        device: &Arc<Device>,
        sensors: &[SensorModel],
        formats: &[Format],
        options: RigOptions,
    ) -> Result<Vec<Self>, Fault> {
        let mut banks = Vec::new();
        for first in (0..sensors.len()).step_by(MAX_CAMERAS) {
            let cameras = first..sensors.len().min(first + MAX_CAMERAS);
            let configs: Vec<CameraConfig> = cameras
                .clone()
                .map(|camera| CameraConfig {
                    sensor: sensors[camera].clone(),
                    camera: camera as u32,
                    hdr: formats[camera].0.hdr(),
                    motion: formats[camera].1.map(Texel::motion),
                })
                .collect();
            let rig = Rig::with_options(device, &configs, options)?;
            banks.push(Bank { rig, cameras, copied: Vec::new(), scratch: Vec::new() });
        }
        Ok(banks)
    }

    /// Copies the frames of this bank's cameras to where its rig reads them.
    pub fn bring(
        &mut self,
        frames: &Frames,
        link: Option<&CudaLink>,
        copies: &mut Copies,
    ) -> Result<(), Fault> {
        let targets = if frames.tiled { 1 } else { self.cameras.len() };
        self.copied.resize_with(targets, Copied::default);
        if frames.tiled && on_device(frames, self.cameras.start) {
            let (hdr, motion, _) = frames.of(self.cameras.start).expect("tiles are for every camera");
            let (first, count) = (self.cameras.start, self.cameras.len());
            let link = link.expect("frames on a device come with a link");
            for (tiles, target) in [(Some(hdr), 0), (motion, 1)] {
                let Some(tiles) = tiles else { continue };
                copies.device += copy(link, tiles, first, count, &mut self.copied[0][target])?;
            }
            return Ok(());
        }
        for (own, camera) in self.cameras.clone().enumerate() {
            let Some((hdr, motion, index)) = frames.of(camera) else { continue };
            if matches!(hdr.place(), Place::Cuda { .. }) {
                let link = link.expect("frames on a device come with a link");
                for (tiles, target) in [(Some(hdr), 0), (motion, 1)] {
                    let Some(tiles) = tiles else { continue };
                    copies.device += copy(link, tiles, index, 1, &mut self.copied[own][target])?;
                }
            } else {
                self.upload(own, hdr, motion, index)?;
                copies.host += 1 + u64::from(motion.is_some());
            }
        }
        Ok(())
    }

    fn upload(&mut self, own: usize, hdr: &Tiles, motion: Option<&Tiles>, index: usize) -> Result<(), Fault> {
        let mut packed_motion = Vec::new();
        let hdr = hdr.as_bytes(index).unwrap_or_else(|| {
            hdr.pack(index, &mut self.scratch);
            &self.scratch
        });
        let motion = motion.map(|motion| match motion.as_bytes(index) {
            Some(bytes) => bytes,
            None => {
                motion.pack(index, &mut packed_motion);
                &packed_motion[..]
            }
        });
        Ok(self.rig.upload(own, &FrameBytes { hdr, motion })?)
    }

    /// Steps the cameras that have a time, with the frames that were copied.
    pub fn step(&mut self, frames: &Frames, t_ns: &[Option<i64>]) -> Result<(), Fault> {
        let Bank { rig, cameras, copied, .. } = self;
        let own = &t_ns[cameras.clone()];
        if frames.tiled && on_device(frames, cameras.start) {
            let times: Vec<i64> = own.iter().flatten().copied().collect();
            let inputs = inputs(&copied[0]).expect("tiles were copied");
            rig.step_tiles(&times, inputs, &SubmitHooks::default())?;
            return Ok(());
        }
        let inputs: Vec<Option<FrameInput<'_>>> = cameras
            .clone()
            .enumerate()
            .map(|(index, camera)| {
                let inputs = if on_device(frames, camera) { inputs(&copied[index]) } else { None };
                own[index].map(|t_ns| FrameInput { t_ns, inputs })
            })
            .collect();
        rig.step_frames(&inputs, &SubmitHooks::default())?;
        Ok(())
    }
}

fn on_device(frames: &Frames, camera: usize) -> bool {
    frames.of(camera).is_some_and(|(hdr, ..)| matches!(hdr.place(), Place::Cuda { .. }))
}

fn inputs(copied: &Copied) -> Option<InputBuffers<'_>> {
    let [hdr, motion] = copied;
    hdr.as_ref()
        .map(|hdr| InputBuffers { hdr: hdr.buffer(), motion: motion.as_ref().map(CudaBuffer::buffer) })
}

/// Copies the images of `count` cameras into their buffer, which is made at the first time.
fn copy(
    link: &CudaLink,
    tiles: &Tiles,
    first: usize,
    count: usize,
    target: &mut Option<CudaBuffer>,
) -> Result<u64, Fault> {
    let bytes = (tiles.image_bytes() * count) as u64;
    let target = match target {
        Some(target) => target,
        None => target.insert(link.buffer(tiles.name(), bytes)?),
    };
    if let Place::Cuda { after: Some(stream) } = tiles.place() {
        // SAFETY: the array's producer says that this is a stream of the device's primary context.
        #[expect(unsafe_code, reason = "CUDA's edge")]
        unsafe { link.follow(stream) }?;
    }
    if let Some(texture) = tiles.texture() {
        // SAFETY: the caller says that this is a handle of the primary context.
        #[expect(unsafe_code, reason = "CUDA's edge")]
        unsafe { link.copy_texture(tiles.name(), texture, tiles.size_px(), tiles.texel().hdr(), target) }?;
        return Ok(1);
    }
    let rows = tiles.rows(first, count);
    let copies = rows.len() as u64;
    for (rows, offset) in rows {
        // SAFETY: the array's owner guarantees its shape, and the array is kept until the step is over.
        #[expect(unsafe_code, reason = "CUDA's edge")]
        unsafe { link.copy(tiles.name(), rows, target, offset) }?;
    }
    Ok(copies)
}
