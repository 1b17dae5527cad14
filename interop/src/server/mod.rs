//! The engine's side of the socket: a thread that answers producers, and what it hands to the one that
//! steps the rig.
//!
//! What both touch is behind one lock that is never held over a wait or an allocation of the device. The
//! thread that steps listens to producers itself while it waits for frames, so that nobody is between the
//! two; the other one listens to them while the rig steps.

mod hub;
mod links;
mod wait;

use crate::error::InteropError;
use crate::ring::{Images, Ring, Slot};
use crate::session::{Agreement, Terms};
use crate::socket::Listener;
use crate::support::Support;
use crate::wire::{self, FrameNotice};
use esaac_engine::Device;
use hub::Hub;
use links::{Shared, State, ring};
use rustix::event::{EventfdFlags, eventfd};
use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

/// One camera of the rig as producers see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CameraTerms {
    /// Its images.
    pub images: Images,
    /// Slots of its ring.
    pub slots: u32,
    /// Whether older frames are dropped for the newest; else the producer waits.
    pub latest: bool,
}

/// How a server behaves.
#[derive(Clone, Copy, Debug)]
pub struct ServerOptions {
    /// A connection that has not come to its first frame by then is closed.
    pub handshake_timeout: Duration,
    /// A frame that was told of and is not there by then ends its connection.
    pub frame_timeout: Duration,
    /// Once a frame is there, how long the other connected cameras are waited for to go in one tick.
    pub gather: Duration,
    /// So long after the last message the thread that steps looks by itself before it sleeps: being woken
    /// takes tens of microseconds, looking takes a processor. Not on a software device, whose producers
    /// need the processor.
    pub spin: Duration,
    /// Memories that may be used, as bits; the device's abilities are a further limit.
    pub memories: u32,
    /// Timelines that may be used, as bits.
    pub timelines: u32,
}

impl Default for ServerOptions {
    fn default() -> Self {
        ServerOptions {
            handshake_timeout: Duration::from_secs(5),
            frame_timeout: Duration::from_secs(5),
            gather: Duration::from_millis(1),
            spin: Duration::from_micros(500),
            memories: wire::MEMORY_EXPORTED | wire::MEMORY_HOST | wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES,
            timelines: wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED,
        }
    }
}

/// What was counted for a camera since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Producers that were given a ring.
    pub connections: u64,
    /// Producers that said goodbye, and whose frames are all done.
    pub finished: u64,
    /// Producers that went without a word or broke the rules.
    pub lost: u64,
    /// Frames that were told of.
    pub frames: u64,
    /// Frames that were stepped.
    pub stepped: u64,
    /// Frames dropped for newer ones.
    pub dropped: u64,
    /// Frames that went with their producer.
    pub abandoned: u64,
    /// Copies on the device of the frames that were stepped: by their producers' word, and the engine's own
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

/// A frame that is there; it goes back with [`Server::release`].
pub struct Ready {
    /// Camera.
    pub camera: usize,
    /// Time of the frame.
    pub t_ns: i64,
    /// Whether it is the first of its producer.
    pub first: bool,
    link: u64,
    ring: Arc<Ring>,
    notice: FrameNotice,
}

impl Ready {
    /// Where it lies.
    #[must_use]
    pub fn slot(&self) -> &Slot {
        self.ring.slot(self.notice.slot)
    }

    /// Value of its timeline that says that it is written; the next says that it is read.
    #[must_use]
    pub fn value(&self) -> u64 {
        self.notice.value
    }

    /// Copies on the device and by way of the host that the producer made of it.
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
    /// Makes the socket and answers from now on.
    pub fn open(
        device: &Arc<Device>,
        path: &Path,
        cameras: &[CameraTerms],
        options: ServerOptions,
    ) -> Result<Self, InteropError> {
        let support = Support::of(device);
        let memories = support.offers(&device.info().name, options.memories)?;
        let terms: Vec<Terms> = (0..)
            .zip(cameras)
            .map(|(camera, c)| Terms {
                camera,
                images: c.images,
                slots: c.slots.clamp(1, wire::MAX_SLOTS),
                backpressure: if c.latest { wire::LATEST } else { wire::LOSSLESS },
                device_uuid: device.info().uuid,
                driver_uuid: device.info().driver_uuid,
                memories: if c.images.are_importable(device) {
                    memories | options.memories & wire::MEMORY_IMAGES
                } else {
                    memories
                },
                timelines: options.timelines & support.timelines(),
            })
            .collect();
        let listener = Listener::bind(path)?;
        let bell = || {
            eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)
                .map_err(InteropError::system("eventfd"))
        };
        let shared = Arc::new(Shared {
            device: Arc::clone(device),
            latest: cameras.iter().map(|c| c.latest).collect(),
            options: ServerOptions {
                spin: if device.is_software() { Duration::ZERO } else { options.spin },
                ..options
            },
            state: Mutex::new(State {
                links: Vec::new(),
                agreed: vec![None; terms.len()],
                counts: vec![LinkCounts::default(); terms.len()],
                notices: VecDeque::new(),
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

    /// Gives a frame's slot back to its producer. The device is done with it.
    pub fn release(&self, ready: &Ready, outcome: Outcome) -> Result<(), InteropError> {
        let mut state = self.shared.lock();
        let counts = &mut state.counts[ready.camera];
        if outcome == Outcome::Stepped {
            counts.stepped += 1;
            counts.device_copies += u64::from(ready.notice.device_copies) + ready.ring.copies();
            counts.host_copies += u64::from(ready.notice.host_copies);
        } else {
            counts.dropped += 1;
        }
        let Some(index) = state.links.iter().position(|link| link.id == ready.link) else { return Ok(()) };
        let told = state.links[index].give_back(ready.notice.slot, outcome);
        self.shared.settle(&mut state, index, told);
        Ok(())
    }

    /// What was counted, a camera.
    #[must_use]
    pub fn counts(&self) -> Vec<LinkCounts> {
        self.shared.lock().counts.clone()
    }

    /// Memory and timelines that each camera's producer uses, or the last one used.
    #[must_use]
    pub fn agreements(&self) -> Vec<Option<Agreement>> {
        self.shared.lock().agreed.clone()
    }

    /// Producers connected now.
    #[must_use]
    pub fn connected(&self) -> usize {
        self.shared.lock().links.len()
    }

    /// What has happened since this was asked last, in words.
    #[must_use]
    pub fn notices(&self) -> Vec<String> {
        self.shared.lock().notices.drain(..).collect()
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
