//! `Engine`: cameras that step together. A lock of its own guards them, so the interpreter's lock is free while they
//! step. `esaac/cameras.py` wraps it in the classes that users see.

use crate::bank::{Frames, Images};
use crate::cuda::CudaSide;
use crate::error::Fault;
use crate::image::{Image, Plane, Streams};
use crate::later::{Done, Later};
use crate::pack::Tiles;
use crate::packet::PyPacket;
use crate::poses::{self, GivenLens, GivenPoses, Moving};
use crate::process::OwnProcess;
use crate::saved::NamedFormat;
use crate::sensor::PySensor;
use crate::state::{Events, Form, Packets, State};
use crate::{device, form, image, report, saved};
use esaac_engine::{Device, Representation};
use esaac_model::physical::LightReport;
use esaac_model::{SensorModel, Synthesis};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Cameras of one process.
#[pyclass(module = "esaac._native", frozen)]
pub struct Engine {
    inner: OwnProcess<Inner>,
    /// Packets of the last step. If Python raises an interrupt when a step returns, the caller does not get the
    /// returned packets and finds them here.
    last: Mutex<Vec<Py<PyPacket>>>,
    size_px: Vec<(u32, u32)>,
    tiled: bool,
    packets: Packets,
}

struct Inner {
    /// A step that was submitted. Whoever uses the state holds this lock and has waited for that step.
    later: Mutex<Later>,
    state: Arc<Mutex<Option<State>>>,
    side: Mutex<Option<Arc<CudaSide>>>,
    device: Arc<Device>,
}

impl Inner {
    /// The lock that comes before the state's, once no step is under way.
    fn settled(&self) -> MutexGuard<'_, Later> {
        let mut later = lock(&self.later);
        later.wait();
        later
    }

    /// Runs `work` on the open state.
    fn with<T>(&self, work: impl FnOnce(&mut State) -> Result<T, Fault>) -> Result<T, Fault> {
        let _settled = self.settled();
        work(open(&mut lock(&self.state))?)
    }

    /// Steps the cameras that have a time; with `submits` only begins to, and returns nothing.
    fn step(
        &self,
        mut frames: Frames,
        t_ns: Vec<Option<i64>>,
        moving: &Moving<'_>,
        submits: bool,
    ) -> Result<Option<Events>, Fault> {
        let side = lock(&self.side).clone();
        let mut later = self.settled();
        later.check_taken()?;
        if submits {
            later.prepare()?;
        }
        let mut state = lock(&self.state);
        let cameras = open(&mut state)?;
        let begun = cameras.begin(&mut frames, &t_ns, moving, side.as_ref())?;
        if !submits {
            return cameras.end(begun, &frames, &t_ns, side.as_ref()).map(Some);
        }
        if let Some(side) = &side
            && let Err(error) = crate::bank::release(&frames, &side.link())
        {
            side.link().finish()?;
            return Err(error);
        }
        drop(state);
        let kept = Arc::clone(&self.state);
        later.submit(move || {
            let mut state = lock(&kept);
            let events =
                open(&mut state).and_then(|cameras| cameras.end(begun, &frames, &t_ns, side.as_ref()));
            Done { frames: Some(frames), events }
        })?;
        Ok(None)
    }

    /// CUDA's side of the device, opened at the first call.
    fn side(&self) -> Result<Arc<CudaSide>, Fault> {
        let mut side = lock(&self.side);
        if side.is_none() {
            *side = Some(CudaSide::open(&self.device)?);
        }
        Ok(Arc::clone(side.as_ref().expect("opened above")))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn open(state: &mut Option<State>) -> Result<&mut State, Fault> {
    state.as_mut().ok_or(Fault::Closed("the camera"))
}

type Array<'py> = Bound<'py, PyAny>;

/// A frame as callers give it: colour, motion, depth, ids.
type Given<'py> = (Array<'py>, Option<Array<'py>>, Option<Array<'py>>, Option<Array<'py>>);

#[pymethods]
impl Engine {
    #[new]
    fn new(
        py: Python<'_>,
        sensors: Vec<PyRef<'_, PySensor>>,
        lenses: Vec<Option<GivenLens>>,
        device: Option<&Bound<'_, PyAny>>,
        packets: &str,
        packet_ring: Option<u32>,
        tiled: bool,
    ) -> PyResult<Self> {
        let sensors: Vec<SensorModel> = sensors.iter().map(|sensor| sensor.0.clone()).collect();
        if sensors.is_empty() {
            return Err(Fault::Argument("no sensors, expected at least one".to_owned()).into());
        }
        if lenses.len() != sensors.len() {
            let message =
                format!("intrinsics of {} cameras, expected those of {}", lenses.len(), sensors.len());
            return Err(Fault::Argument(message).into());
        }
        let lenses =
            lenses.iter().map(|lens| lens.as_ref().map(poses::lens).transpose()).collect::<Result<_, _>>()?;
        let packets = place(packets, packet_ring)?;
        let device = Arc::clone(device::open(py, device)?.get()?);
        let size_px = sensors.iter().map(|s| (s.width, s.height)).collect();
        let state = Arc::new(Mutex::new(Some(State::new(&device, sensors, lenses, packets, tiled)?)));
        let inner = Inner { later: Mutex::default(), state, side: Mutex::default(), device };
        if packets == Packets::Cuda {
            // Fail now if there is no CUDA, and not after the first frame.
            py.detach(|| inner.side())?;
        }
        Ok(Engine { inner: OwnProcess::new(inner), last: Mutex::default(), size_px, tiled, packets })
    }

    /// Steps the cameras that have a time, with one array of each kind for all. `t_ns` is one time, or one for each
    /// camera. With `submits`, `packet` gives the packet later.
    #[pyo3(signature = (frame, t_ns, poses, stream, submits))]
    fn step_tiles(
        &self,
        py: Python<'_>,
        frame: Given<'_>,
        t_ns: Bound<'_, PyAny>,
        poses: Option<GivenPoses<'_>>,
        stream: Option<u64>,
        submits: bool,
    ) -> PyResult<Option<Py<PyPacket>>> {
        let count = self.size_px.len();
        let t_ns = times(&t_ns, count)?;
        let cameras = self.tiled.then_some(count);
        let images = self.images(py, &frame, cameras, self.size_px[0], stream)?;
        let frames = Frames { images: vec![Some(images)], tiled: true };
        let poses = poses.as_ref().map(|poses| poses.read(count)).transpose()?;
        let moving = Moving { poses: vec![poses], together: true };
        let events = self.step_frames(py, frames, t_ns, &moving, submits)?;
        events.map(|events| self.together(py, events)).transpose()
    }

    /// The packet of the step that `step_tiles` submitted.
    fn packet(&self, py: Python<'_>) -> PyResult<Py<PyPacket>> {
        self.together(py, self.submitted(py)?)
    }

    /// The packets of the step that `step` submitted.
    fn packets(&self, py: Python<'_>) -> PyResult<Vec<Py<PyPacket>>> {
        self.each(py, self.submitted(py)?)
    }

    /// Steps the cameras that have a frame. With `submits`, `packets` gives the packets later.
    #[pyo3(signature = (frames, t_ns, poses, stream, submits))]
    fn step(
        &self,
        py: Python<'_>,
        frames: Vec<Option<Given<'_>>>,
        t_ns: Vec<Option<i64>>,
        poses: Vec<Option<GivenPoses<'_>>>,
        stream: Option<u64>,
        submits: bool,
    ) -> PyResult<Option<Vec<Py<PyPacket>>>> {
        let expected = self.size_px.len();
        if frames.len() != expected || t_ns.len() != expected {
            let actual = (frames.len(), t_ns.len());
            let message = format!("{} frames and {} times for {expected} cameras", actual.0, actual.1);
            return Err(Fault::Frame(message).into());
        }
        if poses.len() != expected {
            let message = format!("poses of {} cameras for {expected} cameras", poses.len());
            return Err(Fault::Frame(message).into());
        }
        let images = frames
            .iter()
            .zip(&self.size_px)
            .map(|(given, size_px)| {
                given.as_ref().map(|given| self.images(py, given, None, *size_px, stream)).transpose()
            })
            .collect::<PyResult<_>>()?;
        let frames = Frames { images, tiled: false };
        let poses = poses.iter().map(|poses| poses.as_ref().map(|poses| poses.read(1)).transpose());
        let moving = Moving { poses: poses.collect::<Result<_, _>>()?, together: false };
        let events = self.step_frames(py, frames, t_ns, &moving, submits)?;
        events.map(|events| self.each(py, events)).transpose()
    }

    /// Packets of the last step; none before the first.
    #[getter]
    fn last(&self, py: Python<'_>) -> Vec<Py<PyPacket>> {
        lock(&self.last).iter().map(|packet| packet.clone_ref(py)).collect()
    }

    /// Event frames, or voxel grids of so many bins, which `esaac/checks.py` has checked: of all cameras in one array, or of
    /// each in one.
    fn form(&self, py: Python<'_>, bins: Option<u32>) -> PyResult<Vec<Py<PyAny>>> {
        let what = bins.map_or(Representation::EventFrame, |bins| Representation::VoxelGrid { bins });
        let form = self.form_of(py, what)?;
        let planes = bins.unwrap_or(2) as usize;
        let of_camera = |&(width, height): &(u32, u32)| vec![planes, height as usize, width as usize];
        let shapes: Vec<Vec<usize>> = if self.tiled {
            vec![[self.size_px.len()].into_iter().chain(of_camera(&self.size_px[0])).collect()]
        } else {
            self.size_px.iter().map(of_camera).collect()
        };
        form::arrays(py, &form, what, shapes)
    }

    /// The instance of each event of the last step: of all cameras in one array, or of each in one.
    fn event_ids(&self, py: Python<'_>) -> PyResult<Vec<Py<PyAny>>> {
        let what = Representation::EventIds;
        let form = self.form_of(py, what)?;
        let counts = self.call(py, |state| Ok(state.event_counts()))?;
        let shapes = match self.tiled {
            true => vec![vec![counts.iter().sum()]],
            false => counts.into_iter().map(|count| vec![count]).collect(),
        };
        form::arrays(py, &form, what, shapes)
    }

    #[getter]
    fn sensors(&self, py: Python<'_>) -> PyResult<Vec<PySensor>> {
        let sensors = self.call(py, |state| Ok(state.sensors.clone()))?;
        Ok(sensors.into_iter().map(PySensor).collect())
    }

    /// What each camera's synthesis has come to; None before its first frame.
    #[getter]
    fn syntheses(&self, py: Python<'_>) -> PyResult<Vec<Option<&'static str>>> {
        let syntheses = self.call(py, |state| state.syntheses())?;
        Ok(syntheses.into_iter().map(|synthesis| synthesis.map(Synthesis::name)).collect())
    }

    /// For each camera what to tell, if its depth and poses do not predict its motion vectors.
    fn pose_warnings(&self, py: Python<'_>) -> PyResult<Vec<Option<String>>> {
        self.call(py, |state| state.pose_warnings())
    }

    /// For each camera the light on its focal plane, if it has physical pixels and had a frame.
    fn light<'py>(&self, py: Python<'py>) -> PyResult<Vec<Option<Bound<'py, PyDict>>>> {
        let reports = self.call(py, |state| state.light())?;
        let dict = |report: LightReport| {
            let dict = PyDict::new(py);
            dict.set_item("median_lux", report.median_lux)?;
            dict.set_item("low_lux", report.low_lux)?;
            dict.set_item("high_lux", report.high_lux)?;
            dict.set_item("dim_share", report.dim_share)?;
            dict.set_item("pixels", report.pixels)?;
            dict.set_item("frames", report.frames)?;
            Ok(dict)
        };
        reports.into_iter().map(|report| report.map(dict).transpose()).collect()
    }

    /// For each camera what to tell about its light.
    fn light_warnings(&self, py: Python<'_>) -> PyResult<Vec<Vec<String>>> {
        self.call(py, |state| state.light_warnings())
    }

    /// What is to be told and is new since the last call: kind, number of the camera, text.
    fn new_warnings(&self, py: Python<'_>) -> PyResult<Vec<(&'static str, usize, String)>> {
        let new = self.call(py, State::new_warnings)?;
        Ok(new.into_iter().map(|(kind, camera, text)| (kind.name(), camera, text)).collect())
    }

    /// Time of each camera's last frame.
    #[getter]
    fn last_ns(&self, py: Python<'_>) -> PyResult<Vec<Option<i64>>> {
        self.call(py, |state| Ok(state.last_ns.clone()))
    }

    fn set_sensor(&self, py: Python<'_>, camera: usize, sensor: PyRef<'_, PySensor>) -> PyResult<()> {
        let sensor = sensor.0.clone();
        self.call(py, move |state| state.set_sensor(camera, sensor))
    }

    fn reset(&self, py: Python<'_>, cameras: Vec<usize>) -> PyResult<()> {
        self.call(py, move |state| state.reset(&cameras))
    }

    /// Counts of the last step for each camera, and those that all share.
    fn statistics<'py>(&self, py: Python<'py>) -> PyResult<(Vec<Bound<'py, PyDict>>, Bound<'py, PyDict>)> {
        let (counts, times_ns, copies) =
            self.call(py, |state| Ok((state.diagnostics(), state.times_ns(), state.copies)))?;
        let cameras = counts.iter().map(|counts| report::counts(py, counts)).collect::<PyResult<_>>()?;
        Ok((cameras, report::shared(py, times_ns, copies)?))
    }

    /// APS frames of the last step: time, bits, pixels.
    fn aps(&self, py: Python<'_>) -> PyResult<Vec<Option<report::Aps>>> {
        let frames = self.call(py, |state| Ok(state.aps()))?;
        frames.into_iter().map(|frame| frame.map(|frame| report::aps(py, frame)).transpose()).collect()
    }

    fn memory<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        self.call(py, |state| Ok(state.memory()))?.iter().map(|entry| report::memory(py, entry)).collect()
    }

    #[getter]
    fn device<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        report::device(py, self.inner.get()?.device.info())
    }

    /// Messages of the validation layer, if it is on (`ESAAC_VALIDATION=1`).
    fn validation_messages(&self) -> PyResult<Vec<String>> {
        Ok(self.inner.get()?.device.validation_messages())
    }

    fn save<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        saved::to_python(py, &self.call(py, |state| state.save())?)
    }

    fn restore(
        &self,
        py: Python<'_>,
        formats: Vec<NamedFormat>,
        times_ns: saved::Times,
        left_out: Vec<bool>,
        banks: Vec<Vec<u8>>,
    ) -> PyResult<()> {
        let saved = saved::from_python(formats, times_ns, left_out, banks)?;
        self.call(py, move |state| state.restore(saved))
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let inner = self.inner.get()?;
        py.detach(|| {
            let mut later = inner.settled();
            drop(std::mem::take(&mut *later));
            drop(lock(&inner.state).take());
            drop(lock(&inner.side).take());
        });
        Ok(())
    }

    #[getter]
    fn closed(&self, py: Python<'_>) -> PyResult<bool> {
        let inner = self.inner.get()?;
        Ok(py.detach(|| lock(&inner.state).is_none()))
    }
}

impl Engine {
    fn call<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut State) -> Result<T, Fault> + Send,
    ) -> PyResult<T> {
        let inner = self.inner.get()?;
        Ok(py.detach(|| inner.with(work))?)
    }

    fn step_frames(
        &self,
        py: Python<'_>,
        frames: Frames,
        t_ns: Vec<Option<i64>>,
        moving: &Moving<'_>,
        submits: bool,
    ) -> PyResult<Option<Events>> {
        let inner = self.inner.get()?;
        Ok(py.detach(|| inner.step(frames, t_ns, moving, submits))?)
    }

    /// The events of the step that was submitted. Its arrays are let go.
    fn submitted(&self, py: Python<'_>) -> PyResult<Events> {
        let inner = self.inner.get()?;
        let done = py.detach(|| lock(&inner.later).take())?;
        drop(done.frames);
        Ok(done.events?)
    }

    /// The packet of `step_tiles`, which steps one camera or those of a tiled renderer.
    fn together(&self, py: Python<'_>, events: Events) -> PyResult<Py<PyPacket>> {
        let packet = if self.tiled {
            PyPacket::together(py, events, self.packets != Packets::Host)?
        } else {
            PyPacket::each(py, events)?.swap_remove(0)
        };
        self.keep(vec![packet.clone_ref(py)]);
        Ok(packet)
    }

    fn each(&self, py: Python<'_>, events: Events) -> PyResult<Vec<Py<PyPacket>>> {
        let packets = PyPacket::each(py, events)?;
        self.keep(packets.iter().map(|packet| packet.clone_ref(py)).collect());
        Ok(packets)
    }

    fn keep(&self, packets: Vec<Py<PyPacket>>) {
        let before = std::mem::replace(&mut *lock(&self.last), packets);
        // Dropping may run Python code, so the lock is free by now.
        drop(before);
    }

    /// A representation of the last step's packets.
    fn form_of(&self, py: Python<'_>, what: Representation) -> PyResult<Form> {
        let inner = self.inner.get()?;
        let form = py.detach(|| {
            let side = if self.packets == Packets::Cuda { Some(inner.side()?) } else { None };
            inner.with(|state| state.form(what, side.as_ref()))
        })?;
        Ok(form)
    }

    fn images(
        &self,
        py: Python<'_>,
        given: &Given<'_>,
        cameras: Option<usize>,
        size_px: (u32, u32),
        stream: Option<u64>,
    ) -> PyResult<Images> {
        let inner = self.inner.get()?;
        let streams = || {
            let side = py.detach(|| inner.side())?;
            let callers = stream.map(|s| s.max(image::LEGACY_DEFAULT_STREAM));
            let (ordinal, device) = (side.ordinal, inner.device.info().name.as_str());
            Ok(Streams { ordinal, device, ours: side.stream, callers })
        };
        let tiles = |array: &Array<'_>, plane: Plane| -> PyResult<Tiles> {
            Ok(Tiles::of(Image::of(array, plane, &streams)?, cameras, size_px)?)
        };
        let maybe = |array: &Option<Array<'_>>, plane| array.as_ref().map(|a| tiles(a, plane)).transpose();
        let (hdr, motion, depth, ids) = given;
        Ok(Images {
            hdr: tiles(hdr, Plane::Hdr)?,
            motion: maybe(motion, Plane::Motion)?,
            depth: maybe(depth, Plane::Depth)?,
            ids: maybe(ids, Plane::Ids)?,
            left_out: false,
        })
    }
}

/// Least number of mapped buffer sets, and the default: a step writes one while `last` keeps another.
const PACKET_RING: u32 = 2;

/// The place that Python names for packets.
fn place(packets: &str, ring: Option<u32>) -> Result<Packets, Fault> {
    let place = match packets {
        "host" => Packets::Host,
        "mapped" => Packets::Mapped { ring: ring.unwrap_or(PACKET_RING) },
        "cuda" => Packets::Cuda,
        other => {
            let message = format!("packets is `{other}`, expected `host`, `mapped` or `cuda`");
            return Err(Fault::Argument(message));
        }
    };
    match (place, ring) {
        (Packets::Mapped { .. }, Some(ring)) if !(PACKET_RING..=64).contains(&ring) => {
            Err(Fault::Argument(format!("packet_ring is {ring}, expected {PACKET_RING} to 64")))
        }
        (Packets::Host | Packets::Cuda, Some(ring)) => Err(Fault::Argument(format!(
            "packet_ring is {ring} and packets is `{packets}`, expected packets=\"mapped\" with it"
        ))),
        _ => Ok(place),
    }
}

/// A time for each of `count` cameras, from one number for all or a sequence of `count`.
fn times(t_ns: &Bound<'_, PyAny>, count: usize) -> PyResult<Vec<Option<i64>>> {
    if let Ok(t_ns) = t_ns.extract::<i64>() {
        return Ok(vec![Some(t_ns); count]);
    }
    let Ok(each) = t_ns.try_iter() else { return Ok(vec![Some(nanoseconds(t_ns)?); count]) };
    let time = |t_ns: Bound<'_, PyAny>| t_ns.extract().or_else(|_| nanoseconds(&t_ns).map(Some));
    let times: Vec<Option<i64>> = each.map(|t_ns| time(t_ns?)).collect::<PyResult<_>>()?;
    if times.len() != count {
        let message = format!("{} times for {count} cameras", times.len());
        return Err(Fault::Argument(message).into());
    }
    Ok(times)
}

/// The check of `esaac/checks.py`, which says what is wrong with a time.
fn nanoseconds(t_ns: &Bound<'_, PyAny>) -> PyResult<i64> {
    t_ns.py().import("esaac.checks")?.call_method1("nanoseconds", (t_ns,))?.extract()
}
