//! Compiles the bench's own kernel.

use esaac_kernels::{Optimise, compile};
use std::path::{Path, PathBuf};

fn main() {
    let source = Path::new(&std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"))
        .join("src/heat.comp");
    println!("cargo::rerun-if-changed={}", source.display());
    let words = compile(&source, &[], &[], Optimise::Yes).unwrap_or_else(|e| panic!("{e}"));
    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
    let out = PathBuf::from(std::env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    std::fs::write(out.join("heat.spv"), bytes).expect("OUT_DIR is writable");
}
