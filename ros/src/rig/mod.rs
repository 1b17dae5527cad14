//! The rig's side of publishing: encodes the results of a tick into buffers that the wire and the bag share,
//! and hands the tick over to the publisher's thread.

mod clock;
mod labels;
mod tick;

pub use tick::{ApsImage, TickMessages};

use crate::bag::{BagError, BagWriter};
use crate::encode;
use crate::events::EventFormat;
use crate::payload::Pool;
use crate::plan::{CameraPlan, Plan, PlanError, Policy, RigOptions};
use crate::queue::{Batch, Outgoing, TickSender, queue};
use crate::statistics::{CameraStatus, Statistics, Summary};
use crate::transport::{Transport, TransportError};
use crate::worker::{self, UnsentStates, Worker};
use clock::StampClock;
use crossbeam_channel::{Receiver, Sender, unbounded};
use esaac_model::{PacketView, SensorModel};
use labels::Labels;
use std::sync::Arc;
use std::thread::JoinHandle;
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
    #[error("camera {actual}, expected a number below {expected}")]
    NoCamera {
        /// Cameras.
        expected: usize,
        /// Number given.
        actual: usize,
    },
    /// A packet that its event message cannot hold.
    #[error(
        "events of camera `{camera}` count from {actual} ns, expected 0 or later for the event message `mono`; the \
         others have times before 0"
    )]
    BaseBeforeZero {
        /// Camera.
        camera: String,
        /// Base of the packet.
        actual: i64,
    },
    /// Ids or instances of a camera that has no topics for them.
    #[error("camera `{camera}` has ids or instances, expected none: it was announced without event_ids")]
    NoEventIds {
        /// Camera.
        camera: String,
    },
    /// Ids that are not one for each event.
    #[error("camera `{camera}` has {actual} ids, expected {expected}, one for each event")]
    IdCount {
        /// Camera.
        camera: String,
        /// Events.
        expected: usize,
        /// Ids.
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

/// Most messages that a topic usually has in a tick: samples of an IMU at 1 kHz, packets of a 960th second.
const IMU_SAMPLES: usize = 34;

struct CameraState {
    plan: CameraPlan,
    sequence: u64,
    sensor_is_stale: bool,
    /// End of its last packet in simulation time.
    last_ns: Option<i64>,
    /// Whether the clock is this camera's time too: it has reached the clock since it began, and goes on.
    holds_clock: bool,
    /// Whether the user knows that its packets cannot be sent.
    is_refused: bool,
    labels: Labels,
}

/// Publishes a rig.
pub struct RigPublisher {
    options: RigOptions,
    plan: Arc<Plan>,
    cameras: Vec<CameraState>,
    /// By topic.
    pools: Vec<Pool>,
    /// States that no tick has taken to the queue yet.
    states: Vec<Outgoing>,
    /// `None` once the rig is finished.
    queue: Option<TickSender>,
    notify: Sender<String>,
    notices: Receiver<String>,
    statistics: Arc<Statistics>,
    worker: Option<JoinHandle<Result<(), BagError>>>,
    clock: StampClock,
    /// Whether the user knows of stamps that messages cannot hold.
    is_far: bool,
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
        let (sender, receiver) = queue(options.queue_ticks);
        let (notify, notices) = unbounded();
        let statistics = Arc::new(Statistics::new(&plan, transport.as_deref(), bag.is_some()));
        let worker = worker::start(Worker {
            plan: Arc::clone(&plan),
            node: options.node.clone(),
            transport,
            bag,
            statistics: Arc::clone(&statistics),
            notices: notify.clone(),
            queue: receiver,
            ticks_ahead: (options.policy == Policy::Lossless).then_some(options.queue_ticks),
            states: UnsentStates::default(),
        })
        .map_err(PublishError::Thread)?;
        // As many free buffers as a full queue of ticks leaves behind, up to a limit.
        let buffers = (options.queue_ticks * IMU_SAMPLES).min(1024);
        let pools = plan.topics.iter().map(|_| Pool::new(buffers)).collect();
        let cameras = cameras
            .into_iter()
            .map(|plan| CameraState {
                plan,
                sequence: 0,
                sensor_is_stale: true,
                last_ns: None,
                holds_clock: false,
                is_refused: false,
                labels: Labels::default(),
            })
            .collect();
        Ok(RigPublisher {
            options,
            plan,
            cameras,
            pools,
            states: Vec::new(),
            queue: Some(sender),
            notify,
            notices,
            statistics,
            worker: Some(worker),
            clock: StampClock::default(),
            is_far: false,
        })
    }

    /// The topics.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Fails if there is no such camera.
    pub fn check_camera(&self, camera: usize) -> Result<(), PublishError> {
        let expected = self.cameras.len();
        if camera < expected { Ok(()) } else { Err(PublishError::NoCamera { expected, actual: camera }) }
    }

    /// Fails if the event message cannot hold a packet that counts from `base_ns` in simulation time. Such a packet
    /// is not sent, with a notice.
    pub fn check_base(&self, camera: usize, base_ns: i64) -> Result<(), PublishError> {
        self.check_camera(camera)?;
        if self.options.events == EventFormat::Mono && self.options.sim_time && base_ns < 0 {
            let camera = self.cameras[camera].plan.name.clone();
            return Err(PublishError::BaseBeforeZero { camera, actual: base_ns });
        }
        Ok(())
    }

    /// Publishes a camera's changed parameters with the next tick.
    pub fn set_sensor(&mut self, camera: usize, sensor: &SensorModel) -> Result<(), PublishError> {
        self.check_camera(camera)?;
        let state = &mut self.cameras[camera];
        state.plan.sensor = sensor.clone();
        state.sensor_is_stale = true;
        Ok(())
    }

    /// Shows what is known of a camera on `/diagnostics`, which is published once a second and at the end, until the next
    /// call.
    pub fn set_status(&mut self, camera: usize, status: CameraStatus) -> Result<(), PublishError> {
        self.check_camera(camera)?;
        self.statistics.set_camera(camera, &self.cameras[camera].plan.name, status);
        Ok(())
    }

    /// Begins the messages of the tick at `t_ns`. Nothing is sent before [`TickMessages::send`].
    pub fn tick(&mut self, t_ns: i64) -> TickMessages<'_> {
        let first = self.clock.is_new();
        let (stamp_ns, goes_on) = self.clock.tick(t_ns, self.options.sim_time);
        self.statistics.set_resets(self.clock.resets);
        if !encode::holds_time(stamp_ns) && !std::mem::replace(&mut self.is_far, true) {
            let _ = self.notify.send(format!(
                "a tick is at {stamp_ns} ns, expected within +-2^31 s, which stamps of ROS can hold: the seconds of stamps stay \
                 at that limit"
            ));
        }
        let mut tick = TickMessages::new(self, stamp_ns);
        if goes_on {
            tick.clock();
        }
        if first {
            tick.frames();
        }
        tick.sensors();
        tick.instances();
        tick
    }

    /// The simulation was reset: its time may go back with the next tick. Stamps and `/clock` go back with
    /// it; wall-clock stamps and a recording's own times go on. A camera whose time goes back without this gives
    /// a notice: its stamps go back, and `/clock` does not.
    pub fn restart(&mut self) {
        self.clock.restart();
        for camera in &mut self.cameras {
            (camera.last_ns, camera.holds_clock) = (None, false);
        }
    }

    /// One camera begins anew with a frame at `t_ns`, which comes with the next tick: its time may go back. Stamps and
    /// `/clock` go back with it if no other camera goes on from where the clock is; else the clock stays, and this camera is
    /// behind.
    pub fn begin_camera(&mut self, camera: usize, t_ns: i64) -> Result<(), PublishError> {
        self.end_camera(camera)?;
        let is_behind = self.clock.is_past(self.clock.stamp(t_ns));
        if is_behind && self.cameras.iter().any(|camera| camera.holds_clock) {
            return Ok(());
        }
        if is_behind {
            self.clock.restart();
        }
        self.cameras[camera].holds_clock = true;
        Ok(())
    }

    /// A camera has no more frames until it begins anew. The clock no longer waits for it.
    pub fn end_camera(&mut self, camera: usize) -> Result<(), PublishError> {
        self.check_camera(camera)?;
        let state = &mut self.cameras[camera];
        (state.last_ns, state.holds_clock) = (None, false);
        Ok(())
    }

    /// Whether a camera's packet can be sent. Gives notices of what is wrong with its time.
    fn admits(&mut self, camera: usize, packet: &PacketView<'_>) -> bool {
        if let Err(error) = self.check_base(camera, packet.base_ns) {
            if let Some(state) = self.cameras.get_mut(camera)
                && !std::mem::replace(&mut state.is_refused, true)
            {
                let _ = self.notify.send(format!("{error}; its events are not sent"));
            }
            return false;
        }
        let state = &mut self.cameras[camera];
        let end_ns = packet.watermark_ns;
        if let Some(last_ns) = state.last_ns.replace(end_ns).filter(|&last_ns| end_ns < last_ns) {
            let name = &state.plan.name;
            let _ = self.notify.send(format!(
                "the time of camera `{name}` went back from {last_ns} to {end_ns} ns, and `restart` was not called: \
                 stamps go back, /clock stays, and a recording is out of order"
            ));
            self.statistics.count_unannounced_reset();
        }
        true
    }

    /// Messages for the user since the last call.
    pub fn notices(&self) -> Vec<String> {
        self.notices.try_iter().collect()
    }

    /// Counts of the messages so far.
    #[must_use]
    pub fn summary(&self) -> Summary {
        self.statistics.summary(&self.plan)
    }

    /// Sends the ticks that wait and closes the recording. Returns the counts, the last notices and the
    /// recording's result. After an error the recording is complete up to the message that failed.
    pub fn finish(mut self) -> (Summary, Vec<String>, Result<(), BagError>) {
        let result = self.stop();
        (self.summary(), self.notices(), result)
    }

    fn stop(&mut self) -> Result<(), BagError> {
        // The thread ends when the queue has no sender any more.
        self.queue = None;
        match self.worker.take().map(JoinHandle::join) {
            None => Ok(()),
            Some(Ok(result)) => result,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
        }
    }

    fn enqueue(&mut self, batch: Batch) {
        let Some(queue) = &self.queue else { return };
        let dropped = match self.options.policy {
            Policy::Latest => queue.push_latest(batch),
            Policy::Lossless => queue.push_waiting(batch),
        };
        self.statistics.count_dropped(&dropped);
    }
}

impl Drop for RigPublisher {
    fn drop(&mut self) {
        if self.worker.is_some() && !std::thread::panicking() {
            // The caller did not ask for the result by calling `finish`.
            let _ = self.stop();
        }
    }
}
