//! The stepping thread waits for frames: first it polls, then it sleeps until a socket can be read.

use super::links::hush;
use super::{Ready, Server};
use crate::error::InteropError;
use crate::socket::wait_readable;
use rustix::fd::AsFd;
use rustix::thread::set_current_timer_slack;
use std::num::NonZeroU64;
use std::time::{Duration, Instant};

/// Pause between two looks at a timeline that a device will signal.
const NAP: Duration = Duration::from_micros(30);

/// The last look at a link without a frame comes this long after its time is over.
const TICK: Duration = Duration::from_millis(1);

const TIMER_SLACK_NS: NonZeroU64 = NonZeroU64::new(1_000).unwrap();

impl Server {
    /// Waits for written frames, at most one per camera. The list is empty if none comes within `limit`.
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
            // Ask once. Were a frame written between two questions, this thread would sleep and miss it.
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
            // Nobody else times the first frames of links while this thread listens.
            let new = state.links.iter().filter(|link| link.is_new());
            let first_end = new.map(|link| link.since + options.first_frame_timeout + TICK).min();
            let left = first_end.map_or(left, |end| left.min(end.saturating_duration_since(now)));
            if now - last_heard < options.spin {
                drop(state);
                std::hint::spin_loop();
                continue;
            }
            // A semaphore that the producer's device signals does not wake this thread.
            let under_way =
                state.links.iter().zip(&there).any(|(link, there)| !link.pending.is_empty() && !there);
            let sockets = state.live_sockets();
            drop(state);
            let fds: Vec<_> = [shared.news.as_fd()]
                .into_iter()
                .chain(sockets.iter().map(|(_, socket)| socket.as_fd()))
                .collect();
            if under_way {
                // By default Linux may wake a thread 50 us late. A kernel without this setting just does that.
                let _ = set_current_timer_slack(Some(TIMER_SLACK_NS));
            }
            let readable = wait_readable(&fds, if under_way { left.min(NAP) } else { left })?;
            if readable[0] {
                hush(&shared.news);
            }
        }
    }
}
