//! The parameters that are fitted together, and how each one moves.

use esaac_model::SensorModel;

/// A parameter of the fit.
pub struct Fitted {
    /// Name in sensor files.
    pub name: &'static str,
    /// Step for derivatives.
    pub step: f64,
    /// Moves the parameter.
    pub shift: fn(&mut SensorModel, f64),
}

/// What is fitted together. Positive quantities move by factors. The response stays in step with the charge, since
/// their ratio is the first pole.
pub const FITTED: [Fitted; 9] = [
    Fitted { name: "contrast_on", step: 0.05, shift: |s, by| s.contrast_on *= by.exp() },
    Fitted { name: "contrast_off", step: 0.05, shift: |s, by| s.contrast_off *= by.exp() },
    Fitted { name: "response_e_per_lux_s", step: 0.15, shift: |s, by| s.response_e_per_lux_s *= by.exp() },
    Fitted { name: "second_pole_hz", step: 0.15, shift: |s, by| s.second_pole_hz *= by.exp() },
    Fitted {
        name: "photoreceptor_charge_e",
        step: 0.1,
        shift: |s, by| {
            s.photoreceptor_charge_e *= by.exp();
            s.response_e_per_lux_s *= by.exp();
        },
    },
    Fitted {
        name: "refractory_ns",
        step: 0.1,
        shift: |s, by| s.refractory_ns = (f64::from(s.refractory_ns) * by.exp()).clamp(1e3, 1e9) as u32,
    },
    Fitted { name: "dark_lux", step: 0.3, shift: |s, by| s.dark_lux *= by.exp() },
    // Hz, in place of nepers.
    Fitted { name: "leak_rate_hz", step: 0.1, shift: |s, by| s.leak_rate_hz += by },
    Fitted {
        name: "contrast_mismatch",
        step: 0.02,
        // As a share of the thresholds.
        shift: |s, by| s.contrast_mismatch += by * 0.5 * (s.contrast_on + s.contrast_off),
    },
];

/// The place of the second pole among them.
pub const SECOND_POLE: usize = 3;

/// The steps of all.
pub const STEPS: [f64; FITTED.len()] = {
    let mut steps = [0.0; FITTED.len()];
    let mut number = 0;
    while number < steps.len() {
        steps[number] = FITTED[number].step;
        number += 1;
    }
    steps
};

/// The sensor with parameters moved, kept within what sensors may be.
pub fn shifted(sensor: &SensorModel, by: &[f64]) -> SensorModel {
    let mut sensor = sensor.clone();
    for (parameter, &by) in FITTED.iter().zip(by) {
        (parameter.shift)(&mut sensor, by);
    }
    sensor.contrast_on = sensor.contrast_on.clamp(0.02, 3.0);
    sensor.contrast_off = sensor.contrast_off.clamp(0.02, 3.0);
    let smaller = sensor.contrast_on.min(sensor.contrast_off);
    sensor.contrast_mismatch = sensor.contrast_mismatch.clamp(0.0, 0.5 * smaller);
    sensor.response_e_per_lux_s = sensor.response_e_per_lux_s.clamp(1.0, 1e9);
    sensor.second_pole_hz = sensor.second_pole_hz.clamp(1.0, 1e6);
    sensor.photoreceptor_charge_e = sensor.photoreceptor_charge_e.clamp(10.0, 1e5);
    sensor.dark_lux = sensor.dark_lux.clamp(1e-5, 1e2);
    sensor.leak_rate_hz = sensor.leak_rate_hz.clamp(-100.0, 100.0);
    sensor
}

/// A sensor with the fitted parameters of another.
pub fn like(sensor: &SensorModel, other: &SensorModel) -> SensorModel {
    SensorModel {
        contrast_on: other.contrast_on,
        contrast_off: other.contrast_off,
        contrast_mismatch: other.contrast_mismatch,
        refractory_ns: other.refractory_ns,
        response_e_per_lux_s: other.response_e_per_lux_s,
        photoreceptor_charge_e: other.photoreceptor_charge_e,
        second_pole_hz: other.second_pole_hz,
        dark_lux: other.dark_lux,
        leak_rate_hz: other.leak_rate_hz,
        ..sensor.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_pole_has_its_place() {
        assert_eq!(FITTED[SECOND_POLE].name, "second_pole_hz");
        let mut by = [0.0; FITTED.len()];
        by[SECOND_POLE] = 2.0_f64.ln();
        let sensor = SensorModel::default();
        let twice = SensorModel { second_pole_hz: 2.0 * sensor.second_pole_hz, ..sensor.clone() };
        assert!((shifted(&sensor, &by).second_pole_hz / twice.second_pole_hz - 1.0).abs() < 1e-12);
    }
}
