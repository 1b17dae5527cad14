//! What can go wrong between two processes.

use crate::wire::{ErrorCode, WireError};
use esaac_engine::EngineError;
use esaac_engine::ash::vk;
use rustix::io::Errno;
use std::path::PathBuf;
use std::time::Duration;
use thiserror::Error;

/// Every error of this crate.
#[derive(Debug, Error)]
pub enum InteropError {
    /// The engine's.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// Bytes that are no valid message.
    #[error("message: {0}")]
    Wire(#[from] WireError),
    /// One side has refused to go on: the peer said so, or this side is about to tell the peer.
    #[error("refused ({code:?}): {text}")]
    Refused {
        /// Why.
        code: ErrorCode,
        /// The same in words.
        text: String,
    },
    /// The peer has closed the connection or is dead.
    #[error("the peer closed the connection")]
    PeerGone,
    /// Something took too long.
    #[error("{what} did not come within {limit:?}")]
    Timeout {
        /// What was waited for.
        what: &'static str,
        /// How long.
        limit: Duration,
    },
    /// The peer does not read what it is sent.
    #[error("the peer reads no messages: its queue is full")]
    PeerStalled,
    /// A system call failed.
    #[error("{call}: {source}")]
    System {
        /// The call.
        call: &'static str,
        /// Its error.
        source: Errno,
    },
    /// A socket that cannot be made or reached.
    #[error("socket {}: {reason}", path.display())]
    Socket {
        /// Where.
        path: PathBuf,
        /// Why, and what to do.
        reason: String,
    },
    /// The driver cannot share memory in a way that is needed.
    #[error("device {device} cannot share memory: {reason}")]
    Unsupported {
        /// Device.
        device: String,
        /// What is missing.
        reason: String,
    },
    /// Memory of another process that the driver does not take.
    #[error("import of {bytes} bytes for `{name}` failed: {call}: {result}; {hint}")]
    Import {
        /// Which buffer.
        name: String,
        /// Its size.
        bytes: u64,
        /// The call.
        call: &'static str,
        /// Its result.
        result: String,
        /// What that means, and what to do.
        hint: &'static str,
    },
    /// Memory of another process that is not as long as was said.
    #[error("`{name}` has {actual} bytes, expected {expected}")]
    Size {
        /// Which buffer.
        name: String,
        /// What it must have.
        expected: u64,
        /// What it has.
        actual: u64,
    },
    /// No CUDA.
    #[error("there is no CUDA driver (libcuda.so.1); install NVIDIA's driver, or produce frames with Vulkan")]
    NoCuda,
    /// No CUDA device, or not the one asked for.
    #[error("there is no CUDA device{wanted}")]
    NoCudaDevice {
        /// Which, if one was asked for.
        wanted: String,
    },
    /// A CUDA call failed.
    #[error("{call} failed: {result}")]
    Cuda {
        /// The call.
        call: &'static str,
        /// CUDA's name for the result.
        result: String,
    },
    /// An image in CUDA's own layout that is not what it must be.
    #[error("the texture of `{name}` is {actual}, expected {expected}")]
    Texture {
        /// Which image.
        name: String,
        /// What it must be.
        expected: String,
        /// What it is.
        actual: String,
    },
    /// Poses that cannot be sent with a frame.
    #[error("poses of the frame: {reason}")]
    Scene {
        /// Why.
        reason: String,
    },
    /// A timeline that does not have the value that comes next.
    #[error("slot {slot}: timeline value {actual}, expected {expected}")]
    Value {
        /// Slot.
        slot: u32,
        /// The next value by the rule.
        expected: u64,
        /// What came.
        actual: u64,
    },
}

impl InteropError {
    pub(crate) fn vulkan(call: &'static str, result: vk::Result) -> Self {
        InteropError::Engine(EngineError::Vulkan { call, result })
    }

    pub(crate) fn system(call: &'static str) -> impl Fn(Errno) -> Self {
        move |source| InteropError::System { call, source }
    }

    /// The text that is sent to the peer, beside the code.
    #[must_use]
    pub fn words(&self) -> String {
        match self {
            InteropError::Refused { text, .. } => text.clone(),
            other => other.to_string(),
        }
    }

    /// The code that is sent to the peer.
    #[must_use]
    pub fn code(&self) -> ErrorCode {
        match self {
            InteropError::Refused { code, .. } => *code,
            InteropError::Wire(error) => error.code(),
            InteropError::Import { .. } | InteropError::Size { .. } => ErrorCode::Memory,
            InteropError::Engine(EngineError::OutOfMemory { .. }) => ErrorCode::Memory,
            InteropError::Cuda { .. } | InteropError::Texture { .. } => ErrorCode::Memory,
            InteropError::Unsupported { .. } => ErrorCode::Unsupported,
            InteropError::Timeout { .. } => ErrorCode::Timeout,
            InteropError::Scene { .. } => ErrorCode::Poses,
            InteropError::Value { .. } => ErrorCode::Value,
            _ => ErrorCode::Internal,
        }
    }
}
