//! The Vulkan device that a command runs on.

use crate::arguments::{CommonArguments, DeviceArgument};
use crate::report::DeviceReport;
use anyhow::{Result, anyhow, bail, ensure};
use esaac_engine::{Device, DeviceChoice, DeviceInfo, Validation};
use std::sync::Arc;

/// UUID in the usual groups.
#[must_use]
pub fn uuid_text(uuid: &[u8; 16]) -> String {
    let hex: Vec<String> = uuid.iter().map(|byte| format!("{byte:02x}")).collect();
    [&hex[..4], &hex[4..6], &hex[6..8], &hex[8..10], &hex[10..]].map(<[String]>::concat).join("-")
}

/// Names the device where the command line does not.
const VARIABLE: &str = "ESAAC_DEVICE";

/// Opens the device that the command line or else the environment names, or the best.
pub fn open(common: &CommonArguments) -> Result<Arc<Device>> {
    let DeviceArgument(choice) = match (common.device, std::env::var_os(VARIABLE)) {
        (Some(argument), _) => argument,
        (None, None) => DeviceArgument(DeviceChoice::Best),
        (None, Some(text)) => {
            let text = text.to_string_lossy();
            text.parse().map_err(|expected| anyhow!("{VARIABLE} is `{text}`, {expected}"))?
        }
    };
    let by_environment = std::env::var_os(VALIDATION).unwrap_or_default();
    Ok(Device::open(choice, validation(common.validation, &by_environment.to_string_lossy())?)?)
}

/// Turns the validation layer on, as the option does, and may say what it looks at.
const VALIDATION: &str = "ESAAC_VALIDATION";

/// What the layer looks at, by the option and the environment variable's value. An empty value counts as none.
fn validation(wanted: bool, by_environment: &str) -> Result<Validation> {
    match (by_environment, wanted) {
        ("calls", _) => Ok(Validation::Calls),
        ("1", _) | ("" | "0", true) => Ok(Validation::On),
        ("" | "0", false) => Ok(Validation::Off),
        (other, _) => bail!("{VALIDATION} is `{other}`, expected 1, calls or 0"),
    }
}

/// Fails if the validation layer has reported anything.
pub fn check_validation(device: &Device) -> Result<()> {
    let messages = device.validation_messages();
    ensure!(messages.is_empty(), "the validation layer objects:\n{}", messages.join("\n"));
    Ok(())
}

/// The device as the report describes it.
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
        assert_eq!(text, "01112131-4151-6171-8191-a1b1c1d1e1f1");
        assert_eq!(text.parse(), Ok(DeviceArgument(DeviceChoice::Uuid(uuid))));
    }

    #[test]
    fn the_environment_says_what_the_layer_looks_at() {
        let of = |wanted, by_environment| validation(wanted, by_environment).unwrap();
        for wanted in [true, false] {
            assert_eq!((of(wanted, "calls"), of(wanted, "1")), (Validation::Calls, Validation::On));
        }
        assert_eq!([of(true, ""), of(true, "0")], [Validation::On; 2]);
        assert_eq!([of(false, ""), of(false, "0")], [Validation::Off; 2]);
        let error = validation(true, "banana").unwrap_err().to_string();
        assert_eq!(error, "ESAAC_VALIDATION is `banana`, expected 1, calls or 0");
    }
}
