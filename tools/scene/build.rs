//! Compiles the renderer's shader.

use std::path::{Path, PathBuf};

fn main() {
    let glsl =
        Path::new(&std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR")).join("glsl");
    println!("cargo::rerun-if-changed={}", glsl.display());
    let words = esaac_kernels::compile(
        &glsl.join("render.comp"),
        std::slice::from_ref(&glsl),
        &[],
        esaac_kernels::Optimise::Yes,
    )
    .unwrap_or_else(|error| panic!("kernel render: {error}"));
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let out = PathBuf::from(std::env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    std::fs::write(out.join("render.spv"), bytes).expect("OUT_DIR is writable");
}
