//! The rig's side of publishing: encodes what a tick gave into buffers that the wire and the bag share, and
//! hands the tick over to the publisher's thread.

mod clock;
mod tick;

pub use tick::{ApsImage, TickMessages};

use crate::bag::{BagError, BagWriter};
use crate::payload::Pool;
use crate::plan::{CameraPlan, Plan, PlanError, Policy, RigOptions};
use crate::statistics::{Statistics, Summary};
use crate::transport::{Transport, TransportError};
use crate::worker::{self, Batch};
use clock::StampClock;
use crossbeam_channel::{Receiver, SendTimeoutError, Sender, TrySendError, bounded, unbounded};
use esaac_model::SensorModel;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
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

/// How long a full queue is waited for before a look at the thread that empties it.
const LOOK: Duration = Duration::from_millis(100);

/// Most messages of a topic in a tick as a rule: samples of an IMU at 1 kHz, packets of a 960th second.
const IMU_SAMPLES: usize = 34;

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
    /// By topic.
    pools: Vec<Pool>,
    queue: Sender<Batch>,
    /// The other end of the queue, to take the oldest out where it is full.
    oldest: Receiver<Batch>,
    notices: Receiver<String>,
    statistics: Arc<Statistics>,
    worker: Option<JoinHandle<Result<(), BagError>>>,
    clock: StampClock,
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
        let buffers = (options.queue_ticks * IMU_SAMPLES).min(1024);
        let pools = plan.topics.iter().map(|_| Pool::new(buffers)).collect();
        let cameras =
            cameras.into_iter().map(|plan| CameraState { plan, sequence: 0, sensor_told: false }).collect();
        Ok(RigPublisher {
            options,
            plan,
            cameras,
            pools,
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
        let first = self.clock.is_new();
        let (stamp_ns, goes_on) = self.clock.tick(t_ns, self.options.sim_time);
        self.statistics.set_resets(self.clock.resets);
        let mut tick = TickMessages::new(self, stamp_ns);
        if goes_on {
            tick.clock();
        }
        if first {
            tick.frames();
        }
        tick.sensors();
        tick
    }

    /// The simulation was reset: its time may go back with the next tick. Stamps and `/clock` go back with
    /// it; wall-clock stamps and a recording's own times go on.
    pub fn restart(&mut self) {
        self.clock.restart();
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
