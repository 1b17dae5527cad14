//! A producer on a Vulkan device: it connects a camera, renders into slots and announces the frames.

use crate::client::{Client, Copies, Descriptors, Gives, Greeting};
use crate::error::InteropError;
use crate::ring::{Ring, Slot, Source, import_timelines, make_timelines};
use crate::support::Support;
use crate::wire;
use esaac_engine::{Device, SubmitHooks};
use esaac_model::paths::SceneMotion;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// How a producer connects.
#[derive(Clone, Copy, Debug)]
pub struct ProducerOptions {
    /// Camera to feed.
    pub camera: u32,
    /// Size that it renders; `None` for the rig's.
    pub size_px: Option<(u32, u32)>,
    /// Memories that it may use, as bits; the device's abilities are a further limit.
    pub memories: u32,
    /// Timelines that it may use, as bits.
    pub timelines: u32,
    /// Whether it gives depth and poses.
    pub geometry: Gives,
    /// How long it waits for the engine's answers.
    pub timeout: Duration,
}

impl Default for ProducerOptions {
    fn default() -> Self {
        ProducerOptions {
            camera: 0,
            size_px: None,
            // BROUGHT and IMAGES only suit producers that render into such memory, so they must ask for them.
            memories: wire::MEMORY_EXPORTED | wire::MEMORY_HOST,
            timelines: wire::TIMELINE_CARRIED | wire::TIMELINE_EXPORTED,
            geometry: Gives::Images,
            timeout: Duration::from_secs(10),
        }
    }
}

/// A connected camera.
pub struct Producer {
    client: Client,
    ring: Ring,
}

impl Producer {
    /// Connects to the engine at `path`.
    pub fn connect(
        device: &Arc<Device>,
        path: &Path,
        options: &ProducerOptions,
    ) -> Result<Self, InteropError> {
        let support = Support::of(device);
        let greeting = Greeting {
            device_uuid: device.info().uuid,
            driver_uuid: device.info().driver_uuid,
            camera: options.camera,
            size_px: options.size_px,
            memories: support.takes(&device.info().name, options.memories)?,
            timelines: options.timelines & support.timelines(),
            geometry: options.geometry,
            timeout: options.timeout,
        };
        let (client, descriptors) = Client::greet(path, &greeting)?;
        match ring(device, &client, descriptors) {
            Ok(ring) => Ok(Producer { client, ring }),
            Err(error) => Err(client.give_up(error)),
        }
    }

    /// What was agreed with the engine.
    #[must_use]
    pub fn client(&self) -> &Client {
        &self.client
    }

    /// Returns a slot to write. If none is free it waits until the engine gives one back.
    pub fn slot(&mut self) -> Result<u32, InteropError> {
        let ring = &self.ring;
        self.client.slot(|slot, value| ring.slot(slot).timeline().heard(value))
    }

    /// Calls `render` with the hooks for the submission that writes the slot. They take the buffers over, wait
    /// until the engine has read them, and signal that they are written.
    pub fn write<E>(
        &self,
        slot: u32,
        render: impl FnOnce(&Slot, &SubmitHooks<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        let place = self.ring.slot(slot);
        let (timeline, value) = (place.timeline().timeline(), self.client.value(slot));
        let given_back = [(timeline, value)];
        let hooks = SubmitHooks {
            before: &[place.acquire()],
            after: &[place.release()],
            // The first write of a slot has nothing to wait for.
            waits: if value == 0 { &[] } else { &given_back },
            signals: &[(timeline, value + 1)],
        };
        render(place, &hooks)
    }

    /// Announces the frame in a slot. Its writing must have been submitted.
    pub fn publish(&mut self, slot: u32, t_ns: i64, copies: Copies) -> Result<(), InteropError> {
        self.publish_frame(slot, t_ns, copies, None)
    }

    /// As [`Producer::publish`], with the poses from the last frame to this one. They are sent if the camera takes them
    /// ([`Images::geometry`](crate::Images::geometry)); then they must come with every frame.
    ///
    /// Poses that are wrong are [`InteropError::Scene`]. Then the slot is still the caller's, to be published with other poses.
    pub fn publish_scene(
        &mut self,
        slot: u32,
        t_ns: i64,
        copies: Copies,
        scene: &SceneMotion,
    ) -> Result<(), InteropError> {
        self.publish_frame(slot, t_ns, copies, Some(scene))
    }

    fn publish_frame(
        &mut self,
        slot: u32,
        t_ns: i64,
        copies: Copies,
        scene: Option<&SceneMotion>,
    ) -> Result<(), InteropError> {
        let (timeline, limit) = (self.ring.slot(slot).timeline(), self.client.timeout());
        self.client.publish(slot, t_ns, copies, scene, |value| timeline.settle(value, limit))
    }

    /// Says that there are no more frames and waits until the engine has taken all; how many it has
    /// stepped and dropped.
    pub fn finish(mut self) -> Result<(u64, u64), InteropError> {
        let ring = &self.ring;
        self.client.finish(|slot, value| ring.slot(slot).timeline().heard(value))
    }
}

/// The ring of an offer.
fn ring(device: &Arc<Device>, client: &Client, descriptors: Descriptors) -> Result<Ring, InteropError> {
    let (offer, images) = (client.offer(), client.images());
    let timelines = if client.shares_timelines() {
        import_timelines(device, descriptors.timelines)?
    } else {
        make_timelines(device, offer.slots, false)?
    };
    let source = if client.brings() {
        Source::Own(if offer.memory == wire::MEMORY_IMAGES { offer.memory } else { wire::MEMORY_EXPORTED })
    } else {
        let (kind, fds) = (offer.memory, descriptors.memory);
        Source::Peer { kind, fds, told: [offer.hdr, offer.motion, offer.depth, offer.ids] }
    };
    let mut ring = Ring::new(device, offer.camera, images, source, timelines)?;
    if client.brings() {
        let memory = ring.export_memory(device)?;
        client.bring(ring.described(), &memory)?;
    }
    Ok(ring)
}
