//! The rig's side of publishing: encodes what a tick gave into buffers that the wire and the bag share, and
//! hands the tick over to the publisher's thread.

use crate::bag::{BagError, BagWriter};
use crate::encode::{self, Header, Image, Imu};
use crate::events::{self, PacketHead};
use crate::payload::{Payload, Pool};
use crate::plan::{CameraPlan, Plan, PlanError, Policy, RigOptions};
use crate::statistics::{Statistics, Summary};
use crate::transport::{Transport, TransportError};
use crate::worker::{self, Batch, Outgoing};
use crossbeam_channel::{Receiver, SendTimeoutError, Sender, TrySendError, bounded, unbounded};
use esaac_model::{PacketView, SensorModel};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use thiserror::Error;

/// Why a rig cannot be published.
#[derive(Debug, Error)]
pub enum PublishError {
    /// Names, sizes, qualities.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The network.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The recording.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// A camera that is not there.
    #[error("camera {actual}, expected one of {expected}")]
    NoCamera {
        /// Cameras.
        expected: usize,
        /// Number given.
        actual: usize,
    },
    /// The system gives no thread.
    #[error("no thread for the publisher: {0}")]
    Thread(std::io::Error),
}

/// Where a rig's messages go; at least one of the two, or nothing happens.
#[derive(Default)]
pub struct Sinks {
    /// Subscribers.
    pub transport: Option<Box<dyn Transport>>,
    /// A recording.
    pub bag: Option<BagWriter>,
}

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

/// How long a full queue is waited for before a look at the thread that empties it.
const LOOK: Duration = Duration::from_millis(100);

struct CameraState {
    plan: CameraPlan,
    sequence: u64,
    sensor_told: bool,
}

/// Publishes a rig.
pub struct RigPublisher {
    options: RigOptions,
    plan: Arc<Plan>,
    cameras: Vec<CameraState>,
    pool: Pool,
    queue: Sender<Batch>,
    /// The other end of the queue, to take the oldest out where it is full.
    oldest: Receiver<Batch>,
    notices: Receiver<String>,
    statistics: Arc<Statistics>,
    worker: Option<JoinHandle<Result<(), BagError>>>,
    clock: StampClock,
}

/// From times of the simulation to stamps, and to the bag's times, which never go back.
#[derive(Clone, Copy, Debug, Default)]
struct StampClock {
    wall_offset_ns: Option<i64>,
    last_stamp_ns: Option<i64>,
    log_offset_ns: i64,
    restarted: bool,
    resets: u64,
}

impl StampClock {
    /// Stamp of a tick at `t_ns`, and whether time goes on with it. Of two cameras one may be behind the
    /// other; time itself goes back only where someone said so.
    fn tick(&mut self, t_ns: i64, sim_time: bool) -> (i64, bool) {
        if !sim_time && self.wall_offset_ns.is_none() {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            self.wall_offset_ns = Some(now.as_nanos() as i64 - t_ns);
        }
        let stamp_ns = self.stamp(t_ns);
        let last_ns = self.last_stamp_ns.unwrap_or(i64::MIN);
        let restarted = std::mem::take(&mut self.restarted);
        if stamp_ns < last_ns && restarted {
            self.log_offset_ns += last_ns - stamp_ns;
            self.resets += 1;
        }
        let goes_on = stamp_ns > last_ns || restarted;
        if goes_on {
            self.last_stamp_ns = Some(stamp_ns);
        }
        (stamp_ns, goes_on)
    }

    fn stamp(&self, t_ns: i64) -> i64 {
        t_ns + self.wall_offset_ns.unwrap_or(0)
    }

    fn log(&self, stamp_ns: i64) -> u64 {
        u64::try_from(stamp_ns + self.log_offset_ns).unwrap_or(0)
    }
}

impl RigPublisher {
    /// Announces the topics of `cameras` and starts the thread that sends.
    pub fn start(cameras: Vec<CameraPlan>, options: RigOptions, sinks: Sinks) -> Result<Self, PublishError> {
        let plan = Arc::new(Plan::new(&cameras, &options)?);
        let Sinks { mut transport, mut bag } = sinks;
        for topic in &plan.topics {
            if let Some(transport) = &mut transport {
                transport.advertise(topic)?;
            }
            if let Some(bag) = &mut bag {
                bag.add_topic(topic)?;
            }
        }
        let (queue, oldest) = bounded(options.queue_ticks);
        let (tell, notices) = unbounded();
        let statistics = Arc::new(Statistics::new(&plan, transport.as_deref(), bag.is_some()));
        let worker = worker::start(worker::Worker {
            plan: Arc::clone(&plan),
            node: options.node.clone(),
            transport,
            bag,
            statistics: Arc::clone(&statistics),
            tell,
            queue: oldest.clone(),
            ticks_ahead: (options.policy == Policy::Lossless).then_some(options.queue_ticks),
        })
        .map_err(PublishError::Thread)?;
        // As many free buffers as a full queue of ticks leaves behind, within reason.
        let pool = Pool::new((options.queue_ticks * plan.topics.len() * 8).min(4096));
        let cameras =
            cameras.into_iter().map(|plan| CameraState { plan, sequence: 0, sensor_told: false }).collect();
        Ok(RigPublisher {
            options,
            plan,
            cameras,
            pool,
            queue,
            oldest,
            notices,
            statistics,
            worker: Some(worker),
            clock: StampClock::default(),
        })
    }

    /// The topics.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Publishes a camera's parameters again with the next tick: they have changed.
    pub fn set_sensor(&mut self, camera: usize, sensor: &SensorModel) -> Result<(), PublishError> {
        let expected = self.cameras.len();
        let state =
            self.cameras.get_mut(camera).ok_or(PublishError::NoCamera { expected, actual: camera })?;
        state.plan.sensor = sensor.clone();
        state.sensor_told = false;
        Ok(())
    }

    /// Begins the messages of the tick at `t_ns`. Nothing is sent before [`TickMessages::send`].
    pub fn tick(&mut self, t_ns: i64) -> TickMessages<'_> {
        let first = self.clock.last_stamp_ns.is_none();
        let (stamp_ns, goes_on) = self.clock.tick(t_ns, self.options.sim_time);
        self.statistics.set_resets(self.clock.resets);
        let mut tick = TickMessages { publisher: self, stamp_ns, messages: Vec::new() };
        if let Some(clock) = tick.publisher.plan.clock.filter(|_| goes_on) {
            tick.add(clock, stamp_ns, |out| encode::clock(out, stamp_ns));
        }
        if first {
            let plan = Arc::clone(&tick.publisher.plan);
            let frames: Vec<_> =
                plan.cameras.iter().map(|c| (c.body_frame.as_str(), c.optical_frame.as_str())).collect();
            tick.add(plan.frames, stamp_ns, |out| encode::optical_frames(out, stamp_ns, &frames));
        }
        tick.sensors();
        tick
    }

    /// The simulation was reset: its time may go back with the next tick. Stamps and `/clock` go back with
    /// it; a recording's own times go on.
    pub fn restart(&mut self) {
        self.clock.restarted = true;
    }

    /// What has happened that people should know.
    pub fn notices(&self) -> Vec<String> {
        self.notices.try_iter().collect()
    }

    /// What was sent so far.
    #[must_use]
    pub fn summary(&self) -> Summary {
        self.statistics.summary(&self.plan)
    }

    /// Sends what waits, closes the recording and says how all went. An error is the recording's: it is
    /// complete up to the message at which it failed.
    pub fn finish(mut self) -> (Summary, Vec<String>, Result<(), BagError>) {
        let result = self.stop();
        (self.summary(), self.notices(), result)
    }

    fn stop(&mut self) -> Result<(), BagError> {
        // The thread ends when the queue has no sender any more.
        self.queue = bounded(1).0;
        match self.worker.take().map(JoinHandle::join) {
            None => Ok(()),
            Some(Ok(result)) => result,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
        }
    }

    /// Waits for room, as long as there is someone to make it.
    fn enqueue_waiting(&mut self, mut batch: Batch) {
        while let Err(SendTimeoutError::Timeout(back)) = self.queue.send_timeout(batch, LOOK) {
            batch = back;
            if self.worker.as_ref().is_none_or(JoinHandle::is_finished) {
                return;
            }
        }
    }

    fn enqueue(&mut self, mut batch: Batch) {
        if self.options.policy == Policy::Lossless {
            self.enqueue_waiting(batch);
            return;
        }
        loop {
            match self.queue.try_send(batch) {
                Ok(()) | Err(TrySendError::Disconnected(_)) => return,
                Err(TrySendError::Full(back)) => batch = back,
            }
            if let Ok(dropped) = self.oldest.try_recv() {
                self.statistics.count_dropped(&dropped);
            }
        }
    }
}

impl Drop for RigPublisher {
    fn drop(&mut self) {
        if self.worker.is_some() && !std::thread::panicking() {
            // Without `finish` nobody asks how the recording went.
            let _ = self.stop();
        }
    }
}

/// The messages of one tick.
pub struct TickMessages<'a> {
    publisher: &'a mut RigPublisher,
    stamp_ns: i64,
    messages: Vec<Outgoing>,
}

impl TickMessages<'_> {
    fn add(&mut self, topic: usize, stamp_ns: i64, encode: impl FnOnce(&mut Vec<u8>)) {
        let message: Arc<Payload> = self.publisher.pool.fill(encode);
        let log_ns = self.publisher.clock.log(stamp_ns);
        self.messages.push(Outgoing { topic, log_ns, message });
    }

    fn sensors(&mut self) {
        let plan = Arc::clone(&self.publisher.plan);
        for (camera, topics) in plan.cameras.iter().enumerate() {
            let state = &mut self.publisher.cameras[camera];
            if !std::mem::replace(&mut state.sensor_told, true) {
                let sensor = state.plan.sensor.clone();
                let header = Header { stamp_ns: self.stamp_ns, frame_id: &topics.optical_frame };
                self.add(topics.sensor, header.stamp_ns, |out| encode::sensor_model(out, header, &sensor));
            }
        }
    }

    /// A camera's events, in one message or in parts.
    pub fn events(&mut self, camera: usize, packet: &PacketView<'_>) -> &mut Self {
        let plan = Arc::clone(&self.publisher.plan);
        let Some(topics) = plan.cameras.get(camera) else { return self };
        let (format, split) = (self.publisher.options.events, self.publisher.cameras[camera].plan.split);
        let offset_ns = self.publisher.clock.wall_offset_ns.unwrap_or(0);
        let shifted = PacketView {
            base_ns: packet.base_ns + offset_ns,
            watermark_ns: packet.watermark_ns + offset_ns,
            ..*packet
        };
        let parts = split.parts(&shifted, format);
        let last = parts.len().saturating_sub(1);
        for (number, part) in parts.iter().enumerate() {
            // The last part has the tick's stamp, whatever the sensor's clock makes of its end.
            let stamp_ns = if number == last { self.stamp_ns } else { part.watermark_ns };
            let state = &mut self.publisher.cameras[camera];
            let sequence = state.sequence;
            state.sequence += 1;
            let sensor_name = state.plan.sensor.name.clone();
            let header = Header { stamp_ns, frame_id: &topics.optical_frame };
            let head = PacketHead { header, sequence, sensor_name: &sensor_name };
            self.add(topics.events, stamp_ns, |out| events::encode(out, format, &head, part));
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

    /// A camera's colour image, `rgb8`; `pixels` appends them row by row.
    pub fn rgb(&mut self, camera: usize, pixels: impl FnOnce(&mut Vec<u8>)) -> &mut Self {
        self.image_on(camera, |topics| topics.image, self.stamp_ns, "rgb8", 3, pixels)
    }

    /// A camera's depth, metres along the view axis; what has none is NaN on the wire.
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
            self.add(topic, stamped.t_ns, |out| encode::imu(out, &topics.body_frame, &stamped));
        }
        self
    }

    /// An image and its camera info, with one stamp.
    fn image_on(
        &mut self,
        camera: usize,
        topic: impl Fn(&crate::plan::CameraTopics) -> Option<(usize, usize)>,
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
        let intrinsics = state.plan.intrinsics;
        let header = Header { stamp_ns, frame_id: &topics.optical_frame };
        let shape = Image { width_px, height_px, encoding, pixel_bytes };
        self.add(image, stamp_ns, |out| encode::image(out, header, shape, pixels));
        self.add(info, stamp_ns, |out| {
            encode::camera_info(out, header, (width_px, height_px), intrinsics);
        });
        self
    }

    /// Hands the tick over. With [`Policy::Latest`] this never waits.
    pub fn send(self) {
        let batch = Batch { stamp_ns: self.stamp_ns, encoded: Instant::now(), messages: self.messages };
        self.publisher.enqueue(batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_goes_back_only_where_the_simulation_was_reset() {
        let mut clock = StampClock::default();
        assert_eq!([clock.tick(10, true), clock.tick(20, true)], [(10, true), (20, true)]);
        assert_eq!(clock.tick(15, true), (15, false), "a camera that is behind");
        clock.restarted = true;
        assert_eq!((clock.tick(3, true), clock.resets), ((3, true), 1));
        assert_eq!((clock.log(3), clock.log(5)), (20, 22));
        assert_eq!((clock.tick(2, true), clock.resets), ((2, false), 1));
    }

    #[test]
    fn wall_time_starts_now_and_goes_on_with_the_simulation() {
        let mut clock = StampClock::default();
        let (first_ns, _) = clock.tick(5, false);
        assert!(first_ns > 1_600_000_000_000_000_000);
        assert_eq!(clock.tick(1_005, false).0, first_ns + 1_000);
    }
}
