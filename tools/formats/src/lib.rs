//! Files that the tools read and write: events as NumPy archives, frames as OpenEXR, recordings of real
//! sensors as AEDAT 4.

pub mod event_file;
pub mod exr_frame;
mod npy;
pub mod recording;
pub mod truth_file;
