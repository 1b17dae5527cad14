//! Links: producers that have a ring, with their frames and slots. Both threads use them, behind one lock.

use super::claims::{Claim, Claims};
use super::notices::Notices;
use super::{ConnectionCounts, LinkCounts, Outcome, Ready, ServerOptions};
use crate::error::InteropError;
use crate::frame_scene::FrameScene;
use crate::ring::Ring;
use crate::session::{Action, Agreement, Session, Terms, is_written, may_release};
use crate::socket::{Received, Socket};
use crate::wire::{self, ErrorCode, FrameNotice, Message, Refusal, Released};
use esaac_engine::Device;
use rustix::fd::OwnedFd;
use std::collections::{BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Most messages that are read from one connection before the next connection's turn.
const MAX_TURN: usize = 32;

/// Most such turns of a producer whose camera another one wants, or whose server ends. A socket's queue holds fewer
/// messages, so a goodbye that lies in it is read.
const MAX_HOLDER_TURNS: usize = 16;

/// A frame that was announced by FRAME and is not stepped yet.
pub(super) struct Pending {
    pub(super) notice: FrameNotice,
    pub(super) scene: Option<FrameScene>,
    pub(super) since: Instant,
    pub(super) first: bool,
}

/// A producer that has its ring.
pub(super) struct Link {
    pub(super) id: u64,
    pub(super) claim: Claim,
    pub(super) socket: Arc<Socket>,
    /// When it had its ring.
    pub(super) since: Instant,
    pub(super) session: Session,
    pub(super) ring: Arc<Ring>,
    pub(super) pending: VecDeque<Pending>,
    pub(super) ending: bool,
    /// Whether a FRAME has come.
    pub(super) seen: bool,
}

/// What the lock guards.
pub(super) struct State {
    pub(super) links: Vec<Link>,
    /// What each camera's last producer agreed to.
    pub(super) agreed: Vec<Option<Agreement>>,
    /// What any producer agreed to, each once.
    pub(super) all_agreed: Vec<Agreement>,
    pub(super) counts: Vec<LinkCounts>,
    pub(super) connections: ConnectionCounts,
    /// Processes that had a ring, those of containers that this one does not see into as one.
    pub(super) processes: BTreeSet<i32>,
    pub(super) notices: Notices,
    /// Whether the stepping thread reads the producers' messages.
    pub(super) listens: bool,
    /// Whether the stepping thread must look again.
    pub(super) changed: bool,
    pub(super) stopped: bool,
    /// Why the hub has ended, if it failed.
    pub(super) failed: Option<InteropError>,
}

/// What the hub and the stepping thread share.
pub(super) struct Shared {
    pub(super) device: Arc<Device>,
    pub(super) terms: Vec<Terms>,
    pub(super) latest: Vec<bool>,
    pub(super) claims: Arc<Claims>,
    pub(super) options: ServerOptions,
    pub(super) state: Mutex<State>,
    /// Wakes the hub.
    pub(super) wake: OwnedFd,
    /// Wakes the stepping thread.
    pub(super) news: OwnedFd,
}

impl Link {
    /// Which camera it feeds.
    pub(super) fn camera(&self) -> usize {
        self.claim.camera()
    }

    /// The oldest frame, if it is written.
    pub(super) fn front(&self) -> Option<&Pending> {
        self.pending.front().filter(|pending| self.is_there(pending))
    }

    pub(super) fn is_there(&self, pending: &Pending) -> bool {
        matches!(self.written(pending), Ok(true))
    }

    /// Whether a frame is written; an error if its timeline says what it cannot say by the rules.
    fn written(&self, pending: &Pending) -> Result<bool, InteropError> {
        let notice = &pending.notice;
        is_written(notice.slot, notice.value, self.reached(notice.slot)?)
    }

    /// Value that a slot's timeline has reached. If the timeline is shared, the peer can set it at any time.
    fn reached(&self, slot: u32) -> Result<u64, InteropError> {
        Ok(self.ring.slot(slot).timeline().timeline().value()?)
    }

    /// Why this link cannot go on, if it cannot.
    fn fault(&self, options: &ServerOptions) -> Option<InteropError> {
        for pending in &self.pending {
            match self.written(pending) {
                Err(error) => return Some(error),
                Ok(false) if pending.since.elapsed() > options.frame_timeout => {
                    let limit = options.frame_timeout;
                    return Some(InteropError::Timeout { what: "a frame that was told of", limit });
                }
                Ok(_) => {}
            }
        }
        let limit = options.first_frame_timeout;
        (self.is_new() && self.since.elapsed() > limit)
            .then_some(InteropError::Timeout { what: "the producer's first FRAME", limit })
    }

    /// Whether its first frame is still to come.
    pub(super) fn is_new(&self) -> bool {
        !self.seen && !self.ending
    }

    /// Gives a slot back whose frame nobody reads any more. The host signals the timeline, and only after a
    /// look at it: were the signal part of a submission, a peer that signals ahead would make the submission
    /// invalid, and with it the work of all cameras.
    pub(super) fn give_back(&mut self, slot: u32, outcome: Outcome) -> Result<(), InteropError> {
        let value = self.session.release(slot);
        may_release(slot, value, self.reached(slot)?)?;
        self.ring.slot(slot).timeline().timeline().signal(value)?;
        let outcome = if outcome == Outcome::Dropped { wire::DROPPED } else { wire::STEPPED };
        self.socket.send(&Message::Released(Released { slot, outcome, value, ..Released::default() }), &[])
    }
}

/// Wakes whoever waits for this.
pub(super) fn ring(bell: &OwnedFd) {
    // It fails only if the counter is full, and then the other side wakes anyway.
    let _ = rustix::io::write(bell, &1_u64.to_ne_bytes());
}

/// Resets a bell that has rung.
pub(super) fn hush(bell: &OwnedFd) {
    let _ = rustix::io::read(bell, &mut [0_u8; 8]);
}

impl State {
    /// Adds a line to the log.
    pub(super) fn say(&mut self, text: String) {
        self.notices.say(text, Instant::now());
    }

    /// Connections that may still send messages.
    pub(super) fn live_sockets(&self) -> Vec<(u64, Arc<Socket>)> {
        let live = self.links.iter().filter(|link| !link.ending);
        live.map(|link| (link.id, Arc::clone(&link.socket))).collect()
    }
}

impl Shared {
    pub(super) fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads the messages of a link and says whether there were any. The caller holds the lock, so messages keep
    /// their order whichever thread reads them. It never waits.
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

    /// Reads what a camera's producer has sent so far.
    pub(super) fn hear_holder(&self, camera: usize) {
        let mut state = self.lock();
        if let Some(id) = state.links.iter().find(|link| link.camera() == camera).map(|link| link.id) {
            self.hear_out(&mut state, id);
        }
    }

    /// Reads what a producer has sent so far.
    pub(super) fn hear_out(&self, state: &mut State, id: u64) {
        for _ in 0..MAX_HOLDER_TURNS {
            if !self.hear(state, id) {
                break;
            }
        }
    }

    /// Drops frames that newer ones replace, and links that cannot go on.
    pub(super) fn sweep(&self, state: &mut State) {
        let mut index = 0;
        while index < state.links.len() {
            let link = &mut state.links[index];
            let camera = link.camera();
            let mut told = Ok(());
            if self.latest[camera]
                && let Some(newest) = link.pending.iter().rposition(|pending| link.is_there(pending))
            {
                for _ in 0..newest {
                    // All before the newest written frame. One that the producer's device still writes stays
                    // at the front until it is written.
                    if told.is_ok() && link.front().is_some() {
                        let old = link.pending.pop_front().expect("it has a front");
                        told = link.give_back(old.notice.slot, Outcome::Dropped);
                        // The next frame is the first of its producer instead.
                        if let Some(next) = link.pending.front_mut() {
                            next.first |= old.first;
                            // Its interval begins earlier.
                            if let (Some(dropped), Some(scene)) = (&old.scene, &mut next.scene) {
                                *scene = scene.after(dropped);
                            }
                        }
                        state.counts[camera].dropped += 1;
                    }
                }
            }
            if let Some(fault) = state.links[index].fault(&self.options) {
                self.lose(state, index, &fault);
            } else if !self.settle(state, index, told) {
                index += 1;
            }
        }
    }

    /// Takes the oldest frame of each link, if it is written.
    pub(super) fn take(&self, state: &mut State) -> Vec<Ready> {
        let mut ready = Vec::new();
        for link in &mut state.links {
            if link.front().is_some()
                && let Some(pending) = link.pending.pop_front()
            {
                ready.push(Ready {
                    camera: link.camera(),
                    t_ns: pending.notice.t_ns,
                    first: pending.first,
                    link: link.id,
                    ring: Arc::clone(&link.ring),
                    notice: pending.notice,
                    scene: pending.scene,
                });
            }
        }
        ready
    }

    /// Ends a link that is done or cannot be written to, and says whether it did.
    pub(super) fn settle(&self, state: &mut State, index: usize, told: Result<(), InteropError>) -> bool {
        let link = &state.links[index];
        match told {
            // After BYE a producer may close without reading on.
            Err(error) if !(link.ending && matches!(error, InteropError::PeerGone)) => {
                self.lose(state, index, &error);
                return true;
            }
            _ => {}
        }
        if link.ending && link.session.held() == 0 {
            let link = state.links.remove(index);
            state.counts[link.camera()].finished += 1;
            state.changed = true;
            return true;
        }
        false
    }

    /// Ends a link because of an error.
    pub(super) fn lose(&self, state: &mut State, index: usize, error: &InteropError) {
        let link = state.links.remove(index);
        turn_away(&link.socket, error);
        let counts = &mut state.counts[link.camera()];
        counts.lost += 1;
        counts.abandoned += link.pending.len() as u64;
        // The engine's own words name the camera already.
        let (name, text) = (format!("camera {}: ", link.camera()), error.to_string());
        state.say(if text.starts_with(&name) { text } else { name + &text });
        state.changed = true;
    }
}

/// Does what a producer's message asks.
pub(super) fn heard(state: &mut State, index: usize, received: &Received) -> Result<(), InteropError> {
    let link = &mut state.links[index];
    match link.session.receive(&received.message()?, received.fds.len())? {
        Action::Queue(notice, scene) => {
            link.ring.slot(notice.slot).timeline().heard(notice.value)?;
            let first = !std::mem::replace(&mut link.seen, true);
            link.pending.push_back(Pending { notice, scene, since: Instant::now(), first });
            state.counts[link.camera()].frames += 1;
            Ok(())
        }
        Action::Nothing => Ok(()),
        Action::End => {
            link.ending = true;
            Ok(())
        }
        // A link has its memory already.
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
