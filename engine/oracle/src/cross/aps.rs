//! APS frame: the mean intensity of a pixel over the exposure.

use esaac_model::SensorModel;
use esaac_model::substeps::substep_end_ns;

/// Start and end of the exposure, nanoseconds from the interval's start. `None` if the sensor takes no APS frame or the
/// exposure lies outside the interval.
#[must_use]
pub fn exposure_ns(sensor: &SensorModel, interval_ns: u32) -> Option<(u32, u32)> {
    let start = sensor.aps_start_ns.min(interval_ns);
    let end = sensor.aps_start_ns.saturating_add(sensor.aps_exposure_ns).min(interval_ns);
    (start < end).then_some((start, end))
}

/// Mean intensity over the exposure. Intensity is linear in time between samples.
#[must_use]
pub fn mean(samples: &[f64], interval_ns: u32, (start_ns, end_ns): (u32, u32)) -> f64 {
    let substeps = (samples.len() - 1) as u32;
    let mut integral = 0.0;
    let (mut a_ns, mut before) = (0, samples[0]);
    for (i, &after) in (1..).zip(&samples[1..]) {
        let b_ns = substep_end_ns(interval_ns, i, substeps);
        // Sub-steps without length are one with the next.
        if b_ns == a_ns {
            continue;
        }
        let (from_ns, from) = (std::mem::replace(&mut a_ns, b_ns), std::mem::replace(&mut before, after));
        let (low_ns, high_ns) = (from_ns.max(start_ns), b_ns.min(end_ns));
        if low_ns >= high_ns {
            continue;
        }
        let at = |t_ns: u32| {
            let fraction = f64::from(t_ns - from_ns) / f64::from(b_ns - from_ns);
            from * (1.0 - fraction) + after * fraction
        };
        integral += 0.5 * (at(low_ns) + at(high_ns)) * f64::from(high_ns - low_ns);
    }
    integral / f64::from(end_ns - start_ns)
}

/// Quantises a mean intensity to `aps_bits`, clipped to full scale.
#[must_use]
pub fn quantise(sensor: &SensorModel, mean: f64) -> u16 {
    let full_scale = f64::from((1_u32 << sensor.aps_bits) - 1);
    (mean * sensor.aps_gain / sensor.white_level * full_scale).round().clamp(0.0, full_scale) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_is_cut_to_the_interval() {
        let sensor = |aps_start_ns, aps_exposure_ns| SensorModel {
            aps_start_ns,
            aps_exposure_ns,
            ..SensorModel::default()
        };
        assert_eq!(exposure_ns(&sensor(10, 20), 100), Some((10, 30)));
        assert_eq!(exposure_ns(&sensor(10, 200), 100), Some((10, 100)));
        assert_eq!(exposure_ns(&sensor(100, 20), 100), None);
        assert_eq!(exposure_ns(&sensor(10, 0), 100), None);
    }

    #[test]
    fn mean_of_a_ramp_is_its_middle_however_it_is_cut() {
        let ramp = |n: usize| (0..=n).map(|i| i as f64 / n as f64).collect::<Vec<_>>();
        for n in [1, 2, 5, 25] {
            assert!((mean(&ramp(n), 1000, (120, 480)) - 0.3).abs() < 1e-12, "{n}");
        }
    }

    #[test]
    fn substeps_without_length_are_one_with_the_next() {
        assert_eq!(mean(&[0.0, 7.0, 9.0, 1.0], 1, (0, 1)), 0.5);
        assert_eq!(mean(&[0.0, 7.0, 1.0, 9.0, 3.0], 2, (0, 2)), 0.5 * (0.5 + 2.0));
    }

    #[test]
    fn depth_white_and_clipping() {
        let sensor = SensorModel { aps_bits: 10, white_level: 2.0, ..SensorModel::default() };
        assert_eq!([0.0, 1.0, 2.0, 3.0].map(|s| quantise(&sensor, s)), [0, 512, 1023, 1023]);
    }
}
