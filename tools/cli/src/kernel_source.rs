//! Where a run's kernels come from: embedded ones, or a folder of kernels under development (`--glsl`).

use anyhow::Result;
#[cfg(feature = "shaderc")]
use esaac_engine::KernelFolder;
use esaac_engine::Rig;
use indicatif::ProgressBar;
use std::path::PathBuf;

/// Option of every command that runs kernels.
#[derive(clap::Args, Clone, Debug)]
pub struct KernelArguments {
    /// Folder of kernels to run in place of the embedded ones; those that are edited meanwhile are
    /// reloaded (needs a build with `--features shaderc`)
    #[arg(long, value_name = "DIR")]
    pub glsl: Option<PathBuf>,
}

/// Kernels of a run.
pub struct KernelSource {
    #[cfg(feature = "shaderc")]
    folder: Option<KernelFolder>,
}

#[cfg(feature = "shaderc")]
impl KernelSource {
    /// What the arguments ask for.
    pub fn open(arguments: &KernelArguments) -> Result<Self> {
        Ok(KernelSource { folder: arguments.glsl.as_deref().map(KernelFolder::open).transpose()? })
    }

    /// Gives a new rig its kernels; all of them must be right.
    pub fn load(&mut self, rig: &mut Rig) -> Result<()> {
        if let Some(folder) = &mut self.folder {
            let names = rig.reload_kernels(folder)?;
            eprintln!("kernels of {}: {}", folder.path().display(), names.join(", "));
        }
        Ok(())
    }

    /// Takes what was edited since the last call. Kernels that are wrong are reported, and those that run
    /// stay.
    pub fn refresh(&mut self, rig: &mut Rig, progress: &ProgressBar) {
        let Some(folder) = &mut self.folder else { return };
        match rig.reload_kernels(folder) {
            Ok(names) if names.is_empty() => {}
            Ok(names) => progress.suspend(|| eprintln!("reloaded kernels: {}", names.join(", "))),
            Err(error) => progress.suspend(|| eprintln!("warning: kernels not reloaded:\n{error}")),
        }
    }
}

#[cfg(not(feature = "shaderc"))]
impl KernelSource {
    /// What the arguments ask for.
    pub fn open(arguments: &KernelArguments) -> Result<Self> {
        anyhow::ensure!(
            arguments.glsl.is_none(),
            "--glsl needs a shader compiler in the program, which this build lacks; build it with: \
             cargo build --release -p esaac-cli --features shaderc"
        );
        Ok(KernelSource {})
    }

    /// Gives a new rig its kernels: it has them.
    pub fn load(&mut self, _rig: &mut Rig) -> Result<()> {
        Ok(())
    }

    /// Takes what was edited: embedded kernels are not.
    pub fn refresh(&mut self, _rig: &mut Rig, _progress: &ProgressBar) {}
}
