//! Compiles every kernel of `glsl/` and checks what it says of itself against the Rust layouts.

#[path = "src/interface.rs"]
mod interface;

use esaac_kernels::Optimise;
use esaac_model::layout::glsl;
use std::path::{Path, PathBuf};

fn main() {
    let out = PathBuf::from(std::env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    let glsl_dir = Path::new(&std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"))
        .join("../../glsl");
    println!("cargo::rerun-if-changed={}", glsl_dir.display());
    std::fs::write(out.join("layout.glsl"), glsl()).expect("OUT_DIR is writable");
    let includes = [glsl_dir.clone(), out.clone()];

    for stage in interface::STAGES {
        let source = glsl_dir.join(format!("{stage}.comp"));
        let compile = |optimise| {
            esaac_kernels::compile(&source, &includes, &[], optimise)
                .unwrap_or_else(|e| panic!("kernel {stage}: {e}"))
        };
        interface::check(stage, &compile(Optimise::No)).unwrap_or_else(|e| panic!("kernel {stage}: {e}"));
        let words = compile(Optimise::Yes);
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        std::fs::write(out.join(format!("{stage}.spv")), bytes).expect("OUT_DIR is writable");
    }
}
