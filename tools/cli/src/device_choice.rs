//! Which device a command runs on.

use crate::arguments::CommonArguments;
use crate::report::DeviceReport;
use anyhow::{Result, ensure};
use esaac_engine::{Device, DeviceChoice, DeviceInfo, Validation};
use std::str::FromStr;
use std::sync::Arc;

/// Value of `--device`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceArgument(pub DeviceChoice);

impl FromStr for DeviceArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let digits: String = text.chars().filter(|&c| c != '-').collect();
        if digits.len() == 32 && digits.chars().all(|c| c.is_ascii_hexdigit()) {
            let byte = |i: usize| u8::from_str_radix(&digits[2 * i..2 * i + 2], 16).expect("hex digits");
            return Ok(DeviceArgument(DeviceChoice::Uuid(std::array::from_fn(byte))));
        }
        match text.parse() {
            Ok(index) => Ok(DeviceArgument(DeviceChoice::Index(index))),
            Err(_) => Err("expected a device's number or its UUID of 32 hexadecimal digits".to_owned()),
        }
    }
}

/// UUID in the usual groups.
#[must_use]
pub fn uuid_text(uuid: &[u8; 16]) -> String {
    let hex: Vec<String> = uuid.iter().map(|byte| format!("{byte:02x}")).collect();
    [&hex[..4], &hex[4..6], &hex[6..8], &hex[8..10], &hex[10..]].map(<[String]>::concat).join("-")
}

/// Opens the device that the command line names, or the best.
pub fn open(common: &CommonArguments) -> Result<Arc<Device>> {
    let choice = common.device.map_or(DeviceChoice::Best, |argument| argument.0);
    let validation = if common.validation { Validation::On } else { Validation::Off };
    Ok(Device::open(choice, validation)?)
}

/// Fails if the validation layer has spoken.
pub fn check_validation(device: &Device) -> Result<()> {
    let messages = device.validation_messages();
    ensure!(messages.is_empty(), "the validation layer objects:\n{}", messages.join("\n"));
    Ok(())
}

/// A device for the report.
#[must_use]
pub fn report(info: &DeviceInfo) -> DeviceReport {
    DeviceReport {
        name: info.name.clone(),
        kind: info.kind.to_owned(),
        uuid: uuid_text(&info.uuid),
        driver: info.driver.clone(),
        vulkan: info.api_version.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uuid_reads_back_as_it_is_printed() {
        let uuid: [u8; 16] = std::array::from_fn(|i| i as u8 * 16 + 1);
        let text = uuid_text(&uuid);
        assert_eq!(text.len(), 36);
        assert_eq!(text.parse(), Ok(DeviceArgument(DeviceChoice::Uuid(uuid))));
        assert_eq!("1".parse(), Ok(DeviceArgument(DeviceChoice::Index(1))));
        assert!("best".parse::<DeviceArgument>().is_err());
        assert!("-1".parse::<DeviceArgument>().is_err());
    }
}
