//! Writes files that are either complete or not there.

use anyhow::{Context, Result};
use std::fs::{File, Permissions};
use std::io::{BufWriter, Seek, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Fails before any work is done if [`write()`] would fail because there is no folder or no permission.
pub fn check(path: &Path) -> Result<()> {
    if !is_special(path) {
        temporary_beside(path).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// As [`check`], for events: a name with another format's ending would say what the file is not.
pub fn check_events(path: &Path) -> Result<()> {
    check(path)?;
    anyhow::ensure!(
        is_special(path) || path.extension().is_some_and(|ending| ending == "npz"),
        "cannot write {}: events are written as .npz, expected a name that ends so; `esaac.EventWriter` in Python \
         writes other formats",
        path.display()
    );
    Ok(())
}

/// Runs `fill` on a temporary file beside `path`, flushes it to the disk and renames it to `path`. If
/// anything fails, `path` stays as it was. A device such as `/dev/stdout` is written directly.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn WriteSeek) -> Result<()>) -> Result<()> {
    let written = || -> Result<()> {
        if is_special(path) {
            return through_buffer(&File::options().write(true).open(path)?, fill);
        }
        let temporary = temporary_beside(path)?;
        through_buffer(temporary.as_file(), fill)?;
        temporary.as_file().sync_all()?;
        temporary.persist(path)?;
        Ok(())
    };
    written().with_context(|| format!("cannot write {}", path.display()))
}

/// The file that `fill` writes.
pub trait WriteSeek: Write + Seek {}
impl<T: Write + Seek> WriteSeek for T {}

fn through_buffer(file: &File, fill: impl FnOnce(&mut dyn WriteSeek) -> Result<()>) -> Result<()> {
    let mut buffer = BufWriter::with_capacity(1 << 20, file);
    fill(&mut buffer)?;
    buffer.flush()?;
    Ok(())
}

fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|m| !m.is_file() && !m.is_dir())
}

fn temporary_beside(path: &Path) -> Result<NamedTempFile> {
    anyhow::ensure!(!path.is_dir(), "it is a folder, expected the name of a file");
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    };
    anyhow::ensure!(folder.is_dir(), "there is no folder {}", folder.display());
    // The mode of an ordinary new file, reduced by the umask.
    let temporary = tempfile::Builder::new()
        .prefix(".esaac-")
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(&folder)?;
    Ok(temporary)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write(&path, |w| Ok(w.write_all(b"old")?)).unwrap();
        let error = write(&path, |w| {
            w.write_all(b"new")?;
            anyhow::bail!("stopped")
        })
        .unwrap_err();
        assert!(format!("{error:#}").contains("stopped"), "{error:#}");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_full_disk_is_an_error() {
        let error = write(Path::new("/dev/full"), |w| Ok(w.write_all(b"x")?)).unwrap_err();
        assert!(format!("{error:#}").contains("No space left on device"), "{error:#}");
    }

    #[test]
    fn a_missing_folder_is_named_before_any_work() {
        let error = check(Path::new("/nonesuch/events.npz")).unwrap_err();
        assert!(format!("{error:#}").contains("no folder /nonesuch"), "{error:#}");
        assert!(check(Path::new("/")).is_err());
    }
}
