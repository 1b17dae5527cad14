//! What buffers hold for a camera that begins anew.

use super::CameraState;
use super::geometry::Place;
use super::transfer::Write;
use bytemuck::cast_slice;
use esaac_layout::{self as layout, Counters, StateWord};
use esaac_model::{Pixel, SensorModel};

/// The write that sets both of a camera's sets of counters to their initial values.
pub(super) fn fresh_counters(place: &Place) -> Write {
    counters([only_deferred(0); 2], place)
}

/// The write of both sets of a camera's or an outlet's counters.
pub(super) fn counters(sets: [Counters; 2], place: &Place) -> Write {
    let offset = place.first_element(layout::COUNTERS) * size_of::<Counters>() as u64;
    Write { slot: layout::COUNTERS, offset, bytes: cast_slice(&sets).to_vec() }
}

/// Counters of an empty packet, with deferred events behind it.
pub(super) fn only_deferred(deferred: u32) -> Counters {
    Counters { deferred, emitted_fit: u32::MAX, ..Counters::default() }
}

/// The writes that make a camera's bus free, and nothing wait behind it; none if it has room for no bus.
pub(super) fn fresh_bus(camera: &CameraState) -> Vec<Write> {
    let stride = u64::from(layout::BINDINGS[layout::BUS].stride);
    let elements = camera.place.elements()[layout::BUS].unwrap_or(0);
    if elements == 0 {
        return Vec::new();
    }
    let offset = camera.place.first_element(layout::BUS) * stride;
    let bus = Write { slot: layout::BUS, offset, bytes: vec![0; (elements * stride) as usize] };
    vec![bus, fresh_counters(&camera.outlet)]
}

/// The write of a camera's random draws that are made once per pixel: thresholds, and leak or factors, which lie one
/// after the other in `state`.
pub(super) fn pixel_draws(place: &Place, sensor: &SensorModel, camera: u32) -> Write {
    let draws = sensor.pixel_draws(camera);
    let mut bytes = cast_slice(&draws.contrast_on_q24).to_vec();
    bytes.extend_from_slice(cast_slice(&draws.contrast_off_q24));
    match sensor.pixel {
        Pixel::Log => bytes.extend_from_slice(cast_slice(&draws.leak_per_ns)),
        Pixel::Physical => bytes.extend_from_slice(cast_slice(&sensor.pixel_factors(camera))),
    }
    let first = place.first_element(layout::STATE) + StateWord::ContrastOn as u64 * sensor.pixels() as u64;
    Write { slot: layout::STATE, offset: first * 4, bytes }
}
