//! Frames: their images in host memory, in a camera's own buffers, or in those of a caller.

use super::{CameraState, Rig};
use crate::error::EngineError;
use crate::loan::Loan;
use crate::memory::Buffer;
use esaac_model::{IdFormat, MotionFormat, frame};

/// A frame in host memory, rows tightly packed. Images that the camera does not take may be there; nobody reads them.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameBytes<'a> {
    /// Colour image.
    pub hdr: &'a [u8],
    /// Motion image, if the camera has a motion format.
    pub motion: Option<&'a [u8]>,
    /// Depth, if the camera has a geometry.
    pub depth: Option<&'a [u8]>,
    /// Instance ids, if its geometry has a format for them.
    pub ids: Option<&'a [u8]>,
}

/// Buffers that a producer on the device writes a frame into, rows tightly packed. Images that the camera does not take may
/// be there; nobody reads them.
#[derive(Clone, Copy)]
pub struct InputBuffers<'a> {
    /// Colour image.
    pub hdr: &'a Buffer,
    /// Motion image, if the camera has a motion format.
    pub motion: Option<&'a Buffer>,
    /// Depth, if the camera has a geometry.
    pub depth: Option<&'a Buffer>,
    /// Instance ids, if its geometry has a format for them.
    pub ids: Option<&'a Buffer>,
}

impl InputBuffers<'_> {
    /// Lends the buffers to a step that was submitted.
    pub(super) fn lend(self) -> impl Iterator<Item = Loan> {
        let InputBuffers { hdr, motion, depth, ids } = self;
        [Some(hdr), motion, depth, ids].into_iter().flatten().map(Buffer::lend)
    }
}

/// Device addresses of a camera's images; 0 for those that it has not.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Addresses {
    pub hdr: u64,
    pub motion: u64,
    pub depth: u64,
    pub ids: u64,
}

/// A camera's frame for [`Rig::step_frames`] and [`Rig::submit_frames`].
#[derive(Clone, Copy)]
pub struct FrameInput<'a> {
    /// Time of the frame, nanoseconds.
    pub t_ns: i64,
    /// Buffers that hold the frame; `None` for the camera's own input buffers.
    pub inputs: Option<InputBuffers<'a>>,
}

impl Rig {
    /// A camera's input buffers, for a producer on this device. The producer may write them whenever no tick runs.
    pub fn inputs(&self, camera: usize) -> Result<InputBuffers<'_>, EngineError> {
        self.check_ready()?;
        let c = self.camera(camera)?;
        Ok(c.input_buffers())
    }

    /// Writes a frame from host memory into a camera's input buffers. An error if an image has the wrong size.
    pub fn upload(&mut self, camera: usize, frame: &FrameBytes<'_>) -> Result<(), EngineError> {
        let _zone = zone!("ingest");
        self.check_ready()?;
        self.camera(camera)?;
        let c = &mut self.cameras[camera];
        let (sensor, number) = (&c.config.sensor, camera as u32);
        let size = (sensor.width, sensor.height);
        frame::check_size(number, "hdr", size, c.config.hdr.texel_bytes(), frame.hdr.len())?;
        if let Some(format) = c.config.motion {
            let given = frame.motion.unwrap_or_default().len();
            frame::check_size(number, "motion", size, format.texel_bytes(), given)?;
        }
        if let Some(geometry) = c.config.geometry {
            let given = frame.depth.unwrap_or_default().len();
            frame::check_size(number, "depth", size, geometry.depth.texel_bytes(), given)?;
            if let Some(format) = geometry.ids {
                let given = frame.ids.unwrap_or_default().len();
                frame::check_size(number, "ids", size, format.texel_bytes(), given)?;
            }
        }
        c.hdr.write(0, frame.hdr);
        for (buffer, bytes) in
            [(&mut c.motion, frame.motion), (&mut c.depth, frame.depth), (&mut c.ids, frame.ids)]
        {
            if let (Some(buffer), Some(bytes)) = (buffer, bytes) {
                buffer.write(0, bytes);
            }
        }
        Ok(())
    }
}

impl CameraState {
    /// Its own input buffers.
    pub(super) fn input_buffers(&self) -> InputBuffers<'_> {
        InputBuffers {
            hdr: &self.hdr,
            motion: self.motion.as_ref(),
            depth: self.depth.as_ref(),
            ids: self.ids.as_ref(),
        }
    }

    /// Device addresses of a frame, which is preceded in its buffers by `images_before` images of the same size. An
    /// error if a buffer is too small, or of another device.
    pub(super) fn addresses(
        &self,
        number: usize,
        inputs: Option<InputBuffers<'_>>,
        images_before: usize,
    ) -> Result<Addresses, EngineError> {
        let inputs = inputs.unwrap_or_else(|| self.input_buffers());
        let sensor = &self.config.sensor;
        let own = self.hdr.device();
        let holds = |image, buffer: Option<&Buffer>, texel_bytes: usize| {
            if let Some(buffer) = buffer {
                own.check_own(buffer.device(), || format!("camera {number}: the buffer of {image}"))?;
            }
            let needed = sensor.pixels() * texel_bytes;
            let before = images_before * needed;
            let actual = (buffer.map_or(0, Buffer::bytes) as usize).saturating_sub(before);
            let size = (sensor.width, sensor.height);
            // A buffer may be longer than its image.
            frame::check_size(number as u32, image, size, texel_bytes, actual.min(needed))?;
            Ok::<u64, EngineError>(buffer.map_or(0, Buffer::address) + before as u64)
        };
        let hdr = holds("hdr", Some(inputs.hdr), self.config.hdr.texel_bytes())?;
        let optional = |image, buffer, texel_bytes: Option<usize>| match texel_bytes {
            Some(texel_bytes) => holds(image, buffer, texel_bytes),
            None => Ok(0),
        };
        let geometry = self.config.geometry;
        Ok(Addresses {
            hdr,
            motion: optional("motion", inputs.motion, self.config.motion.map(MotionFormat::texel_bytes))?,
            depth: optional("depth", inputs.depth, geometry.map(|g| g.depth.texel_bytes()))?,
            ids: optional("ids", inputs.ids, geometry.and_then(|g| g.ids).map(IdFormat::texel_bytes))?,
        })
    }
}
