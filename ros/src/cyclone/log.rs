//! Collects the log lines of Cyclone DDS, for error messages and notices.

#![expect(unsafe_code, reason = "Cyclone DDS's edge")]

use super::entity::text_of;
use std::ffi::c_void;
use std::sync::{Mutex, PoisonError};

/// Most lines that are kept. Later ones are repetitions.
const MOST: usize = 64;

/// The library's domain number for lines that belong to no domain.
const ANY: u32 = u32::MAX;

static LINES: Mutex<Vec<(u32, String)>> = Mutex::new(Vec::new());

unsafe extern "C" fn sink(_: *mut c_void, data: *const cyclors::dds_log_data_t) {
    // SAFETY: the library passes a line of `size` bytes that lives until this returns.
    let (domain, line) = unsafe {
        let data = &*data;
        (data.domid, std::slice::from_raw_parts(data.message.cast::<u8>(), data.size))
    };
    let mut lines = LINES.lock().unwrap_or_else(PoisonError::into_inner);
    if lines.len() < MOST {
        lines.push((domain, String::from_utf8_lossy(line).trim().to_owned()));
    }
}

/// Collects this process's lines from now on, instead of printing them.
pub(super) fn take_over() {
    // SAFETY: the function is static and uses no data.
    unsafe { cyclors::dds_set_log_sink(Some(sink), std::ptr::null_mut()) }
}

/// Lines about a domain since the last call.
pub(super) fn take(domain: u32) -> Vec<String> {
    let mut lines = LINES.lock().unwrap_or_else(PoisonError::into_inner);
    lines.extract_if(.., |(about, _)| *about == domain || *about == ANY).map(|(_, line)| line).collect()
}

/// A return code with the lines about the domain.
pub(super) fn explain(domain: u32, code: i32) -> String {
    let lines = take(domain);
    match lines.is_empty() {
        true => text_of(code),
        false => format!("{} ({})", lines.join("; "), text_of(code)),
    }
}
