//! Compilation with `glslc`, the shaderc project's command-line compiler.

use crate::precise::precise;
use std::path::{Path, PathBuf};
use std::process::Command;
use thiserror::Error;

/// Environment that kernels are compiled for. It is older than the Vulkan that the engine needs: for 1.3 `glslc` would give
/// a workgroup's size as `LocalSizeId`, which devices take only with the feature `maintenance4`.
pub const TARGET_ENV: &str = "vulkan1.2";

/// Why a kernel did not compile.
#[derive(Debug, Error)]
pub enum CompileError {
    /// `glslc` cannot be run.
    #[error("glslc cannot be run ({0}); install it with: apt-get install glslc")]
    NoCompiler(std::io::Error),
    /// The source has errors or warnings.
    #[error("{path}:\n{message}")]
    Source {
        /// File.
        path: PathBuf,
        /// The compiler's message.
        message: String,
    },
    /// The output is too short for SPIR-V, or not whole words.
    #[error("{path}: glslc wrote {bytes} bytes, expected a multiple of 4 above 20")]
    Output {
        /// File.
        path: PathBuf,
        /// Bytes written.
        bytes: usize,
    },
    /// The output is SPIR-V that cannot be read.
    #[error("{path}: the compiler's SPIR-V cannot be read: {message}")]
    Unreadable {
        /// File.
        path: PathBuf,
        /// The reader's message.
        message: String,
    },
}

/// Whether the optimiser runs. It removes names, which [`crate::reflect`] needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Optimise {
    /// For the device.
    Yes,
    /// For [`crate::reflect`].
    No,
}

/// Compiles a compute kernel with `glslc`, so that drivers do not fuse its arithmetic. `defines` are `NAME=VALUE`
/// pairs.
pub fn compile(
    source: &Path,
    include_dirs: &[PathBuf],
    defines: &[(&str, &str)],
    optimise: Optimise,
) -> Result<Vec<u32>, CompileError> {
    let mut command = Command::new("glslc");
    command.arg(format!("--target-env={TARGET_ENV}")).args(["-Werror", "-fshader-stage=compute"]);
    command.arg(match optimise {
        Optimise::Yes => "-O",
        Optimise::No => "-O0",
    });
    for dir in include_dirs {
        command.arg("-I").arg(dir);
    }
    for (name, value) in defines {
        command.arg(format!("-D{name}={value}"));
    }
    let output = command.arg(source).args(["-o", "-"]).output().map_err(CompileError::NoCompiler)?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        return Err(CompileError::Source { path: source.to_owned(), message });
    }
    let bytes = output.stdout.len();
    if bytes < 20 || !bytes.is_multiple_of(4) {
        return Err(CompileError::Output { path: source.to_owned(), bytes });
    }
    precise(&crate::words(&output.stdout))
        .map_err(|message| CompileError::Unreadable { path: source.to_owned(), message })
}
