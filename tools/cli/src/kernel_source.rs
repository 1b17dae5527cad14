//! The kernels of a run: the embedded ones, or those of a folder that is being edited (`--glsl`).

use crate::stderr;
use anyhow::Result;
use esaac_engine::{KernelFolder, Rig};
use indicatif::ProgressBar;
use std::path::PathBuf;

/// Option of every command that runs kernels.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Kernels")]
pub struct KernelArguments {
    /// Folder of kernels to run instead of the embedded ones. Kernels that are edited meanwhile are reloaded.
    /// Needs `glslc`
    #[arg(long, value_name = "DIR")]
    pub glsl: Option<PathBuf>,
}

/// Kernels of a run.
pub struct KernelSource {
    folder: Option<KernelFolder>,
}

impl KernelSource {
    /// Opens the folder, if there is one.
    pub fn open(arguments: &KernelArguments) -> Result<Self> {
        Ok(KernelSource { folder: arguments.glsl.as_deref().map(KernelFolder::open).transpose()? })
    }

    /// Loads the folder's kernels into a new rig. A kernel that does not compile is an error.
    pub fn load(&mut self, rig: &mut Rig) -> Result<()> {
        if let Some(folder) = &mut self.folder {
            let names = rig.reload_kernels(folder)?;
            let other = if names.is_empty() { "those embedded".to_owned() } else { names.join(", ") };
            stderr::line(format_args!("kernels of {}: {other}", folder.path().display()));
        }
        Ok(())
    }

    /// Reloads the kernels that were edited since the last call. If one does not compile, this is reported
    /// and the old ones stay.
    pub fn refresh(&mut self, rig: &mut Rig, progress: &ProgressBar) {
        let Some(folder) = &mut self.folder else { return };
        match rig.reload_kernels(folder) {
            Ok(names) if names.is_empty() => {}
            Ok(names) => {
                progress.suspend(|| stderr::line(format_args!("reloaded kernels: {}", names.join(", "))))
            }
            Err(error) => {
                progress.suspend(|| stderr::line(format_args!("warning: kernels not reloaded:\n{error}")))
            }
        }
    }
}
