//! A saved state for Python: the banks' bytes, and the formats of the cameras' frames in words.

use crate::bank::Format;
use crate::error::Fault;
use crate::image::Element;
use crate::pack::Texel;
use crate::state::Saved;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

/// Element and channels of an image.
type Named = (String, usize);

/// Formats of a camera's colour, motion, depth and ids.
pub type NamedFormat = (Named, Option<Named>, Option<Named>, Option<Named>);

/// The last time of each camera, and its first since its reset.
pub type Times = (Vec<Option<i64>>, Vec<Option<i64>>);

/// The parts of a state, by name.
pub fn to_python<'py>(py: Python<'py>, saved: &Saved) -> PyResult<Bound<'py, PyDict>> {
    let of = |texel: &Texel| (element_name(texel.element), texel.channels);
    let named = |format: &Format| {
        let [motion, depth, ids] = [&format.motion, &format.depth, &format.ids].map(|p| p.as_ref().map(of));
        (of(&format.hdr), motion, depth, ids)
    };
    let formats: Vec<_> = saved.formats.iter().map(named).collect();
    let banks: Vec<_> = saved.banks.iter().map(|bytes| PyBytes::new(py, bytes)).collect();
    let parts = PyDict::new(py);
    parts.set_item("formats", formats)?;
    parts.set_item("last_ns", &saved.last_ns)?;
    parts.set_item("first_ns", &saved.first_ns)?;
    parts.set_item("left_out", &saved.left_out)?;
    parts.set_item("banks", banks)?;
    Ok(parts)
}

/// A state from its parts.
pub fn from_python(
    formats: Vec<NamedFormat>,
    (last_ns, first_ns): Times,
    left_out: Vec<bool>,
    banks: Vec<Vec<u8>>,
) -> Result<Saved, Fault> {
    let texel = |(name, channels): Named| Ok::<_, Fault>(Texel { element: element_named(&name)?, channels });
    let formats = formats
        .into_iter()
        .map(|(hdr, motion, depth, ids)| {
            Ok(Format {
                hdr: texel(hdr)?,
                motion: motion.map(texel).transpose()?,
                depth: depth.map(texel).transpose()?,
                ids: ids.map(texel).transpose()?,
            })
        })
        .collect::<Result<Vec<Format>, Fault>>()?;
    Ok(Saved { banks, formats, last_ns, first_ns, left_out })
}

fn element_name(element: Element) -> &'static str {
    match element {
        Element::F16 => "float16",
        Element::F32 => "float32",
        Element::U8 => "uint8",
        Element::U16 => "uint16",
        Element::U32 => "uint32",
    }
}

fn element_named(name: &str) -> Result<Element, Fault> {
    [Element::F16, Element::F32, Element::U8, Element::U16, Element::U32]
        .into_iter()
        .find(|element| element_name(*element) == name)
        .ok_or_else(|| Fault::Argument(format!("saved state with elements of type `{name}`")))
}
