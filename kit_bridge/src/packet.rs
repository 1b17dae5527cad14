//! Events as Python sees them: arrays of NumPy that own the engine's vectors, or tensors on a CUDA device.

use crate::cuda::Block;
use crate::state::Events;
use crate::tensor::{Kind, Tensor};
use esaac_model::Packet;
use numpy::{IntoPyArray, PyArray1, PyArrayMethods};
use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PySlice;
use std::sync::Arc;

/// Events of a camera, or of the cameras of a tiled renderer: see `esaac/__init__.pyi`.
#[pyclass(name = "Packet", module = "esaac", frozen)]
pub struct PyPacket {
    #[pyo3(get)]
    x: Py<PyAny>,
    #[pyo3(get)]
    y: Py<PyAny>,
    #[pyo3(get)]
    p: Py<PyAny>,
    t_ns: PyOnceLock<Py<PyAny>>,
    /// What `t_ns` is made of when it is asked for.
    t_offset_ns: Option<Py<PyArray1<u32>>>,
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
    fn t_ns(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let make = || -> PyResult<Py<PyAny>> {
            let offsets = self.t_offset_ns.as_ref().expect("a packet without times has offsets").bind(py);
            let times = offsets.readonly().as_slice()?.iter().map(|&t| self.base_ns + i64::from(t)).collect();
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
        let (first, last) = (offsets[index as usize] as isize, offsets[index as usize + 1] as isize);
        let part = PySlice::new(py, first, last, 1);
        let cut = |array: &Py<PyAny>| Ok::<_, PyErr>(array.bind(py).get_item(&part)?.unbind());
        Ok(PyPacket {
            x: cut(&self.x)?,
            y: cut(&self.y)?,
            p: cut(&self.p)?,
            t_ns: known(py, cut(&self.t_ns(py)?)?),
            t_offset_ns: None,
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
    /// A packet of the engine's, whose vectors become the arrays.
    fn of_one(py: Python<'_>, packet: Packet) -> Self {
        PyPacket {
            events: packet.len(),
            x: packet.x.into_pyarray(py).into_any().unbind(),
            y: packet.y.into_pyarray(py).into_any().unbind(),
            p: packet.polarity.into_pyarray(py).into_any().unbind(),
            t_ns: PyOnceLock::new(),
            t_offset_ns: Some(packet.t_offset_ns.into_pyarray(py).unbind()),
            offsets: None,
            base_ns: packet.base_ns,
            watermark_ns: packet.watermark_ns,
            sequence: packet.sequence,
            dropped: packet.dropped,
            width: packet.width_px,
            height: packet.height_px,
        }
    }

    /// A packet for each camera.
    pub fn each(py: Python<'_>, events: Events) -> PyResult<Vec<Py<PyPacket>>> {
        match events {
            Events::Host(packets) => {
                packets.into_iter().map(|packet| Py::new(py, Self::of_one(py, packet))).collect()
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
                        Py::new(py, Self::of_tensors(py, tensors, header, count as usize, None))
                    })
                    .collect()
            }
        }
    }

    /// One packet of all cameras, one camera after the other.
    pub fn together(py: Python<'_>, events: Events) -> PyResult<Py<PyPacket>> {
        match events {
            Events::Host(mut packets) if packets.len() == 1 => {
                Py::new(py, Self::of_one(py, packets.swap_remove(0)))
            }
            Events::Host(packets) => Py::new(py, Self::joined(py, packets)),
            Events::Cuda { block, headers, counts } => {
                let all = counts.iter().map(|&n| n as usize).sum();
                let tensors = tensors(py, &block, all, 0, all)?;
                let offsets = (counts.len() > 1).then(|| offsets(counts.iter().map(|&n| n as usize)));
                let offsets = offsets.map(|offsets| offsets.into_pyarray(py).into_any().unbind());
                Py::new(py, Self::of_tensors(py, tensors, &common(&headers), all, offsets))
            }
        }
    }

    fn joined(py: Python<'_>, packets: Vec<Packet>) -> Self {
        let all = packets.iter().map(Packet::len).sum();
        let header = common(&packets);
        let starts = offsets(packets.iter().map(Packet::len));
        let (mut x, mut y) = (Vec::with_capacity(all), Vec::with_capacity(all));
        let (mut p, mut t_ns) = (Vec::with_capacity(all), Vec::with_capacity(all));
        py.detach(|| {
            for packet in &packets {
                x.extend_from_slice(&packet.x);
                y.extend_from_slice(&packet.y);
                p.extend_from_slice(&packet.polarity);
                t_ns.extend(packet.t_offset_ns.iter().map(|&t| packet.base_ns + i64::from(t)));
            }
        });
        PyPacket {
            x: x.into_pyarray(py).into_any().unbind(),
            y: y.into_pyarray(py).into_any().unbind(),
            p: p.into_pyarray(py).into_any().unbind(),
            t_ns: known(py, t_ns.into_pyarray(py).into_any().unbind()),
            t_offset_ns: None,
            offsets: Some(starts.into_pyarray(py).into_any().unbind()),
            events: all,
            base_ns: header.base_ns,
            watermark_ns: header.watermark_ns,
            sequence: header.sequence,
            dropped: header.dropped,
            width: header.width_px,
            height: header.height_px,
        }
    }

    fn of_tensors(
        py: Python<'_>,
        tensors: [Py<PyAny>; 4],
        header: &Packet,
        events: usize,
        offsets: Option<Py<PyAny>>,
    ) -> Self {
        let [t_ns, x, y, p] = tensors;
        PyPacket {
            x,
            y,
            p,
            t_ns: known(py, t_ns),
            t_offset_ns: None,
            offsets,
            events,
            base_ns: header.base_ns,
            watermark_ns: header.watermark_ns,
            sequence: header.sequence,
            dropped: header.dropped,
            width: header.width_px,
            height: header.height_px,
        }
    }
}

fn known(py: Python<'_>, value: Py<PyAny>) -> PyOnceLock<Py<PyAny>> {
    let lock = PyOnceLock::new();
    // It is new, so nothing is in it.
    let _ = lock.set(py, value);
    lock
}

/// What holds of all packets: the earliest base, the earliest watermark, all drops.
fn common(packets: &[Packet]) -> Packet {
    let first = packets.first().cloned().unwrap_or_default();
    Packet {
        base_ns: packets.iter().map(|p| p.base_ns).min().unwrap_or(0),
        watermark_ns: packets.iter().map(|p| p.watermark_ns).min().unwrap_or(0),
        dropped: packets.iter().map(|p| p.dropped).sum(),
        sequence: first.sequence,
        width_px: first.width_px,
        height_px: first.height_px,
        ..Packet::default()
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

/// Times, columns, rows and polarities of `count` events after `before`, of `all` in a block.
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
