//! Compiles GLSL compute kernels to SPIR-V, for build scripts and for kernels under development, and reads the interface
//! of a compiled kernel, for checks that GLSL and Rust agree.

mod compile;
mod precise;
mod reflect;

pub use compile::{CompileError, Optimise, TARGET_ENV, compile};
pub use reflect::{Binding, Member, Reflection, ReflectionError, Specialisation, reflect};

/// Converts SPIR-V bytes, as a build script embeds them, to words.
#[must_use]
pub fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect()
}
