//! The kernels of a run: the embedded ones, or those of a folder that is being edited (`--glsl`).

use anyhow::Result;
#[cfg(feature = "shaderc")]
use esaac_engine::KernelFolder;
use esaac_engine::Rig;
use indicatif::ProgressBar;
use std::path::PathBuf;

/// Option of every command that runs kernels.
#[derive(clap::Args, Clone, Debug)]
pub struct KernelArguments {
    /// Folder of kernels to run instead of the embedded ones. Kernels that are edited meanwhile are reloaded.
    /// Needs a build with `--features shaderc`
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
    /// Opens the folder, if there is one.
    pub fn open(arguments: &KernelArguments) -> Result<Self> {
        Ok(KernelSource { folder: arguments.glsl.as_deref().map(KernelFolder::open).transpose()? })
    }

    /// Loads the folder's kernels into a new rig. A kernel that does not compile is an error.
    pub fn load(&mut self, rig: &mut Rig) -> Result<()> {
        if let Some(folder) = &mut self.folder {
            let names = rig.reload_kernels(folder)?;
            eprintln!("kernels of {}: {}", folder.path().display(), names.join(", "));
        }
        Ok(())
    }

    /// Reloads the kernels that were edited since the last call. If one does not compile, this is reported
    /// and the old ones stay.
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
    /// Fails if there is a folder: this build has no compiler.
    pub fn open(arguments: &KernelArguments) -> Result<Self> {
        anyhow::ensure!(
            arguments.glsl.is_none(),
            "--glsl needs a shader compiler, which this build lacks; build one with: \
             cargo build --release -p esaac-cli --features shaderc"
        );
        Ok(KernelSource {})
    }

    /// Does nothing: a rig has the embedded kernels.
    pub fn load(&mut self, _rig: &mut Rig) -> Result<()> {
        Ok(())
    }

    /// Does nothing: embedded kernels do not change.
    pub fn refresh(&mut self, _rig: &mut Rig, _progress: &ProgressBar) {}
}
