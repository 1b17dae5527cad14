//! How much light falls on the chip: what a user is told, so that nobody simulates moonlight unknowingly.

use super::physical_preset;
use crate::SensorModel;
use crate::intensity::weights;
use crate::optics::vignetting;
use serde::Serialize;
use std::fmt;

/// Illuminance on the focal plane below which a pixel counts as dim, lux: there dark current and noise are most of what
/// a pixel shows.
pub const DIM_LUX: f64 = 0.1;

/// Share of pixels beyond the light that a preset is fitted for, from which it is told.
const TOLD_SHARE: f64 = 0.05;

/// Steps of the histogram in a doubling of the light.
const STEPS: f64 = 8.0;
/// Logarithms, base 2, of the least and the most lux that it tells apart.
const RANGE_LOG2: [f64; 2] = [-32.0, 32.0];

/// Pixels by the light on them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Illuminances {
    counts: Vec<u64>,
    pixels: u64,
    dim: u64,
    frames: u64,
}

/// What [`Illuminances`] come to. Illuminances are up to 5% off: they are counted in steps of an eighth of an octave and
/// told with three digits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LightReport {
    /// Median over pixels and frames, focal-plane lux.
    pub median_lux: f64,
    /// A twentieth of the pixels have less.
    pub low_lux: f64,
    /// A twentieth of the pixels have more.
    pub high_lux: f64,
    /// Share of pixels below [`DIM_LUX`].
    pub dim_share: f64,
    /// Pixels looked at.
    pub pixels: u64,
    /// Frames looked at.
    pub frames: u64,
}

/// Illuminance on pixel `(x, y)` of a sensor that is shown this linear RGB, lux, in steady light; `None` if the colour is
/// no light.
#[must_use]
pub fn lux_of(sensor: &SensorModel, (x, y): (u32, u32), rgb: [f64; 3]) -> Option<f64> {
    let valid = rgb.iter().all(|c| c.is_finite() && *c >= 0.0);
    let seen: f64 = weights(sensor.intensity, x, y).iter().zip(rgb).map(|(w, c)| w * c).sum();
    valid.then(|| seen * sensor.exposure_gain * vignetting(sensor, x, y) * sensor.lux_per_unit)
}

impl Illuminances {
    /// Adds the pixels of a frame.
    pub fn add_frame(&mut self, lux: impl Iterator<Item = f64>) {
        self.counts.resize(((RANGE_LOG2[1] - RANGE_LOG2[0]) * STEPS) as usize, 0);
        for lux in lux {
            let step = ((lux.log2() - RANGE_LOG2[0]) * STEPS).clamp(0.0, (self.counts.len() - 1) as f64);
            self.counts[step as usize] += 1;
            self.pixels += 1;
            self.dim += u64::from(lux < DIM_LUX);
        }
        self.frames += 1;
    }

    /// Whether nothing was added yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.frames == 0
    }

    /// Lux that a share of the pixels does not exceed: the middle of its step, to three digits, for more would tell
    /// nothing.
    fn quantile_lux(&self, share: f64) -> f64 {
        let mut left = (share * self.pixels as f64).floor() as u64;
        for (step, count) in self.counts.iter().enumerate() {
            if left < *count {
                // Everything below the range is as good as none.
                let middle_lux = ((step as f64 + 0.5) / STEPS + RANGE_LOG2[0]).exp2();
                return if step == 0 { 0.0 } else { three_digits(middle_lux) };
            }
            left -= count;
        }
        f64::INFINITY
    }

    /// Share of pixels with less light.
    fn share_below(&self, lux: f64) -> f64 {
        let steps = ((lux.log2() - RANGE_LOG2[0]) * STEPS).max(0.0) as usize;
        self.counts.iter().take(steps).sum::<u64>() as f64 / self.pixels as f64
    }

    /// The report; `None` if there were no pixels.
    #[must_use]
    pub fn report(&self) -> Option<LightReport> {
        (self.pixels > 0).then(|| LightReport {
            median_lux: self.quantile_lux(0.5),
            low_lux: self.quantile_lux(0.05),
            high_lux: self.quantile_lux(0.95),
            dim_share: self.dim as f64 / self.pixels as f64,
            pixels: self.pixels,
            frames: self.frames,
        })
    }

    /// What to tell if many pixels have another light than the sensor's preset was fitted for; `None` for a sensor that
    /// is no fitted preset.
    #[must_use]
    pub fn fit_warning(&self, sensor: &SensorModel) -> Option<String> {
        let report = self.report()?;
        let preset = physical_preset(&sensor.name)?;
        let [low, high] = preset.fitted_lux?;
        let (below, above) = (self.share_below(low), 1.0 - self.share_below(high));
        let mut beyond = Vec::new();
        for (share, what) in
            [(below, "less, where nothing was measured"), (above, "more, where its noise is too high")]
        {
            if share > TOLD_SHARE {
                beyond.push(format!("{}% of pixels have {what}", percent(share)));
            }
        }
        (preset.is_pixel_of(sensor) && !beyond.is_empty()).then(|| {
            format!(
                "`{}` is fitted to noise at {} to {} focal-plane lux; {} (median {} lux)",
                preset.name,
                short(low),
                short(high),
                beyond.join(", "),
                short(report.median_lux)
            )
        })
    }
}

impl fmt::Display for LightReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "median {} lux, {} to {} for nine tenths; {}% of pixels below {} lux",
            short(self.median_lux),
            short(self.low_lux),
            short(self.high_lux),
            percent(self.dim_share),
            short(DIM_LUX)
        )
    }
}

fn three_digits(lux: f64) -> f64 {
    format!("{lux:.2e}").parse().expect("a number's own text")
}

/// Two digits.
fn short(lux: f64) -> String {
    if lux == 0.0 || !lux.is_finite() {
        return lux.to_string();
    }
    let digits = 1 - lux.log10().floor() as i32;
    let unit = 10_f64.powi(-digits);
    format!("{:.*}", digits.max(0) as usize, (lux / unit).round() * unit)
}

/// A share in whole percent, but never none of some.
fn percent(share: f64) -> String {
    if share > 0.0 && share < 0.005 { "<1".to_owned() } else { format!("{:.0}", 100.0 * share) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::presets::preset_with_physical_pixel;
    use crate::{Intensity, Pixel};

    fn of(lux: &[f64]) -> Illuminances {
        let mut light = Illuminances::default();
        light.add_frame(lux.iter().copied());
        light
    }

    #[test]
    fn the_report_tells_the_middle_and_the_dim() {
        assert_eq!(Illuminances::default().report(), None);
        let mut lux = vec![12.0; 90];
        lux.extend([0.02; 4]);
        lux.extend([300.0; 6]);
        let report = of(&lux).report().expect("pixels");
        assert!((report.median_lux / 12.0 - 1.0).abs() < 0.05, "{report:?}");
        assert!((report.high_lux / 300.0 - 1.0).abs() < 0.05 && report.dim_share == 0.04, "{report:?}");
        let text = report.to_string();
        assert!(text.starts_with("median 12 lux") && text.ends_with("4% of pixels below 0.10 lux"), "{text}");
        let dark = of(&[0.0, 0.0, 1e-30]).report().expect("pixels");
        assert_eq!((dark.median_lux, dark.dim_share), (0.0, 1.0));
        assert_eq!([0.0123, 1.26, 126.0, 12_600.0].map(short), ["0.012", "1.3", "130", "13000"]);
    }

    #[test]
    fn light_is_told_with_three_digits_and_to_five_percent() {
        let mut lux = 1e-3;
        while lux < 1e6 {
            let told = of(&[lux]).report().expect("a pixel").median_lux;
            assert!((told / lux - 1.0).abs() < 0.05, "{told} of {lux}");
            let digits = format!("{told:e}").split('e').next().expect("a number").replace('.', "").len();
            assert!(digits <= 3, "{told} of {lux}");
            lux *= 1.0071;
        }
        assert_eq!(of(&[1.0]).report().expect("a pixel").median_lux, 1.04);
    }

    #[test]
    fn light_is_counted_behind_gain_and_lens() {
        let sensor = SensorModel {
            pixel: Pixel::Physical,
            intensity: Intensity::BayerRggb,
            exposure_gain: 2.0,
            lux_per_unit: 10.0,
            ..SensorModel::default()
        };
        assert_eq!(lux_of(&sensor, (0, 0), [1.0, 2.0, 3.0]), Some(20.0));
        assert_eq!(lux_of(&sensor, (1, 1), [1.0, 2.0, 3.0]), Some(60.0));
        assert_eq!(lux_of(&sensor, (1, 1), [1.0, f64::NAN, 3.0]), None);
        let narrow = SensorModel { vignetting_fov_deg: 60.0, ..sensor };
        assert!(lux_of(&narrow, (0, 0), [1.0; 3]).expect("light") < 12.0, "a corner");
    }

    #[test]
    fn a_preset_beyond_its_fit_is_told() {
        let hd = preset_with_physical_pixel("hd").expect("listed");
        assert_eq!(of(&[1.0; 100]).fit_warning(&hd), None);
        let bright = of(&[50.0; 100]).fit_warning(&hd).expect("beyond 20 lux");
        assert!(bright.contains("0.15 to 20 focal-plane lux; 100% of pixels have more"), "{bright}");
        let mut lux = vec![1.0; 90];
        lux.extend([0.01; 10]);
        let dim = of(&lux).fit_warning(&hd).expect("below .15 lux");
        assert!(dim.contains("10% of pixels have less"), "{dim}");
        let resized = SensorModel { width: 64, seed: 3, lux_per_unit: 7.0, ..hd.clone() };
        assert!(of(&[50.0; 100]).fit_warning(&resized).is_some());
        for own in [
            SensorModel { response_e_per_lux_s: 1e5, ..hd.clone() },
            SensorModel { contrast_on: 0.3, ..hd.clone() },
            SensorModel { contrast_mismatch: 0.05, ..hd.clone() },
            SensorModel { dark_lux: 0.1, ..hd.clone() },
            SensorModel { noise_gain: 0.0, ..hd },
        ] {
            assert_eq!(of(&[50.0; 100]).fit_warning(&own), None, "no longer the preset: {own:?}");
        }
        let davis = preset_with_physical_pixel("davis346").expect("listed");
        assert_eq!(of(&[50.0; 100]).fit_warning(&davis), None, "fitted to nothing");
    }
}
