//! The hub: the thread that accepts connections, answers HELLO and BROUGHT, makes rings, and reads messages
//! while the rig steps.

use super::claims::Claim;
use super::links::{Link, Shared, State, hush, ring, turn_away};
use super::pause::Pause;
use crate::error::InteropError;
use crate::image::ImageKind;
use crate::images::{Images, geometry_to_wire};
use crate::ring::{Ring, Source, export_timelines, make_timelines};
use crate::session::{Action, Agreement, Session, Terms, agree, hello};
use crate::socket::{Accepted, Credentials, Listener, Received, Socket, wait_readable};
use crate::support::BUFFER_USAGE;
use crate::timeline::SharedTimeline;
use crate::wire::{self, Brought, ErrorCode, Header, ImageMemory, Message, RingOffer};
use esaac_engine::zone;
use rustix::fd::{AsFd, OwnedFd};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often the hub looks whether the stepping thread still reads the producers' messages.
const TAKE_OVER: Duration = Duration::from_millis(2);

/// A connection that has no ring yet.
struct Guest {
    /// Number of the connection, counted from 0.
    connection: u64,
    socket: Arc<Socket>,
    peer: Credentials,
    since: Instant,
    /// Set from an accepted HELLO on until the producer's memory has come.
    bringing: Option<Bringing>,
}

/// What a producer that brings its memory has been promised.
struct Bringing {
    claim: Claim,
    agreement: Agreement,
    session: Session,
    timelines: Vec<Box<dyn SharedTimeline>>,
}

/// The thread.
pub(super) struct Hub {
    shared: Arc<Shared>,
    listener: Listener,
    guests: Vec<Guest>,
    next_connection: u64,
    pause: Pause,
}

impl Hub {
    pub(super) fn new(shared: &Arc<Shared>, listener: Listener) -> Self {
        Hub {
            shared: Arc::clone(shared),
            listener,
            guests: Vec::new(),
            next_connection: 0,
            pause: Pause::default(),
        }
    }

    /// Answers until the server is dropped.
    pub(super) fn run(mut self) {
        loop {
            match self.turn() {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    self.shared.lock().failed = Some(error);
                    ring(&self.shared.news);
                    break;
                }
            }
        }
        self.shared.lock().links.clear();
    }

    /// Waits for something to do and does it. Returns whether to go on.
    fn turn(&mut self) -> Result<bool, InteropError> {
        let (links, limit) = {
            let mut state = self.shared.lock();
            if state.stopped {
                return Ok(false);
            }
            let limit = match (state.links.is_empty(), self.guests.is_empty()) {
                (true, true) => Duration::from_secs(1),
                (true, false) => Duration::from_millis(50),
                // The hub must take over soon after the rig begins to step.
                (false, _) => TAKE_OVER,
            };
            if state.listens {
                (Vec::new(), limit)
            } else {
                self.shared.sweep(&mut state);
                (state.live_sockets(), limit)
            }
        };
        let paused = self.pause.left(Instant::now());
        let limit = paused.map_or(limit, |left| limit.min(left));
        let fds: Vec<_> = [self.shared.wake.as_fd()]
            .into_iter()
            .chain(self.guests.iter().map(|guest| guest.socket.as_fd()))
            .chain(links.iter().map(|(_, socket)| socket.as_fd()))
            .chain(paused.is_none().then(|| self.listener.as_fd()))
            .collect();
        let readable = wait_readable(&fds, limit)?;
        let _zone = zone!("answer producers");
        if readable[0] {
            hush(&self.shared.wake);
        }
        let (guests, others) = readable[1..].split_at(self.guests.len());
        let (linked, listener) = others.split_at(links.len());
        for ((id, _), _) in links.iter().zip(linked).filter(|(_, readable)| **readable) {
            self.shared.hear(&mut self.shared.lock(), *id);
        }
        self.hear_guests(guests);
        if listener.contains(&true) {
            self.welcome()?;
        }
        if std::mem::take(&mut self.shared.lock().changed) {
            ring(&self.shared.news);
        }
        Ok(true)
    }

    /// Accepts the connections that wait.
    fn welcome(&mut self) -> Result<(), InteropError> {
        loop {
            let (socket, peer) = match self.listener.accept()? {
                Accepted::Nobody => return Ok(()),
                Accepted::One(socket, peer) => (socket, peer),
                Accepted::NoRoom(errno) => {
                    let pause = self.pause.begin(Instant::now());
                    let mut state = self.shared.lock();
                    state.connections.not_accepted += 1;
                    let text = format!("connections wait {pause:?}: accept4: {errno}");
                    state.say(text);
                    return Ok(());
                }
            };
            self.pause.forget();
            let connection = self.next_connection;
            self.next_connection += 1;
            self.shared.lock().connections.accepted += 1;
            match admit(peer, self.guests.len(), self.shared.terms.len()) {
                Err(error) => self.refuse(&socket, &error),
                Ok(()) => self.guests.push(Guest {
                    connection,
                    socket: Arc::new(socket),
                    peer,
                    since: Instant::now(),
                    bringing: None,
                }),
            }
        }
    }

    /// Closes a connection that has no ring, and says why to both sides.
    fn refuse(&self, socket: &Socket, error: &InteropError) {
        turn_away(socket, error);
        let mut state = self.shared.lock();
        state.connections.refused += 1;
        state.say(format!("connection: {error}"));
    }

    /// Messages of connections that have no ring yet.
    fn hear_guests(&mut self, readable: &[bool]) {
        let guests = std::mem::take(&mut self.guests);
        let readable = readable.iter().copied().chain(std::iter::repeat(false));
        for (mut guest, readable) in guests.into_iter().zip(readable) {
            let limit = self.shared.options.handshake_timeout;
            let outcome = if readable {
                match guest.socket.receive() {
                    // It came to see whether somebody serves here, as another service does, and asked for nothing.
                    Err(InteropError::PeerGone) if guest.bringing.is_none() => Ok(false),
                    received => received.and_then(|received| match received {
                        Some(received) => self.answer(&mut guest, received),
                        None => Ok(true),
                    }),
                }
            } else if guest.since.elapsed() > limit {
                let greeted = guest.bringing.is_some();
                let what = if greeted { "the producer's memory, BROUGHT," } else { "the producer's HELLO" };
                Err(InteropError::Timeout { what, limit })
            } else {
                Ok(true)
            };
            match outcome {
                Ok(true) => self.guests.push(guest),
                Ok(false) => {}
                Err(error) => self.refuse(&guest.socket, &error),
            }
        }
    }

    /// Answers a guest's message. Returns whether it is still a guest.
    fn answer(&mut self, guest: &mut Guest, received: Received) -> Result<bool, InteropError> {
        let message = received.message()?;
        if let Some(mut bringing) = guest.bringing.take() {
            return match bringing.session.receive(&message, received.fds.len())? {
                Action::Import(brought) => {
                    self.import(guest, bringing, &brought, received.fds)?;
                    Ok(false)
                }
                Action::End => Ok(false),
                Action::Queue(..) | Action::Nothing => {
                    unreachable!("a session that awaits memory takes no frame and no poses")
                }
            };
        }
        let hello = *hello(&message)?;
        let version = received.version()?;
        guest.socket.speak(version);
        let claim = self.claim(hello.camera as usize, guest)?;
        let terms = self.shared.terms[claim.camera()].clone();
        let agreement = agree(version, &hello, &terms)?;
        let session = Session::new(&terms, agreement);
        let exported = agreement.timeline == wire::TIMELINE_EXPORTED;
        let timelines = make_timelines(&self.shared.device, terms.slots, exported)?;
        let timeline_fds = export_timelines(&timelines)?;
        if agreement.brings() {
            let images = agreement.memory == wire::MEMORY_IMAGES;
            let wanted = wanted(&terms.images_by(agreement), images);
            self.offer(guest, &terms, agreement, wanted, timeline_fds)?;
            guest.bringing = Some(Bringing { claim, agreement, session, timelines });
            return Ok(true);
        }
        let source = Source::Own(agreement.memory);
        let images = terms.images_by(agreement);
        let mut ring = Ring::new(&self.shared.device, terms.camera, &images, source, timelines)?;
        let mut fds = ring.export_memory(&self.shared.device)?;
        fds.extend(timeline_fds);
        let mut state = self.shared.lock();
        self.offer(guest, &terms, agreement, ring.described(), fds)?;
        link(&mut state, guest, claim, agreement, session, ring);
        Ok(false)
    }

    /// Gives a camera to a guest. A HELLO may overtake the goodbye of the camera's last producer, which was sent first, on
    /// another socket. So nobody is refused before the holder has been heard.
    fn claim(&self, camera: usize, guest: &Guest) -> Result<Claim, InteropError> {
        let take = || self.shared.claims.take(camera, guest.connection, guest.peer);
        match take() {
            Err(error) if error.code() == ErrorCode::Taken => {
                self.shared.hear_holder(camera);
                take()
            }
            outcome => outcome,
        }
    }

    /// Sends a guest the description of its ring, and closes this process's ends of `fds`.
    fn offer(
        &self,
        guest: &Guest,
        terms: &Terms,
        agreement: Agreement,
        [hdr, motion, depth, ids]: [ImageMemory; 4],
        fds: Vec<OwnedFd>,
    ) -> Result<(), InteropError> {
        let images = terms.images_by(agreement);
        let (depth_format, id_format, lens) = geometry_to_wire(images.geometry.as_ref());
        let offer = RingOffer {
            device_uuid: terms.device_uuid,
            driver_uuid: terms.driver_uuid,
            camera: terms.camera,
            cameras: self.shared.terms.len() as u32,
            width_px: images.width_px,
            height_px: images.height_px,
            hdr_format: images.hdr as u32,
            motion_format: images.motion.map_or(wire::NO_MOTION, |motion| motion as u32),
            memory: agreement.memory,
            timeline: agreement.timeline,
            slots: terms.slots,
            backpressure: terms.backpressure,
            buffer_usage: BUFFER_USAGE.as_raw(),
            hdr,
            motion,
            depth,
            ids,
            depth_format,
            id_format,
            max_instances: if agreement.geometry { terms.max_instances } else { 0 },
            lens,
            ..RingOffer::default()
        };
        let borrowed: Vec<_> = fds.iter().map(AsFd::as_fd).collect();
        guest.socket.send(&Message::Ring(offer), &borrowed)
    }

    /// Makes a ring of the memory that a guest brings.
    fn import(
        &mut self,
        guest: &Guest,
        bringing: Bringing,
        brought: &Brought,
        fds: Vec<OwnedFd>,
    ) -> Result<(), InteropError> {
        let Bringing { claim, agreement, session, timelines } = bringing;
        let terms = &self.shared.terms[claim.camera()];
        let Brought { hdr, motion, depth, ids, .. } = *brought;
        let source = Source::Peer { kind: agreement.memory, fds, told: [hdr, motion, depth, ids] };
        let images = terms.images_by(agreement);
        let ring = Ring::new(&self.shared.device, terms.camera, &images, source, timelines)?;
        let mut state = self.shared.lock();
        guest.socket.send(&Message::Accepted(Header::default()), &[])?;
        link(&mut state, guest, claim, agreement, session, ring);
        Ok(())
    }
}

/// Makes a guest that has its ring a link. The guest is told under the same lock: a producer that knows that it may
/// send frames is one whose frames a tick waits for.
fn link(state: &mut State, guest: &Guest, claim: Claim, agreement: Agreement, session: Session, ring: Ring) {
    state.agreed[claim.camera()] = Some(agreement);
    if !state.all_agreed.contains(&agreement) {
        state.all_agreed.push(agreement);
    }
    state.counts[claim.camera()].connections += 1;
    state.processes.insert(guest.peer.process);
    state.links.push(Link {
        id: guest.connection,
        claim,
        socket: Arc::clone(&guest.socket),
        since: Instant::now(),
        session,
        ring: Arc::new(ring),
        pending: VecDeque::new(),
        ending: false,
        seen: false,
    });
    state.changed = true;
}

/// Most connections that may be without a ring at a time. As many may wait to be accepted.
pub(super) fn most_guests(cameras: usize) -> usize {
    2 * cameras + 8
}

/// Whether a new connection may say something: it must be this user's, and there must not be too many
/// that have no ring yet.
fn admit(peer: Credentials, guests: usize, cameras: usize) -> Result<(), InteropError> {
    let (user, own) = (peer.user, rustix::process::geteuid().as_raw());
    let most = most_guests(cameras);
    let refused = |code, text| Err(InteropError::Refused { code, text });
    if user != own {
        refused(ErrorCode::User, format!("user {user}, expected {own}"))
    } else if guests >= most {
        refused(ErrorCode::Busy, format!("{most} connections are being answered already"))
    } else {
        Ok(())
    }
}

/// What a producer must know of the memory that it shall bring: its size, and the usage of images.
fn wanted(images: &Images, as_images: bool) -> [ImageMemory; 4] {
    let of = |kind: &ImageKind| ImageMemory {
        bytes: kind.bytes,
        image_usage: if as_images { kind.usage().as_raw() } else { 0 },
        ..ImageMemory::default()
    };
    images.kinds().map(of).all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_users_and_too_many_connections_are_not_admitted() {
        let own = rustix::process::geteuid().as_raw();
        let peer = |user| Credentials { user, process: 1 };
        assert!(admit(peer(own), 0, 1).is_ok() && admit(peer(own), 9, 1).is_ok());
        let error = admit(peer(own), 10, 1).unwrap_err();
        assert_eq!(error.code(), ErrorCode::Busy);
        assert!(error.to_string().contains("10 connections"), "{error}");
        let error = admit(peer(own.wrapping_add(1)), 0, 1).unwrap_err();
        assert_eq!(error.code(), ErrorCode::User);
        assert!(error.to_string().contains(&format!("expected {own}")), "{error}");
    }
}
