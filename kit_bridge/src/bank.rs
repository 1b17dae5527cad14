//! A bank: one rig, and the buffers that CUDA copies its cameras' frames into. A rig holds a limited number of
//! cameras. If there are more, they are spread over several banks, which step at the same time.

use crate::error::Fault;
use crate::image::Place;
use crate::pack::{Texel, Tiles};
use crate::runs::runs;
use esaac_engine::{
    CameraConfig, Device, FrameBytes, FrameInput, GeometryConfig, InputBuffers, MAX_CAMERAS, Rig, RigOptions,
    SubmitHooks, places_in_rig,
};
use esaac_interop::cuda::{CudaBuffer, CudaLink};
use esaac_model::input::InputCheck;
use esaac_model::paths::Intrinsics;
use esaac_model::{DepthFormat, SensorModel};
use std::ops::Range;
use std::sync::Arc;

/// Images of so many bytes between two others are copied with them on a device: a second copy takes longer.
const GAP_BYTES: usize = 1 << 20;

/// Number of arrays that a frame may have: colour, motion, depth, ids.
pub const PLANES: usize = 4;

/// Formats of a camera's images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    /// Colour.
    pub hdr: Texel,
    /// Motion vectors.
    pub motion: Option<Texel>,
    /// Depth.
    pub depth: Option<Texel>,
    /// Instance ids.
    pub ids: Option<Texel>,
}

/// The arrays of a frame, or of the frames of all environments.
pub struct Images {
    /// Colour.
    pub hdr: Tiles,
    /// Motion vectors.
    pub motion: Option<Tiles>,
    /// Depth.
    pub depth: Option<Tiles>,
    /// Instance ids.
    pub ids: Option<Tiles>,
    /// Whether depth and ids are not read, because something else is missing for exact paths.
    pub left_out: bool,
}

impl Format {
    /// The same without what `rigid` alone reads.
    pub fn without_geometry(self) -> Self {
        Format { depth: None, ids: None, ..self }
    }
}

impl Images {
    /// All that are read, in the order of the fields.
    pub fn planes(&self) -> [Option<&Tiles>; PLANES] {
        let geometry = [&self.depth, &self.ids].map(|plane| plane.as_ref().filter(|_| !self.left_out));
        [Some(&self.hdr), self.motion.as_ref(), geometry[0], geometry[1]]
    }

    /// The formats of all that were given.
    pub fn format(&self) -> Format {
        let of = |tiles: &Option<Tiles>| tiles.as_ref().map(Tiles::texel);
        Format { hdr: self.hdr.texel(), motion: of(&self.motion), depth: of(&self.depth), ids: of(&self.ids) }
    }

    /// Whether they are on a CUDA device.
    pub fn on_device(&self) -> bool {
        matches!(self.hdr.place(), Place::Cuda { .. })
    }
}

/// The images of a step.
pub struct Frames {
    /// One entry for all cameras of a tiled renderer, else one for each camera; `None` for a camera without a frame.
    pub images: Vec<Option<Images>>,
    /// Whether the one entry is for all cameras.
    pub tiled: bool,
}

impl Frames {
    /// A camera's images, and its index among them.
    pub fn of(&self, camera: usize) -> Option<(&Images, usize)> {
        let (at, index) = if self.tiled { (0, camera) } else { (camera, 0) };
        self.images[at].as_ref().map(|images| (images, index))
    }
}

/// Buffers that CUDA copies whole images to.
type Copied = [Option<CudaBuffer>; PLANES];

/// Cameras in one rig.
pub struct Bank {
    /// The rig.
    pub rig: Rig,
    /// Numbers of its cameras among all cameras.
    pub cameras: Range<usize>,
    copied: Vec<Copied>,
    scratch: [Vec<u8>; PLANES],
    /// Of each camera whose first frames on the host are looked at, until they have been.
    checks: Vec<Option<InputCheck>>,
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
    /// Banks for cameras of these sensors and formats. The first `checked` cameras have their input looked at.
    pub fn all(
        device: &Arc<Device>,
        sensors: &[SensorModel],
        formats: &[Format],
        lenses: &[Option<Intrinsics>],
        options: RigOptions,
        checked: usize,
    ) -> Result<Vec<Self>, Fault> {
        let mut banks = Vec::new();
        for cameras in shares(sensors) {
            let configs: Vec<CameraConfig> = cameras
                .clone()
                .map(|camera| CameraConfig {
                    sensor: sensors[camera].clone(),
                    camera: camera as u32,
                    hdr: formats[camera].hdr.hdr(),
                    motion: formats[camera].motion.map(Texel::motion),
                    geometry: geometry(&formats[camera], lenses[camera]),
                })
                .collect();
            let rig = Rig::with_options(device, &configs, options)?;
            let (first, checks) = (cameras.start, vec![None; cameras.len()]);
            let mut bank = Bank { rig, cameras, copied: Vec::new(), scratch: Default::default(), checks };
            for own in 0..checked.saturating_sub(first).min(bank.cameras.len()) {
                bank.check_input(own, formats[first + own])?;
            }
            banks.push(bank);
        }
        Ok(banks)
    }

    /// Has the input of one of its cameras looked at from now on.
    pub fn check_input(&mut self, own: usize, format: Format) -> Result<(), Fault> {
        let (sensor, hdr) = (self.rig.sensor(own)?, format.hdr.hdr());
        self.checks[own] = Some(InputCheck::new(sensor, hdr, format.motion.map(Texel::motion)));
        Ok(())
    }

    /// A camera's next frame does not follow its last one.
    pub fn restart_check(&mut self, own: usize) {
        self.checks[own].iter_mut().for_each(InputCheck::restart);
    }

    /// What is to be told of the cameras' input, with the numbers of the cameras: once for each.
    pub fn input_warnings(&mut self) -> Vec<(usize, String)> {
        let (first, mut warnings) = (self.cameras.start, Vec::new());
        for (own, check) in self.checks.iter_mut().enumerate() {
            let Some(running) = check else { continue };
            let warning = running.warning();
            if warning.is_some() || running.is_over() {
                *check = None;
            }
            warnings.extend(warning.map(|text| (first + own, text)));
        }
        warnings
    }

    /// Copies the frames of this bank's cameras to where its rig reads them. Those that have no time are left out,
    /// but for small gaps on a device.
    pub fn bring(
        &mut self,
        frames: &Frames,
        t_ns: &[Option<i64>],
        link: Option<&CudaLink>,
        copies: &mut Copies,
    ) -> Result<(), Fault> {
        let targets = if frames.tiled { 1 } else { self.cameras.len() };
        self.copied.resize_with(targets, Copied::default);
        if frames.tiled && on_device(frames, self.cameras.start) {
            let (images, _) = frames.of(self.cameras.start).expect("tiles are for every camera");
            let link = link.expect("frames on a device come with a link");
            let own = &t_ns[self.cameras.clone()];
            for (tiles, target) in images.planes().into_iter().zip(&mut self.copied[0]) {
                let Some(tiles) = tiles else { continue };
                let runs = runs(own, GAP_BYTES / tiles.image_bytes().max(1));
                copies.device += copy(link, tiles, self.cameras.clone(), &runs, target)?;
            }
            return Ok(());
        }
        for (own, camera) in self.cameras.clone().enumerate() {
            let (Some((images, index)), Some(t_ns)) = (frames.of(camera), t_ns[camera]) else { continue };
            if images.on_device() {
                let link = link.expect("frames on a device come with a link");
                for (tiles, target) in images.planes().into_iter().zip(&mut self.copied[own]) {
                    let Some(tiles) = tiles else { continue };
                    copies.device +=
                        copy(link, tiles, index..index + 1, std::slice::from_ref(&(0..1)), target)?;
                }
            } else {
                self.upload(own, images, index, t_ns)?;
                copies.host += images.planes().into_iter().flatten().count() as u64;
            }
        }
        Ok(())
    }

    fn upload(&mut self, own: usize, images: &Images, index: usize, t_ns: i64) -> Result<(), Fault> {
        let mut bytes: [Option<&[u8]>; PLANES] = [None; PLANES];
        for ((tiles, scratch), bytes) in images.planes().into_iter().zip(&mut self.scratch).zip(&mut bytes) {
            *bytes = tiles.map(|tiles| match tiles.as_bytes(index) {
                Some(bytes) => bytes,
                None => {
                    tiles.pack(index, scratch);
                    &scratch[..]
                }
            });
        }
        let [hdr, motion, depth, ids] = bytes;
        let hdr = hdr.expect("every frame has a colour image");
        if let Some(check) = &mut self.checks[own] {
            check.add(t_ns, hdr, motion);
        }
        Ok(self.rig.upload(own, &FrameBytes { hdr, motion, depth, ids })?)
    }

    /// Steps the cameras that have a time, with the frames that were copied.
    pub fn step(&mut self, frames: &Frames, t_ns: &[Option<i64>]) -> Result<(), Fault> {
        let Bank { rig, cameras, copied, .. } = self;
        let own = &t_ns[cameras.clone()];
        if frames.tiled && on_device(frames, cameras.start) {
            let inputs = inputs(&copied[0]).expect("tiles were copied");
            rig.step_tiles(own, inputs, &SubmitHooks::default())?;
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

/// The cameras of each bank: as many as one rig takes.
pub fn shares(sensors: &[SensorModel]) -> Vec<Range<usize>> {
    let mut shares: Vec<Range<usize>> = Vec::new();
    let mut taken = MAX_CAMERAS;
    for (camera, sensor) in sensors.iter().enumerate() {
        let places = places_in_rig(sensor);
        match shares.last_mut().filter(|_| taken + places <= MAX_CAMERAS) {
            Some(share) => share.end += 1,
            None => {
                shares.push(camera..camera + 1);
                taken = 0;
            }
        }
        taken += places;
    }
    shares
}

/// Lets those who gave the frames write to them again once they are copied: their streams wait for ours. Where a
/// stream is not known, the host waits.
pub fn release(frames: &Frames, link: &CudaLink) -> Result<(), Fault> {
    for images in frames.images.iter().flatten() {
        for tiles in images.planes().into_iter().flatten() {
            match tiles.place() {
                Place::Host => {}
                // SAFETY: the array's producer says that this is a stream of the device's primary context.
                #[expect(unsafe_code, reason = "CUDA's edge")]
                Place::Cuda { after: Some(stream) } => unsafe { link.lead(stream) }?,
                Place::Cuda { after: None } => link.finish()?,
            }
        }
    }
    Ok(())
}

fn on_device(frames: &Frames, camera: usize) -> bool {
    frames.of(camera).is_some_and(|(images, _)| images.on_device())
}

fn inputs(copied: &Copied) -> Option<InputBuffers<'_>> {
    let [hdr, motion, depth, ids] = copied.each_ref().map(|plane| plane.as_ref().map(CudaBuffer::buffer));
    hdr.map(|hdr| InputBuffers { hdr, motion, depth, ids })
}

/// What the rig is told of depth and ids; `None` without depth.
fn geometry(format: &Format, lens: Option<Intrinsics>) -> Option<GeometryConfig> {
    format.depth.map(|_| GeometryConfig {
        depth: DepthFormat::F32,
        ids: format.ids.map(Texel::ids),
        lens: lens.expect("frames with depth come with a lens"),
    })
}

/// Copies the images of some of the array's cameras into the buffer of `cameras`, which is made at the first time.
/// `runs` count from the first of `cameras`.
fn copy(
    link: &CudaLink,
    tiles: &Tiles,
    cameras: Range<usize>,
    runs: &[Range<usize>],
    target: &mut Option<CudaBuffer>,
) -> Result<u64, Fault> {
    let bytes = (tiles.image_bytes() * cameras.len()) as u64;
    let target = match target {
        Some(target) => target,
        None => target.insert(link.buffer(tiles.plane().name(), bytes)?),
    };
    if let Place::Cuda { after: Some(stream) } = tiles.place() {
        // SAFETY: the array's producer says that this is a stream of the device's primary context.
        #[expect(unsafe_code, reason = "CUDA's edge")]
        unsafe { link.follow(stream) }?;
    }
    if let Some(texture) = tiles.texture() {
        // SAFETY: the caller says that this is a handle of the primary context.
        #[expect(unsafe_code, reason = "CUDA's edge")]
        unsafe {
            link.copy_texture(tiles.plane().name(), texture, tiles.size_px(), tiles.texel().hdr(), target)
        }?;
        return Ok(1);
    }
    let mut copies = 0;
    for run in runs {
        let start = (run.start * tiles.image_bytes()) as u64;
        for (rows, offset) in tiles.rows(cameras.start + run.start, run.len()) {
            // SAFETY: the array's owner guarantees its shape, and the array is kept until the step is over.
            #[expect(unsafe_code, reason = "CUDA's edge")]
            unsafe { link.copy(tiles.plane().name(), rows, target, start + offset) }?;
            copies += 1;
        }
    }
    Ok(copies)
}
