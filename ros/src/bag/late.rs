//! A file that keeps what it holds until there is something to write in its place.

use std::fs::File;
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A file that is opened now and overwritten later. What is written before it is wanted is held in memory; without a
/// write after that, the file stays as it was. A pipe or a device has nothing to keep, and is written at once.
pub(super) struct LateFile {
    path: PathBuf,
    file: File,
    /// Whether there was no file before.
    is_new: bool,
    wanted: Arc<AtomicBool>,
    /// Bytes that came before the file was wanted.
    held: Vec<u8>,
    /// Whether the old contents are gone.
    begun: bool,
}

impl LateFile {
    /// Opens a file, or makes it. It is overwritten by the first write after `wanted` is true.
    pub fn open(path: &Path, wanted: Arc<AtomicBool>) -> io::Result<Self> {
        let mut options = File::options();
        options.write(true);
        let (file, is_new) = match options.clone().create_new(true).open(path) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                (options.create(true).truncate(false).open(path)?, false)
            }
            made => (made?, true),
        };
        let begun = !file.metadata()?.is_file();
        Ok(LateFile { path: path.to_owned(), file, is_new, wanted, held: Vec::new(), begun })
    }
}

impl Write for LateFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if !self.begun {
            if !self.wanted.load(Ordering::Relaxed) {
                self.held.extend_from_slice(bytes);
                return Ok(bytes.len());
            }
            self.begun = true;
            self.file.set_len(0)?;
            self.file.write_all(&std::mem::take(&mut self.held))?;
        }
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// The writer of recordings asks where it is, for its index, and goes nowhere else.
impl Seek for LateFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            to if self.begun => self.file.seek(to),
            SeekFrom::Current(0) => Ok(self.held.len() as u64),
            _ => Err(ErrorKind::Unsupported.into()),
        }
    }
}

impl Drop for LateFile {
    fn drop(&mut self) {
        if self.is_new && !self.begun {
            // If it cannot be removed, an empty file is left, and nothing else is lost.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_what_is_held() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        std::fs::write(&path, b"what was there before").unwrap();
        let wanted = Arc::new(AtomicBool::new(false));
        let mut file = LateFile::open(&path, Arc::clone(&wanted)).unwrap();
        assert_eq!(file.stream_position().unwrap(), 0);
        file.write_all(b"head").unwrap();
        assert_eq!(file.stream_position().unwrap(), 4);
        assert_eq!(file.seek(SeekFrom::Start(0)).unwrap_err().kind(), ErrorKind::Unsupported);
        assert_eq!(std::fs::read(&path).unwrap(), b"what was there before");
        wanted.store(true, Ordering::Relaxed);
        file.write_all(b"body").unwrap();
        assert_eq!(file.stream_position().unwrap(), 8);
        assert_eq!(std::fs::read(&path).unwrap(), b"headbody");
    }
}
