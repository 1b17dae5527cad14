//! From a sensor and a frame's time to what the kernels read.

use super::arena::Arena;
use super::{CameraState, RigOptions};
use esaac_model::layout::{self, Camera};
use esaac_model::random::HAZARD_FRACTION_BITS;
use esaac_model::substeps::{BLOCK_PX, MAX_SUBSTEPS, quantise_ns};
use esaac_model::{
    Intensity, LOG_FRACTION_BITS, SensorModel, SubstepPolicy, Synthesis, Taps, Timestamps, log_to_q24,
};

/// Everything that decides which code runs for a camera: the specialisation constants of `cross`, by id,
/// the formats of its images, the transfers between lattices, whether its next frame may be the
/// first, and whether pixels may be unarmed.
pub(super) type Permutation = [u32; 20];

/// Which code a camera needs: an effect that is off is not there. `by_address`: the device reads fastest by address;
/// `branches`: it skips branches that no thread takes; `leaves_out`: threads take a pixel of each row of a
/// strip, and what is rarely needed is left out of the code.
pub(super) fn permutation(
    camera: &CameraState,
    options: RigOptions,
    by_address: bool,
    branches: bool,
    leaves_out: bool,
) -> Permutation {
    let sensor = &camera.config.sensor;
    [
        sensor.intensity as u32,
        u32::from(sensor.contrast_mismatch > 0.0),
        // A pixel that is held when the period is switched off is held to its end.
        u32::from(sensor.refractory_ns > 0 || camera.last_ns < camera.holds_until_ns),
        u32::from(sensor.leak_rate_hz > 0.0),
        u32::from(sensor.shot_noise_rate_hz > 0.0),
        u32::from(sensor.latency_ns > 0 || sensor.latency_jitter_ns > 0),
        u32::from(sensor.timestamps == Timestamps::AtSample),
        u32::from(sensor.aps_exposure_ns > 0),
        sensor.synthesis as u32,
        sensor.taps as u32,
        u32::from(options.keep_substeps),
        0,
        u32::from(by_address),
        u32::from(branches),
        camera.config.hdr as u32,
        camera.config.motion.map_or(0, |m| m as u32),
        // Without lattices there is nothing to transfer.
        if needs_lattice(sensor) { sensor.transfers } else { 0 },
        // What a first frame and unarmed pixels need is left out where it costs more than it takes to compile once
        // more. (A first frame has no interval in which pixels could be unarmed.)
        u32::from(!leaves_out || camera.last_ns.is_none()),
        u32::from(!leaves_out || (camera.last_ns.is_some() && camera.may_be_unarmed)),
        u32::from(leaves_out),
    ]
}

/// Index of the flag for crowded strips, which only [`cross_constants`] sets.
const PERMUTATION_CROWDED: usize = 11;

/// Indices of a permutation's other parts that the host asks about.
const PERMUTATION_INTENSITY: usize = 0;
const PERMUTATION_BY_ADDRESS: usize = 12;
const PERMUTATION_BRANCHES: usize = 13;
const PERMUTATION_HDR: usize = 14;
const PERMUTATION_MOTION: usize = 15;
const PERMUTATION_TRANSFERS: usize = 16;
const PERMUTATION_FIRST: usize = 17;
const PERMUTATION_UNARMED: usize = 18;
const PERMUTATION_WHOLE_STRIPS: usize = 19;

/// Indices of the constants of `cross` after those that a permutation begins with.
const CROSS_CONSTANT_THREADS: usize = 14;
const CROSS_CONSTANT_UNARMED: usize = 15;
const CROSS_CONSTANT_WHOLE_STRIPS: usize = 16;

/// Pixels of a strip.
const STRIP_PIXELS: u32 = layout::STRIP_BLOCKS * BLOCK_PX * BLOCK_PX;

/// Index of a permutation's delay flag.
pub(super) const PERMUTATION_DELAY: usize = 5;

/// Leak in nepers per second as Q24 per nanosecond times 2^32.
pub(super) fn leak_per_ns(leak_log_per_s: f64) -> u32 {
    (leak_log_per_s * 1e-9 * f64::from(1_u32 << LOG_FRACTION_BITS) * 4_294_967_296.0).round() as u32
}

/// How an interval's packet is cut into bins.
struct Bins {
    width: u32,
    rows: u32,
    row_px: u32,
    samples: u32,
}

fn bins(sensor: &SensorModel, span_ns: u32, bin_count: u32, pixels: u32) -> Bins {
    let by_rows = |steps: u32, width: u32, samples: u32| {
        let rows = (bin_count / steps).max(1);
        Bins { width, rows, row_px: pixels.div_ceil(rows).max(1), samples }
    };
    let quantum = sensor.timestamp_quantum_ns;
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

/// One camera's row for a tick.
pub(super) fn camera_row(camera: &CameraState, t_ns: Option<i64>, arena: &Arena) -> Camera {
    let (sensor, place) = (&camera.config.sensor, &camera.place);
    let start_ns = camera.last_ns.or(t_ns).unwrap_or(0);
    let interval_ns = t_ns.map_or(0, |t| (t - start_ns) as u32);
    let phase = match (t_ns, camera.last_ns) {
        (None, _) => 0,
        (Some(_), None) => 1,
        (Some(_), Some(_)) => 2,
    };
    let planes_address = arena.buffers[layout::PLANES].address();
    let samples_pixels = arena.samples_pixels as u32;
    let base_ns = quantise_ns(start_ns, i64::from(sensor.timestamp_quantum_ns));
    let base_to_start_ns = (start_ns - base_ns) as u32;
    let bins = bins(sensor, base_to_start_ns + interval_ns, place.bin_count, place.pixels);
    let q27 = f64::from(1_u32 << HAZARD_FRACTION_BITS);
    let aps_end_ns = sensor.aps_start_ns.saturating_add(sensor.aps_exposure_ns).min(interval_ns);
    let aps_max = ((1_u32 << sensor.aps_bits) - 1) as f32;
    Camera {
        hdr_address: camera.inputs[0],
        motion_address: camera.inputs[1],
        planes_address,
        start_ns,
        epoch_ns: camera.epoch_ns,
        phase,
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
        parity: camera.parity,
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
        log_offset: sensor.log_offset as f32,
        refractory_ns: sensor.refractory_ns,
        latency_ns: sensor.latency_ns,
        latency_jitter_ns: sensor.latency_jitter_ns,
        timestamp_quantum_ns: sensor.timestamp_quantum_ns,
        contrast_on_q24: log_to_q24(sensor.contrast_on),
        contrast_off_q24: log_to_q24(sensor.contrast_off),
        hazard_q27_per_ns: (0.5 * sensor.shot_noise_rate_hz * 1e-9 * q27) as f32,
        inverse_white: (1.0 / sensor.white_level) as f32,
        aps_start_ns: sensor.aps_start_ns.min(aps_end_ns),
        aps_end_ns: if sensor.aps_exposure_ns == 0 { 0 } else { aps_end_ns },
        aps_scale: (sensor.aps_gain / sensor.white_level) as f32 * aps_max,
        aps_max,
        slot: place.slot,
        samples_base: place.slot * (MAX_SUBSTEPS + 1) * samples_pixels,
        log_dark: sensor.log_offset.ln() as f32,
        frame_words: frame_words(sensor),
        strip_base: place.strip_base,
        many_substeps: camera.many_substeps,
        rooms_base: place.rooms_base,
        bin_room: place.bin_room,
        lattice_stride: if needs_lattice(sensor) { lattice_stride(sensor) } else { 0 },
    }
}

/// Words of a frame, all colour components.
pub(super) fn plane_words(sensor: &SensorModel) -> u32 {
    channels(sensor.intensity).saturating_mul(frame_words(sensor))
}

/// Colour components kept of a camera's frames.
pub(super) fn channels(intensity: Intensity) -> u32 {
    if intensity == Intensity::BayerRggb { 3 } else { 1 }
}

/// Words kept of each: the half-pixel lattice that cubic warps read, with a margin for taps beyond the image (a row
/// before it and two after, two columns on either side), or the frame alone. Of a frame that is too large for a rig,
/// more than a rig takes.
pub(super) fn frame_words(sensor: &SensorModel) -> u32 {
    if needs_lattice(sensor) {
        lattice_stride(sensor).saturating_mul(2 * sensor.height + 3)
    } else {
        sensor.width * sensor.height
    }
}

/// Whether warps read a lattice.
pub(super) fn needs_lattice(sensor: &SensorModel) -> bool {
    sensor.synthesis == Synthesis::Motion && sensor.taps == Taps::Cubic
}

/// A row of the lattice: its entries, and two of margin on either side.
fn lattice_stride(sensor: &SensorModel) -> u32 {
    2 * sensor.width + 4
}

pub(super) type IngestConstants = [u32; 8];
pub(super) type EnhanceConstants = [u32; 2];
/// What a permutation begins with, the threads of a workgroup, whether pixels may be unarmed, and whether a workgroup
/// takes whole strips.
pub(super) type CrossConstants = [u32; 17];

/// Specialisation constants of `ingest`, by id.
pub(super) fn ingest_constants(permutation: &Permutation) -> IngestConstants {
    [
        permutation[PERMUTATION_INTENSITY],
        u32::from(permutation[PERMUTATION_TRANSFERS] > 0),
        permutation[PERMUTATION_HDR],
        permutation[PERMUTATION_MOTION],
        permutation[PERMUTATION_BY_ADDRESS],
        u32::from(!fills_up(permutation)),
        threads(permutation, layout::INGEST_THREADS),
        permutation[PERMUTATION_FIRST],
    ]
}

/// Whether `ingest` is cut finely: for a GPU with a lattice to make, one sensor's strips are few and long.
fn fills_up(permutation: &Permutation) -> bool {
    permutation[PERMUTATION_TRANSFERS] > 0 && permutation[PERMUTATION_BRANCHES] != 0
}

/// Workgroups of `ingest` a strip: one, or one a colour component.
pub(super) fn ingest_parts(permutation: &Permutation) -> u32 {
    let bayer = permutation[PERMUTATION_INTENSITY] == Intensity::BayerRggb as u32;
    if bayer && fills_up(permutation) { channels(Intensity::BayerRggb) } else { 1 }
}

/// Specialisation constants of `enhance`, by id, if the permutation has two transfers: the first is part of
/// `ingest`.
pub(super) fn enhance_constants(permutation: &Permutation) -> Option<EnhanceConstants> {
    let constants = [permutation[PERMUTATION_INTENSITY], permutation[PERMUTATION_BY_ADDRESS]];
    (permutation[PERMUTATION_TRANSFERS] > 1).then_some(constants)
}

/// Specialisation constants of `cross`, by id. `crowded`: it goes on after it has stopped.
pub(super) fn cross_constants(permutation: &Permutation, crowded: bool) -> CrossConstants {
    let mut constants: CrossConstants = std::array::from_fn(|id| permutation[id]);
    constants[PERMUTATION_CROWDED] = u32::from(crowded);
    constants[CROSS_CONSTANT_THREADS] =
        if crowded { layout::CROSS_THREADS } else { threads(permutation, layout::CROSS_THREADS) };
    constants[CROSS_CONSTANT_UNARMED] = permutation[PERMUTATION_UNARMED];
    constants[CROSS_CONSTANT_WHOLE_STRIPS] = permutation[PERMUTATION_WHOLE_STRIPS];
    constants
}

/// Threads of a workgroup that has `on_a_gpu` on a GPU.
fn threads(permutation: &Permutation, on_a_gpu: u32) -> u32 {
    if permutation[PERMUTATION_WHOLE_STRIPS] != 0 { layout::SOFTWARE_THREADS } else { on_a_gpu }
}

/// Workgroups of `cross` a strip: see its main function.
pub(super) fn cross_parts(permutation: &Permutation, crowded: bool) -> u32 {
    let whole_strips = permutation[PERMUTATION_WHOLE_STRIPS] != 0 && !crowded;
    if whole_strips { 1 } else { STRIP_PIXELS / layout::CROSS_THREADS }
}
