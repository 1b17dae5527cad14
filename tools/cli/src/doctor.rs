//! `esaac doctor`: finds what this machine lacks, and names the command that installs or fixes it.

use crate::arguments::CommonArguments;
use crate::outcome::{Ending, Outcome};
use crate::ros::NetworkArguments;
use crate::{device_choice, table};
use anyhow::Result;
use esaac_engine::{DeviceInfo, EngineError, list_devices};
use esaac_interop::cuda::{CudaDevice, cuda_devices};
use esaac_interop::{InteropError, Support};
use esaac_ros::host;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Free memory below which even a small run may fail.
const ENOUGH_MEMORY_BYTES: u64 = 512 << 20;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum State {
    Good,
    /// Missing, but only some uses need it.
    Optional,
    /// Missing, and required.
    Missing,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct Check {
    name: &'static str,
    state: State,
    found: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mend: Option<String>,
}

/// Runs the command.
pub fn run(common: &CommonArguments) -> Result<Outcome> {
    let mut checks = vulkan(list_devices());
    if checks.iter().all(|c| c.state == State::Good) {
        checks.extend(opened(common));
    }
    checks.extend([memory(), write_access(), ros_network(), receive_buffer(), glslc(), validation_layer()]);
    let missing = checks.iter().any(|c| c.state == State::Missing);
    let text = if common.json { serde_json::to_string_pretty(&checks)? + "\n" } else { text(&checks) };
    Ok(Outcome { text, ending: if missing { Ending::Wanting } else { Ending::Complete } })
}

fn good(name: &'static str, found: String) -> Check {
    Check { name, state: State::Good, found, mend: None }
}

fn missing(name: &'static str, found: String, mend: &str) -> Check {
    Check { name, state: State::Missing, found, mend: Some(mend.to_owned()) }
}

fn optional(name: &'static str, found: String, mend: &str) -> Check {
    Check { name, state: State::Optional, found, mend: Some(mend.to_owned()) }
}

/// Checks loader, driver and device. Each check needs the one before.
fn vulkan(devices: Result<Vec<DeviceInfo>, EngineError>) -> Vec<Check> {
    const LOADER: &str = "Vulkan loader";
    const DRIVER: &str = "Vulkan driver";
    const DEVICE: &str = "device";
    const MEND_LOADER: &str = "sudo apt-get install libvulkan1";
    const MEND_DRIVER: &str =
        "sudo apt-get install mesa-vulkan-drivers   (software, AMD, Intel; for NVIDIA its own driver)";
    let devices = match devices {
        Ok(devices) => devices,
        Err(error @ EngineError::NoLoader(_)) => {
            return vec![missing(LOADER, error.to_string(), MEND_LOADER)];
        }
        Err(error) => {
            return vec![
                good(LOADER, "libvulkan.so.1".to_owned()),
                missing(DRIVER, error.to_string(), MEND_DRIVER),
            ];
        }
    };
    let loader = good(LOADER, "libvulkan.so.1".to_owned());
    if devices.is_empty() {
        return vec![loader, missing(DRIVER, "none".to_owned(), MEND_DRIVER)];
    }
    let mut drivers: Vec<&str> = devices.iter().map(|d| d.driver.as_str()).collect();
    drivers.dedup();
    let driver = good(DRIVER, drivers.join(", "));
    let enough: Vec<&str> = devices.iter().filter(|d| d.suitable).map(|d| d.name.as_str()).collect();
    let device = if enough.is_empty() {
        let lacks: Vec<String> = devices
            .iter()
            .map(|d| {
                let names: Vec<&str> =
                    d.capabilities.iter().filter(|c| c.required && !c.present).map(|c| c.name).collect();
                format!("{} lacks {}", d.name, names.join(", "))
            })
            .collect();
        missing(DEVICE, lacks.join("; "), MEND_DRIVER)
    } else {
        good(DEVICE, enough.join(", "))
    };
    vec![loader, driver, device]
}

fn opened(common: &CommonArguments) -> Vec<Check> {
    const NAME: &str = "opening it";
    match device_choice::open(common) {
        Ok(device) => vec![
            good(NAME, device.info().name.clone()),
            sharing(&Support::of(&device)),
            cuda(cuda_devices(), device.info()),
        ],
        Err(error) => {
            vec![missing(NAME, format!("{error:#}"), "esaac devices   (shows what can be chosen)")]
        }
    }
}

/// What `esaac serve` can share with other processes.
fn sharing(support: &Support) -> Check {
    const NAME: &str = "sharing with other processes";
    let ways = [
        (support.export_buffer && support.import_buffer, "memory by descriptor"),
        (support.host_alignment.is_some(), "memory of the host"),
        (support.share_timeline, "timelines by descriptor"),
    ];
    let found: Vec<&str> = ways.iter().filter(|(can, _)| *can).map(|(_, way)| *way).collect();
    let found = found.join(", ");
    match (support.engine_memories(), &support.host_refused) {
        (0, refused) => optional(
            NAME,
            match refused {
                None => "the driver lacks both VK_KHR_external_memory_fd and VK_EXT_external_memory_host"
                    .to_owned(),
                Some(why) => format!("the driver lacks VK_KHR_external_memory_fd; {why}"),
            },
            "update the driver, or simulate in one process   (esaac demo --in-process)",
        ),
        (_, Some(why)) => optional(
            NAME,
            format!("{found}; {why}"),
            "only needed for producers that render on the processor or on another device",
        ),
        (_, None) => good(NAME, found),
    }
}

/// Whether CUDA has the engine's device, which producers in CUDA need.
fn cuda(devices: Result<Vec<CudaDevice>, InteropError>, engine: &DeviceInfo) -> Check {
    const NAME: &str = "CUDA (for producers in it)";
    match devices {
        Err(error) => optional(NAME, error.to_string(), "only needed if frames come from CUDA"),
        Ok(devices) => match devices.iter().find(|device| device.uuid == engine.uuid) {
            Some(device) => good(NAME, format!("device {} is {}", device.ordinal, engine.name)),
            None => optional(
                NAME,
                format!("{} devices, but not {}", devices.len(), engine.name),
                "esaac doctor --device N   (choose a device that CUDA has; esaac devices lists all)",
            ),
        },
    }
}

fn memory() -> Check {
    const NAME: &str = "host memory";
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    match available_bytes(&text) {
        None => optional(NAME, "cannot be read from /proc/meminfo".to_owned(), "mount -t proc proc /proc"),
        Some(bytes) if bytes < ENOUGH_MEMORY_BYTES => {
            optional(NAME, format!("{} MiB available, 512 MiB advised", bytes >> 20), "free some memory")
        }
        Some(bytes) => good(NAME, format!("{} MiB available", bytes >> 20)),
    }
}

fn available_bytes(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib << 10)
}

fn write_access() -> Check {
    const NAME: &str = "write access";
    let folder = std::env::current_dir().unwrap_or_else(|_| PathBuf::from("."));
    match tempfile::tempfile_in(&folder) {
        Ok(_) => good(NAME, folder.display().to_string()),
        Err(error) => optional(
            NAME,
            format!("{}: {error}", folder.display()),
            "give --out a folder that you may write to",
        ),
    }
}

/// Whether topics can be published on the network.
fn ros_network() -> Check {
    const NAME: &str = "ROS 2 network";
    match NetworkArguments::of_node("doctor").open(&[]) {
        Ok(joined) => good(NAME, joined.transport.name()),
        Err(error) => optional(NAME, error.to_string(), "sudo ip link set lo up   (or see CYCLONEDDS_URI)"),
    }
}

/// Checks the largest receive buffer. Subscribers with small buffers lose parts of large messages.
fn receive_buffer() -> Check {
    const NAME: &str = "ROS 2 receive buffer";
    receive_buffer_check(NAME, host::receive_buffer_limit_bytes(), host::datagrams_lost().unwrap_or(0))
}

fn receive_buffer_check(name: &'static str, limit_bytes: Option<u64>, lost: u64) -> Check {
    let losses = match lost {
        0 => String::new(),
        lost => format!("; {lost} datagrams lost in full receive buffers since the system started"),
    };
    match limit_bytes {
        Some(bytes) if bytes >= host::ADVISED_RECEIVE_BUFFER_BYTES => {
            good(name, format!("up to {} KiB{losses}", bytes >> 10))
        }
        limit => optional(
            name,
            match limit {
                Some(bytes) => format!(
                    "up to {} KiB, {} advised for images and large packets{losses}",
                    bytes >> 10,
                    host::ADVISED_RECEIVE_BUFFER_BYTES >> 10
                ),
                None => "its limit cannot be read".to_owned(),
            },
            "sudo sysctl -w net.core.rmem_max=4194304   (and let subscribers ask for it, see docs/guide/ros2.md)",
        ),
    }
}

fn glslc() -> Check {
    const NAME: &str = "glslc (to build, and for --glsl)";
    let run = Command::new("glslc").arg("--version").stdin(Stdio::null()).output();
    match run {
        Ok(output) if output.status.success() => {
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            good(NAME, text.lines().next().unwrap_or_default().to_owned())
        }
        _ => optional(NAME, "cannot be run".to_owned(), "sudo apt-get install glslc"),
    }
}

fn validation_layer() -> Check {
    const NAME: &str = "validation layer (to test)";
    const FILE: &str = "VkLayer_khronos_validation.json";
    let mut folders: Vec<PathBuf> =
        std::env::var_os("VK_LAYER_PATH").iter().flat_map(std::env::split_paths).collect();
    folders.extend(
        ["/usr/share", "/usr/local/share", "/etc"]
            .map(|base| Path::new(base).join("vulkan/explicit_layer.d")),
    );
    match folders.iter().map(|folder| folder.join(FILE)).find(|path| path.exists()) {
        Some(path) => good(NAME, path.display().to_string()),
        None => optional(NAME, "not installed".to_owned(), "sudo apt-get install vulkan-validationlayers"),
    }
}

fn text(checks: &[Check]) -> String {
    let mut rows = Vec::new();
    for check in checks {
        let state = match check.state {
            State::Good => "ok",
            State::Optional => "optional",
            State::Missing => "MISSING",
        };
        rows.push(vec![state.to_owned(), check.name.to_owned(), check.found.clone()]);
        if let Some(mend) = &check.mend {
            rows.push(vec![String::new(), String::new(), format!("-> {mend}")]);
        }
    }
    table::render(&rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_link_is_checked_in_turn() {
        let no_driver = vulkan(Ok(Vec::new()));
        assert_eq!(no_driver.last().map(|c| (c.name, c.state)), Some(("Vulkan driver", State::Missing)));
        let text = text(&no_driver);
        assert!(text.contains("apt-get install mesa-vulkan-drivers"), "{text}");
    }

    #[test]
    fn what_other_processes_can_share_is_said() {
        let nothing = sharing(&Support::default());
        assert_eq!(nothing.state, State::Optional);
        assert!(nothing.mend.unwrap().contains("--in-process"));
        let by_host = sharing(&Support { host_alignment: Some(4096), ..Support::default() });
        assert_eq!((by_host.state, &*by_host.found), (State::Good, "memory of the host"));
        let refuses =
            Support { host_refused: Some("it refuses pages of files".to_owned()), ..Support::default() };
        let exports = Support { export_buffer: true, import_buffer: true, ..refuses.clone() };
        for (support, before, mend) in [
            (refuses, "the driver lacks VK_KHR_external_memory_fd", "--in-process"),
            (exports, "memory by descriptor", "on the processor or on another device"),
        ] {
            let check = sharing(&support);
            assert_eq!(
                (check.state, check.found),
                (State::Optional, format!("{before}; it refuses pages of files"))
            );
            assert!(check.mend.is_some_and(|text| text.contains(mend)));
        }
    }

    #[test]
    fn cuda_without_the_engine_s_device_is_told_from_none() {
        let Ok(devices) = list_devices() else { panic!("a device") };
        let engine = &devices[0];
        assert!(cuda(Err(InteropError::NoCuda), engine).found.contains("libcuda.so.1"));
        let other = CudaDevice { ordinal: 0, uuid: engine.uuid.map(|byte| !byte) };
        let unlike = cuda(Ok(vec![other]), engine);
        assert_eq!(unlike.state, State::Optional);
        assert!(unlike.found.contains("1 devices") && unlike.mend.unwrap().contains("--device N"));
        let same = cuda(Ok(vec![other, CudaDevice { ordinal: 1, uuid: engine.uuid }]), engine);
        assert_eq!(same.state, State::Good);
    }

    #[test]
    fn small_receive_buffers_and_losses_are_explained() {
        let stock = receive_buffer_check("b", Some(212_992), 17);
        assert_eq!(stock.state, State::Optional);
        assert!(stock.found.contains("208 KiB, 4096 advised") && stock.found.contains("17 datagrams lost"));
        assert!(stock.mend.unwrap().contains("net.core.rmem_max=4194304"));
        assert_eq!(receive_buffer_check("b", Some(4 << 20), 0).found, "up to 4096 KiB");
    }

    #[test]
    fn available_memory_is_read_in_bytes() {
        let meminfo = "MemTotal:  100 kB\nMemAvailable:   2048 kB\n";
        assert_eq!(available_bytes(meminfo), Some(2 << 20));
        assert_eq!(available_bytes("MemTotal: 1 kB\n"), None);
    }
}
