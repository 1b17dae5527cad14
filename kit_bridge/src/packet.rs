//! Events for Python: NumPy arrays that own their memory or view the device's, or tensors on a CUDA device.

use crate::cuda::Block;
use crate::join::joined;
use crate::mapped::{self, Mapped};
use crate::state::Events;
use crate::tensor::{Kind, Tensor};
use esaac_engine::HeldPackets;
use esaac_model::{Packet, PacketView};
use numpy::{Element, IntoPyArray, PyArray1, PyArrayMethods};
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
    events: usize,
    #[pyo3(get)]
    base_ns: i64,
    #[pyo3(get)]
    watermark_ns: i64,
    #[pyo3(get)]
    sequence: u64,
    #[pyo3(get)]
    dropped: u64,
    #[pyo3(get)]
    width: u32,
    #[pyo3(get)]
    height: u32,
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
            let times = offsets.as_slice()?.iter().map(|&t| self.base_ns + i64::from(t)).collect();
            Ok(PyArray1::from_vec(py, times).into_any().unbind())
        };
        Ok(self.t_ns.get_or_try_init(py, make)?.clone_ref(py))
    }

    #[getter]
    fn t_offset_ns(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.t_offset_ns.as_ref().map(|offsets| offsets.clone_ref(py).into_any())
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
            t_offset_ns: None,
            mapped: None,
            offsets: None,
            events: (last - first) as usize,
            ..*self
        })
    }

    fn __repr__(&self) -> String {
        let size = format!("{}x{} px", self.width, self.height);
        format!("<esaac.Packet {} events, {size}, complete to {} ns>", self.events, self.watermark_ns)
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
        header: &PacketView<'_>,
        events: usize,
    ) -> Self {
        PyPacket {
            x: known(py, x),
            y: known(py, y),
            p: known(py, p),
            t_ns: PyOnceLock::new(),
            t_offset_ns: Some(t_offset_ns),
            mapped: None,
            offsets: None,
            ..Self::of_header(header, events)
        }
    }

    fn of_header(header: &PacketView<'_>, events: usize) -> Self {
        PyPacket {
            x: PyOnceLock::new(),
            y: PyOnceLock::new(),
            p: PyOnceLock::new(),
            t_ns: PyOnceLock::new(),
            t_offset_ns: None,
            mapped: None,
            offsets: None,
            events,
            base_ns: header.base_ns,
            watermark_ns: header.watermark_ns,
            sequence: header.sequence,
            dropped: header.dropped,
            width: header.width_px,
            height: header.height_px,
        }
    }

    /// A packet whose vectors become the arrays.
    fn of_one(py: Python<'_>, packet: Packet) -> Self {
        let (header, events) = (headed(&packet), packet.len());
        let columns = [
            packet.x.into_pyarray(py).into_any().unbind(),
            packet.y.into_pyarray(py).into_any().unbind(),
            packet.polarity.into_pyarray(py).into_any().unbind(),
        ];
        Self::of_arrays(py, columns, packet.t_offset_ns.into_pyarray(py).unbind(), &header.view(), events)
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
        Ok(Self::of_arrays(memory.py(), columns, offsets, &packet, packet.len()))
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
                        Py::new(py, Self::of_tensors(py, tensors, &header.view(), count as usize, None))
                    })
                    .collect()
            }
        }
    }

    /// One packet of all cameras, one camera after the other. Mapped packets become views if `in_place`, else copies
    /// that do not keep the engine's memory.
    pub fn together(py: Python<'_>, events: Events, in_place: bool) -> PyResult<Py<PyPacket>> {
        match events {
            // There is one camera: packets of several are mapped, so that they are copied only once.
            Events::Host(mut packets) => Py::new(py, Self::of_one(py, packets.swap_remove(0))),
            Events::Mapped(held) => {
                let memory = Bound::new(py, Mapped::new(held))?;
                let packets = memory.get().views()?;
                if !in_place {
                    return Py::new(py, Self::copied(py, &packets));
                }
                if packets.len() == 1 {
                    return Py::new(py, Self::in_place(&memory, 0)?);
                }
                let offsets = offsets(packets.iter().map(PacketView::len)).into_pyarray(py);
                let packet = PyPacket {
                    offsets: Some(offsets.into_any().unbind()),
                    mapped: Some(memory.clone().unbind()),
                    ..Self::of_header(&common(&packets), packets.iter().map(PacketView::len).sum())
                };
                Py::new(py, packet)
            }
            Events::Cuda { block, headers, counts } => {
                let all = counts.iter().map(|&n| n as usize).sum();
                let tensors = tensors(py, &block, all, 0, all)?;
                let offsets = (counts.len() > 1).then(|| offsets(counts.iter().map(|&n| n as usize)));
                let offsets = offsets.map(|offsets| offsets.into_pyarray(py).into_any().unbind());
                let headers: Vec<PacketView<'_>> = headers.iter().map(Packet::view).collect();
                Py::new(py, Self::of_tensors(py, tensors, &common(&headers), all, offsets))
            }
        }
    }

    /// Cameras' packets copied into arrays, one camera after the other.
    fn copied(py: Python<'_>, packets: &[PacketView<'_>]) -> Self {
        let (x, y, p, t_ns) = py.detach(|| {
            (
                joined(packets, |packet, part| part.copy_from_slice(packet.x)),
                joined(packets, |packet, part| part.copy_from_slice(packet.y)),
                joined(packets, |packet, part| part.copy_from_slice(packet.polarity)),
                joined(packets, times),
            )
        });
        let starts = offsets(packets.iter().map(PacketView::len)).into_pyarray(py);
        PyPacket {
            x: known(py, x.into_pyarray(py).into_any().unbind()),
            y: known(py, y.into_pyarray(py).into_any().unbind()),
            p: known(py, p.into_pyarray(py).into_any().unbind()),
            t_ns: known(py, t_ns.into_pyarray(py).into_any().unbind()),
            offsets: Some(starts.into_any().unbind()),
            ..Self::of_header(&common(packets), packets.iter().map(PacketView::len).sum())
        }
    }

    fn of_tensors(
        py: Python<'_>,
        tensors: [Py<PyAny>; 4],
        header: &PacketView<'_>,
        events: usize,
        offsets: Option<Py<PyAny>>,
    ) -> Self {
        let [t_ns, x, y, p] = tensors;
        PyPacket {
            x: known(py, x),
            y: known(py, y),
            p: known(py, p),
            t_ns: known(py, t_ns),
            offsets,
            ..Self::of_header(header, events)
        }
    }
}

/// Times of a packet's events.
fn times(packet: &PacketView<'_>, part: &mut [i64]) {
    for (t_ns, &offset) in part.iter_mut().zip(packet.t_offset_ns) {
        *t_ns = packet.base_ns + i64::from(offset);
    }
}

/// A packet without its events.
fn headed(packet: &Packet) -> Packet {
    Packet { x: Vec::new(), y: Vec::new(), t_offset_ns: Vec::new(), polarity: Vec::new(), ..*packet }
}

fn known(py: Python<'_>, value: Py<PyAny>) -> PyOnceLock<Py<PyAny>> {
    let lock = PyOnceLock::new();
    // The lock is new and empty, so this cannot fail.
    let _ = lock.set(py, value);
    lock
}

/// A header for packets together: the earliest base, the earliest watermark, the sum of all drops.
fn common<'a>(packets: &[PacketView<'a>]) -> PacketView<'a> {
    let first = packets.first().copied().unwrap_or_default();
    PacketView {
        base_ns: packets.iter().map(|p| p.base_ns).min().unwrap_or(0),
        watermark_ns: packets.iter().map(|p| p.watermark_ns).min().unwrap_or(0),
        dropped: packets.iter().map(|p| p.dropped).sum(),
        ..first
    }
}

fn offsets(counts: impl Iterator<Item = usize>) -> Vec<i64> {
    let mut offsets = vec![0];
    let mut total = 0;
    offsets.extend(counts.map(|count| {
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
