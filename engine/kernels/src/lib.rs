//! GLSL compute kernels to SPIR-V, for build scripts, and what a compiled kernel says of itself, for
//! the checks that hold GLSL and Rust together.

mod compile;
#[cfg(feature = "shaderc")]
mod linked;
mod precise;
mod reflect;

pub use compile::{CompileError, Optimise, TARGET_ENV, compile};
#[cfg(feature = "shaderc")]
pub use linked::{Include, compile_linked};
pub use reflect::{Binding, Member, Reflection, ReflectionError, reflect};

/// SPIR-V bytes, as embedded by a build script, to words.
#[must_use]
pub fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect()
}
