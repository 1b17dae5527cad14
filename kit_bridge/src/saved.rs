//! A saved state as Python keeps it: banks of bytes, and what its cameras' frames are in words.

use crate::bank::Format;
use crate::error::Fault;
use crate::image::Element;
use crate::pack::Texel;
use crate::state::Saved;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

/// Element and channels of an image.
type Named = (String, usize);

/// Of a camera's colour, and of its motion.
pub type NamedFormat = (Named, Option<Named>);

/// The parts, by the names that [`from_python`] takes them by.
pub fn to_python<'py>(py: Python<'py>, saved: &Saved) -> PyResult<Bound<'py, PyDict>> {
    let of = |texel: &Texel| (element_name(texel.element), texel.channels);
    let formats: Vec<_> =
        saved.formats.iter().map(|(hdr, motion)| (of(hdr), motion.as_ref().map(of))).collect();
    let banks: Vec<_> = saved.banks.iter().map(|bytes| PyBytes::new(py, bytes)).collect();
    let parts = PyDict::new(py);
    parts.set_item("formats", formats)?;
    parts.set_item("last_ns", &saved.last_ns)?;
    parts.set_item("banks", banks)?;
    Ok(parts)
}

/// A state of the parts of one.
pub fn from_python(
    formats: Vec<NamedFormat>,
    last_ns: Vec<Option<i64>>,
    banks: Vec<Vec<u8>>,
) -> Result<Saved, Fault> {
    let texel = |(name, channels): Named| Ok::<_, Fault>(Texel { element: element_named(&name)?, channels });
    let formats = formats
        .into_iter()
        .map(|(hdr, motion)| Ok((texel(hdr)?, motion.map(texel).transpose()?)))
        .collect::<Result<Vec<Format>, Fault>>()?;
    Ok(Saved { banks, formats, last_ns })
}

fn element_name(element: Element) -> &'static str {
    match element {
        Element::F16 => "float16",
        Element::F32 => "float32",
        Element::U8 => "uint8",
    }
}

fn element_named(name: &str) -> Result<Element, Fault> {
    [Element::F16, Element::F32, Element::U8]
        .into_iter()
        .find(|element| element_name(*element) == name)
        .ok_or_else(|| Fault::Argument(format!("saved state with elements of type `{name}`")))
}
