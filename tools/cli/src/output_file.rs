//! Writes files that are either complete or not there.

use anyhow::{Context, Result, bail, ensure};
use std::fs::{File, Permissions};
use std::io::{BufWriter, Cursor, Seek, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Fails before any work is done if [`write()`] would fail because there is no folder or no permission.
pub fn check(path: &Path) -> Result<()> {
    if !is_special(path) {
        temporary_beside(&linked(path)).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Makes a folder for output, unless it is there.
pub fn make_folder(path: &Path) -> Result<()> {
    let made = || -> Result<()> {
        ensure!(path.is_dir() || !path.exists(), "it is a file, expected a folder");
        Ok(std::fs::create_dir_all(path)?)
    };
    made().with_context(|| format!("cannot make folder {}", path.display()))
}

/// As [`check`], for a sensor: a name with another format's ending would say what the file is not.
pub fn check_sensor(path: &Path) -> Result<()> {
    check(path)?;
    ensure!(
        is_special(path) || path.extension().is_some_and(|ending| ending == "toml"),
        "cannot write {}: sensors are written as .toml, expected a name that ends so",
        path.display()
    );
    Ok(())
}

/// Fails if an output is an input or another output, under whatever name. Devices may be given several times.
pub fn check_apart(outputs: &[&Path], inputs: &[&Path]) -> Result<()> {
    for (number, output) in outputs.iter().enumerate().filter(|(_, output)| !is_special(output)) {
        let is_it = |other: &&&Path| place(other) == place(output);
        if let Some(input) = inputs.iter().find(is_it) {
            bail!("cannot write {}: it is the input {}, expected another", output.display(), input.display());
        }
        if let Some(other) = outputs[..number].iter().find(is_it) {
            bail!(
                "cannot write {}: it is the output {} too, expected another",
                output.display(),
                other.display()
            );
        }
    }
    Ok(())
}

/// Runs `fill` on a temporary file beside `path`, flushes it to the disk and renames it to `path`. If
/// anything fails, `path` stays as it was. If it is a link, the file that it names is written. A device or a
/// pipe, such as `/dev/stdout` may be, is written from memory: it cannot be gone back in.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn WriteSeek) -> Result<()>) -> Result<()> {
    let written = || -> Result<()> {
        if is_special(path) {
            let mut whole = Cursor::new(Vec::new());
            fill(&mut whole)?;
            if is_standard_output(path) {
                let mut out = std::io::stdout().lock();
                out.write_all(whole.get_ref())?;
                return Ok(out.flush()?);
            }
            return Ok(File::options().write(true).open(path)?.write_all(whole.get_ref())?);
        }
        let path = linked(path);
        let temporary = temporary_beside(&path)?;
        through_buffer(temporary.as_file(), fill)?;
        temporary.as_file().sync_all()?;
        temporary.persist(&path)?;
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

/// Whether there is something at `path` that is neither a file nor a folder, such as a device; or standard output,
/// whatever it goes to.
pub fn is_special(path: &Path) -> bool {
    names_standard_output(path) || path.metadata().is_ok_and(|m| !m.is_file() && !m.is_dir())
}

/// The names of standard output.
fn names_standard_output(path: &Path) -> bool {
    ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"].iter().any(|name| path == Path::new(name))
}

/// Whether `path` is standard output or the pipe that it goes to, so that text there would be part of the file.
pub fn is_standard_output(path: &Path) -> bool {
    if names_standard_output(path) {
        return true;
    }
    let pipe = |path: &Path| {
        let found = path.metadata().ok().filter(|m| m.file_type().is_fifo())?;
        Some((found.dev(), found.ino()))
    };
    pipe(path).is_some_and(|own| pipe(Path::new("/proc/self/fd/1")) == Some(own))
}

/// The file that a link names, if `path` is one, whether or not that file is there.
fn linked(path: &Path) -> PathBuf {
    let mut path = path.to_owned();
    for _ in 0..MOST_LINKS {
        match path.read_link() {
            Ok(target) => path = path.parent().unwrap_or(Path::new("")).join(target),
            Err(_) => break,
        }
    }
    path
}

/// Links to links that are followed; as many as the system follows.
const MOST_LINKS: usize = 40;

/// One path for all names of a file, which need not be there.
fn place(path: &Path) -> PathBuf {
    let path = linked(path);
    let folder = folder_of(&path);
    match (folder.canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path,
    }
}

fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

fn temporary_beside(path: &Path) -> Result<NamedTempFile> {
    ensure!(!path.is_dir(), "it is a folder, expected the name of a file");
    let folder = folder_of(path);
    ensure!(folder.is_dir(), "there is no folder {}", folder.display());
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
    use std::os::unix::fs::symlink;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        write(&path, |w| Ok(w.write_all(b"old")?)).unwrap();
        let error = write(&path, |w| {
            w.write_all(b"new")?;
            bail!("stopped")
        })
        .unwrap_err();
        assert!(format!("{error:#}").contains("stopped"), "{error:#}");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_link_stays_and_the_file_that_it_names_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let [link, next, file] = ["link", "next", "file"].map(|name| folder.path().join(name));
        symlink("next", &link).unwrap();
        symlink(&file, &next).unwrap();
        for text in ["new", "newer"] {
            check(&link).unwrap();
            write(&link, |w| Ok(w.write_all(text.as_bytes())?)).unwrap();
            assert!(link.is_symlink() && next.is_symlink());
            assert_eq!(std::fs::read_to_string(&file).unwrap(), text);
        }
        symlink("/nonesuch/file", folder.path().join("dangling")).unwrap();
        let error = check(&folder.path().join("dangling")).unwrap_err();
        assert!(format!("{error:#}").contains("no folder /nonesuch"), "{error:#}");
    }

    #[test]
    fn an_output_that_is_an_input_or_another_output_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, link] = ["a", "b", "link"].map(|name| folder.path().join(name));
        symlink(&b, &link).unwrap();
        let roundabout = folder.path().join("../").join(folder.path().file_name().unwrap()).join("a");
        assert!(check_apart(&[&a, &b], &[]).is_ok());
        let device = Path::new("/dev/null");
        assert!(check_apart(&[device, device], &[device]).is_ok());
        let error =
            |outputs: &[&Path], inputs: &[&Path]| check_apart(outputs, inputs).unwrap_err().to_string();
        assert!(error(&[&a, &roundabout], &[]).contains("it is the output"));
        assert!(error(&[&b], &[&a, &link]).contains("it is the input"));
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

    #[test]
    fn a_file_in_place_of_a_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        std::fs::write(&file, "").unwrap();
        let error = format!("{:#}", make_folder(&file).unwrap_err());
        assert!(error.contains("/a: it is a file, expected a folder"), "{error}");
        make_folder(&folder.path().join("b/c")).unwrap();
        make_folder(&folder.path().join("b/c")).unwrap();
    }
}
