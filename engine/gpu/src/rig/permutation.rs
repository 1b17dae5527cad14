//! Which kernels run for a camera, and with which constants.

use super::sensor::{channels, delays, has_bus, is_physical, is_rigid, may_have_layers, needs_half_pel};
use super::{CameraState, RigOptions};
use crate::kernel::stages;
use crate::policy::{KernelPolicy, KernelSet};
use esaac_layout::{
    CROWDED_QUEUE_PER_PX, CrossConstants, CrossCpuConstants, DetailTransferConstants, IngestConstants,
    IngestCpuConstants, QUEUE_PER_PX, ReadoutConstants, SortConstants, SynthesizeConstants,
};
use esaac_model::paths::Projection;
use esaac_model::substeps::by_error;
use esaac_model::{IdFormat, MotionFormat, Pixel, Timestamps};

/// Constants and options that determine which kernels run for a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Permutation {
    /// Whether the kernels are those of synthesis `rigid`.
    pub rigid: bool,
    /// Whether the kernels are those of the physical pixel.
    pub physical: bool,
    /// Whether there is a bus before the packet.
    pub has_bus: bool,
    /// Whether events of earlier intervals may wait for the packet.
    pub any_wait: bool,
    /// Constants of `ingest`.
    pub ingest: IngestConstants,
    /// Constants of `cross`, for its first run in a tick.
    pub cross: CrossConstants,
    /// Whether a log pixel's levels are all synthesised before its walk.
    pub levels_first: bool,
    /// Number of transfers of detail between half-pel frames, 0 to 3.
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
/// `dense_queue_per_px`: that room where levels come first, if the rig has so many events that they do.
pub(super) fn permutation(
    camera: &CameraState,
    options: RigOptions,
    policy: KernelPolicy,
    texels: bool,
    queue_per_px: u32,
    rests: bool,
    dense_queue_per_px: Option<u32>,
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
        any_wait: camera.may_have_waiting(),
        ingest: IngestConstants {
            intensity: sensor.intensity,
            half_pel: needs_half_pel(sensor),
            hdr_format: camera.config.hdr,
            motion_format: camera.config.motion.unwrap_or(MotionFormat::F16x2),
            id_format: camera.config.geometry.and_then(|g| g.ids).unwrap_or(IdFormat::U32),
            effect_psf: sensor.psf_sigma_px > 0.0,
            effect_vignetting: sensor.vignetting_fov_deg > 0.0,
            effect_flicker: sensor.flicker().is_some(),
            fisheye,
            layered: may_have_layers(sensor),
            substeps_by_error: by_error(sensor),
        },
        cross: CrossConstants {
            intensity: sensor.intensity,
            effect_mismatch: sensor.contrast_mismatch > 0.0,
            // A pixel that is held when the refractory period is switched off stays held until the period ends.
            effect_refractory: sensor.refractory_ns > 0 || camera.may_end_old_holds(),
            effect_leak: leaks,
            effect_shot: has_noise,
            effect_delay: delays(sensor),
            at_sample: sensor.timestamps == Timestamps::AtSample,
            effect_aps: sensor.aps_exposure_ns > 0,
            effect_flicker: sensor.flicker().is_some(),
            synthesis: sensor.synthesis,
            taps: sensor.taps,
            dump_samples: options.keep_substeps,
            walks_again: false,
            queue_per_px: dense_queue_per_px.unwrap_or(queue_per_px),
            second_run: false,
            fisheye,
            layers: camera.layers(),
            pixels_rest: camera.knows_rest(rests),
            passes_still: physical
                && policy.passes_still
                && !options.keep_substeps
                && sensor.aps_exposure_ns == 0
                && sensor.flicker().is_none(),
        },
        levels_first: dense_queue_per_px.is_some(),
        // Without half-pel frames there is nothing to transfer.
        transfers: if needs_half_pel(sensor) { sensor.detail_transfers() } else { 0 },
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

    /// The kernel of `detail_transfer` that does transfer `number`, from 1 on (`ingest` does transfer 0); `None` if there are
    /// not so many.
    pub(super) fn detail_transfer(&self, number: u32) -> Option<Specialised> {
        let constants = DetailTransferConstants {
            intensity: self.ingest.intensity,
            by_address: self.by_address,
            fisheye: self.ingest.fisheye,
        };
        let kernel = if self.rigid { stages::DETAIL_TRANSFER_RIGID } else { stages::DETAIL_TRANSFER };
        (self.transfers > number).then(|| Specialised { kernel, constants: constants.words() })
    }

    /// The kernels of `synthesize`: for the lists, and for the levels. `None` if `cross` synthesises by itself.
    pub(super) fn synthesize(&self, policy: KernelPolicy) -> Option<[Specialised; 2]> {
        if policy.kernels != KernelSet::Gpu || !(self.rigid || self.cross.layers > 1) {
            return None;
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
        Some(kernels.map(|kernel| Specialised { kernel, constants: constants.words() }))
    }

    /// The kernels of `cross`: that of most tiles, and that of the tiles where motions meet, if these have one of their
    /// own. `again`: the one that runs again, for sub-tiles that are left.
    pub(super) fn cross(&self, policy: KernelPolicy, again: bool) -> Vec<Specialised> {
        let kinds = if self.cross.layers > 1 { &[false, true][..] } else { &[false] };
        kinds.iter().map(|&meeting| self.cross_where(policy, again, meeting)).collect()
    }

    /// The kernel of `cross` for the sub-tiles that the first run lists; `None` if it lists none, or may have
    /// changed which pixels rest.
    pub(super) fn second_run(&self, policy: KernelPolicy) -> Option<Specialised> {
        let lists =
            policy.kernels == KernelSet::Gpu && !self.rigid && !self.levels_first && !self.cross.pixels_rest;
        let cross = CrossConstants { second_run: true, ..self.cross };
        lists.then(|| Permutation { cross, ..*self }.cross_where(policy, true, false))
    }

    /// The kernel of `cross` of the tiles where motions meet (`meeting`), or of the others. One that runs again takes
    /// sub-tiles with any number of events, and so does one of rigs with many events.
    fn cross_where(&self, policy: KernelPolicy, again: bool, meeting: bool) -> Specialised {
        let walks_again = again || self.levels_first;
        let queue_per_px = match policy.kernels {
            KernelSet::Gpu if again => CROWDED_QUEUE_PER_PX,
            KernelSet::SoftwareDriver if again => QUEUE_PER_PX,
            // Lists of candidates need some of the 32 KiB of shared memory that every device has.
            KernelSet::SoftwareDriver if self.rigid || meeting => {
                self.cross.queue_per_px.min(CROWDED_QUEUE_PER_PX)
            }
            _ => self.cross.queue_per_px,
        };
        let mut constants = CrossConstants { walks_again, queue_per_px, ..self.cross }.words();
        let kernel = match policy.kernels {
            KernelSet::Gpu => match (self.physical, self.levels_first || again, self.rigid || meeting) {
                (false, false, false) => stages::CROSS_GPU,
                (false, false, true) => stages::CROSS_LEVELS_GPU,
                (false, true, false) => stages::CROSS_DENSE_GPU,
                (false, true, true) => stages::CROSS_DENSE_LEVELS_GPU,
                (true, _, false) => stages::CROSS_PHYSICAL_GPU,
                (true, _, true) => stages::CROSS_PHYSICAL_LEVELS_GPU,
            },
            KernelSet::SoftwareDriver => {
                let own = CrossCpuConstants {
                    by_address: self.by_address,
                    threads: policy.cross_threads(again),
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
        [stages::CROSS_LEVELS_GPU, stages::CROSS_DENSE_LEVELS_GPU, stages::CROSS_PHYSICAL_LEVELS_GPU]
            .iter()
            .any(|k| k.0 == self.kernel.0)
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
