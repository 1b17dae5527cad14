//! A producer's side of the protocol: HELLO, slots, frames, BYE. It is the same for Vulkan and CUDA.

use crate::error::InteropError;
use crate::frame_scene::tracks;
use crate::images::{Images, geometry_from_wire, lens_to_wire};
use crate::socket::{Received, Socket};
use crate::wire::{
    self, Brought, ErrorCode, FrameNotice, Header, Hello, ImageMemory, Lens, Message, Refusal, RingOffer,
    Track, Version, WireError,
};
use esaac_model::paths::{Intrinsics, SceneMotion};
use esaac_model::{HdrFormat, MotionFormat};
use rustix::fd::{AsFd, OwnedFd};
use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

/// Copies that were made of a frame before it was in its slot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Copies {
    /// On the device.
    pub device: u32,
    /// By way of the host.
    pub host: u32,
}

/// Descriptors of an offer.
pub(crate) struct Descriptors {
    /// Images of each slot in turn; none if the producer brings them.
    pub memory: Vec<OwnedFd>,
    /// One a slot, if timelines are exported.
    pub timelines: Vec<OwnedFd>,
}

/// What a producer says in its HELLO.
pub(crate) struct Greeting {
    pub device_uuid: [u8; 16],
    pub driver_uuid: [u8; 16],
    pub camera: u32,
    /// Size that it renders; `None` for the rig's.
    pub size_px: Option<(u32, u32)>,
    /// As bits.
    pub memories: u32,
    /// As bits.
    pub timelines: u32,
    pub geometry: Gives,
    /// How long it waits for the engine's answers.
    pub timeout: Duration,
}

/// Whether a producer gives depth, instance ids and poses where a camera takes them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Gives {
    /// Colour and motion alone.
    #[default]
    Images,
    /// Those as well. It renders with the lens of the rig, which is in [`Client::images`].
    Geometry,
    /// Those as well, with this lens. The engine refuses one that is not the rig's.
    GeometryWith(Intrinsics),
}

/// A connection that has its ring: what producers of every kind have in common.
pub struct Client {
    socket: Socket,
    offer: RingOffer,
    images: Images,
    timeout: Duration,
    free: VecDeque<u32>,
    values: Vec<u64>,
    version: Version,
    last_ns: Option<i64>,
    stepped: u64,
    dropped: u64,
}

impl Client {
    /// Connects, sends HELLO and checks that the engine's offer fits to it. An older engine is greeted again as it
    /// understands; it takes no depth and no poses.
    pub(crate) fn greet(path: &Path, greeting: &Greeting) -> Result<(Self, Descriptors), InteropError> {
        match Client::greet_by(Version::NEWEST, path, greeting) {
            Err(InteropError::Refused { code: ErrorCode::Version, .. }) => {
                Client::greet_by(Version::One, path, greeting)
            }
            other => other,
        }
    }

    fn greet_by(
        version: Version,
        path: &Path,
        greeting: &Greeting,
    ) -> Result<(Self, Descriptors), InteropError> {
        let (width_px, height_px) = greeting.size_px.unwrap_or((0, 0));
        let timeout = greeting.timeout;
        let hello = Hello {
            device_uuid: greeting.device_uuid,
            driver_uuid: greeting.driver_uuid,
            camera: greeting.camera,
            width_px,
            height_px,
            memories: greeting.memories,
            timelines: greeting.timelines,
            gives: if greeting.geometry == Gives::Images { 0 } else { wire::GIVES_GEOMETRY },
            lens: match &greeting.geometry {
                Gives::GeometryWith(lens) => lens_to_wire(lens),
                _ => Lens::default(),
            },
            ..Hello::default()
        };
        let socket = Socket::connect(path, version, timeout)?;
        tell(&socket, timeout, &Message::Hello(hello))?;
        let received = socket.receive_within(timeout, "the engine's answer")?;
        let offer = match received.message()? {
            Message::Ring(offer) => offer,
            other => return Err(unexpected(&other)),
        };
        let client = Client {
            socket,
            offer,
            images: images(&offer)?,
            timeout,
            free: (0..offer.slots.min(wire::MAX_SLOTS)).collect(),
            values: vec![0; offer.slots.min(wire::MAX_SLOTS) as usize],
            version,
            last_ns: None,
            stepped: 0,
            dropped: 0,
        };
        match client.descriptors(&hello, received.fds) {
            Ok(descriptors) => Ok((client, descriptors)),
            Err(error) => Err(client.give_up(error)),
        }
    }

    fn descriptors(&self, hello: &Hello, mut fds: Vec<OwnedFd>) -> Result<Descriptors, InteropError> {
        let offer = &self.offer;
        let bad = |text: String| InteropError::Refused { code: ErrorCode::Protocol, text };
        if offer.slots == 0 || offer.slots > wire::MAX_SLOTS {
            return Err(bad(format!("{} slots, expected 1 to {}", offer.slots, wire::MAX_SLOTS)));
        }
        if hello.memories & offer.memory == 0 || hello.timelines & offer.timeline == 0 {
            return Err(bad(format!(
                "memory {:#x} and timeline {:#x} are offered, expected of {:#x} and {:#x}",
                offer.memory, offer.timeline, hello.memories, hello.timelines
            )));
        }
        let slots = offer.slots as usize;
        let memory = if self.brings() { 0 } else { slots * self.images.count() };
        let expected = memory + if self.shares_timelines() { slots } else { 0 };
        if fds.len() != expected {
            return Err(WireError::Descriptors { kind: "RING", expected, actual: fds.len() }.into());
        }
        let timelines = fds.split_off(memory);
        Ok(Descriptors { memory: fds, timelines })
    }

    /// Tells the engine why this side closes, and returns the error.
    pub(crate) fn give_up(&self, error: InteropError) -> InteropError {
        // For the engine's log. If the engine is gone there is nobody to tell.
        let _ = self.socket.send(&Message::Refusal(Refusal::new(error.code(), &error.words())), &[]);
        error
    }

    /// The version that is spoken.
    #[must_use]
    pub fn version(&self) -> Version {
        self.version
    }

    /// What the camera's images are. With a geometry in it, poses go with every frame.
    #[must_use]
    pub fn images(&self) -> &Images {
        &self.images
    }

    /// What the engine has offered.
    #[must_use]
    pub fn offer(&self) -> &RingOffer {
        &self.offer
    }

    pub(crate) fn timeout(&self) -> Duration {
        self.timeout
    }

    /// Whether the producer's memory is to be used.
    pub(crate) fn brings(&self) -> bool {
        matches!(self.offer.memory, wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES)
    }

    pub(crate) fn shares_timelines(&self) -> bool {
        self.offer.timeline == wire::TIMELINE_EXPORTED
    }

    /// Frames that the engine has stepped, and those that it has dropped for newer ones.
    #[must_use]
    pub fn stepped_and_dropped(&self) -> (u64, u64) {
        (self.stepped, self.dropped)
    }

    /// Hands this side's memory to the engine.
    pub(crate) fn bring(
        &self,
        [hdr, motion, depth, ids]: [ImageMemory; 4],
        fds: &[OwnedFd],
    ) -> Result<(), InteropError> {
        let borrowed: Vec<_> = fds.iter().map(AsFd::as_fd).collect();
        let brought = Message::Brought(Brought { hdr, motion, depth, ids, ..Brought::default() });
        self.socket.send(&brought, &borrowed).map_err(|error| reason(&self.socket, error))?;
        match self.socket.receive_within(self.timeout, "the engine's acceptance")?.message()? {
            Message::Accepted(_) => Ok(()),
            other => Err(unexpected(&other)),
        }
    }

    /// Returns a slot to write; if none is free, waits until the engine gives one back. `heard` is called for
    /// each slot that comes back.
    pub(crate) fn slot(
        &mut self,
        mut heard: impl FnMut(u32, u64) -> Result<(), InteropError>,
    ) -> Result<u32, InteropError> {
        let deadline = Instant::now() + self.timeout;
        while let Some(received) = self.socket.receive()? {
            self.take(&received, &mut heard)?;
        }
        loop {
            if let Some(slot) = self.free.pop_front() {
                return Ok(slot);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            let limit = self.timeout;
            let received = self.socket.receive_within(left, "a free slot").map_err(|error| match error {
                // The error shall name the whole time, not what was left of it.
                InteropError::Timeout { what, .. } => InteropError::Timeout { what, limit },
                error => error,
            })?;
            self.take(&received, &mut heard)?;
        }
    }

    /// Value of a slot's timeline while the producer has it.
    pub(crate) fn value(&self, slot: u32) -> u64 {
        self.values[slot as usize]
    }

    /// Tells the engine of the frame in a slot, and of its poses if the camera takes some. `written` gets the value of the
    /// slot's timeline that means "written", and signals it or waits for it. If the poses are wrong it is not called: a
    /// value is signalled once.
    pub(crate) fn publish(
        &mut self,
        slot: u32,
        t_ns: i64,
        copies: Copies,
        scene: Option<&SceneMotion>,
        written: impl FnOnce(u64) -> Result<(), InteropError>,
    ) -> Result<(), InteropError> {
        let tracks = self.poses(t_ns, scene)?;
        let value = self.values[slot as usize] + 1;
        written(value)?;
        let poses = tracks.iter().map(|track| track.samples.len()).sum::<usize>() as u32;
        for tracks in wire::in_messages(tracks) {
            tell(&self.socket, self.timeout, &Message::Poses(tracks))?;
        }
        let notice = FrameNotice {
            slot,
            device_copies: copies.device,
            host_copies: copies.host,
            poses,
            value,
            t_ns,
            ..FrameNotice::default()
        };
        tell(&self.socket, self.timeout, &Message::Frame(notice))?;
        self.values[slot as usize] = value;
        self.last_ns = Some(t_ns);
        Ok(())
    }

    /// The poses from the last frame to one at `t_ns`, which are right to be sent; none if the camera takes none.
    fn poses(&self, t_ns: i64, scene: Option<&SceneMotion>) -> Result<Vec<Track>, InteropError> {
        let Some(geometry) = &self.images.geometry else { return Ok(Vec::new()) };
        let bad = |reason: String| Err(InteropError::Scene { reason });
        let Some(scene) = scene else {
            return bad("the camera takes depth, and there are no poses with the frame".to_owned());
        };
        if !self.images.takes_lens(scene.lens()) {
            let words = |lens| wire::lens_words(&lens_to_wire(lens));
            return bad(format!("lens {}, expected {}", words(scene.lens()), words(&geometry.lens)));
        }
        let tracks = tracks(scene, self.last_ns.unwrap_or(t_ns), t_ns)?;
        let (instances, most) = (tracks.len() - 1, self.offer.max_instances);
        if instances > most as usize {
            return bad(format!("{instances} instances have poses, the camera takes at most {most}"));
        }
        let poses = tracks.iter().map(|track| track.samples.len()).sum::<usize>();
        if poses > wire::MAX_POSES {
            return bad(format!("{poses} poses for a frame, expected at most {}", wire::MAX_POSES));
        }
        Ok(tracks)
    }

    /// Says that there are no more frames and waits until the engine has taken all; how many it has
    /// stepped and dropped.
    pub(crate) fn finish(
        &mut self,
        mut heard: impl FnMut(u32, u64) -> Result<(), InteropError>,
    ) -> Result<(u64, u64), InteropError> {
        tell(&self.socket, self.timeout, &Message::Bye(Header::default()))?;
        while self.values.iter().any(|value| value % 2 == 1) {
            let received = self.socket.receive_within(self.timeout, "the engine's last slot")?;
            self.take(&received, &mut heard)?;
        }
        Ok(self.stepped_and_dropped())
    }

    fn take(
        &mut self,
        received: &Received,
        heard: &mut impl FnMut(u32, u64) -> Result<(), InteropError>,
    ) -> Result<(), InteropError> {
        let released = match received.message()? {
            Message::Released(released) => released,
            other => return Err(unexpected(&other)),
        };
        let slot = released.slot;
        let Some(value) = self.values.get_mut(slot as usize) else {
            return Err(InteropError::Refused {
                code: ErrorCode::Protocol,
                text: format!("the engine releases slot {slot} of {}", self.offer.slots),
            });
        };
        if *value % 2 == 0 || released.value != *value + 1 {
            return Err(InteropError::Value { slot, expected: *value + 1, actual: released.value });
        }
        *value = released.value;
        heard(slot, released.value)?;
        if released.outcome == wire::DROPPED {
            self.dropped += 1
        } else {
            self.stepped += 1
        }
        self.free.push_back(slot);
        Ok(())
    }
}

/// Sends a message. If the engine has closed the connection, the error is the reason that it gave.
fn tell(socket: &Socket, limit: Duration, message: &Message) -> Result<(), InteropError> {
    socket.send_within(limit, message).map_err(|error| reason(socket, error))
}

fn reason(socket: &Socket, error: InteropError) -> InteropError {
    if matches!(error, InteropError::PeerGone) {
        while let Ok(Some(received)) = socket.receive() {
            if let Ok(message @ Message::Refusal(_)) = received.message() {
                return unexpected(&message);
            }
        }
    }
    error
}

fn unexpected(message: &Message) -> InteropError {
    match message {
        Message::Refusal(refusal) => {
            InteropError::Refused { code: ErrorCode::from_number(refusal.code), text: refusal.words() }
        }
        other => InteropError::Refused {
            code: ErrorCode::Protocol,
            text: format!("{} came from the engine out of turn", other.name()),
        },
    }
}

fn images(offer: &RingOffer) -> Result<Images, InteropError> {
    let unknown = |what: &str, number: u32| InteropError::Refused {
        code: ErrorCode::Protocol,
        text: format!("{what} format {number} is unknown"),
    };
    let hdr = [HdrFormat::F16x4, HdrFormat::F32x4, HdrFormat::Srgb8x4]
        .into_iter()
        .find(|format| *format as u32 == offer.hdr_format)
        .ok_or_else(|| unknown("colour", offer.hdr_format))?;
    let motion = if offer.motion_format == wire::NO_MOTION {
        None
    } else {
        let all = [MotionFormat::F16x2, MotionFormat::F32x2, MotionFormat::F32x4];
        let found = all.into_iter().find(|format| *format as u32 == offer.motion_format);
        Some(found.ok_or_else(|| unknown("motion", offer.motion_format))?)
    };
    let geometry = geometry_from_wire(offer.depth_format, offer.id_format, &offer.lens)
        .map_err(|text| InteropError::Refused { code: ErrorCode::Protocol, text })?;
    Ok(Images { width_px: offer.width_px, height_px: offer.height_px, hdr, motion, geometry })
}
