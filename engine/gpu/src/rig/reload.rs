//! Kernels exchanged while a rig runs.

use super::Rig;
use super::code::Code;
use super::record::Kernels;
use crate::error::EngineError;
use crate::kernel_folder::KernelFolder;

impl Rig {
    /// Takes the kernels that were edited since the last call (all of them in the first call) from the
    /// next tick on, and returns their names. State, buffers and what is staged stay as they are. On an
    /// error the rig goes on with the kernels that it has, and the same edits are not tried again until
    /// there is another. A folder serves one rig.
    pub fn reload_kernels(&mut self, folder: &mut KernelFolder) -> Result<Vec<&'static str>, EngineError> {
        let ready = folder.edited()?;
        if ready.is_empty() {
            return Ok(Vec::new());
        }
        let mut code = self.code.clone();
        code.replaced.extend(ready.iter().map(|(stage, words)| (*stage, words.to_vec())));
        let names = ready.iter().map(|(stage, _)| *stage).collect();
        self.exchange(code)?;
        folder.installed();
        Ok(names)
    }

    /// Makes every pipeline from `code` and records anew; on an error, all is as it was.
    fn exchange(&mut self, code: Code) -> Result<(), EngineError> {
        let kernels = Kernels::new(&self.device, &self.cameras, &code, &self.bindings)?;
        let old = (
            std::mem::replace(&mut self.code, code),
            std::mem::replace(&mut self.kernels, kernels),
            std::mem::take(&mut self.specialised),
        );
        let permutations = self.permutations();
        // What was recorded names pipelines that are on their way out.
        self.recorded = None;
        self.recorded_again = false;
        self.record(&permutations).inspect_err(|_| {
            (self.code, self.kernels, self.specialised) = old;
        })
    }
}
