//! Compiles GLSL compute kernels to SPIR-V, for build scripts, and reads the interface of a compiled kernel, for checks
//! that GLSL and Rust agree.

mod compile;
#[cfg(feature = "shaderc")]
mod linked;
mod precise;
mod reflect;

pub use compile::{CompileError, Optimise, TARGET_ENV, compile};
#[cfg(feature = "shaderc")]
pub use linked::{Include, compile_linked};
pub use reflect::{Binding, Member, Reflection, ReflectionError, Specialisation, reflect};

/// Converts SPIR-V bytes, as a build script embeds them, to words.
#[must_use]
pub fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect()
}
