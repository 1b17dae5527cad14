//! Passes the commit on to the program, for `esaac --version`.

#[path = "src/commit.rs"]
mod commit;

use std::path::PathBuf;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=src/commit.rs");
    let manifest = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it"));
    let root = manifest.join("../..");
    let checkout = commit::Checkout::at(&root);
    if let Some(checkout) = &checkout {
        println!("cargo::rerun-if-changed={}", checkout.changes_with.display());
        // An edit of what the program is made of may make the commit a modified one.
        for folder in ["benches", "engine", "glsl", "interop", "ros", "tools"] {
            println!("cargo::rerun-if-changed={}", root.join(folder).display());
        }
    }
    let commit = checkout.map(|checkout| checkout.commit).unwrap_or_default();
    println!("cargo::rustc-env=ESAAC_COMMIT={commit}");
}
