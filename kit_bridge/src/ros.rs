//! `RosPublisher`: a rig's topics of ROS 2, sent and recorded without the interpreter's lock. `esaac/ros.py` gives
//! it the face that users see, and arrays that lie as they are needed here.

use crate::error::Fault;
use crate::process::OwnProcess;
use crate::sensor::PySensor;
use esaac_model::{Intensity, PacketView, SensorModel};
use esaac_ros::qos::QosError;
use esaac_ros::{
    ApsImage, BagWriter, CameraPlan, CycloneTransport, Imu, Intrinsics, NetworkOptions, Policy, QosChange,
    RigOptions, RigPublisher, Sinks, Split, TickMessages, names,
};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Fails for a topic or a frame id that ROS would refuse.
#[pyfunction]
pub fn check_ros_names(topic: &str, frame_id: Option<&str>) -> PyResult<()> {
    let checked = names::check_topic(topic).and_then(|()| frame_id.map_or(Ok(()), names::check_frame));
    Ok(checked.map_err(|error| Fault::Argument(error.to_string()))?)
}

/// A camera as `esaac.ros.Camera` has it.
#[derive(FromPyObject)]
struct Camera {
    name: String,
    sensor: Py<PySensor>,
    focal_px: Option<[f64; 2]>,
    centre_px: Option<[f64; 2]>,
    rgb: bool,
    depth: bool,
    imu: bool,
    frame_id: Option<String>,
}

/// What `esaac.ros.Publisher` was asked for.
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

/// Arrays of a packet.
#[derive(FromPyObject)]
struct Events<'py> {
    x: PyReadonlyArray1<'py, u16>,
    y: PyReadonlyArray1<'py, u16>,
    t_offset_ns: PyReadonlyArray1<'py, u32>,
    p: PyReadonlyArray1<'py, u8>,
    base_ns: i64,
    watermark_ns: i64,
    sequence: u64,
    dropped: u64,
}

/// An APS frame.
#[derive(FromPyObject)]
struct Aps<'py> {
    t_ns: i64,
    bits: u32,
    pixels: PyReadonlyArray2<'py, u16>,
}

/// Time, angular rate, specific force.
type Sample = (i64, [f64; 3], [f64; 3]);

/// One camera's part of a tick.
#[derive(FromPyObject)]
struct Part<'py> {
    camera: usize,
    events: Option<Events<'py>>,
    aps: Option<Aps<'py>>,
    rgb: Option<PyReadonlyArray3<'py, u8>>,
    depth: Option<PyReadonlyArray2<'py, f32>>,
    imu: Vec<Sample>,
}

/// The same without the interpreter.
struct Borrowed<'a> {
    camera: usize,
    events: Option<PacketView<'a>>,
    aps: Option<ApsImage<'a>>,
    rgb: Option<&'a [u8]>,
    depth: Option<&'a [f32]>,
    imu: Vec<Imu>,
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
        let cameras: Vec<CameraPlan> = cameras.into_iter().map(|camera| camera.plan(split)).collect();
        let rig = options.rig()?;
        let plans = cameras.clone();
        let publisher = py.detach(|| {
            // Names are wrong with a network or without, and before a file is made.
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
        let parts = parts.iter().map(|part| self.borrow(part)).collect::<Result<Vec<_>, Fault>>()?;
        self.with(py, move |publisher| {
            let mut tick = publisher.tick(t_ns);
            parts.iter().for_each(|part| part.add(&mut tick));
            tick.send();
            Ok(())
        })
    }

    /// Tells a camera's parameters again: they have changed.
    fn set_sensor(&self, py: Python<'_>, camera: usize, sensor: PyRef<'_, PySensor>) -> PyResult<()> {
        let sensor = sensor.0.clone();
        self.with(py, move |publisher| Ok(publisher.set_sensor(camera, &sensor)?))
    }

    /// Time may go back with the next tick.
    fn restart(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |publisher| {
            publisher.restart();
            Ok(())
        })
    }

    /// What has happened that people should know.
    fn notices(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |publisher| Ok(publisher.notices()))
    }

    /// What was sent, as JSON.
    fn summary(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |publisher| Ok(json(&publisher.summary())))
    }

    /// Sends what waits and ends; what was sent, as JSON. Nothing the second time.
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
    fn plan(self, split: Split) -> CameraPlan {
        let sensor = self.sensor.get().0.clone();
        let middle = [sensor.width, sensor.height].map(|side| 0.5 * (f64::from(side) - 1.0));
        let intrinsics = self
            .focal_px
            .map(|focal_px| Intrinsics { focal_px, centre_px: self.centre_px.unwrap_or(middle) });
        CameraPlan {
            name: self.name,
            sensor,
            intrinsics,
            image: self.rgb,
            depth: self.depth,
            imu: self.imu,
            split,
            frame_id: self.frame_id,
        }
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

    /// A part's arrays, held against what the camera was announced with.
    fn borrow<'a>(&self, part: &'a Part<'_>) -> Result<Borrowed<'a>, Fault> {
        let expected = self.cameras.len();
        let plan = self
            .cameras
            .get(part.camera)
            .ok_or_else(|| Fault::Argument(format!("camera {}, expected one of {expected}", part.camera)))?;
        for (given, announced, what) in [
            (part.rgb.is_some(), plan.image, "rgb"),
            (part.depth.is_some(), plan.depth, "depth"),
            (!part.imu.is_empty(), plan.imu, "imu"),
            (part.aps.is_some(), plan.sensor.aps_exposure_ns > 0, "aps"),
        ] {
            if given && !announced {
                let message = format!("camera `{}` was announced without {what}", plan.name);
                return Err(Fault::Argument(message));
            }
        }
        let aps = part.aps.as_ref().map(|aps| aps.view(plan)).transpose()?;
        let imu = |&(t_ns, angular_rate_rad_s, specific_force_m_s2): &Sample| Imu {
            t_ns,
            angular_rate_rad_s,
            specific_force_m_s2,
        };
        Ok(Borrowed {
            camera: part.camera,
            events: part.events.as_ref().map(|events| events.view(&plan.sensor)).transpose()?,
            aps,
            rgb: part.rgb.as_ref().map(|rgb| image(plan, "rgb", rgb, &[3])).transpose()?,
            depth: part.depth.as_ref().map(|depth| image(plan, "depth", depth, &[])).transpose()?,
            imu: part.imu.iter().map(imu).collect(),
        })
    }
}

/// The elements of an image of a camera's size, rows first.
fn image<'a, T: numpy::Element, D: numpy::ndarray::Dimension>(
    plan: &CameraPlan,
    what: &str,
    array: &'a numpy::PyReadonlyArray<'_, T, D>,
    channels: &[usize],
) -> Result<&'a [T], Fault> {
    use numpy::PyUntypedArrayMethods as _;
    let size = [plan.sensor.height as usize, plan.sensor.width as usize];
    let expected: Vec<usize> = size.iter().chain(channels).copied().collect();
    if array.shape() != expected {
        let message =
            format!("{what} of `{}` has shape {:?}, expected {expected:?}", plan.name, array.shape());
        return Err(Fault::Frame(message));
    }
    flat(what, array.as_slice())
}

/// `esaac/ros.py` hands over arrays without gaps.
fn flat<'a, T>(what: &str, slice: Result<&'a [T], numpy::AsSliceError>) -> Result<&'a [T], Fault> {
    slice.map_err(|_| Fault::Frame(format!("{what} has gaps, expected a contiguous array")))
}

impl Events<'_> {
    fn view(&self, sensor: &SensorModel) -> Result<PacketView<'_>, Fault> {
        let view = PacketView {
            sequence: self.sequence,
            width_px: sensor.width,
            height_px: sensor.height,
            base_ns: self.base_ns,
            watermark_ns: self.watermark_ns,
            x: flat("x", self.x.as_slice())?,
            y: flat("y", self.y.as_slice())?,
            t_offset_ns: flat("t_offset_ns", self.t_offset_ns.as_slice())?,
            polarity: flat("p", self.p.as_slice())?,
            dropped: self.dropped,
            // From where the device wrote them into the packet that Python holds.
            host_copies: 1,
        };
        let lengths = [view.x.len(), view.y.len(), view.polarity.len()];
        if lengths.iter().any(|&length| length != view.len()) {
            let message = format!("columns of {lengths:?} events, expected {} each", view.len());
            return Err(Fault::Frame(message));
        }
        Ok(view)
    }
}

impl Aps<'_> {
    fn view(&self, plan: &CameraPlan) -> Result<ApsImage<'_>, Fault> {
        let bayer = plan.sensor.intensity == Intensity::BayerRggb;
        let pixels = image(plan, "aps", &self.pixels, &[])?;
        Ok(ApsImage { pixels, bits: self.bits, bayer, t_ns: self.t_ns })
    }
}

impl Borrowed<'_> {
    fn add(&self, tick: &mut TickMessages<'_>) {
        if let Some(events) = &self.events {
            tick.events(self.camera, events);
        }
        if let Some(aps) = &self.aps {
            tick.aps(self.camera, aps);
        }
        if let Some(rgb) = self.rgb {
            tick.rgb(self.camera, |out| out.extend_from_slice(rgb));
        }
        if let Some(depth) = self.depth {
            tick.depth(self.camera, depth);
        }
        tick.imu(self.camera, &self.imu);
    }
}
