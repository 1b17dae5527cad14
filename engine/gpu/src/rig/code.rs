//! The SPIR-V of a rig's kernels.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use super::permutation::Specialised;
use crate::error::EngineError;
use crate::kernel::{BindingSet, Kernel};
use esaac_layout::Push;
use std::sync::Arc;

const PUSH_BYTES: u32 = size_of::<Push>() as u32;

/// The embedded kernels, or those that replace them.
#[derive(Clone, Default)]
pub(super) struct Code {
    /// Replacements by name of the kernel.
    pub replaced: std::collections::BTreeMap<&'static str, Vec<u32>>,
}

impl Code {
    /// Makes a kernel that has no specialisation constants; `embedded` is one of [`crate::stages`].
    pub(super) fn plain_kernel(
        &self,
        bindings: &Arc<BindingSet>,
        embedded: (&'static str, &'static [u8]),
    ) -> Result<Kernel, EngineError> {
        self.kernel(bindings, &Specialised { kernel: embedded, constants: Vec::new() })
    }

    /// Makes a kernel with its specialisation constants.
    pub(super) fn kernel(
        &self,
        bindings: &Arc<BindingSet>,
        specialised: &Specialised,
    ) -> Result<Kernel, EngineError> {
        let ((name, spirv), constants) = (specialised.kernel, &specialised.constants[..]);
        if let Some(words) = self.replaced.get(name) {
            // SAFETY: `KernelFolder` has had this compiled by glslc and has checked its interface, as the tests check
            // that of the embedded kernels.
            return unsafe { Kernel::with_bindings(bindings, name, words, PUSH_BYTES, constants) };
        }
        let words =
            ash::util::read_spv(&mut std::io::Cursor::new(spirv)).expect("embedded kernels are whole words");
        // SAFETY: the build script has compiled it. The test suite runs spirv-val on it, and checks its interface.
        unsafe { Kernel::with_bindings(bindings, name, &words, PUSH_BYTES, constants) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::slots;
    use crate::{Device, DeviceChoice, Validation, stages};

    #[test]
    fn what_is_the_same_is_compiled_once() {
        let device = Device::open(DeviceChoice::Best, Validation::from_env()).expect("a Vulkan device");
        let pipeline = |kernel, constants: &[u32]| {
            let bindings = BindingSet::with_sets(&device, slots(true), 1).expect("a set");
            let specialised = Specialised { kernel, constants: constants.to_vec() };
            Code::default().kernel(&bindings, &specialised).expect("a kernel that compiles").pipeline.raw
        };
        let sort = pipeline(stages::SORT, &[32, 64, 0, 0]);
        assert_eq!(sort, pipeline(stages::SORT, &[32, 64, 0, 0]), "though the kernel before is gone");
        assert_ne!(sort, pipeline(stages::SORT, &[32, 64, 1, 0]));
        assert_ne!(sort, pipeline(stages::MERGE, &[32, 64, 0, 0]));
        assert_eq!(device.validation_messages(), [""; 0]);
    }
}
