//! Sensors with parameters at random, and changes of them.

use crate::dice::Dice;
use esaac_model::{Intensity, Pixel, ReadoutKind, SensorModel, SubstepPolicy, Synthesis, Taps, Timestamps};

/// What a camera gets besides colour. It decides which syntheses a sensor may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    pub motion: bool,
    pub geometry: bool,
}

impl Input {
    fn allows(self, synthesis: Synthesis) -> bool {
        match synthesis {
            Synthesis::Rigid => self.geometry,
            Synthesis::Motion | Synthesis::Paper => self.motion,
            Synthesis::Auto | Synthesis::Linear | Synthesis::None => true,
        }
    }
}

/// Syntheses, those with more code more often.
const SYNTHESES: [Synthesis; 10] = [
    Synthesis::None,
    Synthesis::Linear,
    Synthesis::Linear,
    Synthesis::Paper,
    Synthesis::Motion,
    Synthesis::Motion,
    Synthesis::Motion,
    Synthesis::Auto,
    Synthesis::Rigid,
    Synthesis::Rigid,
];

pub fn synthesis(dice: &mut Dice) -> Synthesis {
    dice.shared.pick(&SYNTHESES)
}

fn synthesis_for(dice: &mut Dice, input: Input) -> Synthesis {
    loop {
        let drawn = synthesis(dice);
        if input.allows(drawn) {
            return drawn;
        }
    }
}

/// A valid sensor of this size. Numbers stay where the engine's single precision has the accuracy that comparisons ask for,
/// and where a pixel sends no more than some hundreds of events.
pub fn sensor(dice: &mut Dice, size_px: (u32, u32), input: Input, asked: Option<Synthesis>) -> SensorModel {
    loop {
        let asked = asked.unwrap_or_else(|| synthesis_for(dice, input));
        let drawn = draw(dice, size_px, asked);
        if drawn.validate().is_ok() {
            return drawn;
        }
    }
}

fn draw(dice: &mut Dice, (width, height): (u32, u32), synthesis: Synthesis) -> SensorModel {
    // How many of the effects a sensor has differs from sensor to sensor.
    let share = dice.shared.pick(&[0.1, 0.3, 0.3, 0.7]);
    let mut sensor = SensorModel {
        width,
        height,
        synthesis,
        contrast_on: dice.own.magnitude(0.05, 0.6),
        contrast_off: dice.own.magnitude(0.05, 0.6),
        intensity: dice.shared.pick(&Intensity::ALL),
        log_offset: dice.own.pick(&[0.01, 0.001, 0.1, 1.0]),
        taps: dice.shared.pick(&[Taps::Cubic, Taps::Cubic, Taps::Bilinear]),
        transfers: dice.shared.below(4),
        layers: dice.shared.pick(&[0, 0, 1, 1, 2, 3]),
        substeps: dice.own.pick(&[1, 2, 3, 7, 8, 16, 31, 32, 33, 64]),
        substep_policy: dice.own.pick(&[
            SubstepPolicy::Adaptive,
            SubstepPolicy::Adaptive,
            SubstepPolicy::Fixed,
        ]),
        substep_error_ns: dice.shared.pick(&[0, 150_000, 150_000, 1_000, 300_000, 20_000_000, 1_000_000_000]),
        seed: dice.own.seed(),
        ..SensorModel::default()
    };
    if dice.shared.chance(0.2) {
        sensor.pixel = Pixel::Physical;
    }
    effects(dice, share, &mut sensor);
    optics(dice, share, &mut sensor);
    readout(dice, share, &mut sensor);
    aps(dice, share, &mut sensor);
    if sensor.pixel == Pixel::Physical {
        physical(dice, share, &mut sensor);
    }
    sensor
}

fn effects(dice: &mut Dice, share: f64, sensor: &mut SensorModel) {
    if dice.shared.chance(share) {
        let smaller = sensor.contrast_on.min(sensor.contrast_off);
        sensor.contrast_mismatch = smaller * dice.own.between(0.0, 0.5);
    }
    if dice.shared.chance(share) {
        sensor.refractory_ns = dice.own.whole(1, 100_000_000);
    }
    if dice.shared.chance(share) {
        sensor.leak_rate_hz = dice.own.magnitude(0.01, 100.0);
    }
    if dice.shared.chance(share) {
        sensor.leak_spread_log = dice.own.between(0.0, 1.0);
    }
    if dice.shared.chance(share) {
        sensor.shot_noise_rate_hz = dice.own.magnitude(0.1, 50.0);
        sensor.white_level = dice.own.magnitude(0.01, 100.0);
    }
    if dice.shared.chance(share) {
        sensor.latency_ns = dice.own.whole(1, 200_000_000);
    }
    if dice.shared.chance(share) {
        sensor.latency_jitter_ns = dice.own.whole(1, 20_000_000);
    }
    if dice.shared.chance(share) {
        sensor.timestamp_quantum_ns = dice.own.pick(&[2, 10, 1_000, 1_000, 1_000_000, 7_777_777]);
    }
    if dice.shared.chance(share) {
        sensor.timestamps = Timestamps::AtSample;
    }
    if dice.shared.chance(0.3 * share) {
        sensor.max_events_per_interval = dice.own.whole(1, 3_000);
    }
}

fn optics(dice: &mut Dice, share: f64, sensor: &mut SensorModel) {
    if dice.shared.chance(share) {
        sensor.exposure_gain = dice.own.magnitude(0.05, 20.0);
    }
    if dice.shared.chance(0.5 * share) {
        sensor.psf_sigma_px = dice.own.between(0.0, 1.0);
    }
    if dice.shared.chance(0.5 * share) {
        sensor.vignetting_fov_deg = dice.own.between(10.0, 150.0);
    }
    if dice.shared.chance(0.5 * share) && sensor.synthesis != Synthesis::None {
        sensor.flicker_depth = dice.own.between(0.0, 0.9);
        sensor.flicker_hz = dice.own.magnitude(1.0, 1000.0);
        sensor.flicker_phase_deg = dice.own.between(-360.0, 360.0);
    }
}

fn readout(dice: &mut Dice, share: f64, sensor: &mut SensorModel) {
    if !dice.shared.chance(share) {
        return;
    }
    sensor.readout = dice.shared.pick(&[ReadoutKind::Fifo, ReadoutKind::Rows]);
    // From a bus that is idle to one that is far too slow.
    sensor.readout_event_ns = dice.own.magnitude(0.01, 100_000.0);
    sensor.readout_row_ns = dice.own.magnitude(0.01, 300_000.0);
    if dice.shared.chance(0.3) {
        sensor.readout_cap_events = dice.own.whole(1, 1_000);
        sensor.readout_cap_period_ns = dice.own.whole(1_000, 1_000_000_000);
    }
}

fn aps(dice: &mut Dice, share: f64, sensor: &mut SensorModel) {
    if dice.shared.chance(0.5 * share) {
        sensor.aps_exposure_ns = dice.own.whole(1, 1_000_000_000);
        sensor.aps_start_ns = dice.own.pick(&[0, 0, 1, 7_000_000, 40_000_000]);
        sensor.aps_gain = dice.own.magnitude(0.1, 10.0);
        sensor.aps_bits = 1 + dice.own.below(16);
        sensor.white_level = dice.own.magnitude(0.1, 10.0);
    }
}

fn physical(dice: &mut Dice, share: f64, sensor: &mut SensorModel) {
    sensor.lux_per_unit = dice.own.magnitude(1.0, 1_000.0);
    sensor.dark_lux = dice.own.magnitude(0.01, 1.0);
    sensor.response_e_per_lux_s = dice.own.magnitude(5e4, 2e6);
    sensor.photoreceptor_charge_e = dice.own.magnitude(100.0, 1_000.0);
    sensor.second_pole_hz = dice.own.magnitude(100.0, 1e5);
    sensor.temperature_c = if dice.shared.chance(share) { dice.own.between(-10.0, 60.0) } else { 25.0 };
    sensor.noise_gain = if dice.shared.chance(0.4) { dice.own.between(0.2, 2.0) } else { 0.0 };
    sensor.leak_rate_hz *= if dice.shared.chance(0.5) { -0.1 } else { 0.1 };
    if dice.shared.chance(share) {
        sensor.dark_spread_log = dice.own.between(0.0, 0.8);
    }
    if dice.shared.chance(share) {
        sensor.leak_per_lux_hz = dice.own.between(-0.05, 0.05);
    }
}

/// The sensor with some parameters of another one: what a caller may change while it runs.
pub fn changed(dice: &mut Dice, sensor: &SensorModel, input: Input) -> SensorModel {
    let table = |sensor: &SensorModel| toml::Table::try_from(sensor).expect("a sensor is a table");
    loop {
        let other = table(&self::sensor(dice, (sensor.width, sensor.height), input, None));
        let mut mixed = table(sensor);
        let names: Vec<&String> = other.keys().collect();
        for _ in 0..=dice.shared.below(8) {
            let name = dice.shared.pick(&names);
            mixed.insert(name.clone(), other[name].clone());
        }
        let mixed: SensorModel = mixed.try_into().expect("parameters of two sensors");
        if mixed.validate().is_ok() && mixed != *sensor {
            return mixed;
        }
    }
}
