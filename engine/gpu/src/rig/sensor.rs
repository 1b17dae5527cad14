//! What follows from a sensor's parameters alone.

use esaac_model::substeps::{BLOCK_PX, by_error};
use esaac_model::{Intensity, Pixel, ReadoutKind, SensorModel, Synthesis, Taps};

/// Words of a frame, over all colour components.
pub(super) fn plane_words(sensor: &SensorModel) -> u32 {
    channels(sensor.intensity).saturating_mul(frame_words(sensor))
}

/// Colour components of a frame in `planes`.
pub(super) fn channels(intensity: Intensity) -> u32 {
    if intensity == Intensity::BayerRggb { 3 } else { 1 }
}

/// Words of a frame per colour component: those of the frame itself or, for cubic warps, of the half-pel frame with its
/// border for taps beyond the image (a row before it and two after, two columns on either side) and with a parameter for
/// each block. Even then, since kernels write pairs. Saturates for a frame too large for any rig.
pub(super) fn frame_words(sensor: &SensorModel) -> u32 {
    if needs_half_pel(sensor) {
        let blocks = sensor.width.div_ceil(BLOCK_PX) * sensor.height.div_ceil(BLOCK_PX);
        half_pel_stride(sensor)
            .saturating_mul(2 * sensor.height + 3)
            .saturating_add(blocks.next_multiple_of(2))
    } else {
        sensor.width * sensor.height
    }
}

/// Whether warps read a half-pel frame.
pub(super) fn needs_half_pel(sensor: &SensorModel) -> bool {
    sensor.synthesis.has_half_pels() && sensor.taps == Taps::Cubic
}

/// Words of a row of the half-pel frame: its samples, and two of border on either side.
pub(super) fn half_pel_stride(sensor: &SensorModel) -> u32 {
    2 * sensor.width + 4
}

/// Whether a pixel may ever show several surfaces between two frames, told apart by motion vectors.
pub(super) fn may_have_layers(sensor: &SensorModel) -> bool {
    sensor.synthesis == Synthesis::Motion && sensor.layers != 1
}

/// Whether what pixels show between two frames is worked out apart from their walks, where kernels have threads for it;
/// for a sensor that leaves its layers to the scene, not before the scene needs them.
pub(super) fn makes_levels(sensor: &SensorModel) -> bool {
    is_rigid(sensor) || (may_have_layers(sensor) && sensor.layers > 1)
}

/// Whether surfaces are found in frames and followed along exact paths.
pub(super) fn is_rigid(sensor: &SensorModel) -> bool {
    sensor.synthesis == Synthesis::Rigid
}

/// Whether the pixel is the physical one.
pub(super) fn is_physical(sensor: &SensorModel) -> bool {
    sensor.pixel == Pixel::Physical
}

/// Whether events are stamped later than they happen.
pub(super) fn delays(sensor: &SensorModel) -> bool {
    sensor.latency_ns > 0 || sensor.latency_jitter_ns > 0
}

/// Whether events wait for a bus.
pub(super) fn has_bus(sensor: &SensorModel) -> bool {
    sensor.readout != ReadoutKind::None
}

/// Places in a rig that a camera takes, of [`MAX_CAMERAS`](esaac_layout::MAX_CAMERAS): one, and another for what has left
/// its bus.
#[must_use]
pub fn places_in_rig(sensor: &SensorModel) -> usize {
    1 + usize::from(has_bus(sensor))
}

/// Whether a kernel reads a camera's row of the table of optics: lens or lamp do anything to its light, or sub-steps follow
/// their error.
pub(super) fn has_optics(sensor: &SensorModel) -> bool {
    sensor.psf_sigma_px > 0.0
        || sensor.vignetting_fov_deg > 0.0
        || sensor.flicker().is_some()
        || by_error(sensor)
}
