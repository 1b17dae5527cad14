//! Reads the dictionary that NumPy's and CUDA's array interfaces share.

use crate::error::Fault;
use crate::image::{Element, Plane, compact};
use pyo3::conversion::FromPyObjectOwned;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyString, PyTuple};
use std::borrow::Cow;

/// Address, elements, shape, strides in bytes.
pub type Parsed = (usize, Element, Vec<usize>, Vec<isize>);

/// Reads an array interface.
pub fn parse<'py>(interface: &Bound<'py, PyDict>, plane: Plane) -> PyResult<Parsed> {
    let (py, name) = (interface.py(), plane.name());
    let item = |key: &Bound<'py, PyString>| -> PyResult<Bound<'py, PyAny>> {
        let missing = || Fault::Frame(format!("{name}: its array interface has no `{key}`"));
        Ok(interface.get_item(key)?.ok_or_else(missing)?)
    };
    let typestr = item(intern!(py, "typestr"))?;
    let typestr: Cow<'_, str> = typestr.extract()?;
    let element = match &*typestr {
        "<f2" | "=f2" => Some(Element::F16),
        "<f4" | "=f4" => Some(Element::F32),
        "|u1" | "<u1" => Some(Element::U8),
        "<u2" | "=u2" | "<i2" | "=i2" => Some(Element::U16),
        "<u4" | "=u4" | "<i4" | "=i4" => Some(Element::U32),
        _ => None,
    };
    let element = plane.allow(element, &typestr)?;
    let shape: Vec<usize> = sequence(&item(intern!(py, "shape"))?)?;
    let strides = match interface.get_item(intern!(py, "strides"))? {
        Some(strides) if !strides.is_none() => sequence(&strides)?,
        _ => compact(&shape, element.bytes()),
    };
    if interface.get_item(intern!(py, "mask"))?.is_some_and(|mask| !mask.is_none()) {
        return Err(Fault::Frame(format!("{name} has a mask, expected an array without")).into());
    }
    let (pointer, _read_only): (usize, bool) = item(intern!(py, "data"))?.extract()?;
    Ok((pointer, element, shape, strides))
}

fn sequence<'py, T: FromPyObjectOwned<'py>>(of: &Bound<'py, PyAny>) -> PyResult<Vec<T>> {
    let read = |item: Bound<'py, PyAny>| item.extract::<T>().map_err(Into::into);
    match of.cast::<PyTuple>() {
        Ok(tuple) => tuple.iter().map(read).collect(),
        Err(_) => of.cast::<PyList>()?.iter().map(read).collect(),
    }
}
