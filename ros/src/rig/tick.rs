//! The messages of a tick. Each is encoded once, straight into the buffer that is sent and recorded.

use super::RigPublisher;
use crate::encode::{self, Header, Image, Imu};
use crate::events::{self, PacketHead};
use crate::labels;
use crate::payload::{self, Hold, Payload, Release};
use crate::plan::CameraTopics;
use crate::qos::Durability;
use crate::queue::{Batch, Outgoing};
use esaac_model::PacketView;
use std::sync::Arc;
use std::time::Instant;

/// An APS frame as the engine gives it.
#[derive(Clone, Copy, Debug)]
pub struct ApsImage<'a> {
    /// Row-major pixels.
    pub pixels: &'a [u16],
    /// Significant bits of a pixel.
    pub bits: u32,
    /// Whether it is a mosaic, R at (0, 0).
    pub bayer: bool,
    /// Time of the image, nanoseconds.
    pub t_ns: i64,
}

/// When a sample leaves within its tick. Events go first, and images last, so that nothing waits behind them.
#[derive(Clone, Copy)]
enum Turn {
    /// Clock, and events with their ids.
    First,
    Small,
    Images,
}

/// The messages of one tick.
#[must_use = "nothing is sent before `send`"]
pub struct TickMessages<'a> {
    pub(super) publisher: &'a mut RigPublisher,
    pub(super) stamp_ns: i64,
    /// By [`Turn`].
    samples: [Vec<Outgoing>; 3],
    hold: Hold,
    release: Release,
}

impl<'a> TickMessages<'a> {
    pub(super) fn new(publisher: &'a mut RigPublisher, stamp_ns: i64) -> Self {
        let (hold, release) = payload::hold();
        TickMessages { publisher, stamp_ns, samples: Default::default(), hold, release }
    }

    fn encode(&mut self, topic: usize, stamp_ns: i64, encode: impl FnOnce(&mut Vec<u8>)) -> Outgoing {
        // A latched message is kept for late subscribers, so it must not hold its tick.
        let volatile = self.publisher.plan.topics[topic].qos.durability == Durability::Volatile;
        let hold = volatile.then(|| self.hold.clone());
        let message: Arc<Payload> = self.publisher.pools[topic].fill(hold, encode);
        Outgoing { topic, log_ns: self.publisher.clock.log(stamp_ns), message }
    }

    fn add_sample(&mut self, turn: Turn, topic: usize, stamp_ns: i64, encode: impl FnOnce(&mut Vec<u8>)) {
        let sample = self.encode(topic, stamp_ns, encode);
        self.samples[turn as usize].push(sample);
    }

    /// Adds a message that must arrive. It stays with the publisher until a tick is sent.
    pub(super) fn add_state(&mut self, topic: usize, encode: impl FnOnce(&mut Vec<u8>)) {
        let state = self.encode(topic, self.stamp_ns, encode);
        self.publisher.states.retain(|older| older.topic != topic);
        self.publisher.states.push(state);
    }

    /// `/clock`, where there is one.
    pub(super) fn clock(&mut self) {
        if let Some(clock) = self.publisher.plan.clock {
            let stamp_ns = self.stamp_ns;
            self.add_sample(Turn::First, clock, stamp_ns, |out| encode::clock(out, stamp_ns));
        }
    }

    /// `/tf_static`: from each camera's body frame to its optical frame.
    pub(super) fn frames(&mut self) {
        let (plan, stamp_ns) = (Arc::clone(&self.publisher.plan), self.stamp_ns);
        let frames: Vec<_> =
            plan.cameras.iter().map(|c| (c.body_frame.as_str(), c.optical_frame.as_str())).collect();
        self.add_state(plan.frames, |out| encode::optical_frames(out, stamp_ns, &frames));
    }

    /// Parameters of the cameras whose parameters are new or have changed.
    pub(super) fn sensors(&mut self) {
        let plan = Arc::clone(&self.publisher.plan);
        for (camera, topics) in plan.cameras.iter().enumerate() {
            let state = &mut self.publisher.cameras[camera];
            if std::mem::replace(&mut state.sensor_is_stale, false) {
                let sensor = state.plan.sensor.clone();
                let header = Header { stamp_ns: self.stamp_ns, frame_id: &topics.optical_frame };
                self.add_state(topics.sensor, |out| encode::sensor_model(out, header, &sensor));
            }
        }
    }

    /// A camera's events, in one message or in parts, encoded straight from the packet's memory. A camera that was
    /// announced with ids gives a notice: use [`TickMessages::events_with_ids`].
    pub fn events(&mut self, camera: usize, packet: &PacketView<'_>) -> &mut Self {
        self.events_and_ids(camera, packet, None)
    }

    /// The same, with the instance that each event shows, as [`CameraPlan::event_ids`](crate::CameraPlan::event_ids)
    /// announces them. Each message of events is followed by one of its ids, encoded straight from `ids`. Ids that are not
    /// one for each event are not sent, with a notice ([`RigPublisher::check_ids`]); the events are.
    pub fn events_with_ids(&mut self, camera: usize, packet: &PacketView<'_>, ids: &[i64]) -> &mut Self {
        self.events_and_ids(camera, packet, Some(ids))
    }

    fn events_and_ids(&mut self, camera: usize, packet: &PacketView<'_>, ids: Option<&[i64]>) -> &mut Self {
        let plan = Arc::clone(&self.publisher.plan);
        let Some(topics) = plan.cameras.get(camera) else { return self };
        let complete_ns = self.publisher.cameras[camera].last_ns;
        self.publisher.cameras[camera].holds_clock |= !self.publisher.clock.is_past(self.stamp_ns);
        if !self.publisher.admits(camera, packet) {
            for topic in [Some(topics.events), topics.event_ids].into_iter().flatten() {
                self.publisher.statistics.count_failed(topic);
            }
            return self;
        }
        let mut ids = self.publisher.admitted_ids(camera, packet.len(), ids);
        let (format, split) = (self.publisher.options.events, self.publisher.cameras[camera].plan.split);
        let clock = &self.publisher.clock;
        let shifted = PacketView {
            base_ns: clock.stamp(packet.base_ns),
            watermark_ns: clock.stamp(packet.watermark_ns),
            ..*packet
        };
        self.publisher.statistics.count_packet(packet.host_copies);
        let complete_ns = complete_ns.map(|complete_ns| clock.stamp(complete_ns));
        let parts = split.parts_after(complete_ns, &shifted, format);
        let last = parts.len().saturating_sub(1);
        for (number, part) in parts.iter().enumerate() {
            // The last part has the tick's stamp, even if the sensor's clock ends the packet elsewhere.
            let stamp_ns = if number == last { self.stamp_ns } else { part.watermark_ns };
            let state = &mut self.publisher.cameras[camera];
            let sequence = state.sequence;
            state.sequence += 1;
            let sensor_name = state.plan.sensor.name.clone();
            let header = Header { stamp_ns, frame_id: &topics.optical_frame };
            let head = PacketHead { header, sequence, sensor_name: &sensor_name };
            let began = Instant::now();
            self.add_sample(Turn::First, topics.events, stamp_ns, |out| {
                events::encode(out, format, &head, part)
            });
            self.publisher.statistics.count_encoded(began.elapsed());
            if let Some((topic, left)) = &mut ids {
                let own = left.split_off(..part.len()).expect("an id for each event of the packet");
                self.add_sample(Turn::First, *topic, stamp_ns, |out| {
                    labels::event_ids(out, header, sequence, own)
                });
            }
        }
        self
    }

    /// A camera's APS frame.
    pub fn aps(&mut self, camera: usize, aps: &ApsImage<'_>) -> &mut Self {
        let stamp_ns = self.publisher.clock.stamp(aps.t_ns);
        let wide = aps.bits > 8;
        let (encoding, pixel_bytes) = match (aps.bayer, wide) {
            (true, false) => ("bayer_rggb8", 1),
            (true, true) => ("bayer_rggb16", 2),
            (false, false) => ("mono8", 1),
            (false, true) => ("mono16", 2),
        };
        self.image_on(
            camera,
            |topics| topics.aps,
            stamp_ns,
            encoding,
            pixel_bytes,
            |out| {
                if wide {
                    out.extend(aps.pixels.iter().flat_map(|pixel| pixel.to_le_bytes()));
                } else {
                    out.extend(aps.pixels.iter().map(|&pixel| pixel as u8));
                }
            },
        )
    }

    /// A camera's colour image, `rgb8`; `pixels` appends the pixels row by row.
    pub fn rgb(&mut self, camera: usize, pixels: impl FnOnce(&mut Vec<u8>)) -> &mut Self {
        self.image_on(camera, |topics| topics.image, self.stamp_ns, "rgb8", 3, pixels)
    }

    /// A camera's depth, metres along the optical axis (REP 118), whatever its lens. Pixels without depth are NaN on the wire.
    pub fn depth(&mut self, camera: usize, depth_m: &[f32]) -> &mut Self {
        self.image_on(
            camera,
            |topics| topics.depth,
            self.stamp_ns,
            "32FC1",
            4,
            |out| {
                let valid = |d: f32| if d.is_finite() && d > 0.0 { d } else { f32::NAN };
                out.extend(depth_m.iter().flat_map(|&d| valid(d).to_le_bytes()));
            },
        )
    }

    /// Samples of a camera's IMU.
    pub fn imu(&mut self, camera: usize, samples: &[Imu]) -> &mut Self {
        let plan = Arc::clone(&self.publisher.plan);
        let Some(topics) = plan.cameras.get(camera) else { return self };
        for sample in samples {
            let Some(topic) = topics.imu else { break };
            let stamped = Imu { t_ns: self.publisher.clock.stamp(sample.t_ns), ..*sample };
            self.add_sample(Turn::Small, topic, stamped.t_ns, |out| {
                encode::imu(out, &topics.body_frame, &stamped)
            });
        }
        self
    }

    /// An image and its camera info, with one stamp.
    fn image_on(
        &mut self,
        camera: usize,
        topic: impl Fn(&CameraTopics) -> Option<(usize, usize)>,
        stamp_ns: i64,
        encoding: &str,
        pixel_bytes: u32,
        pixels: impl FnOnce(&mut Vec<u8>),
    ) -> &mut Self {
        let plan = Arc::clone(&self.publisher.plan);
        let Some(topics) = plan.cameras.get(camera) else { return self };
        let Some((image, info)) = topic(topics) else { return self };
        let state = &self.publisher.cameras[camera];
        let (width_px, height_px) = (state.plan.sensor.width, state.plan.sensor.height);
        let lens = state.plan.lens;
        let header = Header { stamp_ns, frame_id: &topics.optical_frame };
        let shape = Image { width_px, height_px, encoding, pixel_bytes };
        self.add_sample(Turn::Images, image, stamp_ns, |out| encode::image(out, header, shape, pixels));
        self.add_sample(Turn::Small, info, stamp_ns, |out| {
            encode::camera_info(out, header, (width_px, height_px), lens);
        });
        self
    }

    /// Hands the tick over. With [`Policy::Latest`](crate::Policy::Latest) this never waits.
    pub fn send(self) {
        let TickMessages { publisher, stamp_ns, samples, release, .. } = self;
        let samples = samples.into_iter().flatten().collect();
        let states = std::mem::take(&mut publisher.states);
        publisher.enqueue(Batch { stamp_ns, encoded: Instant::now(), states, samples, release });
    }
}
