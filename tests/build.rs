//! Compiles the checksum kernel at build time, so that the suites also run on machines without a shader compiler.

use std::path::{Path, PathBuf};

fn main() {
    let folder = std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    let source = Path::new(&folder).join("glsl/checksum.comp");
    println!("cargo::rerun-if-changed={}", source.display());
    let words = esaac_kernels::compile(&source, &[], &[], esaac_kernels::Optimise::Yes)
        .unwrap_or_else(|error| panic!("kernel checksum: {error}"));
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let out = PathBuf::from(std::env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    std::fs::write(out.join("checksum.spv"), bytes).expect("OUT_DIR is writable");
}
