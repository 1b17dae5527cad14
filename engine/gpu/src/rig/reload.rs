//! Exchange of kernels while a rig runs.

use super::code::Code;
use super::kernels::{Kernels, SensorKernels};
use super::{Pipelines, Rig};
use crate::error::EngineError;
use crate::kernel_folder::KernelFolder;
use std::sync::Arc;

impl Rig {
    /// From the next tick on, runs the kernels of the folder whose text differs from what the rig runs; returns their
    /// stages. State, buffers and the events of earlier ticks do not change. On an error the rig keeps its kernels, and
    /// the same edits are not tried again. A folder serves one rig.
    pub fn reload_kernels(&mut self, folder: &mut KernelFolder) -> Result<Vec<&'static str>, EngineError> {
        self.check_ready()?;
        let ready = folder.edited()?;
        if ready.is_empty() {
            return Ok(Vec::new());
        }
        let mut code = self.pipelines.code.clone();
        code.replaced.extend(ready.iter().map(|(name, words)| (*name, words.to_vec())));
        let names: Vec<&str> = ready.iter().map(|(name, _)| *name).collect();
        let stages = esaac_layout::stages(&names);
        self.exchange(code)?;
        folder.installed();
        Ok(stages)
    }

    /// Makes every pipeline from `code`; on an error nothing has changed.
    fn exchange(&mut self, code: Code) -> Result<(), EngineError> {
        let bindings = Arc::clone(&self.pipelines.bindings);
        let policy = self.pipelines.policy;
        let mut kernels = Kernels::new(policy, &self.cameras, &code, &bindings)?;
        let poses = self.pipelines.kernels.poses.is_some();
        kernels.need(policy, &code, &bindings, &self.permutations(), poses)?;
        let mut specialised = SensorKernels::default();
        for permutation in self.permutations() {
            specialised.need(&code, &bindings, policy, &permutation, false)?;
        }
        self.pipelines = Pipelines { bindings, code, kernels, specialised, policy };
        // The recorded commands name the old pipelines.
        self.recordings.forget();
        Ok(())
    }
}
