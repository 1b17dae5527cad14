//! Events for Python: NumPy arrays that own their memory or view the device's, or tensors on a CUDA device.

use crate::cuda::Block;
use crate::join::joined;
use crate::mapped::{self, Mapped};
use crate::state::Events;
use crate::tensor::{Kind, Tensor};
use esaac_engine::HeldPackets;
use esaac_model::{Packet, PacketView};
use numpy::{Element, IntoPyArray, PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PySlice;
use std::sync::Arc;

/// Events of a camera, or of the cameras of a tiled renderer: see `esaac/__init__.pyi`.
#[pyclass(name = "Packet", module = "esaac", frozen)]
pub struct PyPacket {
    x: PyOnceLock<Py<PyAny>>,
    y: PyOnceLock<Py<PyAny>>,
    p: PyOnceLock<Py<PyAny>>,
    t_ns: PyOnceLock<Py<PyAny>>,
    /// `t_ns` is computed from these at the first use.
    t_offset_ns: Option<Py<PyArray1<u32>>>,
    /// Several cameras' packets in mapped memory. A column of all is joined at its first use.
    mapped: Option<Py<Mapped>>,
    #[pyo3(get)]
    offsets: Option<Py<PyAny>>,
    /// The header of each of several cameras.
    headers: Vec<Header>,
    events: usize,
    /// Its own header, or what those of several cameras have in common.
    header: Header,
}

/// The numbers of a packet, without its events.
#[derive(Clone, Copy, Default)]
struct Header {
    base_ns: i64,
    watermark_ns: i64,
    sequence: u64,
    dropped: u64,
    width_px: u32,
    height_px: u32,
}

/// A header for Python: `base_ns`, `watermark_ns`, `sequence`, `dropped`, `width_px`, `height_px`.
type Numbers = (i64, i64, u64, u64, u32, u32);

/// A packet taken apart: x, y, p, `t_ns`, `t_offset_ns`, `offsets` and headers.
type Parts<'py> = (
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Bound<'py, PyAny>,
    Option<Bound<'py, PyAny>>,
    Option<Bound<'py, PyAny>>,
    Vec<Numbers>,
);

impl Header {
    fn numbers(&self) -> Numbers {
        let Header { base_ns, watermark_ns, sequence, dropped, width_px, height_px } = *self;
        (base_ns, watermark_ns, sequence, dropped, width_px, height_px)
    }

    fn of_numbers((base_ns, watermark_ns, sequence, dropped, width_px, height_px): Numbers) -> Self {
        Header { base_ns, watermark_ns, sequence, dropped, width_px, height_px }
    }

    fn of(packet: &PacketView<'_>) -> Self {
        let PacketView { base_ns, watermark_ns, sequence, dropped, width_px, height_px, .. } = *packet;
        Header { base_ns, watermark_ns, sequence, dropped, width_px, height_px }
    }

    /// For packets together: the earliest base, the earliest watermark, the sum of all drops.
    fn common(headers: &[Header]) -> Self {
        Header {
            base_ns: headers.iter().map(|header| header.base_ns).min().unwrap_or(0),
            watermark_ns: headers.iter().map(|header| header.watermark_ns).min().unwrap_or(0),
            dropped: headers.iter().map(|header| header.dropped).sum(),
            ..headers.first().copied().unwrap_or_default()
        }
    }
}

#[pymethods]
impl PyPacket {
    #[getter]
    fn x(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.column(py, &self.x, |packet, part| part.copy_from_slice(packet.x))
    }

    #[getter]
    fn y(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.column(py, &self.y, |packet, part| part.copy_from_slice(packet.y))
    }

    #[getter]
    fn p(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.column(py, &self.p, |packet, part| part.copy_from_slice(packet.polarity))
    }

    #[getter]
    fn t_ns(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let Some(offsets) = &self.t_offset_ns else { return self.column(py, &self.t_ns, times) };
        let make = || -> PyResult<Py<PyAny>> {
            let offsets = offsets.bind(py).readonly();
            let times = offsets.as_slice()?.iter().map(|&t| self.header.base_ns + i64::from(t)).collect();
            Ok(PyArray1::from_vec(py, times).into_any().unbind())
        };
        Ok(self.t_ns.get_or_try_init(py, make)?.clone_ref(py))
    }

    #[getter]
    fn t_offset_ns(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.t_offset_ns.as_ref().map(|offsets| offsets.clone_ref(py).into_any())
    }

    #[getter]
    fn base_ns(&self) -> i64 {
        self.header.base_ns
    }

    #[getter]
    fn watermark_ns(&self) -> i64 {
        self.header.watermark_ns
    }

    #[getter]
    fn sequence(&self) -> u64 {
        self.header.sequence
    }

    #[getter]
    fn dropped(&self) -> u64 {
        self.header.dropped
    }

    #[getter]
    fn width(&self) -> u32 {
        self.header.width_px
    }

    #[getter]
    fn height(&self) -> u32 {
        self.header.height_px
    }

    fn __len__(&self) -> usize {
        self.events
    }

    /// The packet of one camera of several.
    fn __getitem__(&self, py: Python<'_>, camera: isize) -> PyResult<PyPacket> {
        let Some(offsets) = &self.offsets else {
            return Err(PyTypeError::new_err("a packet of one camera has no cameras to choose from"));
        };
        let offsets = offsets.bind(py).cast::<PyArray1<i64>>()?.readonly();
        let offsets = offsets.as_slice()?;
        let count = offsets.len() as isize - 1;
        let index = if camera < 0 { camera + count } else { camera };
        if !(0..count).contains(&index) {
            return Err(PyIndexError::new_err(format!("camera {camera} of {count}")));
        }
        let (first, last) = (offsets[index as usize], offsets[index as usize + 1]);
        if let Some(memory) = &self.mapped {
            return Self::in_place(memory.bind(py), index as usize);
        }
        let part = PySlice::new(py, first as isize, last as isize, 1);
        let cut = |array: Py<PyAny>| Ok::<_, PyErr>(known(py, array.bind(py).get_item(&part)?.unbind()));
        Ok(PyPacket {
            x: cut(self.x(py)?)?,
            y: cut(self.y(py)?)?,
            p: cut(self.p(py)?)?,
            t_ns: cut(self.t_ns(py)?)?,
            ..Self::of_header(self.headers[index as usize], (last - first) as usize)
        })
    }

    /// For pickles and copies.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts<'py>)> {
        let columns = [self.x(py)?, self.y(py)?, self.p(py)?, self.t_ns(py)?].map(|each| each.into_bound(py));
        if columns[0].is_instance_of::<Tensor>() {
            let message = "the packet is on a CUDA device, expected one on the host (packets=\"host\")";
            return Err(PyTypeError::new_err(message));
        }
        let [x, y, p, t_ns] = columns;
        let t_offset_ns = self.t_offset_ns(py).map(|each| each.into_bound(py));
        let offsets = self.offsets.as_ref().map(|offsets| offsets.bind(py).clone());
        let headers = self.headers.iter().chain([&self.header]).map(Header::numbers).collect();
        Ok((py.get_type::<Self>().getattr("_of_parts")?, (x, y, p, t_ns, t_offset_ns, offsets, headers)))
    }

    /// What `__reduce__` has taken apart. The last header is the packet's.
    #[staticmethod]
    fn _of_parts(
        x: Bound<'_, PyArray1<u16>>,
        y: Bound<'_, PyArray1<u16>>,
        p: Bound<'_, PyArray1<u8>>,
        t_ns: Bound<'_, PyArray1<i64>>,
        t_offset_ns: Option<Bound<'_, PyArray1<u32>>>,
        offsets: Option<Bound<'_, PyArray1<i64>>>,
        headers: Vec<Numbers>,
    ) -> PyResult<Self> {
        let (py, events) = (x.py(), x.len());
        let mut headers: Vec<Header> = headers.into_iter().map(Header::of_numbers).collect();
        let header = headers.pop().unwrap_or_default();
        let cameras = offsets.as_ref().map_or(0, |offsets| offsets.len().saturating_sub(1));
        if headers.len() != cameras {
            let message =
                format!("a packet with the headers of {} cameras, expected {cameras}", headers.len());
            return Err(PyTypeError::new_err(message));
        }
        Ok(PyPacket {
            x: known(py, x.into_any().unbind()),
            y: known(py, y.into_any().unbind()),
            p: known(py, p.into_any().unbind()),
            t_ns: known(py, t_ns.into_any().unbind()),
            t_offset_ns: t_offset_ns.map(Bound::unbind),
            offsets: offsets.map(|offsets| offsets.into_any().unbind()),
            headers,
            ..Self::of_header(header, events)
        })
    }

    fn __repr__(&self) -> String {
        let Header { width_px, height_px, watermark_ns, .. } = self.header;
        let events = self.events;
        format!("<esaac.Packet {events} events, {width_px}x{height_px} px, complete to {watermark_ns} ns>")
    }
}

impl PyPacket {
    /// A column: the array, which is joined from the cameras' mapped columns if it is not there yet.
    fn column<T: Element + Clone + Default>(
        &self,
        py: Python<'_>,
        known: &PyOnceLock<Py<PyAny>>,
        fill: impl Fn(&PacketView<'_>, &mut [T]) + Sync,
    ) -> PyResult<Py<PyAny>> {
        let make = || -> PyResult<Py<PyAny>> {
            let memory = self.mapped.as_ref().expect("a column that is not there is in mapped memory");
            let packets = memory.get().views()?;
            Ok(py.detach(|| joined(&packets, &fill)).into_pyarray(py).into_any().unbind())
        };
        Ok(known.get_or_try_init(py, make)?.clone_ref(py))
    }

    /// A packet of these arrays (x, y, polarity) with the numbers of `header`.
    fn of_arrays(
        py: Python<'_>,
        [x, y, p]: [Py<PyAny>; 3],
        t_offset_ns: Py<PyArray1<u32>>,
        header: Header,
        events: usize,
    ) -> Self {
        PyPacket {
            x: known(py, x),
            y: known(py, y),
            p: known(py, p),
            t_offset_ns: Some(t_offset_ns),
            ..Self::of_header(header, events)
        }
    }

    /// A packet without columns.
    fn of_header(header: Header, events: usize) -> Self {
        PyPacket {
            x: PyOnceLock::new(),
            y: PyOnceLock::new(),
            p: PyOnceLock::new(),
            t_ns: PyOnceLock::new(),
            t_offset_ns: None,
            mapped: None,
            offsets: None,
            headers: Vec::new(),
            events,
            header,
        }
    }

    /// The packet of several cameras without columns: `lengths` are the numbers of their events.
    fn of_cameras(py: Python<'_>, headers: Vec<Header>, lengths: &[usize]) -> Self {
        let common = Header::common(&headers);
        let offsets = offsets(lengths).into_pyarray(py).into_any().unbind();
        PyPacket { offsets: Some(offsets), headers, ..Self::of_header(common, lengths.iter().sum()) }
    }

    /// A packet whose vectors become the arrays.
    fn of_one(py: Python<'_>, packet: Packet) -> Self {
        let (header, events) = (Header::of(&packet.view()), packet.len());
        let columns = [
            packet.x.into_pyarray(py).into_any().unbind(),
            packet.y.into_pyarray(py).into_any().unbind(),
            packet.polarity.into_pyarray(py).into_any().unbind(),
        ];
        Self::of_arrays(py, columns, packet.t_offset_ns.into_pyarray(py).unbind(), header, events)
    }

    /// One camera's packet, as views of mapped memory.
    fn in_place(memory: &Bound<'_, Mapped>, camera: usize) -> PyResult<Self> {
        let packet = memory.get().view(camera)?;
        let columns = [
            mapped::array(memory, packet.x).into_any().unbind(),
            mapped::array(memory, packet.y).into_any().unbind(),
            mapped::array(memory, packet.polarity).into_any().unbind(),
        ];
        let offsets = mapped::array(memory, packet.t_offset_ns).unbind();
        Ok(Self::of_arrays(memory.py(), columns, offsets, Header::of(&packet), packet.len()))
    }

    /// A packet for each camera.
    pub fn each(py: Python<'_>, events: Events) -> PyResult<Vec<Py<PyPacket>>> {
        match events {
            Events::Host(packets) => {
                packets.into_iter().map(|packet| Py::new(py, Self::of_one(py, packet))).collect()
            }
            Events::Mapped(held) => {
                let cameras = held.iter().map(HeldPackets::len).sum();
                let memory = Bound::new(py, Mapped::new(held))?;
                (0..cameras).map(|camera| Py::new(py, Self::in_place(&memory, camera)?)).collect()
            }
            Events::Cuda { block, headers, counts } => {
                let all: usize = counts.iter().map(|&n| n as usize).sum();
                let mut before = 0;
                headers
                    .iter()
                    .zip(&counts)
                    .map(|(header, &count)| {
                        let tensors = tensors(py, &block, all, before, count as usize)?;
                        before += count as usize;
                        let packet = Self::of_header(Header::of(&header.view()), count as usize);
                        Py::new(py, packet.with_tensors(py, tensors))
                    })
                    .collect()
            }
        }
    }

    /// One packet of all cameras of a tiled renderer, one camera after the other. Mapped packets become views if
    /// `in_place`, else copies that do not keep the engine's memory.
    pub fn together(py: Python<'_>, events: Events, in_place: bool) -> PyResult<Py<PyPacket>> {
        let packet = match events {
            Events::Host(_) => unreachable!("tiled cameras have mapped packets, which are copied only once"),
            Events::Mapped(held) => {
                let memory = Bound::new(py, Mapped::new(held))?;
                let packets = memory.get().views()?;
                let headers = packets.iter().map(Header::of).collect();
                let lengths: Vec<usize> = packets.iter().map(PacketView::len).collect();
                let packet = Self::of_cameras(py, headers, &lengths);
                if in_place {
                    PyPacket { mapped: Some(memory.clone().unbind()), ..packet }
                } else {
                    packet.with_copies(py, &packets)
                }
            }
            Events::Cuda { block, headers, counts } => {
                let headers = headers.iter().map(|header| Header::of(&header.view())).collect();
                let lengths: Vec<usize> = counts.iter().map(|&n| n as usize).collect();
                let all = lengths.iter().sum();
                Self::of_cameras(py, headers, &lengths).with_tensors(py, tensors(py, &block, all, 0, all)?)
            }
        };
        Py::new(py, packet)
    }

    /// The same with the cameras' columns copied into arrays, one camera after the other.
    fn with_copies(self, py: Python<'_>, packets: &[PacketView<'_>]) -> Self {
        let (x, y, p, t_ns) = py.detach(|| {
            (
                joined(packets, |packet, part| part.copy_from_slice(packet.x)),
                joined(packets, |packet, part| part.copy_from_slice(packet.y)),
                joined(packets, |packet, part| part.copy_from_slice(packet.polarity)),
                joined(packets, times),
            )
        });
        PyPacket {
            x: known(py, x.into_pyarray(py).into_any().unbind()),
            y: known(py, y.into_pyarray(py).into_any().unbind()),
            p: known(py, p.into_pyarray(py).into_any().unbind()),
            t_ns: known(py, t_ns.into_pyarray(py).into_any().unbind()),
            ..self
        }
    }

    /// The same with columns on a CUDA device.
    fn with_tensors(self, py: Python<'_>, [t_ns, x, y, p]: [Py<PyAny>; 4]) -> Self {
        PyPacket { x: known(py, x), y: known(py, y), p: known(py, p), t_ns: known(py, t_ns), ..self }
    }
}

/// Times of a packet's events.
fn times(packet: &PacketView<'_>, part: &mut [i64]) {
    for (t_ns, &offset) in part.iter_mut().zip(packet.t_offset_ns) {
        *t_ns = packet.base_ns + i64::from(offset);
    }
}

fn known(py: Python<'_>, value: Py<PyAny>) -> PyOnceLock<Py<PyAny>> {
    let lock = PyOnceLock::new();
    // The lock is new and empty, so this cannot fail.
    let _ = lock.set(py, value);
    lock
}

/// Where each camera's events begin, and the end of all.
fn offsets(lengths: &[usize]) -> Vec<i64> {
    let mut offsets = vec![0];
    let mut total = 0;
    offsets.extend(lengths.iter().map(|&count| {
        total += count as i64;
        total
    }));
    offsets
}

/// Times, columns, rows and polarities of `count` events from number `before` on, of `all` events in a block.
fn tensors(
    py: Python<'_>,
    block: &Arc<Block>,
    all: usize,
    before: usize,
    count: usize,
) -> PyResult<[Py<PyAny>; 4]> {
    let (all, before) = (all as u64, before as u64);
    let tensor = |offset: u64, kind: Kind| {
        Ok::<_, PyErr>(Py::new(py, Tensor::new(block, offset, kind, vec![count]))?.into_any())
    };
    Ok([
        tensor(8 * before, Kind::I64)?,
        tensor(8 * all + 2 * before, Kind::I16)?,
        tensor(10 * all + 2 * before, Kind::I16)?,
        tensor(12 * all + before, Kind::U8)?,
    ])
}
