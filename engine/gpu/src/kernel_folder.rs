//! A folder of kernels under development, compiled by the running program whenever they are edited.

use crate::error::EngineError;
use crate::interface::check;
use esaac_kernels::{CompileError, Include, Optimise, compile_linked};
use esaac_layout::{KERNELS, KernelInfo, generated_files};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// When a file was written and how long it is; `None` for a file that does not exist.
type Stamp = Option<(SystemTime, u64)>;

/// The files that a kernel was compiled from, with their stamps at that time.
type Files = BTreeMap<PathBuf, Stamp>;

/// A copy of `glsl/` whose kernels a rig runs instead of the embedded ones, see
/// [`Rig::reload_kernels`](crate::Rig::reload_kernels). It holds a file `NAME.comp` for each kernel, and their
/// includes.
pub struct KernelFolder {
    folder: PathBuf,
    /// Generated includes, which are in no folder: name and text.
    generated: Vec<(String, String)>,
    kernels: Vec<Edited>,
}

/// A kernel of the folder.
struct Edited {
    kernel: &'static KernelInfo,
    files: Files,
    standing: Standing,
}

/// The outcome of a kernel's last edit.
enum Standing {
    /// The rig runs it.
    Installed,
    /// It compiles, and waits until every kernel does.
    Ready(Vec<u32>),
    /// It cannot be used, for this reason.
    Broken(String),
}

impl KernelFolder {
    /// Opens a folder; nothing is compiled yet. An error if it is not a folder.
    pub fn open(folder: &Path) -> Result<Self, EngineError> {
        if !folder.is_dir() {
            let problem = if folder.exists() { "is no folder" } else { "does not exist" };
            return Err(EngineError::Kernels(format!(
                "{} {problem}; expected a copy of the engine's folder `glsl`",
                folder.display()
            )));
        }
        Ok(KernelFolder {
            folder: folder.to_owned(),
            generated: generated_files(),
            kernels: KERNELS
                .iter()
                .map(|kernel| Edited { kernel, files: Files::new(), standing: Standing::Installed })
                .collect(),
        })
    }

    /// Path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Compiles the kernels that were edited since the last call. Returns those to exchange if there was an edit and
    /// every kernel compiles; nothing if there was no edit; else the compiler's messages as an error.
    pub(crate) fn edited(&mut self) -> Result<Vec<(&'static str, &[u32])>, EngineError> {
        let mut any = false;
        for kernel in &mut self.kernels {
            let same = |(path, then): (&PathBuf, &Stamp)| stamp(path) == *then;
            if !kernel.files.is_empty() && kernel.files.iter().all(same) {
                continue;
            }
            any = true;
            let (files, outcome) = compile(&self.folder, &self.generated, kernel.kernel);
            kernel.files = files;
            kernel.standing = match outcome {
                Ok(words) => Standing::Ready(words),
                Err(message) => Standing::Broken(message),
            };
        }
        if !any {
            return Ok(Vec::new());
        }
        let mut ready = Vec::new();
        let mut problems: Vec<&str> = Vec::new();
        for kernel in &self.kernels {
            match &kernel.standing {
                Standing::Installed => {}
                Standing::Ready(words) => ready.push((kernel.kernel.name, &words[..])),
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
            kernel.standing = Standing::Installed;
        }
    }
}

fn stamp(path: &Path) -> Stamp {
    let metadata = std::fs::metadata(path).ok()?;
    Some((metadata.modified().ok()?, metadata.len()))
}

/// The files that a kernel is compiled from, and its code or the reason why it has none.
fn compile(
    folder: &Path,
    generated: &[(String, String)],
    kernel: &KernelInfo,
) -> (Files, Result<Vec<u32>, String>) {
    let files = RefCell::new(Files::new());
    let read = |path: PathBuf| {
        // The stamp is taken before the text is read, so that an edit in between counts as another edit.
        files.borrow_mut().entry(path.clone()).or_insert_with(|| stamp(&path));
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok((path.display().to_string(), text))
    };
    let include = |wanted: &str| {
        if let Some((name, text)) = generated.iter().find(|(name, _)| name == wanted) {
            return Ok(Include { name: name.clone(), text: text.clone() });
        }
        read(folder.join(wanted)).map(|(name, text)| Include { name, text })
    };
    let outcome = read(folder.join(format!("{}.comp", kernel.name))).and_then(|(name, text)| {
        let compile = |optimise| {
            compile_linked(&text, &name, include, optimise).map_err(|error| match error {
                CompileError::Source { message, .. } => message,
                other => other.to_string(),
            })
        };
        check(kernel, &compile(Optimise::No)?).map_err(|difference| format!("{name}: {difference}"))?;
        compile(Optimise::Yes)
    });
    (files.into_inner(), outcome)
}
