//! Computes what the kernels read, from a sensor and the time of a frame.

use super::arena::Arena;
use super::geometry::Place;
use super::{CameraState, RigOptions};
use crate::kernel::stages;
use crate::policy::{KernelPolicy, KernelSet};
use esaac_layout::{
    self as layout, BackwardTransferConstants, CROWDED_QUEUE_PER_PX, Camera, CrossConstants,
    CrossCpuConstants, FrameKind, IngestConstants, IngestCpuConstants, Optics, Physical, QUEUE_PER_PX,
    Readout, ReadoutConstants, SortConstants, SynthesizeConstants,
};
use esaac_model::optics::{focal_px, psf_weights};
use esaac_model::paths::Projection;
use esaac_model::physical::Bus;
use esaac_model::random::HAZARD_FRACTION_BITS;
use esaac_model::substeps::{MAX_SUBSTEPS, by_error, error_share, least_substeps, quantise_ns};
use esaac_model::{
    IdFormat, Intensity, LOG_FRACTION_BITS, MotionFormat, Pixel, ReadoutKind, SensorModel, SubstepPolicy,
    Synthesis, Taps, Timestamps, log_to_q24,
};

/// Constants and options that determine which kernels run for a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Permutation {
    /// Whether the kernels are those of synthesis `rigid`.
    pub rigid: bool,
    /// Whether the kernels are those of the physical pixel.
    pub physical: bool,
    /// Whether there is a bus before the packet.
    pub has_bus: bool,
    /// Constants of `ingest`.
    pub ingest: IngestConstants,
    /// Constants of `cross`, for its first run in a tick.
    pub cross: CrossConstants,
    /// Number of transfers of detail between half-pel frames: none, the forward one, or both.
    pub transfers: u32,
    /// Whether frames are read by address.
    pub by_address: bool,
    /// Whether the next frame may be the camera's first.
    pub may_be_first: bool,
    /// Whether pixels may be unarmed in the interval.
    pub may_be_unarmed: bool,
}

/// The permutation that a camera needs; code of effects that are off is left out. `texels`: whether the texel views
/// cover all of `planes` and `motion`. `queue_per_px`: room in the event queues. `rests`: whether pixels rest that can.
pub(super) fn permutation(
    camera: &CameraState,
    options: RigOptions,
    policy: KernelPolicy,
    texels: bool,
    queue_per_px: u32,
    rests: bool,
) -> Permutation {
    let sensor = &camera.config.sensor;
    // On the software driver, code for first frames and unarmed pixels is compiled in only while a camera needs it: it
    // costs more than one more compilation. (A first frame has no interval in which pixels could be unarmed.)
    let leaves_out = policy.whole_tiles;
    let geometry = camera.config.geometry.filter(|_| is_rigid(sensor));
    let fisheye = geometry.is_some_and(|geometry| geometry.lens.projection() == Projection::Fisheye);
    let physical = is_physical(sensor);
    let (leaks, has_noise) = match sensor.pixel {
        Pixel::Log => (sensor.leak_rate_hz > 0.0, sensor.shot_noise_rate_hz > 0.0),
        Pixel::Physical => {
            (sensor.leak_rate_hz != 0.0 || sensor.leak_per_lux_hz != 0.0, sensor.noise_gain > 0.0)
        }
    };
    Permutation {
        rigid: is_rigid(sensor),
        physical,
        has_bus: has_bus(sensor),
        ingest: IngestConstants {
            intensity: sensor.intensity,
            half_pel: needs_half_pel(sensor) && sensor.transfers > 0,
            hdr_format: camera.config.hdr,
            motion_format: camera.config.motion.unwrap_or(MotionFormat::F16x2),
            id_format: camera.config.geometry.and_then(|g| g.ids).unwrap_or(IdFormat::U32),
            effect_psf: sensor.psf_sigma_px > 0.0,
            effect_vignetting: sensor.vignetting_fov_deg > 0.0,
            effect_flicker: sensor.flicker().is_some(),
            fisheye,
            layered: layers(sensor) > 1,
            substeps_by_error: by_error(sensor),
        },
        cross: CrossConstants {
            intensity: sensor.intensity,
            effect_mismatch: sensor.contrast_mismatch > 0.0,
            // A pixel that is held when the refractory period is switched off stays held until the period ends.
            effect_refractory: sensor.refractory_ns > 0 || camera.last_ns < camera.holds_until_ns,
            effect_leak: leaks,
            effect_shot: has_noise,
            effect_delay: sensor.latency_ns > 0 || sensor.latency_jitter_ns > 0,
            at_sample: sensor.timestamps == Timestamps::AtSample,
            effect_aps: sensor.aps_exposure_ns > 0,
            effect_flicker: sensor.flicker().is_some(),
            synthesis: sensor.synthesis,
            taps: sensor.taps,
            dump_samples: options.keep_substeps,
            queue_overflowed: false,
            queue_per_px,
            second_run: false,
            fisheye,
            layers: layers(sensor),
            pixels_rest: camera.knows_rest(rests),
            passes_still: physical
                && policy.passes_still
                && !options.keep_substeps
                && sensor.aps_exposure_ns == 0
                && sensor.flicker().is_none(),
        },
        // Without half-pel frames there is nothing to transfer.
        transfers: if needs_half_pel(sensor) { sensor.transfers } else { 0 },
        // Elements beyond the texel views can be read only by address.
        by_address: policy.by_address || !texels,
        may_be_first: !leaves_out || camera.last_ns.is_none(),
        may_be_unarmed: !leaves_out || (camera.last_ns.is_some() && camera.may_be_unarmed),
    }
}

/// A kernel (name and embedded SPIR-V) with its specialisation constants, by id.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Specialised {
    pub kernel: (&'static str, &'static [u8]),
    pub constants: Vec<u32>,
}

impl Permutation {
    /// The kernel of `ingest`.
    pub(super) fn ingest(&self, policy: KernelPolicy) -> Specialised {
        let mut constants = self.ingest.words();
        let kernel = match policy.kernels {
            KernelSet::Gpu => match (self.physical, self.rigid) {
                (false, false) => stages::INGEST_GPU,
                (false, true) => stages::INGEST_RIGID_GPU,
                (true, false) => stages::INGEST_PHYSICAL_GPU,
                (true, true) => stages::INGEST_PHYSICAL_RIGID_GPU,
            },
            KernelSet::SoftwareDriver => {
                let own = IngestCpuConstants {
                    by_address: self.by_address,
                    threads: policy.ingest_threads(),
                    may_be_first: self.may_be_first,
                };
                constants.extend(own.words());
                match (self.physical, self.rigid) {
                    (false, false) => stages::INGEST_CPU,
                    (false, true) => stages::INGEST_RIGID_CPU,
                    (true, false) => stages::INGEST_PHYSICAL_CPU,
                    (true, true) => stages::INGEST_PHYSICAL_RIGID_CPU,
                }
            }
        };
        Specialised { kernel, constants }
    }

    /// The kernel of `ingest` that makes surfaces alongside the other, if that is a kernel of its own.
    pub(super) fn ingest_surfaces(&self, policy: KernelPolicy) -> Option<Specialised> {
        let apart = policy.kernels == KernelSet::Gpu && self.rigid;
        apart.then(|| Specialised { kernel: stages::INGEST_SURFACES_GPU, constants: self.ingest.words() })
    }

    /// Workgroups of `ingest` per tile: one per colour component on a GPU if frames become half-pel frames, else one.
    pub(super) fn ingest_groups(&self, policy: KernelPolicy) -> u32 {
        let finely = policy.kernels == KernelSet::Gpu && self.ingest.half_pel;
        if finely { channels(self.ingest.intensity) } else { 1 }
    }

    /// The kernel of `backward_transfer`, if there are two transfers; `ingest` does the forward one.
    pub(super) fn backward_transfer(&self) -> Option<Specialised> {
        let constants = BackwardTransferConstants {
            intensity: self.ingest.intensity,
            by_address: self.by_address,
            fisheye: self.ingest.fisheye,
        };
        let kernel = if self.rigid { stages::BACKWARD_TRANSFER_RIGID } else { stages::BACKWARD_TRANSFER };
        (self.transfers > 1).then(|| Specialised { kernel, constants: constants.words() })
    }

    /// The kernels of `synthesize`, one after the other: for the lists, then for the levels. None if `cross` synthesises by
    /// itself.
    pub(super) fn synthesize(&self, policy: KernelPolicy) -> Vec<Specialised> {
        if policy.kernels != KernelSet::Gpu || !(self.rigid || self.cross.layers > 1) {
            return Vec::new();
        }
        let cross = &self.cross;
        let moves_on = self.physical
            || cross.effect_leak
            || cross.effect_shot
            || cross.effect_aps
            || cross.effect_flicker
            || cross.dump_samples;
        let constants = SynthesizeConstants {
            intensity: cross.intensity,
            effect_flicker: cross.effect_flicker,
            synthesis: cross.synthesis,
            taps: cross.taps,
            fisheye: cross.fisheye,
            layers: cross.layers,
            skips_still_tiles: !moves_on,
        };
        let kernels = match self.rigid {
            true => [stages::SYNTHESIZE_LISTS_RIGID, stages::SYNTHESIZE_LEVELS_RIGID],
            false => [stages::SYNTHESIZE_LISTS_LAYERS, stages::SYNTHESIZE_LEVELS_LAYERS],
        };
        kernels.into_iter().map(|kernel| Specialised { kernel, constants: constants.words() }).collect()
    }

    /// The kernels of `cross`: that of most tiles, and that of the tiles where motions meet, if these have one of their
    /// own. `queue_overflowed`: the one that runs again for sub-tiles with more events than the queue
    /// holds.
    pub(super) fn cross(&self, policy: KernelPolicy, queue_overflowed: bool) -> Vec<Specialised> {
        let kinds = if self.cross.layers > 1 { &[false, true][..] } else { &[false] };
        kinds.iter().map(|&meeting| self.cross_where(policy, queue_overflowed, meeting)).collect()
    }

    /// The kernel of `cross` for the sub-tiles that the first run lists; `None` if it lists none, or may have
    /// changed which pixels rest.
    pub(super) fn second_run(&self, policy: KernelPolicy, without_queue: bool) -> Option<Specialised> {
        let lists = policy.kernels == KernelSet::Gpu && !self.rigid && !self.cross.pixels_rest;
        let cross = CrossConstants { queue_per_px: CROWDED_QUEUE_PER_PX, second_run: true, ..self.cross };
        lists.then(|| Permutation { cross, ..*self }.cross_where(policy, without_queue, false))
    }

    /// The kernel of `cross` of the tiles where motions meet (`meeting`), or of the others.
    fn cross_where(&self, policy: KernelPolicy, queue_overflowed: bool, meeting: bool) -> Specialised {
        // Without a queue, its length must not make another kernel.
        let queue_per_px = if queue_overflowed { QUEUE_PER_PX } else { self.cross.queue_per_px };
        let mut constants = CrossConstants { queue_overflowed, queue_per_px, ..self.cross }.words();
        let kernel = match policy.kernels {
            KernelSet::Gpu => match (self.physical, self.rigid, meeting) {
                (false, false, false) => stages::CROSS_GPU,
                (false, false, true) | (false, true, _) => stages::CROSS_LEVELS_GPU,
                (true, false, false) => stages::CROSS_PHYSICAL_GPU,
                (true, false, true) | (true, true, _) => stages::CROSS_PHYSICAL_LEVELS_GPU,
            },
            KernelSet::SoftwareDriver => {
                let own = CrossCpuConstants {
                    by_address: self.by_address,
                    threads: policy.cross_threads(queue_overflowed),
                    may_be_unarmed: self.may_be_unarmed,
                    whole_tiles: policy.whole_tiles,
                };
                constants.extend(own.words());
                match (self.physical, self.rigid, meeting) {
                    (false, false, false) => stages::CROSS_CPU,
                    (false, false, true) => stages::CROSS_LAYERS_CPU,
                    (false, true, _) => stages::CROSS_RIGID_CPU,
                    (true, false, false) => stages::CROSS_PHYSICAL_CPU,
                    (true, false, true) => stages::CROSS_PHYSICAL_LAYERS_CPU,
                    (true, true, _) => stages::CROSS_PHYSICAL_RIGID_CPU,
                }
            }
        };
        Specialised { kernel, constants }
    }
}

impl Specialised {
    /// Whether the kernel reads what `synthesize` has made.
    pub(super) fn reads_levels(&self) -> bool {
        [stages::CROSS_LEVELS_GPU, stages::CROSS_PHYSICAL_LEVELS_GPU].iter().any(|k| k.0 == self.kernel.0)
    }
}

/// The kernel of `readout`.
pub(super) fn readout(policy: KernelPolicy) -> Specialised {
    Specialised { kernel: stages::READOUT, constants: readout_constants(policy).words() }
}

/// The kernel of `readout` that serves chunks side by side.
pub(super) fn readout_apart(policy: KernelPolicy) -> Specialised {
    Specialised { kernel: stages::READOUT_APART, constants: readout_constants(policy).words() }
}

fn readout_constants(policy: KernelPolicy) -> ReadoutConstants {
    ReadoutConstants {
        threads: policy.readout_threads,
        most_rounds: policy.readout_rounds,
        apart: policy.readout_apart,
    }
}

/// The kernel of `sort` whose workgroups take `group_bins` bins. `has_bus`: whether a camera has a bus. `summed`: whether
/// `bin_sums` runs before it.
pub(super) fn sort(policy: KernelPolicy, group_bins: u32, has_bus: bool, summed: bool) -> Specialised {
    let constants = SortConstants {
        group_bins,
        threads: policy.sort_threads,
        native_division: policy.native_division,
        has_bus,
        readout_light: has_bus && policy.readout_light,
        summed,
    };
    Specialised { kernel: stages::SORT, constants: constants.words() }
}

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
    samples: u32,
}

fn bins(sensor: &SensorModel, quantum: u32, span_ns: u32, place: &Place) -> Bins {
    let (bin_count, pixels) = (place.bin_count, place.pixels);
    let by_rows = |steps: u32, width: u32, samples: u32| {
        let rows = (bin_count / steps).max(1);
        Bins { width, rows, row_px: pixels.div_ceil(rows).max(1), samples }
    };
    let quanta = span_ns / quantum + 1;
    let only_at_samples = sensor.timestamps == Timestamps::AtSample
        && sensor.substep_policy == SubstepPolicy::Fixed
        && sensor.latency_ns == 0
        && sensor.latency_jitter_ns == 0
        && quantum == 1
        && sensor.synthesis != Synthesis::None;
    if only_at_samples && sensor.substeps < bin_count {
        by_rows(sensor.substeps + 1, 1, sensor.substeps)
    } else if quanta <= bin_count {
        by_rows(quanta, quantum, 0)
    } else {
        let width = (span_ns / bin_count + 1).next_multiple_of(quantum);
        Bins { width, rows: 1, row_px: pixels, samples: 0 }
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
    let bins = bins(sensor, quantum_ns, base_to_start_ns + interval_ns, place);
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
        bin_samples: bins.samples,
        event_base: place.event_base,
        event_capacity: place.event_capacity,
        aps_base: place.aps_base,
        substeps: sensor.substeps,
        substeps_fixed: u32::from(sensor.substep_policy == SubstepPolicy::Fixed),
        no_skip: u32::from(camera.changed),
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
pub(super) fn outlet_row(camera: &CameraState, camera_row: &Camera) -> Camera {
    let (sensor, outlet) = (&camera.config.sensor, &camera.outlet);
    let quantum_ns = sensor.timestamp_quantum_ns;
    let base_to_start_ns = camera_row.start_ns.rem_euclid(i64::from(quantum_ns)) as u32;
    let mut place = *outlet;
    place.pixels = camera.place.pixels;
    // An event leaves at any time, and not at the end of a sub-step.
    let sensor = SensorModel { timestamps: Timestamps::Interpolated, ..sensor.clone() };
    let bins = bins(&sensor, quantum_ns, base_to_start_ns + camera_row.interval_ns, &place);
    Camera {
        slot: outlet.slot,
        base_to_start_ns,
        timestamp_quantum_ns: quantum_ns,
        bin_base: outlet.bin_base,
        bin_count: outlet.bin_count,
        bin_width: bins.width,
        bin_rows: bins.rows,
        bin_row_px: bins.row_px,
        bin_samples: bins.samples,
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
        unused: 0,
        also_unused: 0,
    }
}

/// Whether a kernel reads a camera's row of the table of optics: lens or lamp do anything to its light, or sub-steps follow
/// their error.
pub(super) fn has_optics(sensor: &SensorModel) -> bool {
    sensor.psf_sigma_px > 0.0
        || sensor.vignetting_fov_deg > 0.0
        || sensor.flicker().is_some()
        || by_error(sensor)
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

/// Words of a frame, over all colour components.
pub(super) fn plane_words(sensor: &SensorModel) -> u32 {
    channels(sensor.intensity).saturating_mul(frame_words(sensor))
}

/// Colour components of a frame in `planes`.
pub(super) fn channels(intensity: Intensity) -> u32 {
    if intensity == Intensity::BayerRggb { 3 } else { 1 }
}

/// Words of a frame per colour component: those of the frame itself or, for cubic warps, of the half-pel frame with its
/// border for taps beyond the image (a row before it and two after, two columns on either side). Saturates for a frame
/// too large for any rig.
pub(super) fn frame_words(sensor: &SensorModel) -> u32 {
    if needs_half_pel(sensor) {
        half_pel_stride(sensor).saturating_mul(2 * sensor.height + 3)
    } else {
        sensor.width * sensor.height
    }
}

/// Whether warps read a half-pel frame.
pub(super) fn needs_half_pel(sensor: &SensorModel) -> bool {
    sensor.synthesis.has_half_pels() && sensor.taps == Taps::Cubic
}

/// Most surfaces that a pixel may show between two frames, told apart by motion vectors.
pub(super) fn layers(sensor: &SensorModel) -> u32 {
    if sensor.synthesis == Synthesis::Motion { sensor.layers } else { 1 }
}

/// Whether what pixels show between two frames is worked out apart from their walks, where kernels have threads for it.
pub(super) fn makes_levels(sensor: &SensorModel) -> bool {
    is_rigid(sensor) || layers(sensor) > 1
}

/// Whether surfaces are found in frames and followed along exact paths.
pub(super) fn is_rigid(sensor: &SensorModel) -> bool {
    sensor.synthesis == Synthesis::Rigid
}

/// Whether the pixel is the physical one.
pub(super) fn is_physical(sensor: &SensorModel) -> bool {
    sensor.pixel == Pixel::Physical
}

/// Whether events wait for a bus.
pub(super) fn has_bus(sensor: &SensorModel) -> bool {
    sensor.readout != ReadoutKind::None
}

/// Words of a row of the half-pel frame: its samples, and two of border on either side.
fn half_pel_stride(sensor: &SensorModel) -> u32 {
    2 * sensor.width + 4
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
