//! Shipped packages depend on no test code, and their metadata agrees everywhere.

use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Packages shipped to users.
const SHIPPED: [&str; 2] = ["esaac-cli", "esaac-python"];

/// Crates that hold test code alone.
const TEST_CODE: [&str; 1] = ["esaac-tests"];

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    version: String,
    dependencies: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    name: String,
    /// `dev`, `build`, or none for a normal dependency.
    kind: Option<String>,
    /// Set for packages of this workspace.
    path: Option<PathBuf>,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn workspace() -> BTreeMap<String, Package> {
    let done = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let metadata: Metadata = serde_json::from_slice(&done.stdout).expect("cargo's metadata");
    metadata.packages.into_iter().map(|package| (package.name.clone(), package)).collect()
}

/// Packages of the workspace needed to build a package, itself included. Assumes that all features are on.
fn needed<'a>(workspace: &'a BTreeMap<String, Package>, package: &'a str) -> BTreeSet<&'a str> {
    let (mut found, mut waiting) = (BTreeSet::new(), vec![package]);
    while let Some(name) = waiting.pop() {
        if found.insert(name) {
            let own = workspace[name].dependencies.iter();
            let own = own.filter(|d| d.path.is_some() && d.kind.as_deref() != Some("dev"));
            waiting.extend(own.map(|d| d.name.as_str()));
        }
    }
    found
}

#[test]
fn program_and_wheel_need_no_test_code() {
    let workspace = workspace();
    for shipped in SHIPPED {
        let needed = needed(&workspace, shipped);
        assert!(needed.contains("esaac-engine"), "{shipped} needs {needed:?}");
        for test in TEST_CODE {
            assert!(workspace.contains_key(test), "the workspace has no {test}");
            assert!(!needed.contains(test), "{shipped} needs {test}");
        }
    }
}

#[test]
fn every_package_has_the_workspace_version() {
    let version = env!("CARGO_PKG_VERSION");
    for package in workspace().values() {
        assert_eq!(package.version, version, "{}", package.name);
    }
    for (path, line) in [
        ("ros/esaac_msgs/package.xml", format!("<version>{version}</version>")),
        ("kit_bridge/exts/esaac.sim/config/extension.toml", format!("version = \"{version}\"")),
    ] {
        let text = read(path);
        assert!(text.lines().any(|l| l.trim() == line), "{path} has no line `{line}`");
    }
}

#[test]
fn the_pinned_toolchain_is_new_enough() {
    let table = |path: &str| -> toml::Table { read(path).parse().unwrap_or_else(|e| panic!("{path}: {e}")) };
    let (toolchain, workspace) = (table("rust-toolchain.toml"), table("Cargo.toml"));
    let numbers = |version: &str| -> Vec<u32> {
        version.split('.').map(|n| n.parse().unwrap_or_else(|e| panic!("{version}: {e}"))).collect()
    };
    let pinned = toolchain["toolchain"]["channel"].as_str().expect("a channel");
    let least = workspace["workspace"]["package"]["rust-version"].as_str().expect("a rust-version");
    assert_eq!(numbers(pinned).len(), 3, "{pinned} is no exact version");
    assert!(numbers(pinned) >= numbers(least), "{pinned} is pinned, {least} is the least");
}

#[test]
fn every_python_package_of_the_tests_is_pinned() {
    let pyproject: toml::Table = read("kit_bridge/pyproject.toml").parse().expect("TOML");
    let asked = read("tools/python/tests.in");
    let wanted = pyproject["project"]["optional-dependencies"]["test"].as_array().expect("a list");
    assert!(!wanted.is_empty());
    for requirement in wanted {
        let requirement = requirement.as_str().expect("a text");
        assert!(asked.lines().any(|line| line == requirement), "tools/python/tests.in lacks {requirement}");
    }
    for list in ["docs", "tools", "tests", "ros", "wheel"] {
        let pinned = read(&format!("tools/python/{list}.txt"));
        for line in read(&format!("tools/python/{list}.in")).lines() {
            if line.starts_with(['#', '-']) || line.is_empty() {
                continue;
            }
            let name = line.split(['=', '<', '>', ',', ';']).next().expect("a name").trim().to_lowercase();
            let found = pinned.lines().any(|l| l.starts_with(&format!("{name}==")));
            assert!(found, "tools/python/{list}.txt does not pin {name}; run: tools/python/lock.sh");
        }
    }
}

#[test]
fn no_file_reads_outside_the_checkout() {
    let files = Command::new("git").args(["ls-files"]).current_dir(root()).output().expect("git runs");
    let files = String::from_utf8(files.stdout).expect("UTF-8");
    // In two parts, so that this file does not contain the text that it searches for.
    let outside = ["../", "shared/"].concat();
    let mut read = 0;
    for path in files.lines() {
        let Ok(text) = std::fs::read_to_string(root().join(path)) else { continue };
        read += 1;
        assert!(!text.contains(&outside), "{path} names {outside}");
    }
    assert!(read > 100, "{read} files read");
}
