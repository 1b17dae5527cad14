//! The text that a kernel is compiled from. The build script reads that of the embedded kernels, a kernel folder its own.

use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};

/// Digest of the text of a kernel of `folder` and of all that it includes, but for generated includes, which do not
/// change. `met` is told of each file before it is read. An error if one cannot be read.
pub fn digest(
    kernel: &str,
    folder: &Path,
    generated: &Path,
    mut met: impl FnMut(&Path),
) -> Result<u64, String> {
    let mut digest = DefaultHasher::new();
    let mut known: Vec<PathBuf> = vec![folder.join(format!("{kernel}.comp"))];
    let mut next = 0;
    while let Some(path) = known.get(next).cloned() {
        next += 1;
        met(&path);
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        digest.write(text.as_bytes());
        for name in included(&text) {
            let path = folder.join(name);
            let is_here = path.exists() || !generated.join(name).exists();
            if is_here && !known.contains(&path) {
                known.push(path);
            }
        }
    }
    Ok(digest.finish())
}

/// Names in the `#include "NAME"` directives of a text.
fn included(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| line.trim().strip_prefix("#include")?.split('"').nth(1))
}
