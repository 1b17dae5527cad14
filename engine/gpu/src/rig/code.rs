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
