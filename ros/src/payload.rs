//! Encoded messages that own their bytes. One buffer is filled once, and the wire and the bag both read
//! it where it lies; when the last of them lets go, its storage is filled again.

use crossbeam_channel::{Receiver, Sender, bounded};
use std::ops::Deref;
use std::sync::Arc;

/// CDR bytes of one message.
pub struct Payload {
    /// The message, and zeros up to a multiple of four: DDS sends whole words.
    padded: Vec<u8>,
    bytes: usize,
    home: Option<Sender<Vec<u8>>>,
}

impl Payload {
    /// A payload of its own, whose storage goes nowhere afterwards.
    #[must_use]
    pub fn new(bytes: Vec<u8>) -> Self {
        Payload::with_home(bytes, None)
    }

    fn with_home(mut padded: Vec<u8>, home: Option<Sender<Vec<u8>>>) -> Self {
        let bytes = padded.len();
        padded.resize(bytes.next_multiple_of(4), 0);
        Payload { padded, bytes, home }
    }

    /// The message and its padding.
    #[must_use]
    pub fn padded(&self) -> &[u8] {
        &self.padded
    }
}

impl Deref for Payload {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.padded[..self.bytes]
    }
}

impl Drop for Payload {
    fn drop(&mut self) {
        if let Some(home) = &self.home {
            // A full pool means that there are buffers enough.
            let _ = home.try_send(std::mem::take(&mut self.padded));
        }
    }
}

/// Storage that goes round.
pub struct Pool {
    home: Sender<Vec<u8>>,
    free: Receiver<Vec<u8>>,
}

impl Pool {
    /// Keeps at most `buffers` that are free.
    #[must_use]
    pub fn new(buffers: usize) -> Self {
        let (home, free) = bounded(buffers);
        Pool { home, free }
    }

    /// A payload that `encode` wrote into storage of an earlier one, where there is some.
    pub fn fill(&self, encode: impl FnOnce(&mut Vec<u8>)) -> Arc<Payload> {
        let mut bytes = self.free.try_recv().unwrap_or_default();
        bytes.clear();
        encode(&mut bytes);
        Arc::new(Payload::with_home(bytes, Some(self.home.clone())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn storage_comes_back_when_the_last_reader_lets_go() {
        let pool = Pool::new(2);
        let payload = pool.fill(|out| out.extend_from_slice(&[1, 2, 3, 4, 5]));
        assert_eq!((&payload[..], payload.padded()), (&[1, 2, 3, 4, 5][..], &[1, 2, 3, 4, 5, 0, 0, 0][..]));
        let at = payload.padded().as_ptr();
        let reader = Arc::clone(&payload);
        drop(payload);
        assert_ne!(pool.fill(|out| out.push(0)).padded().as_ptr(), at, "someone still reads it");
        drop(reader);
        let again: Vec<_> = (0..2).map(|_| pool.fill(|out| out.extend_from_slice(&[7; 8]))).collect();
        assert!(again.iter().any(|payload| payload.padded().as_ptr() == at));
    }
}
