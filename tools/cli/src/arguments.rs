//! Options that every command has. This module depends on no other module of the program.

use esaac_engine::DeviceChoice;
use std::str::FromStr;

/// Options of every command.
#[derive(clap::Args, Clone, Debug)]
pub struct CommonArguments {
    /// Print JSON on standard output
    #[arg(long, global = true)]
    pub json: bool,
    /// Vulkan device, by number or UUID as `esaac devices` lists them [default: that of ESAAC_DEVICE, else the best one]
    // The variable is read where a device is opened, so that other commands do not fail for it.
    #[arg(long, global = true, value_name = "INDEX|UUID")]
    pub device: Option<DeviceArgument>,
    /// Turn on Vulkan's validation layer, as ESAAC_VALIDATION=1 does; ESAAC_VALIDATION=calls leaves the shaders as they are
    // Read where a device is opened, too.
    #[arg(long, global = true)]
    pub validation: bool,
}

/// Value of `--device`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceArgument(pub DeviceChoice);

impl FromStr for DeviceArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // An empty environment variable counts as none.
        if text.is_empty() {
            return Ok(DeviceArgument(DeviceChoice::Best));
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_is_a_number_or_a_uuid() {
        let uuid: [u8; 16] = std::array::from_fn(|i| i as u8 * 16 + 1);
        let text = "01112131-4151-6171-8191-a1b1c1d1e1f1";
        assert_eq!(text.parse(), Ok(DeviceArgument(DeviceChoice::Uuid(uuid))));
        assert_eq!("1".parse(), Ok(DeviceArgument(DeviceChoice::Index(1))));
        assert_eq!("".parse(), Ok(DeviceArgument(DeviceChoice::Best)));
        assert!("best".parse::<DeviceArgument>().is_err());
        assert!("-1".parse::<DeviceArgument>().is_err());
    }
}
