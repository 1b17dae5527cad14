//! The list of all kernels.

use crate::constants::{
    ConstantList, CrossConstants, CrossCpuConstants, DetailTransferConstants, IngestConstants,
    IngestCpuConstants, ReadoutConstants, SortConstants, SynthesizeConstants,
};
use crate::sizes::{
    CROSS_THREADS, INGEST_THREADS, PATHS_THREADS, POSES_THREADS, READOUT_THREADS, SORT_THREADS,
    SYNTHESIZE_THREADS,
};

/// A kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KernelInfo {
    /// Its file, without `.comp`.
    pub name: &'static str,
    /// Its stage. A stage may have one kernel for GPUs and one for the software driver, more of each for synthesis
    /// `rigid` and where motions meet, and twice as many for two pixel models.
    pub stage: &'static str,
    /// Threads of a workgroup, before specialisation.
    pub threads: u32,
    /// Its specialisation constants.
    pub constants: &'static [ConstantList],
}

const fn kernel(
    name: &'static str,
    stage: &'static str,
    threads: u32,
    constants: &'static [ConstantList],
) -> KernelInfo {
    KernelInfo { name, stage, threads, constants }
}

/// Threads of kernels that stride over events.
const STRIDING_THREADS: u32 = 256;

/// Every kernel.
pub const KERNELS: &[KernelInfo] = &[
    kernel("poses", "poses", POSES_THREADS, &[]),
    kernel("ingest_gpu", "ingest", INGEST_THREADS, &[IngestConstants::LIST]),
    kernel("ingest_cpu", "ingest", INGEST_THREADS, &[IngestConstants::LIST, IngestCpuConstants::LIST]),
    kernel("ingest_rigid_gpu", "ingest", INGEST_THREADS, &[IngestConstants::LIST]),
    kernel("ingest_rigid_cpu", "ingest", INGEST_THREADS, &[IngestConstants::LIST, IngestCpuConstants::LIST]),
    kernel("ingest_surfaces_gpu", "ingest", INGEST_THREADS, &[IngestConstants::LIST]),
    kernel("ingest_physical_gpu", "ingest", INGEST_THREADS, &[IngestConstants::LIST]),
    kernel(
        "ingest_physical_cpu",
        "ingest",
        INGEST_THREADS,
        &[IngestConstants::LIST, IngestCpuConstants::LIST],
    ),
    kernel("ingest_physical_rigid_gpu", "ingest", INGEST_THREADS, &[IngestConstants::LIST]),
    kernel(
        "ingest_physical_rigid_cpu",
        "ingest",
        INGEST_THREADS,
        &[IngestConstants::LIST, IngestCpuConstants::LIST],
    ),
    kernel("detail_transfer", "detail_transfer", INGEST_THREADS, &[DetailTransferConstants::LIST]),
    kernel("detail_transfer_rigid", "detail_transfer", INGEST_THREADS, &[DetailTransferConstants::LIST]),
    kernel("paths", "paths", PATHS_THREADS, &[]),
    kernel("deferred", "deferred", STRIDING_THREADS, &[]),
    kernel("synthesize_lists_rigid", "synthesize", INGEST_THREADS, &[SynthesizeConstants::LIST]),
    kernel("synthesize_lists_layers", "synthesize", INGEST_THREADS, &[SynthesizeConstants::LIST]),
    kernel("synthesize_levels_rigid", "synthesize", SYNTHESIZE_THREADS, &[SynthesizeConstants::LIST]),
    kernel("synthesize_levels_layers", "synthesize", SYNTHESIZE_THREADS, &[SynthesizeConstants::LIST]),
    kernel("cross_gpu", "cross", CROSS_THREADS, &[CrossConstants::LIST]),
    kernel("cross_dense_gpu", "cross", CROSS_THREADS, &[CrossConstants::LIST]),
    kernel("cross_cpu", "cross", CROSS_THREADS, &[CrossConstants::LIST, CrossCpuConstants::LIST]),
    kernel("cross_levels_gpu", "cross", CROSS_THREADS, &[CrossConstants::LIST]),
    kernel("cross_dense_levels_gpu", "cross", CROSS_THREADS, &[CrossConstants::LIST]),
    kernel("cross_rigid_cpu", "cross", CROSS_THREADS, &[CrossConstants::LIST, CrossCpuConstants::LIST]),
    kernel("cross_layers_cpu", "cross", CROSS_THREADS, &[CrossConstants::LIST, CrossCpuConstants::LIST]),
    kernel("cross_physical_gpu", "cross", CROSS_THREADS, &[CrossConstants::LIST]),
    kernel("cross_physical_cpu", "cross", CROSS_THREADS, &[CrossConstants::LIST, CrossCpuConstants::LIST]),
    kernel("cross_physical_levels_gpu", "cross", CROSS_THREADS, &[CrossConstants::LIST]),
    kernel(
        "cross_physical_rigid_cpu",
        "cross",
        CROSS_THREADS,
        &[CrossConstants::LIST, CrossCpuConstants::LIST],
    ),
    kernel(
        "cross_physical_layers_cpu",
        "cross",
        CROSS_THREADS,
        &[CrossConstants::LIST, CrossCpuConstants::LIST],
    ),
    kernel("bin_sums", "sort", STRIDING_THREADS, &[]),
    kernel("sort", "sort", SORT_THREADS, &[SortConstants::LIST]),
    kernel("readout_apart", "readout", READOUT_THREADS, &[ReadoutConstants::LIST]),
    kernel("readout", "readout", READOUT_THREADS, &[ReadoutConstants::LIST]),
    kernel("merge", "merge", STRIDING_THREADS, &[]),
    kernel("gather", "gather", STRIDING_THREADS, &[]),
    kernel("event_frame", "event_frame", STRIDING_THREADS, &[]),
    kernel("voxel_grid", "voxel_grid", STRIDING_THREADS, &[]),
    kernel("event_ids_lists", "event_ids", INGEST_THREADS, &[]),
    kernel("event_ids", "event_ids", STRIDING_THREADS, &[]),
];

/// Stages of a tick that are timed, in order. (`paths` and `deferred` run alongside `ingest`, the lists of `synthesize`
/// alongside `detail_transfer`, and what `cross` walks without levels alongside those of `synthesize`; their time counts there. `merge` runs only for heavy
/// packets, the other kernels only when a program asks for a representation.)
pub const TICK_STAGES: &[&str] = &["poses", "ingest", "detail_transfer", "synthesize", "cross", "sort"];

/// The stages of a tick with a bus. The last one includes the sort of what has left the bus.
pub const TICK_STAGES_WITH_BUS: &[&str] =
    &["poses", "ingest", "detail_transfer", "synthesize", "cross", "sort", "readout"];

/// The stages of the kernels with these names, in the order of [`KERNELS`] and each once.
#[must_use]
pub fn stages(kernels: &[&str]) -> Vec<&'static str> {
    let mut stages: Vec<&'static str> =
        KERNELS.iter().filter(|k| kernels.contains(&k.name)).map(|k| k.stage).collect();
    stages.dedup();
    stages
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stage_of_a_tick_has_a_kernel() {
        for stage in TICK_STAGES_WITH_BUS {
            assert!(KERNELS.iter().any(|k| k.stage == *stage), "{stage}");
        }
    }

    #[test]
    fn both_kernels_of_a_stage_are_one_stage() {
        assert_eq!(stages(&["sort", "cross_cpu", "cross_gpu"]), ["cross", "sort"]);
    }
}
