//! Noise of presets against published rates.

use esaac_model::physical::PhysicalPixel;
use esaac_model::{SensorModel, SubstepPolicy};
use esaac_oracle::Oracle;

/// Noise rate of still pixels of a preset, Hz, over `seconds` after the burn-in.
fn still_rate_hz(preset: &str, lux: f64, (pixels, burn_in_s, seconds): (u32, u32, u32)) -> f64 {
    let sensor = esaac_model::presets::preset_with_physical_pixel(preset).expect("listed");
    let pixel = PhysicalPixel { lux_per_unit: 1.0, ..sensor.physical_pixel() };
    let sensor = SensorModel {
        width: pixels,
        height: 1,
        substeps: 1,
        substep_policy: SubstepPolicy::Fixed,
        seed: 5,
        ..sensor
    };
    let mut camera = Oracle::new(sensor.with_physical(&pixel), 0).expect("valid");
    let mut count = 0;
    for k in 0..=burn_in_s + seconds {
        let packet = camera.step_samples(i64::from(k) * 1_000_000_000, &|_, _| lux).expect("in time").packet;
        count += if k > burn_in_s { packet.len() } else { 0 };
    }
    count as f64 / f64::from(pixels * seconds)
}

#[test]
fn the_noise_of_a_still_hd_pixel_is_the_published_one_from_5_s_on() {
    // Published: the EVK4's noise against light, ON and OFF, Hz a pixel.
    let published =
        [(0.15, 0.49), (0.5, 0.88), (1.0, 1.15), (2.0, 1.31), (5.0, 0.99), (10.0, 0.48), (20.0, 0.145)];
    let mut peak = (0.0, 0.0);
    for (lux, published_hz) in published {
        let rate_hz = still_rate_hz("hd", lux, (200, 5, 30));
        let ratio = rate_hz / published_hz;
        println!("{lux} lux: {rate_hz:.3} Hz, {ratio:.2} of the published rate");
        assert!((1.0 / 1.5..1.5).contains(&ratio), "{lux} lux: {rate_hz} Hz, published {published_hz} Hz");
        peak = if rate_hz > peak.1 { (lux, rate_hz) } else { peak };
    }
    assert!((1.0..=5.0).contains(&peak.0), "the peak is at {} lux", peak.0);
}

#[test]
fn still_pixels_of_the_older_sensors_are_as_quiet_in_an_office_as_published() {
    // Published: .05 to .1 events of a pixel and second. Ten lux are an office behind a lens.
    for preset in ["dvs128", "davis240"] {
        let rate_hz = still_rate_hz(preset, 10.0, (120, 5, 40));
        assert!((0.03..0.25).contains(&rate_hz), "{preset}: {rate_hz} Hz");
    }
}
