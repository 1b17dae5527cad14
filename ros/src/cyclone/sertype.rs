//! Lets Cyclone DDS read encoded messages directly from the encoder's buffer, also when it sends a message
//! again. There is no copy between that buffer and the system's socket.

#![expect(unsafe_code, reason = "Cyclone DDS's edge")]

use crate::payload::Payload;
use cyclors::{
    DDSI_SERTYPE_FLAG_TOPICKIND_NO_KEY, dds_free_op_t, ddsi_keyhash, ddsi_rdata, ddsi_serdata,
    ddsi_serdata_init, ddsi_serdata_kind, ddsi_serdata_kind_SDK_DATA, ddsi_serdata_kind_SDK_KEY,
    ddsi_serdata_ops, ddsi_sertype, ddsi_sertype_fini, ddsi_sertype_init_flags, ddsi_sertype_ops,
    ddsi_sertype_v0, ddsrt_iovec_t, ddsrt_msg_iovlen_t,
};
use std::ffi::{CStr, c_char, c_void};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

unsafe extern "C" {
    /// Adds a reference. The library exports this function; its binding does not have it.
    fn ddsi_serdata_ref(serdata: *const ddsi_serdata) -> *mut ddsi_serdata;
}

/// A message that Cyclone owns. Cyclone knows the first field only.
#[repr(C)]
struct Sample {
    base: ddsi_serdata,
    /// `None` for a topic's key, which is empty because the topics have no keys.
    payload: Option<Arc<Payload>>,
}

/// A type without keys whose samples are payloads. Cyclone owns it once there is a topic of it.
pub(super) fn new_sertype(type_name: &CStr) -> *mut ddsi_sertype {
    // SAFETY: all-zero bytes are a valid `ddsi_sertype` (numbers and null pointers), which the call fills.
    // The tables are static and the name is copied.
    unsafe {
        let sertype = Box::into_raw(Box::new(std::mem::zeroed::<ddsi_sertype>()));
        ddsi_sertype_init_flags(
            sertype,
            type_name.as_ptr(),
            &SERTYPE_OPS.0,
            &SERDATA_OPS,
            DDSI_SERTYPE_FLAG_TOPICKIND_NO_KEY,
        );
        sertype
    }
}

/// A sample of `sertype` that keeps `payload` alive. The caller owns one reference.
pub(super) fn new_sample(sertype: *const ddsi_sertype, payload: &Arc<Payload>) -> *mut ddsi_serdata {
    sample(sertype, ddsi_serdata_kind_SDK_DATA, Some(Arc::clone(payload)))
}

fn sample(
    sertype: *const ddsi_sertype,
    kind: ddsi_serdata_kind,
    payload: Option<Arc<Payload>>,
) -> *mut ddsi_serdata {
    // SAFETY: all-zero bytes are a valid `ddsi_serdata`, which the call fills; `Sample` begins with it.
    unsafe {
        let sample = Box::into_raw(Box::new(Sample { base: std::mem::zeroed(), payload }));
        ddsi_serdata_init(sample.cast(), sertype, kind);
        sample.cast()
    }
}

/// The bytes of a sample and their number without padding.
///
/// # Safety
/// `serdata` was made by [`sample`] and has not been freed.
unsafe fn bytes<'a>(serdata: *const ddsi_serdata) -> (&'a [u8], usize) {
    // SAFETY: the caller guarantees a live sample. The payload lives as long as the sample, and Cyclone holds
    // a reference to the sample while it reads.
    match unsafe { &(*serdata.cast::<Sample>()).payload } {
        Some(payload) => (payload.padded(), payload.len()),
        None => (&[], 0),
    }
}

unsafe extern "C" fn eqkey(_: *const ddsi_serdata, _: *const ddsi_serdata) -> bool {
    true
}

unsafe extern "C" fn get_size(serdata: *const ddsi_serdata) -> u32 {
    // SAFETY: Cyclone calls this only with samples of types that `new_sertype` made.
    unsafe { bytes(serdata) }.1 as u32
}

/// This process has no readers of these types, so it never receives samples.
unsafe extern "C" fn from_ser(
    _: *const ddsi_sertype,
    _: ddsi_serdata_kind,
    _: *const ddsi_rdata,
    _: usize,
) -> *mut ddsi_serdata {
    std::ptr::null_mut()
}

unsafe extern "C" fn from_ser_iov(
    _: *const ddsi_sertype,
    _: ddsi_serdata_kind,
    _: ddsrt_msg_iovlen_t,
    _: *const ddsrt_iovec_t,
    _: usize,
) -> *mut ddsi_serdata {
    std::ptr::null_mut()
}

unsafe extern "C" fn from_keyhash(_: *const ddsi_sertype, _: *const ddsi_keyhash) -> *mut ddsi_serdata {
    std::ptr::null_mut()
}

unsafe extern "C" fn from_sample(
    _: *const ddsi_sertype,
    _: ddsi_serdata_kind,
    _: *const c_void,
) -> *mut ddsi_serdata {
    std::ptr::null_mut()
}

/// Whether Cyclone has ever asked this process for a copy of a message instead of reading it in place.
static COPIED: AtomicBool = AtomicBool::new(false);

/// How often a message is copied on its way to the socket.
pub(super) fn copies() -> u32 {
    COPIED.load(Ordering::Relaxed).into()
}

unsafe extern "C" fn to_ser(serdata: *const ddsi_serdata, offset: usize, size: usize, out: *mut c_void) {
    COPIED.fetch_or(size > 0, Ordering::Relaxed);
    // SAFETY: Cyclone asks for bytes of this sample, padded to a multiple of four, and `out` has room for
    // them.
    unsafe {
        let part = &bytes(serdata).0[offset..offset + size];
        std::ptr::copy_nonoverlapping(part.as_ptr(), out.cast(), size);
    }
}

unsafe extern "C" fn to_ser_ref(
    serdata: *const ddsi_serdata,
    offset: usize,
    size: usize,
    reference: *mut ddsrt_iovec_t,
) -> *mut ddsi_serdata {
    // SAFETY: as for `to_ser`. The added reference keeps the sample alive until `to_ser_unref`.
    unsafe {
        let part = &bytes(serdata).0[offset..offset + size];
        (*reference).iov_base = part.as_ptr().cast_mut().cast();
        (*reference).iov_len = size as _;
        ddsi_serdata_ref(serdata)
    }
}

unsafe extern "C" fn to_ser_unref(serdata: *mut ddsi_serdata, _: *const ddsrt_iovec_t) {
    // SAFETY: drops the reference that `to_ser_ref` added.
    unsafe { cyclors::ddsi_serdata_unref(serdata) }
}

unsafe extern "C" fn to_sample(
    _: *const ddsi_serdata,
    _: *mut c_void,
    _: *mut *mut c_void,
    _: *mut c_void,
) -> bool {
    false
}

unsafe extern "C" fn to_untyped(serdata: *const ddsi_serdata) -> *mut ddsi_serdata {
    // SAFETY: the sample's type is alive. The untyped key must have no type, as Cyclone requires.
    unsafe {
        let key = sample((*serdata).type_, ddsi_serdata_kind_SDK_KEY, None);
        (*key).type_ = std::ptr::null();
        key
    }
}

unsafe extern "C" fn untyped_to_sample(
    _: *const ddsi_sertype,
    _: *const ddsi_serdata,
    _: *mut c_void,
    _: *mut *mut c_void,
    _: *mut c_void,
) -> bool {
    false
}

unsafe extern "C" fn free(serdata: *mut ddsi_serdata) {
    // SAFETY: the last reference is gone, and the sample came from a `Box`.
    drop(unsafe { Box::from_raw(serdata.cast::<Sample>()) });
}

unsafe extern "C" fn print(
    _: *const ddsi_sertype,
    _: *const ddsi_serdata,
    out: *mut c_char,
    size: usize,
) -> usize {
    if size > 0 {
        // SAFETY: there is room for at least one character.
        unsafe { *out = 0 };
    }
    0
}

unsafe extern "C" fn get_keyhash(_: *const ddsi_serdata, out: *mut ddsi_keyhash, _: bool) {
    // SAFETY: `out` is a key hash to fill. All zeros mean no key.
    unsafe { out.write_bytes(0, 1) };
}

static SERDATA_OPS: ddsi_serdata_ops = ddsi_serdata_ops {
    eqkey: Some(eqkey),
    get_size: Some(get_size),
    from_ser: Some(from_ser),
    from_ser_iov: Some(from_ser_iov),
    from_keyhash: Some(from_keyhash),
    from_sample: Some(from_sample),
    to_ser: Some(to_ser),
    to_ser_ref: Some(to_ser_ref),
    to_ser_unref: Some(to_ser_unref),
    to_sample: Some(to_sample),
    to_untyped: Some(to_untyped),
    untyped_to_sample: Some(untyped_to_sample),
    free: Some(free),
    print: Some(print),
    get_keyhash: Some(get_keyhash),
    // Shared memory by plug-ins: not used.
    from_loaned_sample: None,
    from_psmx: None,
};

unsafe extern "C" fn free_sertype(sertype: *mut ddsi_sertype) {
    // SAFETY: nobody refers to it any more, and it came from a `Box`.
    unsafe {
        ddsi_sertype_fini(sertype);
        drop(Box::from_raw(sertype));
    }
}

unsafe extern "C" fn zero_samples(_: *const ddsi_sertype, _: *mut c_void, _: usize) {}

unsafe extern "C" fn realloc_samples(
    _: *mut *mut c_void,
    _: *const ddsi_sertype,
    _: *mut c_void,
    _: usize,
    _: usize,
) {
}

unsafe extern "C" fn free_samples(_: *const ddsi_sertype, _: *mut *mut c_void, _: usize, _: dds_free_op_t) {}

unsafe extern "C" fn equal(_: *const ddsi_sertype, _: *const ddsi_sertype) -> bool {
    // Cyclone has compared the names already, and types have nothing else.
    true
}

unsafe extern "C" fn hash(_: *const ddsi_sertype) -> u32 {
    0
}

/// The table of functions. A pointer in it keeps it from being `Sync` by itself.
struct SertypeOps(ddsi_sertype_ops);
// SAFETY: the only pointer in it is null and never written.
unsafe impl Sync for SertypeOps {}

static SERTYPE_OPS: SertypeOps = SertypeOps(ddsi_sertype_ops {
    version: Some(ddsi_sertype_v0),
    arg: std::ptr::null_mut(),
    free: Some(free_sertype),
    zero_samples: Some(zero_samples),
    realloc_samples: Some(realloc_samples),
    free_samples: Some(free_samples),
    equal: Some(equal),
    hash: Some(hash),
    type_id: None,
    type_map: None,
    type_info: None,
    derive_sertype: None,
    get_serialized_size: None,
    serialize_into: None,
});
