//! Encoded messages. A message is encoded into a buffer once; the transport and the recording share that
//! buffer. When both have dropped it, the next message reuses its memory.

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use std::convert::Infallible;
use std::ops::Deref;
use std::sync::Arc;
use std::time::Duration;

/// CDR bytes of one message.
pub struct Payload {
    /// The message, and zeros up to a multiple of four: DDS sends whole words.
    padded: Vec<u8>,
    bytes: usize,
    home: Option<Sender<Vec<u8>>>,
    _hold: Option<Hold>,
}

impl Payload {
    /// A payload whose memory is not reused.
    #[must_use]
    pub fn new(bytes: Vec<u8>) -> Self {
        Payload::with(bytes, None, None)
    }

    fn with(mut padded: Vec<u8>, home: Option<Sender<Vec<u8>>>, hold: Option<Hold>) -> Self {
        let bytes = padded.len();
        padded.resize(bytes.next_multiple_of(4), 0);
        Payload { padded, bytes, home, _hold: hold }
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
            // A full pool has enough buffers.
            let _ = home.try_send(std::mem::take(&mut self.padded));
        }
    }
}

/// Every message of a tick has a clone of the tick's hold. The tick is held while one of them is.
#[derive(Clone)]
pub struct Hold(#[expect(dead_code, reason = "dropping it is the signal")] Sender<Infallible>);

/// Signals that nobody holds a message of a tick any more.
pub struct Release(Receiver<Infallible>);

/// A hold and the release that it delays.
#[must_use]
pub fn hold() -> (Hold, Release) {
    let (hold, release) = bounded(0);
    (Hold(hold), Release(release))
}

impl Release {
    /// Waits until nobody holds a message. Returns false if that takes longer than `limit`.
    #[must_use]
    pub fn wait(&self, limit: Duration) -> bool {
        matches!(self.0.recv_timeout(limit), Err(RecvTimeoutError::Disconnected))
    }
}

/// Buffers of one topic's messages, for reuse. Every topic has its own pool: in a common pool all buffers
/// would grow to the size of the largest message.
pub struct Pool {
    home: Sender<Vec<u8>>,
    free: Receiver<Vec<u8>>,
}

impl Pool {
    /// Keeps at most `buffers` free buffers.
    #[must_use]
    pub fn new(buffers: usize) -> Self {
        let (home, free) = bounded(buffers);
        Pool { home, free }
    }

    /// A payload that `encode` writes, into the memory of an earlier one if there is a free buffer.
    pub fn fill(&self, hold: Option<Hold>, encode: impl FnOnce(&mut Vec<u8>)) -> Arc<Payload> {
        let mut bytes = self.free.try_recv().unwrap_or_default();
        bytes.clear();
        encode(&mut bytes);
        Arc::new(Payload::with(bytes, Some(self.home.clone()), hold))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn storage_comes_back_when_the_last_reader_lets_go() {
        let pool = Pool::new(2);
        let payload = pool.fill(None, |out| out.extend_from_slice(&[1, 2, 3, 4, 5]));
        assert_eq!((&payload[..], payload.padded()), (&[1, 2, 3, 4, 5][..], &[1, 2, 3, 4, 5, 0, 0, 0][..]));
        let at = payload.padded().as_ptr();
        let reader = Arc::clone(&payload);
        drop(payload);
        assert_ne!(pool.fill(None, |out| out.push(0)).padded().as_ptr(), at, "someone still reads it");
        drop(reader);
        let again: Vec<_> = (0..2).map(|_| pool.fill(None, |out| out.extend_from_slice(&[7; 8]))).collect();
        assert!(again.iter().any(|payload| payload.padded().as_ptr() == at));
    }

    #[test]
    fn a_tick_is_released_with_the_last_reader_of_its_last_message() {
        let pool = Pool::new(2);
        let (hold, release) = hold();
        let messages: Vec<_> = (0..2).map(|n| pool.fill(Some(hold.clone()), |out| out.push(n))).collect();
        let reader = Arc::clone(&messages[1]);
        drop((hold, messages));
        assert!(!release.wait(Duration::from_millis(1)));
        let other = std::thread::spawn(move || drop(reader));
        assert!(release.wait(Duration::from_secs(20)));
        other.join().unwrap();
    }
}
