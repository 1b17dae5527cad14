//! A folder of kernels under development, compiled in the program whenever they are edited.

use crate::error::EngineError;
use crate::interface::{STAGES, check};
use esaac_kernels::{CompileError, Include, Optimise, compile_linked};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Include that is generated from the model crate, in no folder.
const LAYOUT: &str = "layout.glsl";

/// When a file was written and how long it is; nothing for a file that is not there.
type Stamp = Option<(SystemTime, u64)>;

/// Files that a kernel was made of, as they were.
type Files = BTreeMap<PathBuf, Stamp>;

/// A copy of `glsl/` whose kernels a rig takes in place of the embedded ones, see
/// [`Rig::reload_kernels`](crate::Rig::reload_kernels): an entry `STAGE.comp` a kernel, and what they
/// include.
pub struct KernelFolder {
    folder: PathBuf,
    layout: String,
    kernels: Vec<Edited>,
}

/// A kernel of the folder.
struct Edited {
    stage: &'static str,
    files: Files,
    standing: Standing,
}

/// What became of a kernel's last edit.
enum Standing {
    /// A rig runs it.
    Installed,
    /// It waits until every kernel compiles.
    Ready(Vec<u32>),
    /// It cannot be used, and why.
    Broken(String),
}

impl KernelFolder {
    /// A folder; nothing is compiled yet.
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
            layout: esaac_model::layout::glsl(),
            kernels: STAGES
                .iter()
                .map(|&stage| Edited { stage, files: Files::new(), standing: Standing::Installed })
                .collect(),
        })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Compiles what was edited since the last call; returns every kernel that is to be exchanged once
    /// there was an edit and all compile, else nothing.
    pub(crate) fn edited(&mut self) -> Result<Vec<(&'static str, &[u32])>, EngineError> {
        let mut any = false;
        for kernel in &mut self.kernels {
            let same = |(path, then): (&PathBuf, &Stamp)| stamp(path) == *then;
            if !kernel.files.is_empty() && kernel.files.iter().all(same) {
                continue;
            }
            any = true;
            let (files, outcome) = compile(&self.folder, &self.layout, kernel.stage);
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
                Standing::Ready(words) => ready.push((kernel.stage, &words[..])),
                // An include that is wrong is so in every kernel.
                Standing::Broken(message) if problems.contains(&message.as_str()) => {}
                Standing::Broken(message) => problems.push(message),
            }
        }
        if problems.is_empty() { Ok(ready) } else { Err(EngineError::Kernels(problems.join("\n"))) }
    }

    /// What the last [`KernelFolder::edited`] returned runs.
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

/// A kernel's code or why there is none, and the files that decide it.
fn compile(folder: &Path, layout: &str, stage: &str) -> (Files, Result<Vec<u32>, String>) {
    let files = RefCell::new(Files::new());
    let read = |path: PathBuf| {
        // Before the text, so that an edit in between is another edit.
        files.borrow_mut().entry(path.clone()).or_insert_with(|| stamp(&path));
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok((path.display().to_string(), text))
    };
    let include = |wanted: &str| {
        if wanted == LAYOUT {
            return Ok(Include { name: LAYOUT.to_owned(), text: layout.to_owned() });
        }
        read(folder.join(wanted)).map(|(name, text)| Include { name, text })
    };
    let outcome = read(folder.join(format!("{stage}.comp"))).and_then(|(name, text)| {
        let compile = |optimise| {
            compile_linked(&text, &name, include, optimise).map_err(|error| match error {
                CompileError::Source { message, .. } => message,
                other => other.to_string(),
            })
        };
        check(stage, &compile(Optimise::No)?).map_err(|difference| format!("{name}: {difference}"))?;
        compile(Optimise::Yes)
    });
    (files.into_inner(), outcome)
}
