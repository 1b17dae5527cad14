//! The thread that answers producers: new connections, greetings, rings, and messages that come while the
//! rig steps.

use super::links::{Link, Shared, hush, ring, turn_away};
use crate::error::InteropError;
use crate::image::ImageKind;
use crate::ring::{Images, Ring, Source, export_timelines, make_timelines};
use crate::session::{Action, Agreement, Session, Terms, agree, hello};
use crate::socket::{Listener, Received, Socket, wait_readable};
use crate::support::BUFFER_USAGE;
use crate::timeline::SharedTimeline;
use crate::wire::{self, Brought, ErrorCode, Header, ImageMemory, Message, RingOffer};
use rustix::fd::{AsFd, OwnedFd};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Between two looks at whether the thread that steps still listens to the producers itself.
const TAKE_OVER: Duration = Duration::from_millis(2);

/// A connection that has no ring yet.
struct Guest {
    socket: Arc<Socket>,
    since: Instant,
    /// What it is to bring memory for.
    bringing: Option<Bringing>,
}

struct Bringing {
    camera: usize,
    agreement: Agreement,
    session: Session,
    timelines: Vec<Box<dyn SharedTimeline>>,
}

/// The thread.
pub(super) struct Hub {
    shared: Arc<Shared>,
    listener: Listener,
    guests: Vec<Guest>,
    next_id: u64,
}

impl Hub {
    pub(super) fn new(shared: &Arc<Shared>, listener: Listener) -> Self {
        Hub { shared: Arc::clone(shared), listener, guests: Vec::new(), next_id: 0 }
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

    /// Waits for something to do and does it; whether to go on.
    fn turn(&mut self) -> Result<bool, InteropError> {
        let (links, limit) = {
            let mut state = self.shared.lock();
            if state.stopped {
                return Ok(false);
            }
            let limit = match (state.links.is_empty(), self.guests.is_empty()) {
                (true, true) => Duration::from_secs(1),
                (true, false) => Duration::from_millis(50),
                // Soon enough to take over once the rig steps.
                (false, _) => TAKE_OVER,
            };
            if state.listens {
                (Vec::new(), limit)
            } else {
                self.shared.sweep(&mut state);
                (state.live_sockets(), limit)
            }
        };
        let fds: Vec<_> = [self.shared.wake.as_fd(), self.listener.as_fd()]
            .into_iter()
            .chain(self.guests.iter().map(|guest| guest.socket.as_fd()))
            .chain(links.iter().map(|(_, socket)| socket.as_fd()))
            .collect();
        let readable = wait_readable(&fds, limit)?;
        if readable[0] {
            hush(&self.shared.wake);
        }
        let (guests, linked) = readable[2..].split_at(self.guests.len());
        for ((id, _), _) in links.iter().zip(linked).filter(|(_, readable)| **readable) {
            self.shared.hear(&mut self.shared.lock(), *id);
        }
        let guests: Vec<bool> = guests.to_vec();
        self.hear_guests(&guests);
        if readable[1] {
            self.welcome()?;
        }
        if std::mem::take(&mut self.shared.lock().changed) {
            ring(&self.shared.news);
        }
        Ok(true)
    }

    /// Lets a new connection in.
    fn welcome(&mut self) -> Result<(), InteropError> {
        while let Some((socket, uid)) = self.listener.accept()? {
            let own = rustix::process::geteuid().as_raw();
            let most = 2 * self.shared.terms.len() + 8;
            let refusal = if uid != own {
                Some((ErrorCode::User, format!("user {uid}, expected {own}")))
            } else if self.guests.len() >= most {
                Some((ErrorCode::Busy, format!("{most} connections are being answered already")))
            } else {
                None
            };
            match refusal {
                Some((code, text)) => {
                    let error = InteropError::Refused { code, text };
                    turn_away(&socket, &error);
                    Shared::say(&mut self.shared.lock(), format!("connection: {error}"));
                }
                None => self.guests.push(Guest {
                    socket: Arc::new(socket),
                    since: Instant::now(),
                    bringing: None,
                }),
            }
        }
        Ok(())
    }

    /// Messages of connections that have no ring yet.
    fn hear_guests(&mut self, readable: &[bool]) {
        let guests = std::mem::take(&mut self.guests);
        let readable = readable.iter().copied().chain(std::iter::repeat(false));
        for (mut guest, readable) in guests.into_iter().zip(readable) {
            let limit = self.shared.options.handshake_timeout;
            let outcome = if readable {
                guest.socket.receive().and_then(|received| match received {
                    Some(received) => self.answer(&mut guest, received),
                    None => Ok(true),
                })
            } else if guest.since.elapsed() > limit {
                Err(InteropError::Timeout { what: "the producer's greeting", limit })
            } else {
                Ok(true)
            };
            match outcome {
                Ok(true) => self.guests.push(guest),
                Ok(false) => {}
                Err(error) => {
                    turn_away(&guest.socket, &error);
                    Shared::say(&mut self.shared.lock(), format!("connection: {error}"));
                }
            }
        }
    }

    /// Answers a guest's message; whether it stays one.
    fn answer(&mut self, guest: &mut Guest, received: Received) -> Result<bool, InteropError> {
        let message = received.message()?;
        if let Some(mut bringing) = guest.bringing.take() {
            return match bringing.session.receive(&message, received.fds.len())? {
                Action::Import(brought) => {
                    self.import(guest, bringing, &brought, received.fds)?;
                    Ok(false)
                }
                Action::End => Ok(false),
                Action::Queue(_) => unreachable!("a session that awaits memory takes no frame"),
            };
        }
        let hello = *hello(&message)?;
        let camera = hello.camera as usize;
        let refused = |code, text| Err(InteropError::Refused { code, text });
        let Some(terms) = self.shared.terms.get(camera).copied() else {
            let cameras = self.shared.terms.len();
            return refused(ErrorCode::Camera, format!("camera {camera}, the rig has {cameras}"));
        };
        let taken = self.shared.lock().links.iter().any(|link| link.camera == camera)
            || self.guests.iter().any(|g| g.bringing.as_ref().is_some_and(|b| b.camera == camera));
        if taken {
            return refused(ErrorCode::Taken, format!("camera {camera} has a producer already"));
        }
        let agreement = agree(&hello, &terms)?;
        let session = Session::new(&terms, agreement);
        let exported = agreement.timeline == wire::TIMELINE_EXPORTED;
        let timelines = make_timelines(&self.shared.device, terms.slots, exported)?;
        let timeline_fds = export_timelines(&timelines)?;
        if agreement.brings() {
            let images = agreement.memory == wire::MEMORY_IMAGES;
            self.offer(guest, &terms, agreement, wanted(&terms.images, images), &timeline_fds)?;
            guest.bringing = Some(Bringing { camera, agreement, session, timelines });
            return Ok(true);
        }
        let source = Source::Own(agreement.memory);
        let ring = Ring::new(&self.shared.device, terms.camera, &terms.images, source, timelines)?;
        let mut fds = ring.export_memory(&self.shared.device)?;
        fds.extend(timeline_fds);
        self.offer(guest, &terms, agreement, ring.described(), &fds)?;
        self.link(guest, camera, agreement, session, ring);
        Ok(false)
    }

    /// Tells a guest its ring.
    fn offer(
        &self,
        guest: &Guest,
        terms: &Terms,
        agreement: Agreement,
        [hdr, motion]: [ImageMemory; 2],
        fds: &[OwnedFd],
    ) -> Result<(), InteropError> {
        let images = &terms.images;
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
            ..RingOffer::default()
        };
        let fds: Vec<_> = fds.iter().map(AsFd::as_fd).collect();
        guest.socket.send(&Message::Ring(offer), &fds)
    }

    /// Makes a ring of the memory that a guest brings.
    fn import(
        &mut self,
        guest: &Guest,
        bringing: Bringing,
        brought: &Brought,
        fds: Vec<OwnedFd>,
    ) -> Result<(), InteropError> {
        let Bringing { camera, agreement, session, timelines } = bringing;
        let terms = &self.shared.terms[camera];
        let Brought { hdr, motion, .. } = *brought;
        let source = Source::Peer { kind: agreement.memory, fds, hdr, motion };
        let ring = Ring::new(&self.shared.device, terms.camera, &terms.images, source, timelines)?;
        guest.socket.send(&Message::Accepted(Header::default()), &[])?;
        self.link(guest, camera, agreement, session, ring);
        Ok(())
    }

    /// A guest has its ring.
    fn link(&mut self, guest: &Guest, camera: usize, agreement: Agreement, session: Session, ring: Ring) {
        let mut state = self.shared.lock();
        state.agreed[camera] = Some(agreement);
        state.counts[camera].connections += 1;
        state.links.push(Link {
            id: self.next_id,
            camera,
            socket: Arc::clone(&guest.socket),
            session,
            ring: Arc::new(ring),
            pending: VecDeque::new(),
            ending: false,
            seen: false,
        });
        state.changed = true;
        self.next_id += 1;
    }
}

/// What a guest must know of the memory that it is to bring: of images what they are used for.
fn wanted(images: &Images, as_images: bool) -> [ImageMemory; 2] {
    let of = |kind: ImageKind| ImageMemory {
        bytes: kind.bytes,
        image_usage: if as_images { kind.usage().as_raw() } else { 0 },
        ..ImageMemory::default()
    };
    [of(images.hdr_kind()), images.motion_kind().map_or(ImageMemory::default(), of)]
}
