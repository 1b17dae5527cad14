//! A folder of kernels under development, compiled by the running program whenever they are edited.

use crate::error::EngineError;
use crate::interface::check;
use crate::kernel::stages;
use crate::sources::digest;
use esaac_kernels::{CompileError, Optimise};
use esaac_layout::{KERNELS, KernelInfo, generated_files};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;
use tempfile::TempDir;

/// When a file was written and how long it is; `None` for a file that does not exist.
type Stamp = Option<(SystemTime, u64)>;

/// The files that a kernel was read from, with their stamps at that time.
type Files = BTreeMap<PathBuf, Stamp>;

/// A copy of `glsl/` whose kernels a rig runs instead of the embedded ones, see
/// [`Rig::reload_kernels`](crate::Rig::reload_kernels). It holds a file `NAME.comp` for each kernel, and their
/// includes.
///
/// The folder is trusted as the program's own code is: a kernel must compile and have the layouts of the Rust code, but
/// nothing keeps it from reading or writing beyond its buffers.
pub struct KernelFolder {
    folder: PathBuf,
    /// Generated includes, which are not in `glsl/`.
    generated: TempDir,
    kernels: Vec<Edited>,
}

/// A kernel of the folder.
struct Edited {
    kernel: &'static KernelInfo,
    /// The files that it was read from.
    files: Files,
    /// Digest of the text that the rig runs.
    running: u64,
    standing: Standing,
}

/// What a kernel's text is to the rig.
enum Standing {
    /// The rig runs it.
    Installed,
    /// It compiles, and waits until every kernel does.
    Ready { words: Vec<u32>, digest: u64 },
    /// It cannot be used, for this reason.
    Broken(String),
}

impl KernelFolder {
    /// Opens a folder; nothing is compiled yet. An error if it is not a folder, or if there is no room for the
    /// generated includes.
    pub fn open(folder: &Path) -> Result<Self, EngineError> {
        if !folder.is_dir() {
            let problem = if folder.exists() { "is no folder" } else { "does not exist" };
            return Err(EngineError::Kernels(format!(
                "{} {problem}; expected a copy of the engine's folder `glsl`",
                folder.display()
            )));
        }
        let generated = write_generated()
            .map_err(|e| EngineError::Kernels(format!("a temporary folder for generated includes: {e}")))?;
        Ok(KernelFolder {
            folder: folder.to_owned(),
            generated,
            kernels: KERNELS
                .iter()
                .map(|kernel| {
                    let (files, running) = (Files::new(), embedded_digest(kernel));
                    Edited { kernel, files, running, standing: Standing::Installed }
                })
                .collect(),
        })
    }

    /// Path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Reads the kernels whose files were written since the last call, and compiles those whose text is not what the rig
    /// runs. Returns those to exchange if every kernel compiles; nothing if no file was written; else the compiler's
    /// messages as an error.
    pub(crate) fn edited(&mut self) -> Result<Vec<(&'static str, &[u32])>, EngineError> {
        let written: Vec<_> = self.kernels.iter_mut().filter(|kernel| kernel.is_written()).collect();
        if written.is_empty() {
            return Ok(Vec::new());
        }
        read_all(&self.folder, self.generated.path(), written);
        let mut ready = Vec::new();
        let mut problems: Vec<&str> = Vec::new();
        for kernel in &self.kernels {
            match &kernel.standing {
                Standing::Installed => {}
                Standing::Ready { words, .. } => ready.push((kernel.kernel.name, &words[..])),
                // A wrong include gives the same message in every kernel: report it once.
                Standing::Broken(message) if problems.contains(&message.as_str()) => {}
                Standing::Broken(message) => problems.push(message),
            }
        }
        if problems.is_empty() { Ok(ready) } else { Err(EngineError::Kernels(problems.join("\n"))) }
    }

    /// Marks the kernels that the last [`KernelFolder::edited`] returned as running.
    pub(crate) fn installed(&mut self) {
        for kernel in &mut self.kernels {
            if let Standing::Ready { digest, .. } = kernel.standing {
                kernel.running = digest;
                kernel.standing = Standing::Installed;
            }
        }
    }
}

fn stamp(path: &Path) -> Stamp {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

impl Edited {
    /// Whether one of its files was written since it was read; also before it is read for the first time.
    fn is_written(&self) -> bool {
        self.files.is_empty() || self.files.iter().any(|(path, then)| stamp(path) != *then)
    }

    /// Reads it, and compiles it if its text is neither what the rig runs nor that of the embedded kernel.
    fn read(&mut self, folder: &Path, generated: &Path) {
        self.files.clear();
        // The stamp is taken before the file is read, so that an edit in between counts as another edit.
        let met = |path: &Path| {
            self.files.insert(path.to_owned(), stamp(path));
        };
        let standing = digest(self.kernel.name, folder, generated, met).and_then(|digest| {
            if digest == self.running {
                return Ok(Standing::Installed);
            }
            let is_embedded = digest == embedded_digest(self.kernel);
            let words =
                if is_embedded { embedded(self.kernel) } else { compile(folder, generated, self.kernel)? };
            Ok(Standing::Ready { words, digest })
        });
        self.standing = standing.unwrap_or_else(Standing::Broken);
    }
}

/// Reads kernels side by side: a compiler runs on one core, and an edited include concerns dozens.
fn read_all(folder: &Path, generated: &Path, kernels: Vec<&mut Edited>) {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(kernels.len());
    let queue = Mutex::new(kernels.into_iter());
    let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
    let work = || {
        while let Some(kernel) = next() {
            kernel.read(folder, generated);
        }
    };
    std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(work))));
}

/// Writes the generated includes where the compiler finds them.
fn write_generated() -> std::io::Result<TempDir> {
    let folder = tempfile::tempdir()?;
    for (name, text) in generated_files() {
        std::fs::write(folder.path().join(name), text)?;
    }
    Ok(folder)
}

/// Digest of the text that an embedded kernel was compiled from.
fn embedded_digest(kernel: &KernelInfo) -> u64 {
    let found = stages::DIGESTS.iter().find(|(name, _)| *name == kernel.name);
    found.expect("every kernel is embedded").1
}

/// Code of an embedded kernel.
fn embedded(kernel: &KernelInfo) -> Vec<u32> {
    let found = stages::ALL.iter().find(|(name, _)| *name == kernel.name);
    esaac_kernels::words(found.expect("every kernel is embedded").1)
}

/// A kernel's code, or the reason why it has none.
fn compile(folder: &Path, generated: &Path, kernel: &KernelInfo) -> Result<Vec<u32>, String> {
    let source = folder.join(format!("{}.comp", kernel.name));
    let includes = [folder.to_owned(), generated.to_owned()];
    let compile = |optimise| {
        esaac_kernels::compile(&source, &includes, &[], optimise).map_err(|error| match error {
            CompileError::Source { message, .. } => message.trim_end().to_owned(),
            other => other.to_string(),
        })
    };
    let named = |difference| format!("{}: {difference}", source.display());
    check(kernel, &compile(Optimise::No)?).map_err(named)?;
    compile(Optimise::Yes)
}
