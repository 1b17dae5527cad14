//! The kernels that a rig has compiled. Each is compiled when a camera needs it first.

use super::code::Code;
use super::permutation::{Permutation, Specialised, readout, readout_apart, sort};
use super::{CameraState, Pipelines, Rig};
use crate::error::EngineError;
use crate::kernel::{BindingSet, Kernel, stages};
use crate::policy::KernelPolicy;
use esaac_layout::{KERNELS, KernelInfo};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

/// How `sort` goes through the bins of a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sorting {
    /// Bins that a workgroup takes.
    pub group_bins: u32,
    /// Whether `bin_sums` runs before it in a rig without a bus.
    summed: bool,
}

impl Sorting {
    /// That of a rig whose cameras have so many bins each.
    fn of(policy: KernelPolicy, bin_counts: &[u32]) -> Self {
        let group_bins = policy.group_bins_of(bin_counts.iter().sum(), bin_counts.len() as u32);
        let reads = |&bins: &u32| u64::from(bins) * u64::from(bins) / u64::from(group_bins);
        let summed = bin_counts.iter().map(reads).sum::<u64>() >= policy.summed_reads;
        Sorting { group_bins, summed }
    }

    fn kernel(self, policy: KernelPolicy, has_bus: bool) -> Specialised {
        sort(policy, self.group_bins, has_bus, self.summed && !has_bus)
    }

    /// The kernel of `bin_sums`, if it runs.
    fn bin_sums(self, code: &Code, bindings: &Arc<BindingSet>) -> Result<Option<Kernel>, EngineError> {
        self.summed.then(|| code.plain_kernel(bindings, stages::BIN_SUMS)).transpose()
    }
}

fn bin_counts(cameras: &[CameraState]) -> Vec<u32> {
    cameras.iter().map(|c| c.place.bin_count).collect()
}

/// Kernels that are the same for every sensor.
pub(super) struct Kernels {
    pub sorting: Sorting,
    pub deferred: Kernel,
    /// Compiled when a camera needs it first.
    pub paths: Option<Kernel>,
    /// If bins are summed before they are sorted.
    pub bin_sums: Option<Kernel>,
    /// Compiled when the device works out poses first.
    pub poses: Option<Kernel>,
    pub sort: Kernel,
    pub merge: Kernel,
    /// Compiled when a camera needs it first.
    pub bus: Option<BusKernels>,
    /// Kernels that make representations of packets, by name; compiled at their first use.
    pub forms: HashMap<&'static str, Kernel>,
}

/// Kernels of rigs in which a camera has a bus.
pub(super) struct BusKernels {
    pub readout: Kernel,
    /// `None` if chunks are not served side by side.
    pub apart: Option<Kernel>,
    pub sort: Kernel,
}

impl Kernels {
    pub(super) fn new(
        policy: KernelPolicy,
        cameras: &[CameraState],
        code: &Code,
        bindings: &Arc<BindingSet>,
    ) -> Result<Self, EngineError> {
        let sorting = Sorting::of(policy, &bin_counts(cameras));
        Ok(Kernels {
            sorting,
            deferred: code.plain_kernel(bindings, stages::DEFERRED)?,
            paths: None,
            poses: None,
            bin_sums: sorting.bin_sums(code, bindings)?,
            sort: code.kernel(bindings, &sorting.kernel(policy, false))?,
            merge: code.plain_kernel(bindings, stages::MERGE)?,
            bus: None,
            forms: HashMap::new(),
        })
    }

    /// Compiles the kernels that the permutations of `cameras`, and poses from the device if it works them out, need and
    /// that are missing.
    pub(super) fn need(
        &mut self,
        policy: KernelPolicy,
        code: &Code,
        bindings: &Arc<BindingSet>,
        permutations: &[Permutation],
        poses: bool,
    ) -> Result<(), EngineError> {
        if self.poses.is_none() && poses {
            self.poses = Some(code.plain_kernel(bindings, stages::POSES)?);
        }
        if self.paths.is_none() && permutations.iter().any(|p| p.rigid) {
            self.paths = Some(code.plain_kernel(bindings, stages::PATHS)?);
        }
        if self.bus.is_none() && permutations.iter().any(|p| p.has_bus) {
            self.bus = Some(BusKernels {
                readout: code.kernel(bindings, &readout(policy))?,
                apart: match policy.readout_apart {
                    true => Some(code.kernel(bindings, &readout_apart(policy))?),
                    false => None,
                },
                sort: code.kernel(bindings, &self.sorting.kernel(policy, true))?,
            });
        }
        Ok(())
    }

    /// Compiles the kernels that sort such numbers of bins, if those at hand do not. On an error nothing has changed.
    fn follow_bins(
        &mut self,
        policy: KernelPolicy,
        bin_counts: &[u32],
        code: &Code,
        bindings: &Arc<BindingSet>,
    ) -> Result<(), EngineError> {
        let sorting = Sorting::of(policy, bin_counts);
        if sorting == self.sorting {
            return Ok(());
        }
        let bin_sums = sorting.bin_sums(code, bindings)?;
        let sort = code.kernel(bindings, &sorting.kernel(policy, false))?;
        if let Some(bus) = &mut self.bus {
            bus.sort = code.kernel(bindings, &sorting.kernel(policy, true))?;
        }
        (self.sorting, self.bin_sums, self.sort) = (sorting, bin_sums, sort);
        Ok(())
    }
}

/// Kernels that differ from sensor to sensor, by their specialisation constants. Sensors with equal constants share
/// them.
#[derive(Default)]
pub(super) struct SensorKernels(pub HashMap<Specialised, Kernel>);

impl SensorKernels {
    /// Compiles the kernels of a permutation that are missing.
    pub(super) fn need(
        &mut self,
        code: &Code,
        bindings: &Arc<BindingSet>,
        policy: KernelPolicy,
        permutation: &Permutation,
        again: bool,
    ) -> Result<(), EngineError> {
        let needed = [
            Some(permutation.ingest(policy)),
            permutation.ingest_surfaces(policy),
            permutation.detail_transfer(1),
        ];
        let needed = needed.into_iter().flatten().chain(permutation.synthesize(policy).into_iter().flatten());
        for specialised in needed.chain(permutation.cross(policy, again)) {
            self.need_one(code, bindings, specialised)?;
        }
        Ok(())
    }

    /// Compiles a kernel if it is missing.
    fn need_one(
        &mut self,
        code: &Code,
        bindings: &Arc<BindingSet>,
        specialised: Specialised,
    ) -> Result<(), EngineError> {
        if let Entry::Vacant(missing) = self.0.entry(specialised) {
            let kernel = code.kernel(bindings, missing.key())?;
            missing.insert(kernel);
        }
        Ok(())
    }
}

impl Rig {
    /// Compiles the kernels of these permutations that are missing, for a whole tick (with `poses` or without) or (`whole`
    /// false) the part that runs again.
    pub(super) fn need_kernels(
        &mut self,
        permutations: &[Permutation],
        whole: bool,
        poses: bool,
    ) -> Result<(), EngineError> {
        let Pipelines { bindings, code, kernels, specialised, policy } = &mut self.pipelines;
        for p in permutations {
            specialised.need(code, bindings, *policy, p, !whole)?;
        }
        kernels.need(*policy, code, bindings, permutations, poses)
    }

    /// Compiles the kernels that sort such numbers of bins, if those at hand do not; commands that name them must be recorded
    /// anew. On an error the rig keeps its kernels, which sort any number.
    pub(super) fn follow_bins(&mut self, bin_counts: &[u32]) -> Result<(), EngineError> {
        let Pipelines { bindings, code, kernels, policy, .. } = &mut self.pipelines;
        kernels.follow_bins(*policy, bin_counts, code, bindings)
    }

    /// Compiles the kernels of the second run of `cross` that are missing.
    pub(super) fn need_second_run(&mut self, permutations: &[Permutation]) -> Result<(), EngineError> {
        let Pipelines { bindings, code, specialised, policy, .. } = &mut self.pipelines;
        for second_run in permutations.iter().filter_map(|p| p.second_run(*policy)) {
            specialised.need_one(code, bindings, second_run)?;
        }
        Ok(())
    }

    /// Every kernel that the rig has compiled, by stage.
    pub(super) fn kernels_by_stage(&self) -> impl Iterator<Item = (&'static str, &Kernel)> {
        let stage_of = |name| KERNELS.iter().find(|k| k.name == name).map_or(name, |k: &KernelInfo| k.stage);
        let of_sensors =
            self.pipelines.specialised.0.iter().map(move |(s, kernel)| (stage_of(s.kernel.0), kernel));
        let k = &self.pipelines.kernels;
        let events = [("deferred", &k.deferred), ("sort", &k.sort), ("merge", &k.merge)];
        let paths = k.paths.iter().map(|kernel| ("paths", kernel));
        let sums = k.bin_sums.iter().map(|kernel| ("sort", kernel));
        let paths = paths.chain(k.poses.iter().map(|kernel| ("poses", kernel)));
        let bus = k.bus.iter().flat_map(|bus| {
            [("sort", &bus.sort), ("readout", &bus.readout)]
                .into_iter()
                .chain(bus.apart.iter().map(|apart| ("readout", apart)))
        });
        let forms = k.forms.iter().map(move |(name, kernel)| (stage_of(name), kernel));
        of_sensors.chain(events).chain(sums).chain(paths).chain(bus).chain(forms)
    }

    /// Names of the compiled kernels and their specialisation constants, for tests: which permutations ran.
    #[doc(hidden)]
    #[must_use]
    pub fn permutations_compiled(&self) -> Vec<(&'static str, Vec<u32>)> {
        let mut all: Vec<_> =
            self.pipelines.specialised.0.keys().map(|s| (s.kernel.0, s.constants.clone())).collect();
        let bus = &self.pipelines.kernels.bus;
        for has_bus in [false, true].iter().take(1 + usize::from(bus.is_some())) {
            let sort = self.pipelines.kernels.sorting.kernel(self.pipelines.policy, *has_bus);
            all.push((sort.kernel.0, sort.constants));
        }
        all.extend(self.pipelines.kernels.poses.iter().map(|_| (stages::POSES.0, Vec::new())));
        all.sort();
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_whose_bins_become_many_sorts_larger_groups_and_sums_them_first() {
        let policy = KernelPolicy::gpu();
        let of = |bin_counts: &[u32]| {
            let Sorting { group_bins, summed } = Sorting::of(policy, bin_counts);
            (group_bins, summed)
        };
        assert_eq!(of(&[4096]), (policy.group_bins, false));
        assert_eq!(of(&[16_384]), (policy.group_bins_of_many, false));
        assert_eq!(of(&[32_768]), (policy.group_bins_of_many, true));
        assert_eq!(of(&[128, 16_384, 32_768]), (policy.group_bins_of_many, true));
    }
}
