//! The thread that steps waits for frames: it looks for a while, then it sleeps on the producers' sockets.

use super::links::hush;
use super::{Ready, Server};
use crate::error::InteropError;
use crate::socket::wait_readable;
use rustix::fd::AsFd;
use rustix::thread::set_current_timer_slack;
use std::num::NonZeroU64;
use std::time::{Duration, Instant};

/// Between two looks at a device's work once it sleeps.
const NAP: Duration = Duration::from_micros(30);

const TIMER_SLACK_NS: NonZeroU64 = NonZeroU64::new(1_000).unwrap();

impl Server {
    /// Frames that are there, one a camera at most; none if none comes within `limit`.
    pub fn wait(&self, limit: Duration) -> Result<Vec<Ready>, InteropError> {
        self.shared.lock().listens = true;
        let ready = self.listen(limit);
        self.shared.lock().listens = false;
        ready
    }

    fn listen(&self, limit: Duration) -> Result<Vec<Ready>, InteropError> {
        let (shared, options) = (&self.shared, &self.shared.options);
        let started = Instant::now();
        let mut last_heard = started;
        let mut first_seen: Option<Instant> = None;
        loop {
            let mut state = shared.lock();
            if let Some(error) = state.failed.take() {
                return Err(error);
            }
            let ids: Vec<u64> = state.links.iter().map(|link| link.id).collect();
            let mut heard = false;
            for id in ids {
                heard |= shared.hear(&mut state, id);
            }
            shared.sweep(&mut state);
            let now = Instant::now();
            if heard {
                last_heard = now;
            }
            // Asked once: a frame that comes between two questions would be slept over.
            let there: Vec<bool> = state.links.iter().map(|link| link.front().is_some()).collect();
            let left = if there.contains(&true) {
                let since = *first_seen.get_or_insert(now);
                let all = state.links.iter().zip(&there).all(|(link, there)| *there || link.ending);
                let left = (since + options.gather).saturating_duration_since(now);
                if all || left.is_zero() {
                    return Ok(shared.take(&mut state));
                }
                left
            } else {
                first_seen = None;
                let left = (started + limit).saturating_duration_since(now);
                if left.is_zero() {
                    return Ok(Vec::new());
                }
                left
            };
            if now - last_heard < options.spin {
                drop(state);
                std::hint::spin_loop();
                continue;
            }
            // A semaphore that the producer's device signals wakes nobody.
            let under_way =
                state.links.iter().zip(&there).any(|(link, there)| !link.pending.is_empty() && !there);
            let sockets = state.live_sockets();
            drop(state);
            let fds: Vec<_> = [shared.news.as_fd()]
                .into_iter()
                .chain(sockets.iter().map(|(_, socket)| socket.as_fd()))
                .collect();
            if under_way {
                // The kernel may be 50 us late else. A kernel that does not know this is.
                let _ = set_current_timer_slack(Some(TIMER_SLACK_NS));
            }
            let readable = wait_readable(&fds, if under_way { left.min(NAP) } else { left })?;
            if readable[0] {
                hush(&shared.news);
            }
        }
    }
}
