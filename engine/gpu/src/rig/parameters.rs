//! The rows of tables that kernels read: from a sensor and the time of a frame.

use super::CameraState;
use super::arena::Arena;
use super::geometry::Place;
use super::sensor::{frame_words, half_pel_stride, has_bus, needs_half_pel};
use esaac_layout::{self as layout, Camera, FrameKind, Optics, Physical, Readout};
use esaac_model::optics::{focal_px, psf_weights};
use esaac_model::physical::Bus;
use esaac_model::random::HAZARD_FRACTION_BITS;
use esaac_model::substeps::{MAX_SUBSTEPS, error_share, least_substeps, quantise_ns};
use esaac_model::{LOG_FRACTION_BITS, Pixel, SensorModel, SubstepPolicy, Synthesis, Timestamps, log_to_q24};

/// First element of a camera's log intensities in `samples`, which has `kept` elements; 0 if log intensities are not
/// kept. If they are kept, it fits 32 bits, or the allocation would have failed.
fn samples_base(kept: u64, samples_pixels: usize, slot: u32) -> u32 {
    let first = u64::from(slot) * u64::from(MAX_SUBSTEPS + 1) * samples_pixels as u64;
    if first < kept { u32::try_from(first).expect("a buffer has fewer bytes than 2^32") } else { 0 }
}

/// How an interval's packet is cut into bins.
struct Bins {
    width: u32,
    rows: u32,
    row_px: u32,
}

/// Whether all events of a packet have the end of a sub-step as their time. A log pixel's shots have their own times, and so
/// have events that wait.
fn only_at_samples(sensor: &SensorModel, quantum: u32, any_wait: bool) -> bool {
    let has_shots = sensor.pixel == Pixel::Log && sensor.shot_noise_rate_hz > 0.0;
    sensor.timestamps == Timestamps::AtSample
        && sensor.substep_policy == SubstepPolicy::Fixed
        && quantum == 1
        && sensor.synthesis != Synthesis::None
        && !has_shots
        && !any_wait
}

fn bins(sensor: &SensorModel, quantum: u32, span_ns: u32, place: &Place, any_wait: bool) -> Bins {
    let (bin_count, pixels) = (place.bin_count, place.pixels);
    let by_rows = |steps: u32, width: u32| {
        let rows = (bin_count / steps).max(1);
        Bins { width, rows, row_px: pixels.div_ceil(rows).max(1) }
    };
    let quanta = span_ns / quantum + 1;
    if only_at_samples(sensor, quantum, any_wait) && sensor.substeps < bin_count {
        by_rows(sensor.substeps + 1, 0)
    } else if quanta <= bin_count {
        by_rows(quanta, quantum)
    } else {
        let width = (span_ns / bin_count + 1).next_multiple_of(quantum);
        Bins { width, rows: 1, row_px: pixels }
    }
}

/// One camera's row of the table for a tick; `t_ns` is `None` if the camera takes no part.
pub(super) fn camera_row(camera: &CameraState, t_ns: Option<i64>, arena: &Arena) -> Camera {
    let (sensor, place) = (&camera.config.sensor, &camera.place);
    let start_ns = camera.last_ns.or(t_ns).unwrap_or(0);
    let interval_ns = t_ns.map_or(0, |t| (t - start_ns) as u32);
    let frame_kind = match (t_ns, camera.last_ns) {
        (None, _) => FrameKind::None,
        (Some(_), None) => FrameKind::First,
        (Some(_), Some(_)) => FrameKind::Interval,
    };
    let planes_address = arena.buffer(layout::PLANES).address();
    let stride = u64::from(layout::BINDINGS[layout::SAMPLES].stride);
    let samples = arena.buffer(layout::SAMPLES).bytes() / stride;
    // Events come to a bus when they happen. They are stamped when they leave it.
    let quantum_ns = if has_bus(sensor) { 1 } else { sensor.timestamp_quantum_ns };
    let base_ns = quantise_ns(start_ns, i64::from(quantum_ns));
    let base_to_start_ns = (start_ns - base_ns) as u32;
    let bins = bins(sensor, quantum_ns, base_to_start_ns + interval_ns, place, camera.may_have_waiting());
    let q27 = f64::from(1_u32 << HAZARD_FRACTION_BITS);
    let aps_end_ns = sensor.aps_start_ns.saturating_add(sensor.aps_exposure_ns).min(interval_ns);
    let aps_max = ((1_u32 << sensor.aps_bits) - 1) as f32;
    Camera {
        hdr_address: camera.inputs.hdr,
        motion_address: camera.inputs.motion,
        planes_address,
        start_ns,
        epoch_ns: camera.epoch_ns,
        frame_kind: frame_kind as u32,
        interval_ns,
        previous_interval_ns: camera.last_interval_ns,
        base_to_start_ns,
        first_stamp_ns: t_ns.map_or(0, |t_ns| camera.first_stamp_ns(base_ns, t_ns)),
        width: sensor.width,
        height: sensor.height,
        pixels: place.pixels,
        blocks_x: place.blocks_x,
        blocks: place.blocks,
        camera: camera.config.camera,
        seed_low: sensor.seed as u32,
        seed_high: (sensor.seed >> 32) as u32,
        frame_slot: camera.frame_slot,
        has_motion: u32::from(camera.motion.is_some()),
        has_previous_motion: u32::from(camera.motion.is_some() && camera.frames >= 1),
        plane_base: place.plane_base,
        motion_base: place.motion_base,
        state_base: place.state_base,
        block_base: place.block_base,
        bin_base: place.bin_base,
        bin_count: place.bin_count,
        bin_width: bins.width,
        bin_rows: bins.rows,
        bin_row_px: bins.row_px,
        event_base: place.event_base,
        event_capacity: place.event_capacity,
        aps_base: place.aps_base,
        substeps: sensor.substeps,
        substeps_fixed: u32::from(sensor.substep_policy == SubstepPolicy::Fixed),
        // While a hold may end that began under another refractory period, each pixel is walked: the holds that end in
        // skipped tiles would be forgotten with the kernels that know of them.
        no_skip: u32::from(camera.changed || camera.may_end_old_holds()),
        exposure_gain: sensor.exposure_gain as f32,
        log_offset: sensor.dark_level() as f32,
        refractory_ns: sensor.refractory_ns,
        latency_ns: sensor.latency_ns,
        latency_jitter_ns: sensor.latency_jitter_ns,
        timestamp_quantum_ns: quantum_ns,
        contrast_on_q24: log_to_q24(sensor.contrast_on),
        contrast_off_q24: log_to_q24(sensor.contrast_off),
        hazard_q27_per_ns: (0.5 * sensor.shot_noise_rate_hz * 1e-9 * q27) as f32,
        inverse_white: (1.0 / sensor.white_level) as f32,
        aps_start_ns: sensor.aps_start_ns.min(aps_end_ns),
        aps_end_ns: if sensor.aps_exposure_ns == 0 { 0 } else { aps_end_ns },
        aps_scale: (sensor.aps_gain / sensor.white_level) as f32 * aps_max,
        aps_max,
        slot: place.slot,
        samples_base: samples_base(samples, arena.samples_pixels, place.slot),
        log_dark: sensor.dark_level().ln() as f32,
        frame_words: frame_words(sensor),
        tile_base: place.tile_base,
        many_substeps: camera.many_substeps,
        bin_storage_base: place.bin_storage_base,
        bin_capacity: place.bin_capacity,
        half_pel_stride: if needs_half_pel(sensor) { half_pel_stride(sensor) } else { 0 },
    }
}

/// The row of a camera's outlet in the table of cameras. `camera_row` is the camera's own.
pub(super) fn outlet_row(camera: &CameraState, t_ns: Option<i64>, camera_row: &Camera) -> Camera {
    let (sensor, outlet) = (&camera.config.sensor, &camera.outlet);
    let quantum_ns = sensor.timestamp_quantum_ns;
    let base_ns = quantise_ns(camera_row.start_ns, i64::from(quantum_ns));
    let base_to_start_ns = (camera_row.start_ns - base_ns) as u32;
    let mut place = *outlet;
    place.pixels = camera.place.pixels;
    // An event leaves at any time, and not at the end of a sub-step.
    let sensor = SensorModel { timestamps: Timestamps::Interpolated, ..sensor.clone() };
    let bins = bins(&sensor, quantum_ns, base_to_start_ns + camera_row.interval_ns, &place, false);
    Camera {
        slot: outlet.slot,
        base_to_start_ns,
        first_stamp_ns: t_ns.map_or(0, |t_ns| camera.first_stamp_ns(base_ns, t_ns)),
        timestamp_quantum_ns: quantum_ns,
        bin_base: outlet.bin_base,
        bin_count: outlet.bin_count,
        bin_width: bins.width,
        bin_rows: bins.rows,
        bin_row_px: bins.row_px,
        bin_storage_base: outlet.bin_storage_base,
        bin_capacity: outlet.bin_capacity,
        event_base: outlet.event_base,
        event_capacity: outlet.event_capacity,
        ..*camera_row
    }
}

/// A camera's row of the table of readouts. `row`: that of the camera in the table of cameras, `outlet_row`: that of its
/// outlet; `None` without a bus.
pub(super) fn readout_row(camera: &CameraState, row: &Camera, outlet_row: Option<u32>) -> Readout {
    let Some(outlet_row) = outlet_row else { return Readout::default() };
    let readout = camera.config.sensor.readout_model();
    let (row_ps, event_ps) = match readout.bus {
        Bus::Ideal => (0, 0),
        Bus::Fifo { event_ps } => (0, event_ps),
        Bus::Rows { row_ps, event_ps } => (row_ps, event_ps),
    };
    let period_ns = i64::from(readout.cap_period_ns);
    Readout {
        event_ps,
        row_ps,
        first_period: row.start_ns.div_euclid(period_ns),
        period_to_start_ns: row.start_ns.rem_euclid(period_ns) as u32,
        cap_period_ns: readout.cap_period_ns,
        cap_events: readout.cap_events,
        has_bus: 1,
        outlet_row,
        bus_base: camera.place.bus_base,
    }
}

/// A camera's row of the table of physical pixels.
pub(super) fn physical_row(sensor: &SensorModel) -> Physical {
    let pixel = sensor.physical_pixel();
    let q24 = f64::from(1_u32 << LOG_FRACTION_BITS);
    let drive_per_s = pixel.drive_per_s(1.0);
    // Leak for an intensity of 1 and a second.
    let light_q24 = q24 * sensor.contrast_on * pixel.leak_per_lux_hz * pixel.lux_per_unit;
    Physical {
        drive_log: drive_per_s.ln() as f32,
        second_per_s: pixel.second_pole_per_s() as f32,
        variance: (pixel.noise_gain * pixel.noise_gain / pixel.photoreceptor_charge_e) as f32,
        dark_leak_q24_per_s: (q24 * sensor.contrast_on * pixel.leak_hz(0.0, 1.0)) as f32,
        dark_light_q24_per_s: (light_q24 * pixel.dark_intensity(1.0)) as f32,
        light_q24_per_charge: (light_q24 / drive_per_s) as f32,
        padding: 0,
    }
}

/// A camera's row of the table of optics for a tick; `t_ns` is `None` if the camera takes no part.
pub(super) fn optics_row(camera: &CameraState, t_ns: Option<i64>) -> Optics {
    let sensor = &camera.config.sensor;
    let start_ns = camera.last_ns.or(t_ns).unwrap_or(0);
    let end_ns = t_ns.unwrap_or(start_ns);
    let interval_ns = (end_ns - start_ns) as u32;
    let [psf_0, psf_1, psf_2, psf_3] = psf_weights(sensor.psf_sigma_px).map(|weight| weight as f32);
    let tangent_per_px = match sensor.vignetting_fov_deg {
        0.0 => 0.0,
        fov_deg => 1.0 / focal_px(sensor.width, fov_deg),
    };
    let row = Optics {
        psf_0,
        psf_1,
        psf_2,
        psf_3,
        vignetting_per_px2: (tangent_per_px * tangent_per_px) as f32,
        lamp_start: 1.0,
        lamp_end: 1.0,
        least_substeps: least_substeps(sensor, interval_ns),
        substep_error_share: error_share(sensor, interval_ns) as f32,
        ..Optics::default()
    };
    let Some(lamp) = sensor.flicker() else { return row };
    let step = lamp.hz * 1e-9 * (1_u64 << layout::FLICKER_FRACTION_BITS) as f64;
    Optics {
        lamp_start: lamp.factor(start_ns) as f32,
        lamp_end: lamp.factor(end_ns) as f32,
        flicker_depth: lamp.depth as f32,
        // A whole turn is 0.
        flicker_phase: (lamp.turns(start_ns) * 4_294_967_296.0).round() as u64 as u32,
        flicker_step: step.round() as u32,
        ..row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_log_intensities_lie_does_not_overflow() {
        // Eighty cameras of two megapixels: their log intensities are not kept, and would begin beyond 32 bits.
        assert_eq!(samples_base(4, 1920 * 1080, 79), 0);
        assert_eq!(samples_base(10 * 65 * 100, 100, 9), 9 * 65 * 100);
    }
}
