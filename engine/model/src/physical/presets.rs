//! The physical pixels of the presets. Every number says where it comes from, and whether it is measured or assumed.

use super::{Bus, PhysicalPixel, Readout, ReadoutKind};
use crate::{Pixel, SensorModel};

/// A number with its source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sourced {
    /// The number.
    pub value: f64,
    /// Where it comes from.
    pub source: &'static str,
    /// Whether it is an assumption: scaled from another sensor, or typical.
    pub assumed: bool,
}

const fn known(value: f64, source: &'static str) -> Sourced {
    Sourced { value, source, assumed: false }
}

const fn assumed(value: f64, source: &'static str) -> Sourced {
    Sourced { value, source, assumed: true }
}

/// The physical pixel of a preset (a name in [`PRESETS`](crate::PRESETS)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhysicalPreset {
    /// Name of the preset.
    pub name: &'static str,
    /// Photocurrent, electrons a second for each lux.
    pub response_e_per_lux_s: Sourced,
    /// Dark current, lux.
    pub dark_lux: Sourced,
    /// Charge of the photoreceptor, electrons a neper.
    pub photoreceptor_charge_e: Sourced,
    /// The second pole, Hz.
    pub second_pole_hz: Sourced,
    /// ON and OFF threshold, nepers.
    pub contrast_log: [Sourced; 2],
    /// Standard deviation of the thresholds, nepers.
    pub mismatch_log: Sourced,
    /// Refractory period, microseconds.
    pub refractory_us: Sourced,
    /// Leak at 25 C, Hz.
    pub leak_rate_hz: Sourced,
    /// Leak, Hz for each lux.
    pub leak_per_lux_hz: Sourced,
    /// Delay of an event up to the readout, microseconds.
    pub latency_us: Sourced,
    /// The readout: the service of a row (0 for word-serial readout) and of an event, nanoseconds.
    pub service_ns: [Sourced; 2],
    /// Tick of the time stamps, nanoseconds.
    pub tick_ns: Sourced,
    /// Range of focal-plane lux in which the noise is that of measurements, if any.
    pub fitted_lux: Option<[f64; 2]>,
}

const JSSC: &str = "Lichtsteiner et al., JSSC 43(2), 2008";
const CIRCUIT: &str = "wengflow/rpg_esim, constants of the DVS128's photoreceptor";
const JAER: &str = "jAER: 16 fC over its default refractory current";
const LIKE_HD: &str = "as hd";
const SCALED: &str = "hd's, scaled to the pixel's area";
const TYPICAL: &str = "typical of the sensor's kind";
const FIT: &str =
    "fit to the EVK4's noise, .15 to 20 lux (Noise2Params, arXiv 2605.16317), and NIST's latencies";
const AROUND: &str =
    "fit, around .25 (arXiv 2404.07656, second-hand): unequal, since ON and OFF noise differ";
const QUIET: &str =
    "typical; with .2 its noise in an office, beside the leak, would be ten times the published .1 Hz";
const QUIET_DVS: &str =
    "as davis346; still noise beside the leak below .1 Hz in an office needs it with this charge";
const NIST: &str = "NIST, pixel latency, IEEE TIM 2025";
const NO_LEAK_OF_LIGHT: Sourced = assumed(0.0, "the published figures disagree by a factor of 5000");
const NO_DELAY: Sourced = assumed(0.0, "none is published apart from the bandwidth's");
const WORD_SERIAL: Sourced = known(0.0, "word-serial");
const MICROSECOND: Sourced = known(1000.0, "the format's tick");

/// The physical pixel of every preset. Only `hd` is fitted to measurements of noise.
pub const PHYSICAL_PRESETS: &[PhysicalPreset] = &[
    PhysicalPreset {
        name: "dvs128",
        response_e_per_lux_s: assumed(4e5, SCALED),
        dark_lux: assumed(
            0.06,
            "dark current of 4 fA (wengflow/rpg_esim) over the response, which is assumed",
        ),
        photoreceptor_charge_e: known(188.0, CIRCUIT),
        second_pole_hz: known(3100.0, CIRCUIT),
        contrast_log: [assumed(0.335, QUIET_DVS), assumed(0.335, QUIET_DVS)],
        mismatch_log: known(0.021, JSSC),
        refractory_us: assumed(100.0, TYPICAL),
        leak_rate_hz: known(0.05, "still noise of .05 to .1 events a pixel and second at 25 C, second-hand"),
        leak_per_lux_hz: NO_LEAK_OF_LIGHT,
        latency_us: NO_DELAY,
        service_ns: [WORD_SERIAL, assumed(1000.0, "about 1 Mev/s, recalled")],
        tick_ns: MICROSECOND,
        fitted_lux: None,
    },
    PhysicalPreset {
        name: "davis240",
        response_e_per_lux_s: assumed(2e5, SCALED),
        dark_lux: assumed(0.06, "as dvs128"),
        photoreceptor_charge_e: assumed(340.0, LIKE_HD),
        second_pole_hz: assumed(1000.0, LIKE_HD),
        contrast_log: [assumed(0.26, QUIET), assumed(0.26, QUIET)],
        mismatch_log: assumed(0.02, TYPICAL),
        refractory_us: assumed(500.0, JAER),
        leak_rate_hz: known(0.1, "v2e, and still noise of .05 to .1 Hz, second-hand"),
        leak_per_lux_hz: NO_LEAK_OF_LIGHT,
        latency_us: NO_DELAY,
        service_ns: [WORD_SERIAL, assumed(83.0, "12 Mev/s, recalled")],
        tick_ns: MICROSECOND,
        fitted_lux: None,
    },
    PhysicalPreset {
        name: "atis",
        response_e_per_lux_s: assumed(2.3e5, SCALED),
        dark_lux: assumed(0.05, TYPICAL),
        photoreceptor_charge_e: assumed(340.0, LIKE_HD),
        second_pole_hz: assumed(1000.0, LIKE_HD),
        contrast_log: [assumed(0.26, QUIET), assumed(0.26, QUIET)],
        mismatch_log: assumed(0.03, TYPICAL),
        refractory_us: assumed(100.0, TYPICAL),
        leak_rate_hz: assumed(0.1, TYPICAL),
        leak_per_lux_hz: NO_LEAK_OF_LIGHT,
        latency_us: NO_DELAY,
        service_ns: [WORD_SERIAL, assumed(30.0, TYPICAL)],
        tick_ns: MICROSECOND,
        fitted_lux: None,
    },
    PhysicalPreset {
        name: "davis346",
        response_e_per_lux_s: assumed(2e5, SCALED),
        dark_lux: assumed(0.06, "as dvs128"),
        photoreceptor_charge_e: assumed(340.0, LIKE_HD),
        second_pole_hz: assumed(1000.0, LIKE_HD),
        contrast_log: [
            known(0.337, "fit to a recording (esaac calibrate)"),
            known(0.366, "fit to a recording (esaac calibrate)"),
        ],
        mismatch_log: known(0.089, "fit to a recording, an upper bound (esaac calibrate)"),
        refractory_us: assumed(500.0, JAER),
        leak_rate_hz: known(0.06, "fit to a recording (esaac calibrate)"),
        leak_per_lux_hz: NO_LEAK_OF_LIGHT,
        latency_us: NO_DELAY,
        service_ns: [WORD_SERIAL, known(83.0, "12 Mev/s; 10 000 simultaneous events spread over 1 ms")],
        tick_ns: MICROSECOND,
        fitted_lux: None,
    },
    PhysicalPreset {
        name: "genx320",
        response_e_per_lux_s: assumed(1.6e5, SCALED),
        dark_lux: assumed(0.04, TYPICAL),
        photoreceptor_charge_e: assumed(340.0, LIKE_HD),
        second_pole_hz: assumed(1000.0, LIKE_HD),
        contrast_log: [assumed(0.26, TYPICAL), assumed(0.26, TYPICAL)],
        mismatch_log: assumed(0.02, TYPICAL),
        refractory_us: assumed(80.0, LIKE_HD),
        leak_rate_hz: assumed(0.02, LIKE_HD),
        leak_per_lux_hz: NO_LEAK_OF_LIGHT,
        latency_us: NO_DELAY,
        service_ns: [assumed(130.0, LIKE_HD), assumed(0.33, LIKE_HD)],
        tick_ns: MICROSECOND,
        fitted_lux: None,
    },
    PhysicalPreset {
        name: "vga",
        response_e_per_lux_s: assumed(2e5, SCALED),
        dark_lux: assumed(0.02, TYPICAL),
        photoreceptor_charge_e: assumed(700.0, "hd's, scaled to the pixel's area"),
        second_pole_hz: assumed(1000.0, LIKE_HD),
        contrast_log: [assumed(0.25, TYPICAL), assumed(0.25, TYPICAL)],
        mismatch_log: assumed(0.03, TYPICAL),
        refractory_us: assumed(200.0, TYPICAL),
        leak_rate_hz: assumed(0.1, TYPICAL),
        leak_per_lux_hz: NO_LEAK_OF_LIGHT,
        latency_us: known(369.0, NIST),
        service_ns: [WORD_SERIAL, assumed(15.0, "66 Mev/s of Gen3.1, recalled")],
        tick_ns: MICROSECOND,
        fitted_lux: None,
    },
    PhysicalPreset {
        name: "hd",
        response_e_per_lux_s: known(1.34e5, FIT),
        dark_lux: assumed(0.035, "part of the fit, below its range"),
        photoreceptor_charge_e: known(335.0, FIT),
        second_pole_hz: known(840.0, FIT),
        contrast_log: [known(0.265, AROUND), known(0.235, AROUND)],
        mismatch_log: known(0.0125, "Noise2Params, arXiv 2605.16317"),
        refractory_us: known(79.0, "Noise2Params, arXiv 2605.16317"),
        leak_rate_hz: known(-0.06, FIT),
        leak_per_lux_hz: NO_LEAK_OF_LIGHT,
        latency_us: known(0.0, "the second pole delays by more than NIST's 24 us"),
        service_ns: [
            known(130.0, "NIST, latency against active pixels, IEEE TIM 2025"),
            known(0.33, "NIST, latency against active pixels, IEEE TIM 2025"),
        ],
        tick_ns: MICROSECOND,
        fitted_lux: Some([0.15, 20.0]),
    },
];

/// The physical pixel of the preset with this name, if there is one.
#[must_use]
pub fn physical_preset(name: &str) -> Option<&'static PhysicalPreset> {
    PHYSICAL_PRESETS.iter().find(|preset| preset.name == name)
}

impl PhysicalPreset {
    /// Every number by the parameter of a [`SensorModel`] that it is, in that parameter's unit.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, Sourced); 14] {
        let nanoseconds = |microseconds: Sourced| Sourced { value: 1e3 * microseconds.value, ..microseconds };
        [
            ("contrast_on", self.contrast_log[0]),
            ("contrast_off", self.contrast_log[1]),
            ("contrast_mismatch", self.mismatch_log),
            ("refractory_ns", nanoseconds(self.refractory_us)),
            ("latency_ns", nanoseconds(self.latency_us)),
            ("timestamp_quantum_ns", self.tick_ns),
            ("response_e_per_lux_s", self.response_e_per_lux_s),
            ("dark_lux", self.dark_lux),
            ("photoreceptor_charge_e", self.photoreceptor_charge_e),
            ("second_pole_hz", self.second_pole_hz),
            ("leak_rate_hz", self.leak_rate_hz),
            ("leak_per_lux_hz", self.leak_per_lux_hz),
            ("readout_row_ns", self.service_ns[0]),
            ("readout_event_ns", self.service_ns[1]),
        ]
    }

    /// Whether a sensor has this pixel, with nothing changed: its noise is that of the fit.
    #[must_use]
    pub fn is_pixel_of(&self, sensor: &SensorModel) -> bool {
        let mut as_preset = sensor.clone();
        let (pixel, _) = self.apply(&mut as_preset);
        let pixel = PhysicalPixel { lux_per_unit: sensor.lux_per_unit, ..pixel };
        as_preset == *sensor && sensor.physical_pixel() == pixel
    }

    /// What its noise was fitted to, as a sentence.
    #[must_use]
    pub fn fit(&self) -> String {
        match self.fitted_lux {
            Some([low, high]) => {
                format!(
                    "The noise of `{}` is fitted to measurements at {low} to {high} focal-plane lux.",
                    self.name
                )
            }
            None => format!("The noise of `{}` is fitted to no measurement, at no light.", self.name),
        }
    }

    /// The pixel and its readout. Sets what the pixel shares with the log-intensity pixel in `sensor`: thresholds,
    /// mismatch, refractory period, latency and tick.
    #[must_use]
    pub fn apply(&self, sensor: &mut SensorModel) -> (PhysicalPixel, Readout) {
        let nanoseconds = |microseconds: f64| (microseconds * 1e3).round() as u32;
        [sensor.contrast_on, sensor.contrast_off] = self.contrast_log.map(|contrast| contrast.value);
        sensor.contrast_mismatch = self.mismatch_log.value;
        sensor.refractory_ns = nanoseconds(self.refractory_us.value);
        sensor.latency_ns = nanoseconds(self.latency_us.value);
        sensor.timestamp_quantum_ns = self.tick_ns.value.round() as u32;
        let pixel = PhysicalPixel {
            response_e_per_lux_s: self.response_e_per_lux_s.value,
            dark_lux: self.dark_lux.value,
            photoreceptor_charge_e: self.photoreceptor_charge_e.value,
            second_pole_hz: self.second_pole_hz.value,
            leak_rate_hz: self.leak_rate_hz.value,
            leak_per_lux_hz: self.leak_per_lux_hz.value,
            ..PhysicalPixel::default()
        };
        let [row_ps, event_ps] = self.service_ns.map(|service| (service.value * 1e3).round() as u64);
        let bus = if row_ps == 0 { Bus::Fifo { event_ps } } else { Bus::Rows { row_ps, event_ps } };
        (pixel, Readout { bus, ..Readout::default() })
    }
}

/// What to tell of a physical pixel that has assumed numbers of a preset whose noise is fitted to no measurement: their
/// parameters. `None` for another one.
#[must_use]
pub fn assumed_note(sensor: &SensorModel) -> Option<String> {
    let preset = physical_preset(&sensor.name).filter(|preset| preset.fitted_lux.is_none())?;
    let values = toml::Table::try_from(sensor).expect("a sensor is a table");
    let has = |parameter: &str, number: f64| {
        let value = &values[parameter];
        value.as_float().or(value.as_integer().map(|whole| whole as f64)) == Some(number)
    };
    let is_read = |parameter: &str| sensor.readout != ReadoutKind::None || !parameter.starts_with("readout_");
    let numbers = preset.numbers();
    let assumed = numbers
        .iter()
        .filter(|(parameter, number)| number.assumed && is_read(parameter) && has(parameter, number.value));
    let assumed: Vec<&str> = assumed.map(|(parameter, _)| *parameter).collect();
    (sensor.pixel == Pixel::Physical && !assumed.is_empty())
        .then(|| format!("{} Assumed: {}", preset.fit(), assumed.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::presets::{PRESETS, preset, preset_with_physical_pixel};

    #[test]
    fn every_preset_has_a_valid_physical_pixel() {
        for p in PHYSICAL_PRESETS {
            assert!(preset(p.name).is_some(), "`{}` of PHYSICAL_PRESETS is not in PRESETS", p.name);
        }
        for p in PRESETS {
            let mut sensor = preset(p.name).expect("listed");
            let physical = physical_preset(p.name);
            let physical = physical.unwrap_or_else(|| panic!("`{}` is not in PHYSICAL_PRESETS", p.name));
            let (pixel, readout) = physical.apply(&mut sensor);
            sensor.validate().unwrap_or_else(|e| panic!("{}: {e}", p.name));
            pixel.validate().unwrap_or_else(|e| panic!("{}: {e}", p.name));
            readout.validate().unwrap_or_else(|e| panic!("{}: {e}", p.name));
        }
        assert!(physical_preset("nonesuch").is_none());
    }

    #[test]
    fn hd_has_the_fitted_speed_and_noise() {
        let mut sensor = preset("hd").expect("listed");
        let (pixel, _) = physical_preset("hd").expect("listed").apply(&mut sensor);
        let per_lux = pixel.drive_per_s(1.0 / pixel.lux_per_unit);
        assert!((per_lux / 400.0 - 1.0).abs() < 0.01, "{per_lux} rad/s for each lux");
        let distance = sensor.contrast_on * pixel.photoreceptor_charge_e.sqrt();
        assert!((distance / 4.85 - 1.0).abs() < 0.01, "{distance} standard deviations of one pole");
    }

    #[test]
    fn what_is_assumed_is_told_of_presets_without_a_fit() {
        for preset in PHYSICAL_PRESETS {
            let sensor = preset_with_physical_pixel(preset.name).expect("listed");
            let note = assumed_note(&sensor);
            assert_eq!(note.is_none(), preset.name == "hd", "{note:?}");
            assert_eq!(assumed_note(&SensorModel { pixel: Pixel::Log, ..sensor }), None);
        }
        let dvs128 = assumed_note(&preset_with_physical_pixel("dvs128").expect("listed"));
        let dvs128 = dvs128.expect("its response is assumed, and what follows from it");
        assert!(dvs128.contains("response_e_per_lux_s, dark_lux"), "{dvs128}");
        let davis = preset_with_physical_pixel("davis346").expect("listed");
        let note = assumed_note(&davis).expect("speed and charge are assumed");
        assert!(
            note.starts_with("The noise of `davis346` is fitted to no measurement, at no light."),
            "{note}"
        );
        assert!(note.contains("photoreceptor_charge_e, second_pole_hz"), "{note}");
        assert!(!note.contains("contrast_on") && !note.contains("readout"), "{note}");
        // What the user has set is not assumed, and what the bus needs is told if there is one.
        let own = SensorModel { photoreceptor_charge_e: 200.0, ..davis };
        assert!(!assumed_note(&own).expect("the rest").contains("photoreceptor_charge_e"));
        let atis = preset_with_physical_pixel("atis").expect("listed");
        let bus = SensorModel { readout: ReadoutKind::Fifo, ..atis };
        assert!(assumed_note(&bus).expect("the rest").contains("readout_event_ns"));
        assert_eq!(assumed_note(&SensorModel { name: "mine".to_owned(), ..own }), None, "no preset");
    }
}
