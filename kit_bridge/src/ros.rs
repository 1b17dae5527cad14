//! `RosPublisher`: sends and records a rig's ROS 2 topics without the interpreter's lock. `esaac/ros.py` wraps it in
//! the class that users see, and gives it contiguous arrays.

use crate::error::Fault;
use crate::process::OwnProcess;
use crate::ros_tick::Part;
use crate::sensor::PySensor;
use esaac_model::paths::{Intrinsics, LensError};
use esaac_ros::qos::QosError;
use esaac_ros::{
    BagWriter, CameraPlan, CameraStatus, CycloneTransport, Instance, NetworkOptions, Policy, QosChange,
    RigOptions, RigPublisher, Sinks, Split, names,
};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Fails for a topic or a frame id that ROS would refuse.
#[pyfunction]
pub fn check_ros_names(topic: &str, frame_id: Option<&str>) -> PyResult<()> {
    let checked = names::check_topic(topic).and_then(|()| frame_id.map_or(Ok(()), names::check_frame));
    Ok(checked.map_err(|error| Fault::Argument(error.to_string()))?)
}

/// The fields of `esaac.ros.Camera`.
#[derive(FromPyObject)]
struct Camera {
    name: String,
    sensor: Py<PySensor>,
    focal_px: Option<[f64; 2]>,
    centre_px: Option<[f64; 2]>,
    rgb: bool,
    depth: bool,
    imu: bool,
    event_ids: bool,
    frame_id: Option<String>,
}

/// Id, name and labels of an instance. A label is a kind and a text.
type Named = (i64, String, Vec<(String, String)>);

/// The options of `esaac.ros.Publisher`.
#[derive(FromPyObject)]
struct Options {
    namespace: String,
    node: String,
    events: String,
    lossless: bool,
    sim_time: bool,
    qos: Vec<(String, String)>,
    slice_ns: u32,
    max_bytes: u32,
    network: bool,
    domain: Option<u32>,
    interface: Option<String>,
    record: Option<PathBuf>,
}

/// Publishes the cameras of a rig: see `esaac/ros.pyi`.
#[pyclass(module = "esaac._native", frozen)]
pub struct RosPublisher {
    publisher: OwnProcess<Mutex<Option<RigPublisher>>>,
    cameras: Vec<CameraPlan>,
    topics: Vec<(String, String)>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[pymethods]
impl RosPublisher {
    #[new]
    fn new(py: Python<'_>, cameras: Vec<Camera>, options: Options) -> PyResult<Self> {
        let split = Split { slice_ns: options.slice_ns, max_bytes: options.max_bytes };
        let cameras: Vec<CameraPlan> =
            cameras.into_iter().map(|camera| camera.plan(split)).collect::<Result<_, _>>()?;
        let rig = options.rig()?;
        let plans = cameras.clone();
        let publisher = py.detach(|| {
            // Check names first: no network is needed for that, and no file is made in vain.
            esaac_ros::Plan::new(&plans, &rig).map_err(|error| Fault::Argument(error.to_string()))?;
            let bag = options.record.as_deref().map(BagWriter::create).transpose().map_err(ros)?;
            let transport = if options.network { Some(options.open()?) } else { None };
            let sinks = Sinks { transport: transport.map(|transport| Box::new(transport) as Box<_>), bag };
            Ok::<_, Fault>(RigPublisher::start(plans, rig, sinks)?)
        })?;
        let topics = publisher.plan().topics.iter().map(|t| (t.name.clone(), t.type_name.clone())).collect();
        Ok(RosPublisher { publisher: OwnProcess::new(Mutex::new(Some(publisher))), cameras, topics })
    }

    /// Names and types.
    #[getter]
    fn topics(&self) -> Vec<(String, String)> {
        self.topics.clone()
    }

    /// Sends one tick.
    fn publish(&self, py: Python<'_>, t_ns: i64, parts: Vec<Part<'_>>) -> PyResult<()> {
        let parts = parts.iter().map(|part| part.borrow(&self.cameras)).collect::<Result<Vec<_>, Fault>>()?;
        self.with(py, move |publisher| {
            parts.iter().try_for_each(|part| part.check(publisher))?;
            let mut tick = publisher.tick(t_ns);
            parts.iter().for_each(|part| part.add(&mut tick));
            tick.send();
            Ok(())
        })
    }

    /// Publishes a camera's parameters again after they have changed.
    fn set_sensor(&self, py: Python<'_>, camera: usize, sensor: PyRef<'_, PySensor>) -> PyResult<()> {
        let sensor = sensor.0.clone();
        self.with(py, move |publisher| Ok(publisher.set_sensor(camera, &sensor)?))
    }

    /// Publishes which instances a camera's ids are.
    fn set_instances(&self, py: Python<'_>, camera: usize, instances: Vec<Named>) -> PyResult<()> {
        let instance = |(id, name, labels)| Instance { id, name, labels };
        let instances = instances.into_iter().map(instance).collect();
        self.with(py, move |publisher| Ok(publisher.set_instances(camera, instances)?))
    }

    /// Shows what is known of a camera on `/diagnostics`: names and values, and warnings.
    fn set_status(
        &self,
        py: Python<'_>,
        camera: usize,
        values: Vec<(String, String)>,
        warnings: Vec<String>,
    ) -> PyResult<()> {
        self.with(py, move |publisher| Ok(publisher.set_status(camera, CameraStatus { values, warnings })?))
    }

    /// Allows the next tick to be earlier than the last.
    fn restart(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |publisher| {
            publisher.restart();
            Ok(())
        })
    }

    /// Messages for the user since the last call.
    fn notices(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |publisher| Ok(publisher.notices()))
    }

    /// Counts of what was sent, as JSON.
    fn summary(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |publisher| Ok(json(&publisher.summary())))
    }

    /// Sends what is queued and ends. Returns counts of what was sent as JSON, and None at a second call.
    fn close(&self, py: Python<'_>) -> PyResult<Option<String>> {
        let publisher = self.publisher.get()?;
        Ok(py.detach(|| {
            let Some(publisher) = lock(publisher).take() else { return Ok(None) };
            let (summary, _, recorded) = publisher.finish();
            recorded.map_err(|error| Fault::Ros(format!("the recording is not whole: {error}")))?;
            Ok::<_, Fault>(Some(json(&summary)))
        })?)
    }
}

fn ros(error: impl std::fmt::Display) -> Fault {
    Fault::Ros(error.to_string())
}

fn json(summary: &esaac_ros::Summary) -> String {
    serde_json::to_string(summary).expect("a struct of numbers")
}

impl Camera {
    fn plan(self, split: Split) -> Result<CameraPlan, Fault> {
        let wrong = |what: &str, actual: [f64; 2], expected: &str| {
            let name = &self.name;
            Fault::Argument(format!("{what} of `{name}` is {actual:?}, expected {expected}"))
        };
        let sensor = self.sensor.get().0.clone();
        let middle = [sensor.width, sensor.height].map(|side| 0.5 * (f64::from(side) - 1.0));
        let centre_px = self.centre_px.unwrap_or(middle);
        let lens = |focal_px: [f64; 2]| {
            let ([fx, fy], [cx, cy]) = (focal_px, centre_px);
            Intrinsics::pinhole(fx, fy, cx, cy).map_err(|error| match error {
                LensError::Focal { .. } => wrong("focal_px", focal_px, "finite numbers above 0"),
                LensError::Centre { .. } => wrong("centre_px", centre_px, "finite numbers"),
            })
        };
        let lens = self.focal_px.map(lens).transpose()?;
        Ok(CameraPlan {
            name: self.name,
            sensor,
            lens,
            image: self.rgb,
            depth: self.depth,
            imu: self.imu,
            event_ids: self.event_ids,
            split,
            frame_id: self.frame_id,
        })
    }
}

impl Options {
    fn rig(&self) -> Result<RigOptions, Fault> {
        let argument = |error: String| Fault::Argument(error);
        let qos = |(topic, words): &(String, String)| {
            let change: QosChange = words.parse().map_err(|error: QosError| argument(error.to_string()))?;
            Ok::<_, Fault>((topic.trim_matches('/').to_owned(), change))
        };
        Ok(RigOptions {
            namespace: self.namespace.clone(),
            node: self.node.clone(),
            events: self.events.parse().map_err(argument)?,
            policy: if self.lossless { Policy::Lossless } else { Policy::Latest },
            sim_time: self.sim_time,
            qos: self.qos.iter().map(qos).collect::<Result<_, _>>()?,
            ..RigOptions::default()
        })
    }

    fn open(&self) -> Result<CycloneTransport, Fault> {
        let from = NetworkOptions::from_environment(|name| std::env::var(name).ok()).map_err(ros)?;
        CycloneTransport::open(NetworkOptions {
            domain: self.domain.unwrap_or(from.domain),
            interface: self.interface.clone(),
            node: self.node.clone(),
            ..from
        })
        .map_err(ros)
    }
}

impl RosPublisher {
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut RigPublisher) -> Result<T, Fault> + Send,
    ) -> PyResult<T> {
        let publisher = self.publisher.get()?;
        Ok(py.detach(|| work(lock(publisher).as_mut().ok_or(Fault::Closed("the publisher"))?))?)
    }
}
