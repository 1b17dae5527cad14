//! Sensors and noise profiles by name.

use crate::physical::{PhysicalPixel, physical_preset};
use crate::sensor::{Pixel, SensorError, SensorModel, SubstepPolicy, Synthesis, Timestamps};
use serde::{Deserialize, Serialize};

/// Log offset of the paper's `log(S + 1)`, for intensities of 8-bit scale.
pub const LOG_OFFSET_PAPER: f64 = 1.0;

/// Log offset for HDR scene units, near the dark level: a 50% step at S = 0.01 keeps 70% of its size
/// (the paper's offset leaves 1%).
pub const LOG_OFFSET_HDR: f64 = 0.01;

/// Spread of the leak in the profile `noisy`, log.
const LEAK_SPREAD_LOG: f64 = 0.2;

/// A sensor by name: the paper's five (Table 2) and two common sizes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// What it is.
    pub about: &'static str,
}

/// Every preset.
pub const PRESETS: &[Preset] = &[
    Preset { name: "dvs128", width_px: 128, height_px: 128, about: "iniVation DVS128" },
    Preset { name: "davis240", width_px: 240, height_px: 180, about: "iniVation DAVIS240" },
    Preset { name: "atis", width_px: 304, height_px: 240, about: "Prophesee ATIS" },
    Preset { name: "davis346", width_px: 346, height_px: 260, about: "iniVation DAVIS346" },
    Preset { name: "genx320", width_px: 320, height_px: 320, about: "Prophesee GenX320" },
    Preset { name: "vga", width_px: 640, height_px: 480, about: "640x480 (Prophesee Gen3/Gen4 VGA class)" },
    Preset { name: "hd", width_px: 1280, height_px: 720, about: "1280x720 (Prophesee IMX636 class)" },
];

/// A named set of sensor effects, applied on top of a preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// No noise, no refractory period, no latency.
    Clean,
    /// Every effect of the pixels on. The values are those of v2e's "noisy" setting where it has them. Lens, lamp and
    /// readout stay as they are.
    Noisy,
    /// The paper's event model: `log(S + 1)`, its warp, events at sample times, fixed sub-steps.
    Paper,
}

impl Profile {
    /// Sets the profile's parameters and leaves the others as they are. `Paper` is a log pixel, so a sensor with another
    /// one gets it first ([`SensorModel::with_pixel`]); the others keep the pixel that a sensor has.
    ///
    /// # Panics
    /// As [`SensorModel::to_toml`].
    pub fn apply(self, sensor: &mut SensorModel) {
        if self == Profile::Paper {
            *sensor = sensor.clone().with_pixel(Pixel::Log);
        }
        self.set_numbers(sensor);
    }

    /// Sets all parameters of the profile but the pixel.
    fn set_numbers(self, sensor: &mut SensorModel) {
        let clean = SensorModel::default();
        if sensor.pixel == Pixel::Physical {
            sensor.noise_gain = if self == Profile::Noisy { clean.noise_gain } else { 0.0 };
            // Assumed: as the leak's, since both come from junctions that differ from pixel to pixel.
            sensor.dark_spread_log =
                if self == Profile::Noisy { LEAK_SPREAD_LOG } else { clean.dark_spread_log };
            sensor.leak_per_lux_hz = clean.leak_per_lux_hz;
        }
        sensor.contrast_mismatch = clean.contrast_mismatch;
        sensor.refractory_ns = clean.refractory_ns;
        sensor.leak_rate_hz = clean.leak_rate_hz;
        sensor.leak_spread_log = clean.leak_spread_log;
        sensor.shot_noise_rate_hz = clean.shot_noise_rate_hz;
        sensor.latency_ns = clean.latency_ns;
        sensor.latency_jitter_ns = clean.latency_jitter_ns;
        sensor.timestamp_quantum_ns = clean.timestamp_quantum_ns;
        match self {
            Profile::Clean => {}
            Profile::Noisy => {
                sensor.contrast_mismatch = 0.05;
                sensor.refractory_ns = 500_000;
                sensor.leak_rate_hz = 0.1;
                sensor.leak_spread_log = LEAK_SPREAD_LOG;
                sensor.shot_noise_rate_hz = 5.0;
                sensor.latency_ns = 100_000;
                sensor.latency_jitter_ns = 10_000;
                sensor.timestamp_quantum_ns = 1_000;
            }
            Profile::Paper => {
                sensor.log_offset = LOG_OFFSET_PAPER;
                sensor.synthesis = Synthesis::Paper;
                sensor.timestamps = Timestamps::AtSample;
                sensor.substep_policy = SubstepPolicy::Fixed;
            }
        }
    }
}

/// The sensor of the preset with this name, if there is one. It has the service times of that sensor's bus, but no
/// readout until one is chosen.
#[must_use]
pub fn preset(name: &str) -> Option<SensorModel> {
    PRESETS.iter().find(|p| p.name == name).map(|p| {
        let clean = SensorModel::default();
        let service_ns = physical_preset(name).map(|preset| preset.service_ns.map(|service| service.value));
        let [readout_row_ns, readout_event_ns] =
            service_ns.unwrap_or([clean.readout_row_ns, clean.readout_event_ns]);
        let (name, width, height) = (p.name.to_owned(), p.width_px, p.height_px);
        SensorModel { name, width, height, readout_row_ns, readout_event_ns, ..clean }
    })
}

/// As [`preset`], with the physical pixel of that sensor.
#[must_use]
pub fn preset_with_physical_pixel(name: &str) -> Option<SensorModel> {
    preset(name).map(SensorModel::with_preset_pixel)
}

/// The preset of this name with a pixel and with the profile's numbers, if there is such a preset.
fn made_with(name: &str, pixel: Pixel, profile: Option<Profile>) -> Option<SensorModel> {
    let mut sensor = match pixel {
        Pixel::Log => preset(name),
        Pixel::Physical => preset_with_physical_pixel(name),
    }?;
    if let Some(profile) = profile {
        profile.set_numbers(&mut sensor);
    }
    Some(sensor)
}

impl SensorModel {
    /// This sensor with another pixel.
    ///
    /// If its name is a preset's, every parameter that has the value which the preset gives it with the old pixel gets the
    /// one which the preset gives it with the new pixel. Others are somebody's choice and stay. A sensor of another name
    /// keeps all of its numbers.
    ///
    /// Profiles count as the preset's: one that was made with `Noisy` or `Paper` ends as if it had been made with this
    /// profile and the new pixel. A sensor does not remember its profile, so it is taken for the one that leaves the fewest
    /// parameters to choices. A log sensor with `Clean` is the preset itself: with a physical pixel its noise is on.
    ///
    /// # Panics
    /// As [`SensorModel::to_toml`].
    #[must_use]
    pub fn with_pixel(self, pixel: Pixel) -> Self {
        if pixel == self.pixel {
            return self;
        }
        let table = |sensor: &SensorModel| toml::Table::try_from(sensor).expect("a sensor is a table");
        let mut values = table(&self);
        let olds = [None, Some(Profile::Clean), Some(Profile::Noisy), Some(Profile::Paper)]
            .into_iter()
            .filter_map(|profile| Some((profile, table(&made_with(&self.name, self.pixel, profile)?))));
        let chosen = |old: &toml::Table| values.iter().filter(|(key, value)| old[*key] != **value).count();
        let Some((profile, old)) = olds.min_by_key(|(_, old)| chosen(old)) else {
            return SensorModel { pixel, ..self };
        };
        let new = table(&made_with(&self.name, pixel, profile).expect("it was made with the old pixel"));
        for (key, value) in values.iter_mut().filter(|(key, value)| old[*key] == **value) {
            *value = new[key].clone();
        }
        values.try_into().expect("values of sensors are a sensor")
    }

    /// This sensor with a profile, then with parameters from text in their order ([`SensorModel::set`]). A pixel among
    /// them comes before all else, so that the profile and the other parameters replace numbers of that pixel.
    ///
    /// # Errors
    /// As [`SensorModel::set`].
    ///
    /// # Panics
    /// As [`SensorModel::to_toml`].
    pub fn with_changes(
        mut self,
        profile: Option<Profile>,
        parameters: &[(impl AsRef<str>, String)],
    ) -> Result<Self, SensorError> {
        let pixel = parameters.iter().rfind(|(parameter, _)| parameter.as_ref() == "pixel");
        let choose_pixel =
            |sensor: &mut SensorModel| pixel.map_or(Ok(()), |(_, value)| sensor.set("pixel", value));
        choose_pixel(&mut self)?;
        if let Some(profile) = profile {
            profile.apply(&mut self);
            // `Paper` has a pixel of its own.
            choose_pixel(&mut self)?;
        }
        for (parameter, value) in parameters {
            self.set(parameter.as_ref(), value)?;
        }
        Ok(self)
    }

    /// This sensor with the physical pixel of the preset that it is named after
    /// ([`PHYSICAL_PRESETS`](crate::physical::PHYSICAL_PRESETS)), or with a physical pixel of its own parameters if it has
    /// another name. All numbers of the pixel are the preset's, whoever chose the old ones; [`SensorModel::with_pixel`]
    /// keeps those that somebody chose. The noise is on. The readout stays as it is.
    #[must_use]
    pub fn with_preset_pixel(mut self) -> Self {
        let pixel = match physical_preset(&self.name) {
            Some(preset) => preset.apply(&mut self).0,
            None => self.physical_pixel(),
        };
        let lux_per_unit = self.lux_per_unit;
        self.with_physical(&PhysicalPixel { lux_per_unit, ..pixel })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ReadoutKind;

    #[test]
    fn every_preset_and_profile_is_valid() {
        for p in PRESETS {
            for profile in [Profile::Clean, Profile::Noisy, Profile::Paper] {
                for sensor in [preset(p.name), preset_with_physical_pixel(p.name)] {
                    let mut sensor = sensor.expect("listed");
                    profile.apply(&mut sensor);
                    sensor.validate().unwrap_or_else(|e| panic!("{} {profile:?}: {e}", p.name));
                }
            }
        }
        assert!(preset("nonesuch").is_none() && preset_with_physical_pixel("nonesuch").is_none());
    }

    #[test]
    fn every_preset_has_the_readout_of_its_sensor() {
        for p in PRESETS {
            let sensor = preset(p.name).expect("listed");
            assert_eq!(sensor.readout, ReadoutKind::None, "{}: off unless it is asked for", p.name);
            let physical = physical_preset(p.name);
            let physical = physical.unwrap_or_else(|| panic!("`{}` is not in PHYSICAL_PRESETS", p.name));
            let (_, expected) = physical.apply(&mut sensor.clone());
            let readout = if sensor.readout_row_ns > 0.0 { ReadoutKind::Rows } else { ReadoutKind::Fifo };
            let chosen = SensorModel { readout, ..sensor.clone() };
            assert_eq!((chosen.validate(), chosen.readout_model()), (Ok(()), expected), "{}", p.name);
            let word_serial = SensorModel { readout: ReadoutKind::Rows, ..sensor };
            assert_eq!(word_serial.validate().is_ok(), readout == ReadoutKind::Rows, "{}", p.name);
        }
    }

    #[test]
    fn profiles_switch_the_noise_of_the_physical_pixel() {
        let hd = preset_with_physical_pixel("hd").expect("listed");
        assert_eq!((hd.pixel, hd.noise_gain, hd.leak_rate_hz), (Pixel::Physical, 1.0, -0.06));
        let with = |profile: Profile| {
            let mut sensor = hd.clone();
            profile.apply(&mut sensor);
            (sensor.pixel, sensor.noise_gain, sensor.dark_spread_log)
        };
        assert_eq!(with(Profile::Clean), (Pixel::Physical, 0.0, 0.0));
        assert_eq!(with(Profile::Noisy), (Pixel::Physical, 1.0, 0.2));
        assert_eq!(with(Profile::Paper).0, Pixel::Log);
        let mut log = preset("hd").expect("listed");
        Profile::Noisy.apply(&mut log);
        assert_eq!(log.dark_spread_log, 0.0, "a log pixel has no dark current");
    }

    const PIXELS: [Pixel; 2] = [Pixel::Log, Pixel::Physical];

    fn made(name: &str, profile: Option<Profile>, pixel: Pixel) -> SensorModel {
        let pixel = if pixel == Pixel::Log { "log" } else { "physical" };
        let sensor = preset(name).expect("listed").with_changes(profile, &[("pixel", pixel.to_owned())]);
        sensor.expect("a pixel")
    }

    fn turned(mut sensor: SensorModel, pixel: Pixel) -> SensorModel {
        let pixel = if pixel == Pixel::Log { "log" } else { "physical" };
        sensor.set("pixel", pixel).expect("a pixel");
        sensor
    }

    #[test]
    fn another_pixel_has_the_numbers_of_the_preset() {
        for p in PRESETS {
            let (log, physical) = (preset(p.name).unwrap(), preset_with_physical_pixel(p.name).unwrap());
            assert_eq!(turned(log.clone(), Pixel::Physical), physical, "{}", p.name);
            assert_eq!(turned(physical.clone(), Pixel::Log), log, "{}", p.name);
            for sensor in [log, physical] {
                assert_eq!(turned(sensor.clone(), sensor.pixel), sensor, "no other pixel");
            }
        }
        let mine = SensorModel { name: "mine".to_owned(), ..preset("hd").unwrap() };
        let expected = SensorModel { pixel: Pixel::Physical, ..mine.clone() };
        assert_eq!(turned(mine, Pixel::Physical), expected, "no preset");
    }

    #[test]
    fn what_somebody_has_chosen_stays_with_another_pixel() {
        let choose = |sensor: SensorModel| SensorModel {
            width: 64,
            contrast_on: 0.31,
            refractory_ns: 123,
            leak_rate_hz: 0.7,
            dark_lux: 0.9,
            second_pole_hz: 50.0,
            log_offset: 0.5,
            latency_jitter_ns: 7,
            seed: 3,
            ..sensor
        };
        for p in PRESETS {
            for profile in [None, Some(Profile::Noisy)] {
                let [log, physical] = PIXELS.map(|pixel| choose(made(p.name, profile, pixel)));
                assert_eq!(turned(log.clone(), Pixel::Physical), physical, "{} {profile:?}", p.name);
                assert_eq!(turned(physical, Pixel::Log), log, "{} {profile:?}", p.name);
            }
        }
        let own_leak = SensorModel { leak_rate_hz: -0.5, ..preset_with_physical_pixel("hd").unwrap() };
        let error = turned(own_leak, Pixel::Log).validate().unwrap_err().to_string();
        assert!(error.contains("`leak_rate_hz` is -0.5, expected 0 to 100"), "{error}");
    }

    #[test]
    fn another_pixel_keeps_the_profile() {
        for p in PRESETS {
            for profile in [Profile::Noisy, Profile::Paper] {
                let [log, physical] = PIXELS.map(|pixel| made(p.name, Some(profile), pixel));
                assert_eq!([log.pixel, physical.pixel], PIXELS, "{} {profile:?}", p.name);
                assert_eq!(turned(log.clone(), Pixel::Physical), physical, "{} {profile:?}", p.name);
                assert_eq!(turned(physical, Pixel::Log), log, "{} {profile:?}", p.name);
            }
            let clean = made(p.name, Some(Profile::Clean), Pixel::Physical);
            assert_eq!(turned(clean.clone(), Pixel::Log), preset(p.name).unwrap());
            let mut paper = clean;
            Profile::Paper.apply(&mut paper);
            assert_eq!(paper, made(p.name, Some(Profile::Paper), Pixel::Log), "it is a log pixel");
        }
    }

    #[test]
    fn parameters_that_come_with_a_pixel_replace_its_numbers() {
        // These are what a log pixel has, and stand before the pixel.
        let given = [("contrast_on", "0.2"), ("noise_gain", "1"), ("pixel", "physical")];
        let given = given.map(|(parameter, value)| (parameter, value.to_owned()));
        let physical = preset_with_physical_pixel("hd").unwrap();
        let hd = preset("hd").unwrap();
        let expected = SensorModel { contrast_on: 0.2, ..physical.clone() };
        assert_eq!(hd.clone().with_changes(None, &given), Ok(expected));
        let mut expected = physical;
        Profile::Clean.apply(&mut expected);
        let expected = SensorModel { contrast_on: 0.2, noise_gain: 1.0, ..expected };
        assert_eq!(hd.clone().with_changes(Some(Profile::Clean), &given), Ok(expected));
        assert!(hd.with_changes(None, &[("pixel", "quantum".to_owned())]).is_err());
    }
}
