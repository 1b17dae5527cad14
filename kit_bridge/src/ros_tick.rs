//! The arrays that Python gives for one tick. They are checked against the camera that was announced, and read in
//! place.

use crate::error::Fault;
use esaac_model::{Intensity, PacketView};
use esaac_ros::{ApsImage, CameraPlan, Imu, RigPublisher, TickMessages};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

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
    width: u32,
    height: u32,
    host_copies: u32,
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
pub struct Part<'py> {
    camera: usize,
    events: Option<Events<'py>>,
    ids: Option<PyReadonlyArray1<'py, i64>>,
    aps: Option<Aps<'py>>,
    rgb: Option<PyReadonlyArray3<'py, u8>>,
    depth: Option<PyReadonlyArray2<'py, f32>>,
    imu: Vec<Sample>,
}

/// The same, usable without the interpreter's lock.
pub struct Borrowed<'a> {
    camera: usize,
    events: Option<PacketView<'a>>,
    ids: Option<&'a [i64]>,
    aps: Option<ApsImage<'a>>,
    rgb: Option<&'a [u8]>,
    depth: Option<&'a [f32]>,
    imu: Vec<Imu>,
}

impl Part<'_> {
    /// The arrays, checked against the camera that was announced.
    pub fn borrow(&self, cameras: &[CameraPlan]) -> Result<Borrowed<'_>, Fault> {
        let expected = cameras.len();
        let plan = cameras
            .get(self.camera)
            .ok_or_else(|| Fault::Argument(format!("camera {}, expected one of {expected}", self.camera)))?;
        for (given, announced, what) in [
            (self.rgb.is_some(), plan.image, "rgb"),
            (self.depth.is_some(), plan.depth, "depth"),
            (!self.imu.is_empty(), plan.imu, "imu"),
            (self.ids.is_some(), plan.event_ids, "event_ids"),
            (self.aps.is_some(), plan.sensor.aps_exposure_ns > 0, "aps"),
        ] {
            if given && !announced {
                let message = format!("camera `{}` was announced without {what}", plan.name);
                return Err(Fault::Argument(message));
            }
        }
        let aps = self.aps.as_ref().map(|aps| aps.view(plan)).transpose()?;
        let imu = |&(t_ns, angular_rate_rad_s, specific_force_m_s2): &Sample| Imu {
            t_ns,
            angular_rate_rad_s,
            specific_force_m_s2,
        };
        Ok(Borrowed {
            camera: self.camera,
            events: self.events.as_ref().map(|events| events.view(plan)).transpose()?,
            ids: self.ids.as_ref().map(|ids| flat("ids", ids.as_slice())).transpose()?,
            aps,
            rgb: self.rgb.as_ref().map(|rgb| image(plan, "rgb", rgb, &[3])).transpose()?,
            depth: self.depth.as_ref().map(|depth| image(plan, "depth", depth, &[])).transpose()?,
            imu: self.imu.iter().map(imu).collect(),
        })
    }
}

/// The elements of an image of a camera's size, row-major.
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

/// `esaac/ros.py` gives contiguous arrays.
fn flat<'a, T>(what: &str, slice: Result<&'a [T], numpy::AsSliceError>) -> Result<&'a [T], Fault> {
    slice.map_err(|_| Fault::Frame(format!("{what} has gaps, expected a contiguous array")))
}

impl Events<'_> {
    fn view(&self, plan: &CameraPlan) -> Result<PacketView<'_>, Fault> {
        let (width_px, height_px) = (self.width, self.height);
        let (actual, expected) = ((width_px, height_px), (plan.sensor.width, plan.sensor.height));
        if actual != expected {
            let size = |(width, height)| format!("{width}x{height} px");
            let (name, actual, expected) = (&plan.name, size(actual), size(expected));
            return Err(Fault::Frame(format!("packet of `{name}` is {actual}, expected {expected}")));
        }
        let view = PacketView {
            sequence: self.sequence,
            width_px,
            height_px,
            base_ns: self.base_ns,
            watermark_ns: self.watermark_ns,
            x: flat("x", self.x.as_slice())?,
            y: flat("y", self.y.as_slice())?,
            t_offset_ns: flat("t_offset_ns", self.t_offset_ns.as_slice())?,
            polarity: flat("p", self.p.as_slice())?,
            dropped: self.dropped,
            host_copies: self.host_copies,
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
    /// Fails if the publisher's event message cannot hold the events, or if there is not an id for each.
    pub fn check(&self, publisher: &RigPublisher) -> Result<(), Fault> {
        let (base_ns, events) = self.events.as_ref().map_or((0, 0), |events| (events.base_ns, events.len()));
        publisher.check_base(self.camera, base_ns)?;
        Ok(publisher.check_ids(self.camera, events, self.ids.map(<[i64]>::len))?)
    }

    /// Adds this part to a tick's messages.
    pub fn add(&self, tick: &mut TickMessages<'_>) {
        if let Some(events) = &self.events {
            match self.ids {
                Some(ids) => tick.events_with_ids(self.camera, events, ids),
                None => tick.events(self.camera, events),
            };
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
