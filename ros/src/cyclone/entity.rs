//! Handles of Cyclone DDS that are released when they are dropped.

#![expect(unsafe_code, reason = "Cyclone DDS's edge")]

use super::graph::Guid;
use std::ffi::CStr;
use std::time::Duration;

/// The text of a return code.
pub(super) fn text_of(code: i32) -> String {
    // SAFETY: the library returns a text of its own for every number.
    unsafe { CStr::from_ptr(cyclors::dds_strretcode(code)) }.to_string_lossy().into_owned()
}

/// A domain, participant, topic or writer.
pub(super) struct Entity(i32);

impl Entity {
    /// Owns the handle that a function of Cyclone returned. A negative value is an error code.
    pub fn new(returned: i32) -> Result<Self, i32> {
        if returned < 0 { Err(returned) } else { Ok(Entity(returned)) }
    }

    pub fn id(&self) -> i32 {
        self.0
    }

    /// The entity's identity on DDS.
    pub fn guid(&self) -> Guid {
        // SAFETY: plain data that the call fills.
        unsafe {
            let mut guid: cyclors::dds_guid_t = std::mem::zeroed();
            cyclors::dds_get_guid(self.0, &raw mut guid);
            guid.v
        }
    }

    /// Number of readers that a writer sends to.
    pub fn matched(&self) -> usize {
        // SAFETY: plain data that the call fills.
        unsafe {
            let mut status: cyclors::dds_publication_matched_status_t = std::mem::zeroed();
            cyclors::dds_get_publication_matched_status(self.0, &raw mut status);
            status.current_count as usize
        }
    }

    /// Number of readers so far whose quality of service did not match, and the policy of the last one.
    pub fn incompatible(&self) -> (u32, &'static str) {
        // SAFETY: plain data that the call fills.
        let status = unsafe {
            let mut status: cyclors::dds_offered_incompatible_qos_status_t = std::mem::zeroed();
            cyclors::dds_get_offered_incompatible_qos_status(self.0, &raw mut status);
            status
        };
        let policy = match status.last_policy_id {
            2 => "DURABILITY",
            4 => "DEADLINE",
            8 => "LIVELINESS",
            11 => "RELIABILITY",
            23 => "DATA_REPRESENTATION",
            _ => "UNKNOWN",
        };
        (status.total_count, policy)
    }

    /// Sends the datagram that a writer has begun to fill.
    pub fn flush(&self) {
        // SAFETY: a call on a live handle. It can only fail if the handle is not a writer.
        let _ = unsafe { cyclors::dds_write_flush(self.0) };
    }

    /// Waits until reliable readers have all messages.
    pub fn wait_for_acks(&self, limit: Duration) {
        let limit_ns = i64::try_from(limit.as_nanos()).unwrap_or(i64::MAX);
        // SAFETY: a call on a live handle. After the limit the caller goes on without the missing readers.
        let _ = unsafe { cyclors::dds_wait_for_acks(self.0, limit_ns) };
    }
}

impl Drop for Entity {
    fn drop(&mut self) {
        // SAFETY: nobody uses the handle any more. If its parent was deleted first, the call fails without
        // effect.
        let _ = unsafe { cyclors::dds_delete(self.0) };
    }
}

/// A quality of service that Cyclone allocated.
pub(super) struct QosHandle(*mut cyclors::dds_qos_t);

impl QosHandle {
    pub fn new() -> Self {
        // SAFETY: the library ends the process if it runs out of memory, so this is never null.
        QosHandle(unsafe { cyclors::dds_create_qos() })
    }

    pub fn as_ptr(&self) -> *mut cyclors::dds_qos_t {
        self.0
    }

    pub fn set_user_data(&self, text: &str) {
        // SAFETY: the handle is alive; the text is copied.
        unsafe { cyclors::dds_qset_userdata(self.0, text.as_ptr().cast(), text.len()) }
    }
}

impl Drop for QosHandle {
    fn drop(&mut self) {
        // SAFETY: nobody uses the handle any more.
        unsafe { cyclors::dds_delete_qos(self.0) }
    }
}
