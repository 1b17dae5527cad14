//! The topics of a rig, with names, types and quality of service, checked before anything is created.

use crate::events::{EventFormat, Split};
use crate::message::MessageType;
use crate::names::{self, NameError};
use crate::qos::{Durability, Qos, QosChange};
use esaac_model::SensorModel;
use esaac_model::paths::Intrinsics;
use std::time::Duration;
use thiserror::Error;

/// A topic as transports and bags see it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Absolute name.
    pub name: String,
    /// Type, `pkg/msg/Name`.
    pub type_name: String,
    /// Type hash, if it is known.
    pub type_hash: Option<String>,
    /// Definition, with those of all types that it contains.
    pub schema: String,
    /// Quality of service offered.
    pub qos: Qos,
    /// How long a message waits for subscribers that have not fetched earlier ones. 0: it never waits.
    pub patience: Duration,
}

impl Topic {
    fn new(name: String, message: MessageType, qos: Qos) -> Self {
        Topic {
            name,
            type_name: message.name().to_owned(),
            type_hash: Some(message.type_hash()),
            schema: message.schema(),
            qos,
            patience: Duration::ZERO,
        }
    }
}

/// A camera that is published.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPlan {
    /// Its part of the namespace.
    pub name: String,
    /// Its sensor.
    pub sensor: SensorModel,
    /// Its lens, if it is known.
    pub lens: Option<Intrinsics>,
    /// Whether colour images of it are published.
    pub image: bool,
    /// Whether depth images of it are published.
    pub depth: bool,
    /// Whether IMU samples of it are published.
    pub imu: bool,
    /// Whether the instance that each of its events shows is published, with a table of instances.
    pub event_ids: bool,
    /// Division of its packets.
    pub split: Split,
    /// Its optical frame. By default the words of its namespace and `optical_frame`.
    pub frame_id: Option<String>,
}

/// What happens to a tick while earlier ones wait to be sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// A full queue drops and counts the oldest tick. Messages that are sent once (`sensor`, `/tf_static`)
    /// move on to the next tick.
    #[default]
    Latest,
    /// A full queue makes the simulation wait, and topics keep longer histories for slow subscribers. Work
    /// that the device has begun goes on.
    Lossless,
}

/// Options of a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct RigOptions {
    /// Namespace of all cameras.
    pub namespace: String,
    /// Name of the node.
    pub node: String,
    /// Message type and encoding of events.
    pub events: EventFormat,
    /// What happens when messages wait.
    pub policy: Policy,
    /// Number of ticks that may wait.
    pub queue_ticks: usize,
    /// Whether stamps are simulation times, with `/clock` published; otherwise they are wall-clock times.
    pub sim_time: bool,
    /// Changes of quality of service, by the topic's name in the camera's namespace, or `all`.
    pub qos: Vec<(String, QosChange)>,
}

impl Default for RigOptions {
    fn default() -> Self {
        RigOptions {
            namespace: "/esaac".to_owned(),
            node: "esaac".to_owned(),
            events: EventFormat::default(),
            policy: Policy::default(),
            queue_ticks: 8,
            sim_time: true,
            qos: Vec::new(),
        }
    }
}

/// Why a plan is not possible.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PlanError {
    /// A name.
    #[error(transparent)]
    Name(#[from] NameError),
    /// Two cameras have the same name.
    #[error("two cameras are named `{0}`, expected a name for each")]
    Twice(String),
    /// A sensor is too large for the encoding of events.
    #[error(
        "camera `{camera}` has {actual} px on a side, expected at most {expected} for this event message"
    )]
    TooLarge {
        /// Camera.
        camera: String,
        /// Limit.
        expected: u32,
        /// Longer side.
        actual: u32,
    },
    /// Messages would cover too little time.
    #[error(
        "slices of {actual} ns for camera `{camera}`, expected 0, or {} to {}",
        Split::LEAST_SLICE_NS,
        u32::MAX
    )]
    Slice {
        /// Camera.
        camera: String,
        /// Length given.
        actual: u32,
    },
    /// Quality of service for an unknown topic.
    #[error("quality of service for `{given}`, expected one of the topics: all, {}", topics.join(", "))]
    UnknownTopic {
        /// Name given.
        given: String,
        /// Known names.
        topics: Vec<&'static str>,
    },
    /// The queue has no room for a tick.
    #[error("a queue of 0 ticks, expected 1 or more")]
    NoQueue,
}

/// A camera's topics, by their numbers in the plan. An image comes with its camera info.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct CameraTopics {
    pub events: usize,
    pub sensor: usize,
    pub image: Option<(usize, usize)>,
    pub aps: Option<(usize, usize)>,
    pub depth: Option<(usize, usize)>,
    pub imu: Option<usize>,
    pub event_ids: Option<usize>,
    pub instances: Option<usize>,
    pub optical_frame: String,
    pub body_frame: String,
}

/// All topics of a rig.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Topics, in the order of their numbers.
    pub topics: Vec<Topic>,
    pub(crate) cameras: Vec<CameraTopics>,
    pub(crate) clock: Option<usize>,
    pub(crate) diagnostics: usize,
    pub(crate) frames: usize,
}

impl Plan {
    /// Plans the topics of `cameras`.
    pub fn new(cameras: &[CameraPlan], options: &RigOptions) -> Result<Self, PlanError> {
        names::check_namespace(&options.namespace)?;
        names::check_node(&options.node)?;
        if options.queue_ticks == 0 {
            return Err(PlanError::NoQueue);
        }
        let mut lay = Layout { options, topics: Vec::new(), relative: Vec::new() };
        let clock = options.sim_time.then(|| lay.add("/", "clock", MessageType::Clock, Qos::sensor_data(10)));
        let diagnostics = lay.add("/", "diagnostics", MessageType::DiagnosticArray, Qos::sensor_data(10));
        let frames = lay.add("/", "tf_static", MessageType::Transforms, Qos::latched());
        let mut placed: Vec<CameraTopics> = Vec::new();
        for (number, camera) in cameras.iter().enumerate() {
            if cameras[..number].iter().any(|other| other.name == camera.name) {
                return Err(PlanError::Twice(camera.name.clone()));
            }
            let (expected, actual) =
                (options.events.side_limit_px(), camera.sensor.width.max(camera.sensor.height));
            if actual > expected {
                return Err(PlanError::TooLarge { camera: camera.name.clone(), expected, actual });
            }
            if !camera.split.has_valid_slice() {
                return Err(PlanError::Slice { camera: camera.name.clone(), actual: camera.split.slice_ns });
            }
            placed.push(lay.camera(camera)?);
        }
        lay.topics.iter().try_for_each(|topic| names::check_topic(&topic.name))?;
        for (given, _) in &options.qos {
            if given != "all" && !lay.relative.iter().any(|name| name == given) {
                let mut topics = lay.relative.clone();
                topics.sort_unstable();
                topics.dedup();
                return Err(PlanError::UnknownTopic { given: given.clone(), topics });
            }
        }
        Ok(Plan { topics: lay.topics, cameras: placed, clock, diagnostics, frames })
    }
}

/// End of an optical frame's name (REP 103).
const OPTICAL: &str = "_optical_frame";

/// History of images.
const IMAGES: u32 = 5;
/// History of IMU samples: a few ticks at 1 kHz.
const IMU_SAMPLES: u32 = 200;
/// History of event packets: a second at 960 Hz, as camera drivers have it.
const PACKETS: u32 = 1000;

/// Factor of a lossless rig's histories, for slow subscribers.
const LOSSLESS_DEPTH: u32 = 100;
/// How long a lossless rig waits for a subscriber that has half a gigabyte to fetch. DDS forgets a dead one
/// earlier.
const PATIENCE: Duration = Duration::from_secs(12);

struct Layout<'a> {
    options: &'a RigOptions,
    topics: Vec<Topic>,
    relative: Vec<&'static str>,
}

impl Layout<'_> {
    fn add(&mut self, namespace: &str, relative: &'static str, message: MessageType, qos: Qos) -> usize {
        let lossless = self.options.policy == Policy::Lossless;
        let depth = if lossless { qos.depth.saturating_mul(LOSSLESS_DEPTH) } else { qos.depth };
        let qos = if qos.durability == Durability::Volatile { Qos { depth, ..qos } } else { qos };
        let changes = self.options.qos.iter().filter(|(name, _)| name == "all" || name == relative);
        let qos = changes.fold(qos, |qos, (_, change)| change.apply(qos));
        let patience = if lossless { PATIENCE } else { Duration::ZERO };
        let topic = Topic::new(names::join(namespace, relative), message, qos);
        self.topics.push(Topic { patience, ..topic });
        self.relative.push(relative);
        self.topics.len() - 1
    }

    fn camera(&mut self, camera: &CameraPlan) -> Result<CameraTopics, PlanError> {
        let namespace = names::join(&self.options.namespace, &camera.name);
        names::check_namespace(&namespace)?;
        let optical_frame = match &camera.frame_id {
            Some(frame_id) => frame_id.clone(),
            None => format!("{}{OPTICAL}", namespace[1..].replace('/', "_")),
        };
        let body_frame = format!("{}_link", optical_frame.strip_suffix(OPTICAL).unwrap_or(&optical_frame));
        names::check_frame(&optical_frame)?;
        let mut images = |image: &'static str, info: &'static str| {
            let qos = Qos::sensor_data(IMAGES);
            (
                self.add(&namespace, image, MessageType::Image, qos),
                self.add(&namespace, info, MessageType::CameraInfo, qos),
            )
        };
        let image = camera.image.then(|| images("image_raw", "camera_info"));
        let aps = (camera.sensor.aps_exposure_ns > 0).then(|| images("aps/image_raw", "aps/camera_info"));
        let depth = camera.depth.then(|| images("depth/image_raw", "depth/camera_info"));
        Ok(CameraTopics {
            events: self.add(&namespace, "events", self.options.events.message(), Qos::sensor_data(PACKETS)),
            sensor: self.add(&namespace, "sensor", MessageType::SensorModel, Qos::latched()),
            image,
            aps,
            depth,
            imu: camera
                .imu
                .then(|| self.add(&namespace, "imu", MessageType::Imu, Qos::sensor_data(IMU_SAMPLES))),
            event_ids: camera
                .event_ids
                .then(|| self.add(&namespace, "event_ids", MessageType::EventIds, Qos::sensor_data(PACKETS))),
            instances: camera
                .event_ids
                .then(|| self.add(&namespace, "instances", MessageType::Instances, Qos::latched())),
            optical_frame,
            body_frame,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::qos::Reliability;

    fn camera(name: &str) -> CameraPlan {
        let sensor = SensorModel { aps_exposure_ns: 1, ..SensorModel::default() };
        CameraPlan {
            name: name.to_owned(),
            sensor,
            lens: None,
            image: true,
            depth: true,
            imu: true,
            event_ids: true,
            split: Split::default(),
            frame_id: None,
        }
    }

    #[test]
    fn a_camera_has_its_topics_under_its_namespace() {
        let mut options = RigOptions { events: EventFormat::Evt3, ..RigOptions::default() };
        options.qos = vec![
            ("all".to_owned(), "depth:3".parse().unwrap()),
            ("imu".to_owned(), "best_effort".parse().unwrap()),
        ];
        let plan = Plan::new(&[camera("left")], &options).unwrap();
        let names: Vec<&str> = plan.topics.iter().map(|topic| topic.name.as_str()).collect();
        let expected = "/clock /diagnostics /tf_static /esaac/left/image_raw /esaac/left/camera_info \
             /esaac/left/aps/image_raw /esaac/left/aps/camera_info /esaac/left/depth/image_raw \
             /esaac/left/depth/camera_info /esaac/left/events /esaac/left/sensor /esaac/left/imu \
             /esaac/left/event_ids /esaac/left/instances";
        assert_eq!(names, expected.split_whitespace().collect::<Vec<_>>());
        let topics = &plan.cameras[0];
        assert_eq!(plan.topics[topics.events].type_name, "event_camera_msgs/msg/EventPacket");
        assert_eq!(topics.optical_frame, "esaac_left_optical_frame");
        assert!(plan.topics.iter().all(|topic| topic.qos.depth == 3));
        assert_eq!(plan.topics[topics.imu.unwrap()].qos.reliability, Reliability::BestEffort);
        let without = CameraPlan { event_ids: false, ..camera("left") };
        assert_eq!(Plan::new(&[without], &options).unwrap().topics.len(), plan.topics.len() - 2);
        options.sim_time = false;
        assert_eq!(Plan::new(&[camera("left")], &options).unwrap().clock, None);
        let frames = |frame_id: &str| {
            let named = CameraPlan { frame_id: Some(frame_id.to_owned()), ..camera("left") };
            let plan = Plan::new(&[named], &RigOptions::default()).unwrap();
            (plan.cameras[0].optical_frame.clone(), plan.cameras[0].body_frame.clone())
        };
        assert_eq!(frames("sim_camera"), ("sim_camera".to_owned(), "sim_camera_link".to_owned()));
        assert_eq!(frames("a_optical_frame").1, "a_link");
    }

    #[test]
    fn what_cannot_be_is_named() {
        let fail = |cameras: &[CameraPlan], change: fn(&mut RigOptions)| {
            let mut options = RigOptions::default();
            change(&mut options);
            Plan::new(cameras, &options).unwrap_err().to_string()
        };
        let one = [camera("a")];
        let sliced = CameraPlan { split: Split { slice_ns: 1, max_bytes: 0 }, ..camera("a") };
        assert!(fail(&[sliced], |_| ()).contains("slices of 1 ns for camera `a`, expected 0, or 1000 to"));
        assert!(fail(&one, |o| o.namespace = "esaac".to_owned()).contains("`esaac` does not start"));
        assert!(fail(&one, |o| o.node = "my node".to_owned()).contains("node `my node`"));
        assert!(fail(&[camera("a-b")], |_| ()).contains("a-b"));
        assert!(fail(&[camera("a"), camera("a")], |_| ()).contains("two cameras are named `a`"));
        assert!(fail(&one, |o| o.queue_ticks = 0).contains("0 ticks"));
        let error = fail(&one, |o| o.qos = vec![("event".to_owned(), QosChange::default())]);
        assert!(error.contains("`event`") && error.contains("events"), "{error}");
        let mut large = camera("a");
        large.sensor.width = 3000;
        assert!(
            fail(&[large], |o| o.events = EventFormat::Evt3)
                .contains("3000 px on a side, expected at most 2048")
        );
    }
}
