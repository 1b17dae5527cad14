//! The engine's side of the socket. One thread, the hub, answers producers; another steps the rig.
//!
//! Both share a state behind one lock. Nobody holds the lock while it waits or allocates memory of the device.
//! While the stepping thread waits for frames it reads the producers' messages itself, which is quickest.
//! While it steps, the hub reads them.

mod claims;
mod hub;
mod links;
mod notices;
mod pause;
mod wait;

use crate::error::InteropError;
use crate::frame_scene::FrameScene;
use crate::images::Images;
use crate::ring::{Ring, Slot};
use crate::session::{Agreement, Terms};
use crate::socket::Listener;
use crate::support::{Support, safe_memories};
use crate::wire::{self, FrameNotice};
use claims::Claims;
use esaac_engine::{CameraConfig, Device};
use esaac_model::Synthesis;
use hub::{Hub, most_guests};
use links::{Shared, State, ring};
use notices::Notices;
use rustix::event::{EventfdFlags, eventfd};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// One camera of the rig as producers see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraTerms {
    /// Its images, and the lens of depth and poses if it takes those.
    pub images: Images,
    /// Whether it cannot do without depth and poses. Otherwise a producer that does not give them is served, and the
    /// camera is simulated without.
    pub requires_geometry: bool,
    /// Most instances that may have poses.
    pub max_instances: u32,
    /// Slots of its ring.
    pub slots: u32,
    /// Whether a newer frame replaces those that were not stepped yet. Otherwise the producer waits.
    pub latest: bool,
}

/// Instances with poses, unless a rig says otherwise.
pub const DEFAULT_INSTANCES: u32 = 256;

/// Slots of a ring, unless a rig says otherwise: one for the producer to write, one for the engine to read, and one that
/// waits.
pub const DEFAULT_SLOTS: u32 = 3;

impl From<&CameraConfig> for CameraTerms {
    /// The usual terms of a camera: its producer waits.
    fn from(config: &CameraConfig) -> Self {
        CameraTerms {
            images: config.into(),
            requires_geometry: config.sensor.synthesis == Synthesis::Rigid,
            max_instances: DEFAULT_INSTANCES,
            slots: DEFAULT_SLOTS,
            latest: false,
        }
    }
}

/// How a server behaves.
#[derive(Clone, Copy, Debug)]
pub struct ServerOptions {
    /// A connection that has not sent what it needs for a ring this long after it was made is closed: HELLO,
    /// and BROUGHT if it brings memory.
    pub handshake_timeout: Duration,
    /// A producer whose first FRAME has not come this long after it had its ring is closed: it holds a camera
    /// that another one may want. It learns its formats from the ring and may build its pipelines after that.
    pub first_frame_timeout: Duration,
    /// A frame that is announced by FRAME and not written after this time ends its connection.
    pub frame_timeout: Duration,
    /// Once a frame is there, how long the tick waits for frames of the other connected cameras.
    pub gather: Duration,
    /// How long after the last message the stepping thread polls before it sleeps. Waking up takes tens of
    /// microseconds; polling keeps a processor busy. On a software device it never polls, because the
    /// producers need the processor.
    pub spin: Duration,
    /// Kinds of memory that may be used, as bits. What the device cannot share is left out.
    pub memories: u32,
    /// Whether a software device shares memory by its own descriptors too. Such a driver keeps its notes
    /// beside the texels, where the peer can overwrite them: a hostile producer can then crash this process.
    /// Without trust only memory of the host is shared there. GPUs are not affected.
    pub trusts_producers: bool,
    /// Timelines that may be used, as bits.
    pub timelines: u32,
}

impl Default for ServerOptions {
    fn default() -> Self {
        ServerOptions {
            handshake_timeout: Duration::from_secs(5),
            first_frame_timeout: Duration::from_secs(120),
            frame_timeout: Duration::from_secs(5),
            gather: Duration::from_millis(1),
            spin: Duration::from_micros(500),
            memories: wire::MEMORY_EXPORTED | wire::MEMORY_HOST | wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES,
            trusts_producers: false,
            timelines: wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED,
        }
    }
}

/// Counts of all connections since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ConnectionCounts {
    /// Connections that were accepted from the system.
    pub accepted: u64,
    /// Those that were closed before they had a ring: other users, bad greetings, cameras that are taken. Not those that
    /// closed themselves without a word.
    pub refused: u64,
    /// How often a connection had to wait because the system had no descriptor or memory for it.
    pub not_accepted: u64,
}

/// Counts of one camera since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Producers that were given a ring.
    pub connections: u64,
    /// Producers that sent BYE and whose frames are all done.
    pub finished: u64,
    /// Producers that disappeared without BYE or broke the rules.
    pub lost: u64,
    /// Frames announced by FRAME.
    pub frames: u64,
    /// Frames that were stepped.
    pub stepped: u64,
    /// Frames dropped for newer ones, or with a step that failed.
    pub dropped: u64,
    /// Frames that were not stepped because their producer was lost, or the server closed.
    pub abandoned: u64,
    /// Copies on the device of the frames that were stepped: those that producers report, and the engine's own
    /// of images.
    pub device_copies: u64,
    /// Copies by way of the host.
    pub host_copies: u64,
}

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It was stepped.
    Stepped,
    /// It was not.
    Dropped,
}

/// A frame that is written. Give its slot back by [`Server::release`].
pub struct Ready {
    /// Camera.
    pub camera: usize,
    /// Time of the frame.
    pub t_ns: i64,
    /// Whether it is the first of its producer.
    pub first: bool,
    /// Poses of its interval, if they come with the frames.
    pub scene: Option<FrameScene>,
    link: u64,
    ring: Arc<Ring>,
    notice: FrameNotice,
}

impl Ready {
    /// The slot that holds it.
    #[must_use]
    pub fn slot(&self) -> &Slot {
        self.ring.slot(self.notice.slot)
    }

    /// Value of the slot's timeline that means "written". The next one means "read".
    #[must_use]
    pub fn value(&self) -> u64 {
        self.notice.value
    }

    /// Copies that the producer made of it: on the device, and through the host.
    #[must_use]
    pub fn copies(&self) -> (u32, u32) {
        (self.notice.device_copies, self.notice.host_copies)
    }
}

/// Listens for producers.
pub struct Server {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Makes the socket and starts to answer producers.
    pub fn open(
        device: &Arc<Device>,
        path: &Path,
        cameras: &[CameraTerms],
        options: ServerOptions,
    ) -> Result<Self, InteropError> {
        let support = Support::of(device);
        let allowed = options.memories & safe_memories(device.is_software(), options.trusts_producers);
        let memories = support.offers(&device.info().name, allowed)?;
        let terms: Vec<Terms> = (0..)
            .zip(cameras)
            .map(|(camera, c)| Terms {
                camera,
                images: c.images,
                requires_geometry: c.requires_geometry,
                max_instances: c.max_instances,
                slots: c.slots.clamp(1, wire::MAX_SLOTS),
                backpressure: if c.latest { wire::LATEST } else { wire::LOSSLESS },
                device_uuid: device.info().uuid,
                driver_uuid: device.info().driver_uuid,
                memories: if c.images.are_importable(device) {
                    memories | allowed & wire::MEMORY_IMAGES
                } else {
                    memories
                },
                host_refused: support.host_refused.clone(),
                timelines: options.timelines & support.timelines(),
            })
            .collect();
        let listener = Listener::bind(path, most_guests(cameras.len()))?;
        let bell = || {
            eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)
                .map_err(InteropError::system("eventfd"))
        };
        let shared = Arc::new(Shared {
            device: Arc::clone(device),
            latest: cameras.iter().map(|c| c.latest).collect(),
            claims: Claims::new(cameras.len()),
            options: ServerOptions {
                spin: if device.is_software() { Duration::ZERO } else { options.spin },
                ..options
            },
            state: Mutex::new(State {
                links: Vec::new(),
                agreed: vec![None; terms.len()],
                all_agreed: Vec::new(),
                counts: vec![LinkCounts::default(); terms.len()],
                connections: ConnectionCounts::default(),
                processes: BTreeSet::new(),
                notices: Notices::new(Instant::now()),
                listens: false,
                changed: false,
                stopped: false,
                failed: None,
            }),
            terms,
            wake: bell()?,
            news: bell()?,
        });
        let hub = Hub::new(&shared, listener);
        let thread = std::thread::Builder::new()
            .name("esaac-link".to_owned())
            .spawn(move || hub.run())
            .map_err(|error| InteropError::Socket { path: path.to_owned(), reason: error.to_string() })?;
        Ok(Server { shared, thread: Some(thread) })
    }

    /// Gives a frame's slot back to its producer and signals its timeline. The device must be done with it.
    pub fn release(&self, ready: &Ready, outcome: Outcome) {
        let mut state = self.shared.lock();
        let counts = &mut state.counts[ready.camera];
        if outcome == Outcome::Stepped {
            counts.stepped += 1;
            counts.device_copies += u64::from(ready.notice.device_copies) + ready.ring.copies();
            counts.host_copies += u64::from(ready.notice.host_copies);
        } else {
            counts.dropped += 1;
        }
        if let Some(index) = state.links.iter().position(|link| link.id == ready.link) {
            let told = state.links[index].give_back(ready.notice.slot, outcome);
            self.shared.settle(&mut state, index, told);
        }
    }

    /// Ends the connection of a frame's producer because of an error; the frame counts as abandoned.
    pub(crate) fn turn_away(&self, ready: &Ready, error: &InteropError) {
        let mut state = self.shared.lock();
        state.counts[ready.camera].abandoned += 1;
        if let Some(index) = state.links.iter().position(|link| link.id == ready.link) {
            self.shared.lose(&mut state, index, error);
        }
    }

    /// Ends all connections. Frames that have come and were not taken count as abandoned.
    pub fn close(&self) {
        let mut state = self.shared.lock();
        state.stopped = true;
        let ids: Vec<u64> = state.links.iter().map(|link| link.id).collect();
        ids.into_iter().for_each(|id| self.shared.hear_out(&mut state, id));
        let State { links, counts, .. } = &mut *state;
        for link in links.drain(..) {
            counts[link.camera()].abandoned += link.pending.len() as u64;
        }
    }

    /// Counts of each camera.
    #[must_use]
    pub fn counts(&self) -> Vec<LinkCounts> {
        self.shared.lock().counts.clone()
    }

    /// Memory and timeline of each camera's producer, or of its last one.
    #[must_use]
    pub fn agreements(&self) -> Vec<Option<Agreement>> {
        self.shared.lock().agreed.clone()
    }

    /// Every combination of version, memory and timeline that producers have agreed to since the start.
    #[must_use]
    pub fn all_agreements(&self) -> Vec<Agreement> {
        self.shared.lock().all_agreed.clone()
    }

    /// The images that a camera takes.
    pub(crate) fn images(&self, camera: usize) -> &Images {
        &self.shared.terms[camera].images
    }

    /// Number of producers that have a ring now.
    #[must_use]
    pub fn connected(&self) -> usize {
        self.shared.lock().links.len()
    }

    /// Number of processes that took part since the start: this one, and those whose producers were given a ring. Those of
    /// containers that this one does not see into count as one.
    #[must_use]
    pub fn processes(&self) -> usize {
        let own = rustix::process::getpid().as_raw_nonzero().get();
        1 + self.shared.lock().processes.iter().filter(|process| **process != own).count()
    }

    /// Counts of all connections.
    #[must_use]
    pub fn connections(&self) -> ConnectionCounts {
        self.shared.lock().connections
    }

    /// Adds a line to those of [`Server::notices`], within their limits.
    pub fn say(&self, text: String) {
        self.shared.lock().say(text);
    }

    /// Lines for a log about what has happened since the last call. What happens too often is summed up in one
    /// line.
    #[must_use]
    pub fn notices(&self) -> Vec<String> {
        self.shared.lock().notices.take(Instant::now())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.lock().stopped = true;
        ring(&self.shared.wake);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            eprintln!("esaac: the thread that answers producers has panicked");
        }
    }
}
