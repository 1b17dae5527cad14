//! Simulates other drivers. A test runs in a process of its own, with a Vulkan layer that hides features of the
//! installed driver, or with several devices.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Environment variable that is set in a test's own process. Its value is the test's name.
const ALONE: &str = "ESAAC_TEST_ALONE";

const LAYER: &str = "VK_LAYER_ESAAC_other_driver";

/// The driver that the test's own process shall find.
#[derive(Default)]
pub struct OtherDriver<'a> {
    /// Device extensions that the layer hides.
    pub lacks: &'a [&'a str],
    /// Total bytes of memory imports that succeed before the device reports that it is full.
    pub import_bytes: Option<u64>,
    /// Whether it refuses memory of the host that is a mapped file.
    pub anonymous_only: bool,
    /// Shows the software driver twice, as two devices with different UUIDs.
    pub twice: bool,
}

/// Runs the test of this name again in a process of its own, where it must pass. Returns true in that process and false
/// in the calling one.
///
/// # Panics
/// If the test fails in its own process. The message holds its output.
#[must_use]
pub fn in_a_process_of_its_own(test: &str, driver: Option<&OtherDriver<'_>>) -> bool {
    let folder = tempfile::tempdir().expect("a temporary folder");
    again(test, |command| {
        if let Some(driver) = driver {
            driver.set_up(folder.path(), command);
        }
    })
}

/// The same without the validation layer, for tests of the process's memory: the layer keeps some for each object that
/// there ever was.
///
/// # Panics
/// If the test fails in its own process. The message holds its output.
#[must_use]
pub fn in_a_process_without_the_layer(test: &str) -> bool {
    again(test, |command| {
        command.env_remove("ESAAC_VALIDATION");
    })
}

fn again(test: &str, set_up: impl FnOnce(&mut Command)) -> bool {
    if std::env::var_os(ALONE).is_some_and(|name| name == *test) {
        return true;
    }
    let mut command = Command::new(std::env::current_exe().expect("this program"));
    command.args(["--exact", test, "--nocapture"]).env(ALONE, test);
    set_up(&mut command);
    let output = command.output().expect("this program, once more");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("1 passed"), "no test `{test}`: {said}");
    false
}

impl OtherDriver<'_> {
    fn set_up(&self, folder: &Path, command: &mut Command) {
        let library = folder.join("libother_driver.so");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("drivers/other_driver.c");
        let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
        let output = Command::new(compiler)
            .args(["-std=c11", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-o"])
            .args([&library, &source])
            .output()
            .expect("a C compiler");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}\nVulkan's headers: apt-get install libvulkan-dev");
        let manifest = format!(
            r#"{{"file_format_version": "1.1.2", "layer": {{"name": "{LAYER}", "type": "GLOBAL",
                "library_path": "{}", "api_version": "1.3.0", "implementation_version": "1",
                "description": "A driver with less"}}}}"#,
            library.display()
        );
        std::fs::write(folder.join("other_driver.json"), manifest).expect("a manifest");
        command.env("VK_ADD_LAYER_PATH", folder).env("VK_INSTANCE_LAYERS", LAYER);
        command.env("ESAAC_DRIVER_LACKS", self.lacks.join(" "));
        if let Some(bytes) = self.import_bytes {
            command.env("ESAAC_DRIVER_FULL", bytes.to_string());
        }
        if self.anonymous_only {
            command.env("ESAAC_DRIVER_ANONYMOUS", "1");
        }
        if self.twice {
            let first = software_driver();
            let second = folder.join("second.json");
            std::fs::copy(&first, &second).expect("a copy of the driver's manifest");
            let both = std::env::join_paths([first, second]).expect("paths without colons");
            command
                .env("ESAAC_DRIVER_UUIDS", "1")
                .env("VK_ICD_FILENAMES", &both)
                .env("VK_DRIVER_FILES", both);
        }
    }
}

/// Path of the manifest of Mesa's software driver.
fn software_driver() -> PathBuf {
    let named = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].into_iter().filter_map(std::env::var_os);
    let named: Vec<PathBuf> =
        named.flat_map(|paths: OsString| std::env::split_paths(&paths).collect::<Vec<_>>()).collect();
    let installed = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"]
        .into_iter()
        .filter_map(|d| std::fs::read_dir(d).ok());
    let installed = installed.flatten().filter_map(Result::ok).map(|entry| entry.path());
    named
        .into_iter()
        .chain(installed)
        .find(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("lvp_")))
        .expect("Mesa's software driver: apt-get install mesa-vulkan-drivers")
}
