//! A stream of a context: the caller's, or one of our own.

#![expect(unsafe_code, reason = "CUDA's edge")]

use super::context::{Context, check};
use crate::error::InteropError;
use cudarc::driver::sys;
use std::sync::Arc;

pub(super) struct Stream {
    context: Arc<Context>,
    pub(super) raw: sys::CUstream,
    owned: bool,
}

// SAFETY: the stream is a handle of a context that is entered for every use, on whichever thread.
unsafe impl Send for Stream {}

impl Stream {
    pub(super) fn new(context: &Arc<Context>, given: Option<u64>) -> Result<Self, InteropError> {
        let owned = given.is_none();
        let mut raw = given.map_or(std::ptr::null_mut(), |given| given as sys::CUstream);
        if owned {
            let _entered = context.enter()?;
            let flags = sys::CUstream_flags::CU_STREAM_NON_BLOCKING as u32;
            // SAFETY: a context is current.
            check("cuStreamCreate", unsafe { sys::cuStreamCreate(&mut raw, flags) })?;
        }
        Ok(Stream { context: Arc::clone(context), raw, owned })
    }

    /// Waits for all that is in it. The context is current.
    pub(super) fn finish(&self) -> Result<(), InteropError> {
        // SAFETY: the stream is of the current context.
        check("cuStreamSynchronize", unsafe { sys::cuStreamSynchronize(self.raw) })
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        if !self.owned {
            return;
        }
        let destroyed = self.context.enter().and_then(|_entered| {
            // SAFETY: the stream was made here, and its work is waited for.
            check("cuStreamDestroy", unsafe { sys::cuStreamDestroy_v2(self.raw) })
        });
        if let Err(error) = destroyed {
            eprintln!("esaac: {error}");
        }
    }
}
