//! Packets in the memory that the device wrote. NumPy's arrays view it, and keep it for as long as they live.

#![expect(unsafe_code, reason = "NumPy's edge")]

use crate::error::Fault;
use crate::process::OwnProcess;
use esaac_engine::HeldPackets;
use esaac_model::PacketView;
use numpy::ndarray::ArrayView1;
use numpy::{Element, PyArray1, PyArrayMethods};
use pyo3::prelude::*;

/// The packets of one step, of all cameras.
#[pyclass(module = "esaac._native", frozen)]
pub struct Mapped(OwnProcess<Vec<HeldPackets>>);

impl Mapped {
    /// Packets of cameras in order, some of them in each `HeldPackets`.
    pub fn new(held: Vec<HeldPackets>) -> Self {
        Mapped(OwnProcess::new(held))
    }

    /// A packet a camera.
    pub fn views(&self) -> Result<Vec<PacketView<'_>>, Fault> {
        let all = |held: &'_ HeldPackets| 0..held.len();
        Ok(self.0.get()?.iter().flat_map(|held| all(held).map(|camera| held.view(camera))).collect())
    }

    /// The packet of one camera.
    pub fn view(&self, mut camera: usize) -> Result<PacketView<'_>, Fault> {
        for held in self.0.get()? {
            if camera < held.len() {
                return Ok(held.view(camera));
            }
            camera -= held.len();
        }
        unreachable!("callers ask for cameras that there are")
    }
}

/// A read-only array over a column of `memory`.
pub fn array<'py, T: Element>(memory: &Bound<'py, Mapped>, column: &[T]) -> Bound<'py, PyArray1<T>> {
    // SAFETY: the column is in buffers that `memory` holds. They neither move nor change while it lives, and the array
    // keeps it. Nobody can write through the array: it is made read-only below, and NumPy lets nobody undo that,
    // since `memory` offers no writable buffer.
    let array = unsafe { PyArray1::borrow_from_array(&ArrayView1::from(column), memory.clone().into_any()) };
    array.readwrite().make_nonwriteable();
    array
}
