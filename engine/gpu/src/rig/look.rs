//! What is read back of a tick's frames before the tick that takes them.

use super::transfer::{Part, read_back_after};
use super::{CameraState, InputBuffers, Rig};
use crate::commands::SubmitHooks;
use crate::error::EngineError;
use crate::memory::Buffer;
use esaac_model::SensorModel;

/// A frame that a tick is to take.
#[derive(Clone, Copy)]
pub(super) struct Given<'a> {
    pub t_ns: i64,
    /// Buffers that hold it; `None` for the camera's own.
    pub inputs: Option<InputBuffers<'a>>,
    /// Images of the same size before it in each buffer.
    pub images_before: usize,
}

/// At most so many rows of an image, evenly spread.
pub(super) fn spread_rows(height: u32, most: u32) -> impl Iterator<Item = u32> + use<> {
    let stride = height.div_ceil(most);
    (stride / 2..height).step_by(stride as usize)
}

/// These rows of a frame's image in `buffer`.
pub(super) fn parts_of_rows<'a>(
    sensor: &SensorModel,
    given: &Given<'_>,
    buffer: &'a Buffer,
    texel_bytes: usize,
    rows: impl Iterator<Item = u32>,
) -> impl Iterator<Item = Part<'a>> {
    let row_bytes = sensor.width as usize * texel_bytes;
    let first_row = given.images_before * sensor.height as usize;
    rows.map(move |row| Part {
        buffer,
        offset: ((first_row + row as usize) * row_bytes) as u64,
        bytes: row_bytes as u64,
    })
}

impl Rig {
    /// Reads parts of a tick's frames back: those that `parts` names, none for a camera that is not looked at. `take` gets
    /// each of the other cameras with its frame, and takes its bytes off those that are left. What `hooks` have before a first
    /// submission is taken out of them, if this is the step's first.
    pub(super) fn look_at_frames(
        &mut self,
        frames: &[Option<Given<'_>>],
        hooks: &mut SubmitHooks<'_>,
        parts: impl for<'a> Fn(&'a CameraState, &Given<'a>) -> Vec<Part<'a>>,
        take: impl Fn(&mut CameraState, &Given<'_>, &mut &[u8]),
    ) -> Result<(), EngineError> {
        let mut all_parts = Vec::new();
        let mut looked = Vec::new();
        for (number, (camera, given)) in self.cameras.iter().zip(frames).enumerate() {
            let Some(given) = given else { continue };
            let own = parts(camera, given);
            if !own.is_empty() {
                all_parts.extend(own);
                looked.push((number, given));
            }
        }
        if looked.is_empty() {
            return Ok(());
        }
        let bytes = match read_back_after(&self.device, &all_parts, hooks) {
            Ok(bytes) => bytes,
            Err(error) => return Err(if error.leaves_work() { self.lose(error) } else { error }),
        };
        let mut rest = &bytes[..];
        for (number, given) in looked {
            take(&mut self.cameras[number], given, &mut rest);
        }
        Ok(())
    }
}
