//! What Cyclone DDS would print: kept, to explain errors and to be told as notices.

#![expect(unsafe_code, reason = "Cyclone DDS's edge")]

use super::entity::text_of;
use std::ffi::c_void;
use std::sync::{Mutex, PoisonError};

/// Lines that nobody has asked for yet; what is beyond them is repetition.
const MOST: usize = 64;

/// The library's number for what is about no domain.
const ANY: u32 = u32::MAX;

static LINES: Mutex<Vec<(u32, String)>> = Mutex::new(Vec::new());

unsafe extern "C" fn sink(_: *mut c_void, data: *const cyclors::dds_log_data_t) {
    // SAFETY: the library hands over a line of `size` bytes that lives until this returns.
    let (domain, line) = unsafe {
        let data = &*data;
        (data.domid, std::slice::from_raw_parts(data.message.cast::<u8>(), data.size))
    };
    let mut lines = LINES.lock().unwrap_or_else(PoisonError::into_inner);
    if lines.len() < MOST {
        lines.push((domain, String::from_utf8_lossy(line).trim().to_owned()));
    }
}

/// Takes the lines of this process from here on.
pub(super) fn take_over() {
    // SAFETY: the function lives for ever and needs no data.
    unsafe { cyclors::dds_set_log_sink(Some(sink), std::ptr::null_mut()) }
}

/// Lines about a domain since the last call.
pub(super) fn take(domain: u32) -> Vec<String> {
    let mut lines = LINES.lock().unwrap_or_else(PoisonError::into_inner);
    lines.extract_if(.., |(about, _)| *about == domain || *about == ANY).map(|(_, line)| line).collect()
}

/// A return code with what was printed about the domain.
pub(super) fn explain(domain: u32, code: i32) -> String {
    let lines = take(domain);
    match lines.is_empty() {
        true => text_of(code),
        false => format!("{} ({})", lines.join("; "), text_of(code)),
    }
}
