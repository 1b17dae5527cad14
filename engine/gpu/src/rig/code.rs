//! Which SPIR-V a rig's kernels are made of.

use crate::error::EngineError;
use crate::kernel::{BindingSet, Kernel};
use esaac_model::layout::Push;
use std::sync::Arc;

const PUSH_BYTES: u32 = size_of::<Push>() as u32;

/// The embedded kernels, or those that took their place.
#[derive(Clone, Default)]
pub(super) struct Code {
    /// By stage name.
    #[cfg(feature = "shaderc")]
    pub replaced: std::collections::BTreeMap<&'static str, Vec<u32>>,
}

impl Code {
    /// A kernel of the rig; `embedded` is one of [`crate::stages`].
    pub(super) fn kernel(
        &self,
        bindings: &Arc<BindingSet>,
        embedded: (&str, &[u8]),
        constants: &[u32],
    ) -> Result<Kernel, EngineError> {
        let (name, spirv) = embedded;
        #[cfg(feature = "shaderc")]
        if let Some(words) = self.replaced.get(name) {
            return Kernel::with_bindings(bindings, name, words, PUSH_BYTES, constants);
        }
        let words =
            ash::util::read_spv(&mut std::io::Cursor::new(spirv)).expect("embedded kernels are whole words");
        Kernel::with_bindings(bindings, name, &words, PUSH_BYTES, constants)
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
        let pipeline = |embedded, constants: &[u32]| {
            let bindings = BindingSet::with_kinds(&device, slots()).expect("a set");
            let kernel = Code::default().kernel(&bindings, embedded, constants);
            kernel.expect("a kernel that compiles").pipeline.raw
        };
        let sort = pipeline(stages::SORT, &[32, 64, 0]);
        assert_eq!(sort, pipeline(stages::SORT, &[32, 64, 0]), "though the kernel before is gone");
        assert_ne!(sort, pipeline(stages::SORT, &[32, 64, 1]));
        assert_ne!(sort, pipeline(stages::MERGE, &[32, 64, 0]));
        assert_eq!(device.validation_messages(), [""; 0]);
    }
}
