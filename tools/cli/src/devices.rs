//! `esaac devices`: lists the Vulkan devices, their capabilities, and whether each one is suitable.

use crate::arguments::{CommonArguments, DeviceArgument};
use crate::device_choice::uuid_text;
use crate::outcome::{Ending, Outcome};
use crate::table;
use anyhow::Result;
use esaac_engine::{DeviceInfo, list_devices};
use serde::Serialize;

#[derive(Serialize)]
struct DeviceRow {
    index: usize,
    name: String,
    kind: &'static str,
    uuid: String,
    driver: String,
    driver_uuid: String,
    vulkan: String,
    memory_bytes: u64,
    subgroup_size: u32,
    suitable: bool,
    capabilities: Vec<CapabilityRow>,
}

#[derive(Serialize)]
struct CapabilityRow {
    name: &'static str,
    required: bool,
    present: bool,
}

/// Runs the command.
pub fn run(common: &CommonArguments) -> Result<Outcome> {
    let devices = list_devices()?;
    if let Some(DeviceArgument(choice)) = common.device {
        // As commands fail that open it.
        choice.place_among(devices.iter())?;
    }
    let rows: Vec<DeviceRow> = devices.into_iter().map(DeviceRow::from).collect();
    let ending = if rows.iter().any(|d| d.suitable) { Ending::Complete } else { Ending::Wanting };
    let text = if common.json { serde_json::to_string_pretty(&rows)? + "\n" } else { text(&rows) };
    Ok(Outcome { text, ending })
}

impl From<DeviceInfo> for DeviceRow {
    fn from(info: DeviceInfo) -> Self {
        DeviceRow {
            uuid: uuid_text(&info.uuid),
            driver_uuid: uuid_text(&info.driver_uuid),
            index: info.index,
            name: info.name,
            kind: info.kind,
            driver: info.driver,
            vulkan: info.api_version,
            memory_bytes: info.memory_bytes,
            subgroup_size: info.subgroup_size,
            suitable: info.suitable,
            capabilities: info
                .capabilities
                .into_iter()
                .map(|c| CapabilityRow { name: c.name, required: c.required, present: c.present })
                .collect(),
        }
    }
}

fn text(devices: &[DeviceRow]) -> String {
    if devices.is_empty() {
        return "no Vulkan device; `esaac doctor` says what is missing\n".to_owned();
    }
    let mut rows = vec![["", "device", "kind", "uuid", "memory", "enough"].map(str::to_owned).to_vec()];
    rows.extend(devices.iter().map(|d| {
        vec![
            d.index.to_string(),
            d.name.clone(),
            d.kind.to_owned(),
            d.uuid.clone(),
            format!("{:.1} GiB", d.memory_bytes as f64 / f64::from(1 << 30)),
            if d.suitable { "yes" } else { "no" }.to_owned(),
        ]
    }));
    let mut text = table::render(&rows);
    for device in devices {
        text.push_str(&format!(
            "\n{}  {}\n   driver    {} ({}), Vulkan {}, subgroups of {}\n",
            device.index, device.name, device.driver, device.driver_uuid, device.vulkan, device.subgroup_size
        ));
        for (label, required, present) in [
            ("lacks", true, false),
            ("needed", true, true),
            ("optional", false, true),
            ("without", false, false),
        ] {
            let names: Vec<&str> = device
                .capabilities
                .iter()
                .filter(|c| c.required == required && c.present == present)
                .map(|c| c.name)
                .collect();
            if !names.is_empty() {
                text.push_str(&format!("   {label:<9} {}\n", names.join(", ")));
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_device_lacks_is_named() {
        let device = DeviceRow {
            index: 0,
            name: "Old GPU".to_owned(),
            kind: "discrete GPU",
            uuid: uuid_text(&[1; 16]),
            driver: "driver 1".to_owned(),
            driver_uuid: uuid_text(&[2; 16]),
            vulkan: "1.1.0".to_owned(),
            memory_bytes: 1 << 30,
            subgroup_size: 32,
            suitable: false,
            capabilities: vec![
                CapabilityRow { name: "timelineSemaphore", required: true, present: false },
                CapabilityRow { name: "shaderInt64", required: true, present: true },
            ],
        };
        let text = text(&[device]);
        assert!(text.contains("lacks     timelineSemaphore\n"), "{text}");
        assert!(text.contains("1.0 GiB  no"), "{text}");
    }
}
