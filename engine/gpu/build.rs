//! Compiles every kernel of `glsl/` and checks its reflection against the Rust layouts.

#[path = "src/interface.rs"]
mod interface;
#[path = "src/sources.rs"]
mod sources;

use esaac_kernels::Optimise;
use esaac_layout::{KERNELS, generated_files};
use std::path::{Path, PathBuf};

fn main() {
    let out = PathBuf::from(std::env::var("OUT_DIR").expect("cargo sets OUT_DIR"));
    let glsl_dir = Path::new(&std::env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"))
        .join("../../glsl");
    println!("cargo::rerun-if-changed={}", glsl_dir.display());
    for (name, text) in generated_files() {
        std::fs::write(out.join(name), text).expect("OUT_DIR is writable");
    }
    let includes = [glsl_dir.clone(), out.clone()];

    let mut embedded = String::new();
    let mut all = String::new();
    let mut digests = String::new();
    for kernel in KERNELS {
        let name = kernel.name;
        let source = glsl_dir.join(format!("{name}.comp"));
        let compile = |optimise| {
            esaac_kernels::compile(&source, &includes, &[], optimise)
                .unwrap_or_else(|e| panic!("kernel {name}: {e}"))
        };
        interface::check(kernel, &compile(Optimise::No)).unwrap_or_else(|e| panic!("kernel {name}: {e}"));
        let words = compile(Optimise::Yes);
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        std::fs::write(out.join(format!("{name}.spv")), bytes).expect("OUT_DIR is writable");
        let upper = name.to_uppercase();
        embedded.push_str(&format!(
            "/// SPIR-V of `{name}`.\npub const {upper}: (&str, &[u8]) = \
             (\"{name}\", include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{name}.spv\")));\n"
        ));
        all.push_str(&format!("{upper}, "));
        let digest = sources::digest(name, &glsl_dir, &out, |_| {}).unwrap_or_else(|e| panic!("{e}"));
        digests.push_str(&format!("(\"{name}\", {digest}), "));
    }
    embedded.push_str(&format!("/// Every kernel.\npub const ALL: &[(&str, &[u8])] = &[{all}];\n"));
    embedded.push_str(&format!(
        "/// Digest of the text of every kernel.\npub(crate) const DIGESTS: &[(&str, u64)] = &[{digests}];\n"
    ));
    std::fs::write(out.join("kernels.rs"), embedded).expect("OUT_DIR is writable");
}
