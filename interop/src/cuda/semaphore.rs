//! A slot's timeline in CUDA, where the engine exports it.

#![expect(unsafe_code, reason = "CUDA's edge")]

use super::context::{Context, check};
use crate::error::InteropError;
use crate::lent::Lent;
use cudarc::driver::sys;
use rustix::fd::OwnedFd;
use std::sync::Arc;

/// An imported timeline semaphore.
pub(super) struct CudaTimeline {
    context: Arc<Context>,
    raw: sys::CUexternalSemaphore,
}

// SAFETY: a handle of a context that is entered for every use, on whichever thread.
unsafe impl Send for CudaTimeline {}

impl CudaTimeline {
    pub(super) fn import(context: &Arc<Context>, fd: OwnedFd) -> Result<Self, InteropError> {
        let _entered = context.enter()?;
        let lent = Lent::new(fd)?;
        let description = sys::CUDA_EXTERNAL_SEMAPHORE_HANDLE_DESC {
            type_:
                sys::CUexternalSemaphoreHandleType::CU_EXTERNAL_SEMAPHORE_HANDLE_TYPE_TIMELINE_SEMAPHORE_FD,
            handle: sys::CUDA_EXTERNAL_SEMAPHORE_HANDLE_DESC_st__bindgen_ty_1 { fd: lent.number() },
            flags: 0,
            reserved: [0; 16],
        };
        let mut raw = std::ptr::null_mut();
        // SAFETY: a context is current; the description names an open descriptor and outlives the call.
        check("cuImportExternalSemaphore", unsafe {
            sys::cuImportExternalSemaphore(&mut raw, &description)
        })?;
        lent.taken();
        Ok(CudaTimeline { context: Arc::clone(context), raw })
    }

    /// Has the stream set `value` when it comes there. The context is current.
    pub(super) fn signal(&self, stream: sys::CUstream, value: u64) -> Result<(), InteropError> {
        // SAFETY: all zero is a valid value of this plain struct.
        let mut parameters: sys::CUDA_EXTERNAL_SEMAPHORE_SIGNAL_PARAMS = unsafe { std::mem::zeroed() };
        parameters.params.fence.value = value;
        // SAFETY: stream and semaphore are of the current context; one parameter for one semaphore.
        check("cuSignalExternalSemaphoresAsync", unsafe {
            sys::cuSignalExternalSemaphoresAsync(&self.raw, &parameters, 1, stream)
        })
    }

    /// Has the stream wait for `value`. The context is current.
    pub(super) fn wait(&self, stream: sys::CUstream, value: u64) -> Result<(), InteropError> {
        // SAFETY: all zero is a valid value of this plain struct.
        let mut parameters: sys::CUDA_EXTERNAL_SEMAPHORE_WAIT_PARAMS = unsafe { std::mem::zeroed() };
        parameters.params.fence.value = value;
        // SAFETY: as above.
        check("cuWaitExternalSemaphoresAsync", unsafe {
            sys::cuWaitExternalSemaphoresAsync(&self.raw, &parameters, 1, stream)
        })
    }
}

impl Drop for CudaTimeline {
    fn drop(&mut self) {
        let destroyed = self.context.enter().and_then(|_entered| {
            // SAFETY: whoever owns it has waited for its stream.
            check("cuDestroyExternalSemaphore", unsafe { sys::cuDestroyExternalSemaphore(self.raw) })
        });
        if let Err(error) = destroyed {
            eprintln!("esaac: {error}");
        }
    }
}
