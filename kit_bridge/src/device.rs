//! Lists devices, and opens them. Cameras on the same device share it.

use crate::error::Fault;
use crate::process::OwnProcess;
use esaac_cli::arguments::DeviceArgument;
use esaac_cli::device_choice::uuid_text;
use esaac_engine::{Device, DeviceChoice, Validation, find_device, list_devices};
use esaac_interop::cuda::cuda_devices;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, PoisonError, Weak};

/// Open devices of this process, with the choices that named them.
static OPEN: Mutex<Vec<(u32, DeviceChoice, Weak<Device>)>> = Mutex::new(Vec::new());

/// The device that Python names: None for the best, a number or UUID of `devices()`, or `cuda:N`.
fn choice(named: Option<&Bound<'_, PyAny>>) -> PyResult<DeviceChoice> {
    let from_environment = std::env::var("ESAAC_DEVICE").ok().filter(|name| !name.is_empty());
    let name = match named {
        None => match from_environment {
            None => return Ok(DeviceChoice::Best),
            Some(name) => name,
        },
        Some(named) => named.str()?.to_cow()?.into_owned(),
    };
    if let Some(ordinal) = name.strip_prefix("cuda") {
        let number = if ordinal.is_empty() { Some("0") } else { ordinal.strip_prefix(':') };
        let ordinal: i32 = number.and_then(|number| number.parse().ok()).ok_or_else(|| {
            Fault::Argument(format!("device is `{name}`, expected `cuda:N` with a number of a CUDA device"))
        })?;
        let found = cuda_devices().map_err(Fault::from)?.into_iter().find(|d| d.ordinal == ordinal);
        return Ok(DeviceChoice::Uuid(
            found.ok_or_else(|| Fault::Device(format!("there is no CUDA device {ordinal}")))?.uuid,
        ));
    }
    let DeviceArgument(choice) =
        name.parse().map_err(|reason| Fault::Argument(format!("device is `{name}`, {reason}")))?;
    Ok(choice)
}

/// Opens a device, or shares it if it is open.
pub fn open(py: Python<'_>, named: Option<&Bound<'_, PyAny>>) -> PyResult<OwnProcess<Arc<Device>>> {
    let (choice, here) = (choice(named)?, std::process::id());
    let device = py.detach(|| {
        let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
        // After fork() the list still has the parent's devices.
        open.retain(|(owner, _, device)| *owner == here && device.strong_count() > 0);
        let known = open.iter().find(|(_, made_by, _)| *made_by == choice);
        if let Some(device) = known.and_then(|(_, _, device)| device.upgrade()) {
            return Ok(device);
        }
        // It may be open under another name.
        let info = find_device(choice).map_err(Fault::from)?;
        let is_it =
            |device: &Arc<Device>| (device.info().index, device.info().uuid) == (info.index, info.uuid);
        let device = match open.iter().filter_map(|(.., device)| device.upgrade()).find(is_it) {
            Some(device) => device,
            None => Device::open(choice, Validation::from_env()).map_err(Fault::from)?,
        };
        open.push((here, choice, Arc::downgrade(&device)));
        Ok::<_, Fault>(device)
    })?;
    Ok(OwnProcess::new(device))
}

/// Every Vulkan device of this machine: number, name, kind, UUID, driver, whether the engine can use it, and
/// its number in CUDA.
#[pyfunction]
pub fn devices(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let list = py.detach(list_devices).map_err(Fault::from)?;
    // Vulkan devices are listed on machines without CUDA too.
    let cuda = cuda_devices().unwrap_or_default();
    list.iter()
        .map(|info| {
            let entry = PyDict::new(py);
            entry.set_item("index", info.index)?;
            entry.set_item("name", &info.name)?;
            entry.set_item("kind", info.kind)?;
            entry.set_item("uuid", uuid_text(&info.uuid))?;
            entry.set_item("driver", &info.driver)?;
            entry.set_item("memory_bytes", info.memory_bytes)?;
            entry.set_item("suitable", info.suitable)?;
            entry.set_item("cuda", cuda.iter().find(|d| d.uuid == info.uuid).map(|d| d.ordinal))?;
            Ok(entry)
        })
        .collect()
}
