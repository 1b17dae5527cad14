//! Files that the tools read and write: events as NumPy archives, frames as OpenEXR, the poses of a scene as JSON,
//! recordings of real sensors as AEDAT 4 and EVT3.

pub mod any_events;
pub mod event_file;
pub mod exr_frame;
pub mod exr_writer;
pub mod frame_time;
mod npy;
pub mod recording;
pub mod scene_file;
pub mod truth_file;
mod until_failure;
