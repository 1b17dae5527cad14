//! How kernels are run on a device. Every decision of the host about kernels that depends on the kind of device is
//! here; none of them changes an event.

use crate::device::Device;
use crate::error::EngineError;
use crate::instance::Validation;
use esaac_layout::{CROSS_THREADS, INGEST_THREADS, QUEUE_PER_PX, READOUT_THREADS, SORT_THREADS, TILE_BLOCKS};
use esaac_model::substeps::BLOCK_PX;

/// Which kernels run the stages that have some for GPUs and others for the software driver, over the same code: `ingest` and
/// `cross`. The names of their files end in `_gpu` and `_cpu`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KernelSet {
    /// For GPUs: events go to a shared queue, subgroups aggregate their atomics, walks draw random numbers where they
    /// need them, loads are by address.
    Gpu,
    /// For the software driver: events go to slots of their pixel, each thread does its own atomics, draws are
    /// deferred, loads are by texel.
    SoftwareDriver,
}

/// Whether pixels in still light are passed over until their noise may send something.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resting {
    /// All are walked.
    Never,
    /// They are passed over while past ticks say that it costs less.
    WherePaid,
    /// They are passed over always.
    Always,
}

/// Whether `cross` synthesises all levels of a log pixel before it walks. Kernels for GPUs alone can.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LevelsFirst {
    /// Each sub-step is walked once it is synthesised.
    Never,
    /// All are synthesised first while past ticks had many events.
    WherePaid,
    /// All are synthesised first.
    Always,
}

/// How kernels are run; chosen once for a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KernelPolicy {
    /// Kernels of `ingest` and `cross`.
    pub kernels: KernelSet,
    /// For the software driver's kernels: whether a workgroup walks whole tiles row by row, and code that is rarely
    /// needed is compiled only where it is needed. Costs more permutations.
    pub whole_tiles: bool,
    /// Whether every load is by address.
    pub by_address: bool,
    /// Threads of a workgroup of `sort`.
    pub sort_threads: u32,
    /// Whether `sort` divides by the device's own instruction.
    pub native_division: bool,
    /// Neighbouring bins that a workgroup of `sort` takes: together they write several whole lines on the bus.
    pub group_bins: u32,
    /// `group_bins` of a rig with at least `many_bins` bins. Each workgroup sums all bins of its camera; such a rig
    /// fills the device with fewer, larger groups.
    pub group_bins_of_many: u32,
    /// `group_bins` of such a rig whose cameras have few bins, 128 or less on average: their packets are small.
    pub group_bins_of_small: u32,
    /// Bins of a rig from which on `group_bins_of_many` or `group_bins_of_small` applies.
    pub many_bins: u32,
    /// Bins that all workgroups of `sort` together would read to sum them, from which on a dispatch of its own sums them
    /// first.
    pub summed_reads: u64,
    /// Threads of a workgroup of `readout`.
    pub readout_threads: u32,
    /// Rounds of loops of a thread of `readout` after which it leaves the rest to the next dispatch.
    pub readout_rounds: u32,
    /// Dispatches of `readout` in a submission. If it needs more, it costs another submission.
    pub readout_dispatches: u32,
    /// Whether `sort` serves ticks in which events hardly wait for a bus, and `readout` has a submission of its own for the
    /// others.
    pub readout_light: bool,
    /// Whether `readout` serves chunks side by side, where the bus is idle in between.
    pub readout_apart: bool,
    /// Most events that a thread strides over when the event buffers are full.
    pub events_per_thread: u32,
    /// Longest event queue of `cross`, in events for each pixel of a sub-tile. The queue grows from
    /// [`QUEUE_PER_PX`] to this while intervals overflow it.
    pub most_queue_per_px: u32,
    /// Fewest rows of `levels`, if cameras could use as many: with fewer, ticks of small rigs take more passes.
    pub least_level_rows: u32,
    /// Whether pixels rest.
    pub resting: Resting,
    /// Whether a log pixel's levels are all synthesised before its walk.
    pub levels_first: LevelsFirst,
    /// Whether settled physical pixels in still light that send nothing are taken over an interval in closed form. Without,
    /// each is walked.
    pub passes_still: bool,
    /// How many neighbouring pixels must rest for most of the work on them to be spared.
    pub rest_together: u32,
    /// Moving tracks of a tick from which on the device works out poses, not the host; `u32::MAX` for never. The host takes
    /// longer with each track; the kernel takes about as long for many as for one.
    pub device_tracks: u32,
    /// Whether the dispatches of a stage run one after the other.
    pub serial: bool,
}

/// Fewest threads of a workgroup of `sort` or `readout`. Each thread of `sort` has at most one bin of its workgroup's.
const LEAST_THREADS: u32 = 64;

/// See [`KernelPolicy::group_bins_of_small`].
const FEW_BINS: u32 = 128;

impl KernelPolicy {
    /// For GPUs.
    #[must_use]
    pub const fn gpu() -> Self {
        KernelPolicy {
            kernels: KernelSet::Gpu,
            whole_tiles: false,
            by_address: true,
            sort_threads: SORT_THREADS,
            native_division: true,
            group_bins: 8,
            group_bins_of_many: 32,
            group_bins_of_small: 64,
            many_bins: 1 << 13,
            summed_reads: 1 << 25,
            readout_threads: READOUT_THREADS,
            // A few hundredths of a second on a fast GPU. Drivers give a device up that does not end a dispatch in seconds.
            readout_rounds: 1 << 20,
            readout_dispatches: 1,
            readout_light: true,
            readout_apart: true,
            // Buffers are seldom half full, so that a thread usually has less than one event.
            events_per_thread: 2,
            most_queue_per_px: 2 * QUEUE_PER_PX,
            // 8 MiB.
            least_level_rows: 1 << 15,
            resting: Resting::WherePaid,
            levels_first: LevelsFirst::WherePaid,
            passes_still: true,
            rest_together: TILE_WIDTH_PX * BLOCK_PX,
            device_tracks: 24,
            serial: false,
        }
    }

    /// For Mesa's software driver. A workgroup costs much before its first pixel or event, so that there are few of
    /// them. But the driver silently ends all loops of a thread after 65 535 rounds in all, which limits the work of a
    /// thread.
    #[must_use]
    pub const fn software_driver() -> Self {
        KernelPolicy {
            kernels: KernelSet::SoftwareDriver,
            whole_tiles: true,
            by_address: false,
            // Fewer threads would be faster, but each would come near the limit of rounds.
            sort_threads: 64,
            native_division: false,
            group_bins: 32,
            group_bins_of_many: 32,
            group_bins_of_small: 32,
            many_bins: u32::MAX,
            summed_reads: 1 << 25,
            readout_threads: 64,
            readout_rounds: 16_384,
            readout_dispatches: 4,
            readout_light: false,
            readout_apart: false,
            events_per_thread: 64,
            // A row of a tile has room for 128 events a pixel then.
            most_queue_per_px: 4 * QUEUE_PER_PX,
            // `cross` synthesises by itself.
            least_level_rows: 0,
            resting: Resting::WherePaid,
            levels_first: LevelsFirst::Never,
            passes_still: true,
            rest_together: TILE_WIDTH_PX,
            // The same processor does either.
            device_tracks: u32::MAX,
            serial: true,
        }
    }

    /// The policy that suits a device.
    pub(crate) fn of(device: &Device) -> Self {
        let policy = if device.is_software() { KernelPolicy::software_driver() } else { KernelPolicy::gpu() };
        policy.validated(device.validation())
    }

    /// The policy under the validation layer. The layer tracks whole buffers, while each dispatch of a stage accesses
    /// only the parts of its own cameras: dispatches have to be serial. Where it looks at shaders too, the software
    /// driver takes long to compile them: one permutation has to do.
    pub(crate) fn validated(self, validation: Validation) -> Self {
        KernelPolicy {
            whole_tiles: self.whole_tiles && validation != Validation::On,
            serial: self.serial || validation != Validation::Off,
            ..self
        }
    }

    /// An error if kernels cannot be run so.
    pub(crate) fn check(&self) -> Result<(), EngineError> {
        let powers_of_two = [
            ("sort_threads", self.sort_threads, LEAST_THREADS, SORT_THREADS),
            ("readout_threads", self.readout_threads, LEAST_THREADS, READOUT_THREADS),
            ("group_bins", self.group_bins, 1, LEAST_THREADS),
            ("group_bins_of_many", self.group_bins_of_many, 1, LEAST_THREADS),
            ("group_bins_of_small", self.group_bins_of_small, 1, LEAST_THREADS),
        ];
        for (name, actual, least, most) in powers_of_two {
            if !actual.is_power_of_two() || actual < least || actual > most {
                let expected = format!("a power of two from {least} to {most}");
                return Err(EngineError::Option { name, expected, actual });
            }
        }
        let counts = [
            ("readout_rounds", self.readout_rounds, 1, u32::MAX),
            ("readout_dispatches", self.readout_dispatches, 1, 64),
            ("events_per_thread", self.events_per_thread, 1, 1 << 16),
            ("most_queue_per_px", self.most_queue_per_px, 0, 4 * QUEUE_PER_PX),
        ];
        for (name, actual, least, most) in counts {
            if actual < least || actual > most {
                return Err(EngineError::Option { name, expected: format!("{least} to {most}"), actual });
            }
        }
        Ok(())
    }

    /// Bins that a workgroup of `sort` takes in a rig whose `cameras` have `bins` bins in all.
    pub(crate) fn group_bins_of(&self, bins: u32, cameras: u32) -> u32 {
        match (bins >= self.many_bins, bins <= cameras * FEW_BINS) {
            (false, _) => self.group_bins,
            (true, false) => self.group_bins_of_many,
            (true, true) => self.group_bins_of_small,
        }
    }

    /// Threads of a workgroup of `ingest_cpu`.
    pub(crate) fn ingest_threads(&self) -> u32 {
        if self.whole_tiles { TILE_WIDTH_PX } else { INGEST_THREADS }
    }

    /// Threads of a workgroup of `cross_cpu`; `again`: of one that runs again.
    pub(crate) fn cross_threads(&self, again: bool) -> u32 {
        if self.whole_tiles && !again { TILE_WIDTH_PX } else { CROSS_THREADS }
    }

    /// Workgroups of `cross` per tile; `again`: where it runs again.
    pub(crate) fn cross_groups(&self, again: bool) -> u32 {
        let all_sub_tiles = self.whole_tiles && !again;
        if all_sub_tiles { 1 } else { TILE_WIDTH_PX * BLOCK_PX / CROSS_THREADS }
    }
}

/// Pixels in a row of a tile.
const TILE_WIDTH_PX: u32 = TILE_BLOCKS * BLOCK_PX;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workgroups_of_cross_cover_a_tile() {
        for policy in [KernelPolicy::gpu(), KernelPolicy::software_driver()] {
            for again in [false, true] {
                let pixels = policy.cross_groups(again) * policy.cross_threads(again);
                // A workgroup that takes all sub-tiles walks them row by row.
                let rows = if policy.whole_tiles && !again { BLOCK_PX } else { 1 };
                assert_eq!(pixels * rows, TILE_WIDTH_PX * BLOCK_PX, "{policy:?}");
            }
        }
    }

    #[test]
    fn a_policy_that_kernels_cannot_follow_is_refused() {
        let own = KernelPolicy::software_driver();
        for policy in [own, KernelPolicy::gpu()] {
            policy.check().unwrap();
        }
        for (name, policy) in [
            ("sort_threads", KernelPolicy { sort_threads: 0, ..own }),
            ("sort_threads", KernelPolicy { sort_threads: 7, ..own }),
            ("sort_threads", KernelPolicy { sort_threads: 512, ..own }),
            ("readout_threads", KernelPolicy { readout_threads: 0, ..own }),
            ("group_bins", KernelPolicy { group_bins: 0, ..own }),
            ("group_bins", KernelPolicy { group_bins: u32::MAX, ..own }),
            ("group_bins_of_many", KernelPolicy { group_bins_of_many: 128, ..own }),
            ("group_bins_of_small", KernelPolicy { group_bins_of_small: 3, ..own }),
            ("readout_rounds", KernelPolicy { readout_rounds: 0, ..own }),
            ("readout_dispatches", KernelPolicy { readout_dispatches: 0, ..own }),
            ("events_per_thread", KernelPolicy { events_per_thread: 0, ..own }),
            ("most_queue_per_px", KernelPolicy { most_queue_per_px: u32::MAX, ..own }),
        ] {
            let error = policy.check().expect_err(name).to_string();
            assert!(error.starts_with(&format!("`{name}` is ")), "{error}");
        }
    }

    #[test]
    fn groups_of_bins_are_large_where_many_packets_are_small() {
        let policy = KernelPolicy::gpu();
        let of = |cameras: u32, bins: u32| policy.group_bins_of(cameras * bins, cameras);
        assert_eq!([of(1, 128), of(8, 128), of(1, 4096)], [policy.group_bins; 3]);
        assert_eq!([of(2, 4096), of(1, 16_384), of(256, 256)], [policy.group_bins_of_many; 3]);
        assert_eq!([of(64, 128), of(256, 128)], [policy.group_bins_of_small; 2]);
    }

    #[test]
    fn the_layer_gets_serial_dispatches_and_for_shaders_one_permutation() {
        let [off, calls, on] = [Validation::Off, Validation::Calls, Validation::On];
        let whole_tiles = |v| KernelPolicy::software_driver().validated(v).whole_tiles;
        assert!(whole_tiles(off) && whole_tiles(calls) && !whole_tiles(on));
        let serial = |v| KernelPolicy::gpu().validated(v).serial;
        assert!(!serial(off) && serial(calls) && serial(on));
    }
}
