//! A file that fails once. `ZipWriter` tries to finish an archive when it is dropped, and prints a message of its own if
//! it cannot: on a full disk a second one, beside the caller's. So after the first failure nothing more is written.

use std::io::{Result, Seek, SeekFrom, Write};

/// Writes to `out` until that fails. From then on it only counts the position, and nothing fails any more.
pub(crate) struct UntilFailure<W> {
    out: W,
    position: u64,
    end: u64,
    failed: bool,
}

impl<W> UntilFailure<W> {
    pub(crate) fn new(out: W) -> Self {
        UntilFailure { out, position: 0, end: 0, failed: false }
    }

    fn moved(&mut self, position: u64) -> u64 {
        self.position = position;
        self.end = self.end.max(position);
        position
    }

    fn noted<T>(&mut self, result: Result<T>) -> Result<T> {
        self.failed = result.is_err();
        result
    }
}

impl<W: Write> Write for UntilFailure<W> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        let count = if self.failed {
            bytes.len()
        } else {
            let written = self.out.write(bytes);
            let count = self.noted(written)?;
            // A file without room, as its callers see it.
            self.failed = count == 0 && !bytes.is_empty();
            count
        };
        self.moved(self.position + count as u64);
        Ok(count)
    }

    fn flush(&mut self) -> Result<()> {
        if self.failed {
            return Ok(());
        }
        let flushed = self.out.flush();
        self.noted(flushed)
    }
}

impl<W: Seek> Seek for UntilFailure<W> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        let position = if self.failed {
            match to {
                SeekFrom::Start(position) => position,
                SeekFrom::Current(by) => self.position.saturating_add_signed(by),
                SeekFrom::End(by) => self.end.saturating_add_signed(by),
            }
        } else {
            let sought = self.out.seek(to);
            self.noted(sought)?
        };
        Ok(self.moved(position))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn nothing_fails_after_the_first_failure_and_positions_go_on() {
        let mut room = [0_u8; 6];
        let mut out = UntilFailure::new(Cursor::new(&mut room[..]));
        out.write_all(b"abcd").unwrap();
        assert_eq!(out.seek(SeekFrom::Start(2)).unwrap(), 2);
        assert!(out.write_all(b"efghi").is_err());
        out.write_all(b"jk").unwrap();
        out.flush().unwrap();
        assert_eq!(out.stream_position().unwrap(), 8);
        assert_eq!(out.seek(SeekFrom::Current(-3)).unwrap(), 5);
        assert_eq!(out.seek(SeekFrom::End(0)).unwrap(), 8);
        assert_eq!(&room, b"abefgh");
    }
}
