//! What a driver says that it can share is tried before it is offered to anybody.

use crate::error::InteropError;
use crate::memory::SharedBuffer;
use crate::support::Support;
use esaac_engine::Device;
use std::sync::Arc;

impl Support {
    /// Asks the driver, and gives it a page of the host's memory if it says that it takes such: amdgpu has the extension, but
    /// takes no pages of a file.
    #[must_use]
    pub fn of(device: &Arc<Device>) -> Self {
        let mut support = Support::told(device);
        if support.host_alignment.is_some()
            && let Some(refused) = refusal_of_the_hosts(device)
        {
            support.host_alignment = None;
            support.host_refused = Some(refused);
        }
        support
    }
}

/// Why a driver takes no page of a mapped file, in words; `None` if it takes it, or if the system has none to give.
fn refusal_of_the_hosts(device: &Arc<Device>) -> Option<String> {
    let why = match SharedBuffer::on_host(device, "a first page", 16, None) {
        Ok(_) | Err(InteropError::System { .. }) => return None,
        Err(InteropError::Import { call, result, .. }) => format!("{call}: {result}"),
        Err(error) => error.to_string(),
    };
    Some(format!("the driver refuses memory of the host that is a file, as two processes need it ({why})"))
}
