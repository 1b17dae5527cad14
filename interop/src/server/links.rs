//! Producers that have their rings: their frames and slots, behind the lock that both threads take.

use super::{LinkCounts, Outcome, Ready, ServerOptions};
use crate::error::InteropError;
use crate::ring::Ring;
use crate::session::{Action, Agreement, Session, Terms};
use crate::socket::{Received, Socket};
use crate::wire::{self, ErrorCode, FrameNotice, Message, Refusal, Released};
use esaac_engine::Device;
use rustix::fd::OwnedFd;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Notices kept until someone asks for them.
const MAX_NOTICES: usize = 256;

/// Messages taken from one connection before it is another's turn.
const MAX_TURN: usize = 32;

/// A frame that was told of.
pub(super) struct Pending {
    pub(super) notice: FrameNotice,
    pub(super) since: Instant,
    pub(super) first: bool,
}

/// A producer that has its ring.
pub(super) struct Link {
    pub(super) id: u64,
    pub(super) camera: usize,
    pub(super) socket: Arc<Socket>,
    pub(super) session: Session,
    pub(super) ring: Arc<Ring>,
    pub(super) pending: VecDeque<Pending>,
    pub(super) ending: bool,
    pub(super) seen: bool,
}

/// What the lock guards.
pub(super) struct State {
    pub(super) links: Vec<Link>,
    /// What each camera's last producer agreed to.
    pub(super) agreed: Vec<Option<Agreement>>,
    pub(super) counts: Vec<LinkCounts>,
    pub(super) notices: VecDeque<String>,
    /// Whether the thread that steps listens to the producers.
    pub(super) listens: bool,
    /// Whether something has happened since it was told last.
    pub(super) changed: bool,
    pub(super) stopped: bool,
    /// The other thread's own end, if it failed.
    pub(super) failed: Option<InteropError>,
}

/// What both threads have.
pub(super) struct Shared {
    pub(super) device: Arc<Device>,
    pub(super) terms: Vec<Terms>,
    pub(super) latest: Vec<bool>,
    pub(super) options: ServerOptions,
    pub(super) state: Mutex<State>,
    /// Wakes the thread that answers.
    pub(super) wake: OwnedFd,
    /// Wakes the one that steps.
    pub(super) news: OwnedFd,
}

impl Link {
    /// The frame that would be taken now: the first, if it is there.
    pub(super) fn front(&self) -> Option<&Pending> {
        self.pending.front().filter(|pending| self.is_there(pending))
    }

    pub(super) fn is_there(&self, pending: &Pending) -> bool {
        let timeline = self.ring.slot(pending.notice.slot).timeline().timeline();
        timeline.value().is_ok_and(|value| value >= pending.notice.value)
    }

    pub(super) fn give_back(&mut self, slot: u32, outcome: Outcome) -> Result<(), InteropError> {
        let value = self.session.release(slot);
        let timeline = self.ring.slot(slot).timeline().timeline();
        if outcome == Outcome::Dropped {
            timeline.signal(value)?;
        }
        let outcome = if outcome == Outcome::Dropped { wire::DROPPED } else { wire::STEPPED };
        self.socket.send(&Message::Released(Released { slot, outcome, value, ..Released::default() }), &[])
    }
}

/// Wakes whoever waits for this.
pub(super) fn ring(bell: &OwnedFd) {
    // A full counter wakes as well.
    let _ = rustix::io::write(bell, &1_u64.to_ne_bytes());
}

/// It was heard.
pub(super) fn hush(bell: &OwnedFd) {
    let _ = rustix::io::read(bell, &mut [0_u8; 8]);
}

impl State {
    /// Connections that may still say something.
    pub(super) fn live_sockets(&self) -> Vec<(u64, Arc<Socket>)> {
        let live = self.links.iter().filter(|link| !link.ending);
        live.map(|link| (link.id, Arc::clone(&link.socket))).collect()
    }
}

impl Shared {
    pub(super) fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn say(state: &mut State, text: String) {
        if state.notices.len() == MAX_NOTICES {
            state.notices.pop_front();
        }
        state.notices.push_back(text);
    }

    /// Takes messages of a producer that has its ring; whether there were any. Under the lock, so that they
    /// are taken in their order whichever thread does it; it never waits.
    pub(super) fn hear(&self, state: &mut State, id: u64) -> bool {
        for turn in 0..MAX_TURN {
            let Some(index) = state.links.iter().position(|link| link.id == id && !link.ending) else {
                return turn > 0;
            };
            let outcome = match state.links[index].socket.receive() {
                Ok(None) => return turn > 0,
                Ok(Some(received)) => heard(state, index, &received),
                Err(error) => Err(error),
            };
            match outcome {
                Ok(()) => {
                    self.sweep(state);
                    state.changed = true;
                }
                Err(error) => {
                    self.lose(state, index, &error);
                    return true;
                }
            }
        }
        true
    }

    /// Drops frames that newer ones replace, and producers whose frames do not come.
    pub(super) fn sweep(&self, state: &mut State) {
        let mut index = 0;
        while index < state.links.len() {
            let link = &mut state.links[index];
            let camera = link.camera;
            let mut told = Ok(());
            if self.latest[camera]
                && let Some(newest) = link.pending.iter().rposition(|pending| link.is_there(pending))
            {
                for _ in 0..newest {
                    // Those before the newest that is there; the device has begun them earlier, and one
                    // that is still under way stays at the front until it is done.
                    if told.is_ok() && link.front().is_some() {
                        let old = link.pending.pop_front().expect("it has a front");
                        told = link.give_back(old.notice.slot, Outcome::Dropped);
                        // The next frame taken is the first of its producer instead.
                        if let Some(next) = link.pending.front_mut() {
                            next.first |= old.first;
                        }
                        state.counts[camera].dropped += 1;
                    }
                }
            }
            let link = &state.links[index];
            let late = link
                .pending
                .iter()
                .any(|p| p.since.elapsed() > self.options.frame_timeout && !link.is_there(p));
            if late {
                let limit = self.options.frame_timeout;
                self.lose(state, index, &InteropError::Timeout { what: "a frame that was told of", limit });
            } else if !self.settle(state, index, told) {
                index += 1;
            }
        }
    }

    /// Takes each link's first frame that is there.
    pub(super) fn take(&self, state: &mut State) -> Vec<Ready> {
        let mut ready = Vec::new();
        for link in &mut state.links {
            if link.front().is_some()
                && let Some(pending) = link.pending.pop_front()
            {
                ready.push(Ready {
                    camera: link.camera,
                    t_ns: pending.notice.t_ns,
                    first: pending.first,
                    link: link.id,
                    ring: Arc::clone(&link.ring),
                    notice: pending.notice,
                });
            }
        }
        ready
    }

    /// Ends a link that is done or cannot be told; whether it has.
    pub(super) fn settle(&self, state: &mut State, index: usize, told: Result<(), InteropError>) -> bool {
        let link = &state.links[index];
        match told {
            // A producer that has said goodbye need not listen.
            Err(error) if !(link.ending && matches!(error, InteropError::PeerGone)) => {
                self.lose(state, index, &error);
                return true;
            }
            _ => {}
        }
        if link.ending && link.session.held() == 0 {
            let link = state.links.remove(index);
            state.counts[link.camera].finished += 1;
            state.changed = true;
            return true;
        }
        false
    }

    /// Ends a link by fault.
    pub(super) fn lose(&self, state: &mut State, index: usize, error: &InteropError) {
        let link = state.links.remove(index);
        turn_away(&link.socket, error);
        let counts = &mut state.counts[link.camera];
        counts.lost += 1;
        counts.abandoned += link.pending.len() as u64;
        Self::say(state, format!("camera {}: {error}", link.camera));
        state.changed = true;
    }
}

/// Does what a producer's message asks.
pub(super) fn heard(state: &mut State, index: usize, received: &Received) -> Result<(), InteropError> {
    let link = &mut state.links[index];
    match link.session.receive(&received.message()?, received.fds.len())? {
        Action::Queue(notice) => {
            link.ring.slot(notice.slot).timeline().heard(notice.value)?;
            let first = !std::mem::replace(&mut link.seen, true);
            link.pending.push_back(Pending { notice, since: Instant::now(), first });
            state.counts[link.camera].frames += 1;
            Ok(())
        }
        Action::End => {
            link.ending = true;
            Ok(())
        }
        // The session of a link has its memory.
        Action::Import(_) => {
            Err(InteropError::Refused { code: ErrorCode::Protocol, text: "BROUGHT came twice".to_owned() })
        }
    }
}

/// Tells a peer why, if it still listens.
pub(super) fn turn_away(socket: &Socket, error: &InteropError) {
    if !matches!(error, InteropError::PeerGone) {
        let _ = socket.send(&Message::Refusal(Refusal::new(error.code(), &error.words())), &[]);
    }
}
