//! Compiles the bench's own kernels.

use esaac_kernels::{Optimise, compile};
use std::path::{Path, PathBuf};

fn main() {
    let folder =
        Path::new(&std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR")).join("src");
    let out = PathBuf::from(std::env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    for kernel in ["heat", "copy"] {
        let source = folder.join(format!("{kernel}.comp"));
        println!("cargo::rerun-if-changed={}", source.display());
        let words = compile(&source, &[], &[], Optimise::Yes).unwrap_or_else(|e| panic!("{e}"));
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        std::fs::write(out.join(format!("{kernel}.spv")), bytes).expect("OUT_DIR is writable");
    }
}
