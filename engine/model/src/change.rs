//! What a running camera must discard or redo when its parameters change.

use crate::{Pixel, SensorModel, Synthesis, Taps};

/// What a change of parameters requires beyond using the new values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChangeEffects {
    /// The image size differs. A running camera refuses this.
    pub resizes: bool,
    /// The stored planes hold other values or another resolution: the next frame counts as the camera's first.
    pub resets_frames: bool,
    /// The per-pixel random draws must be repeated; see [`SensorModel::pixel_draws`].
    pub redraws_pixels: bool,
}

impl SensorModel {
    /// Compares this sensor with `next` and returns what the change requires.
    #[must_use]
    pub fn change_to(&self, next: &SensorModel) -> ChangeEffects {
        // The stored planes hold ln(intensity * exposure_gain + log_offset), at half-pel samples or at pixels.
        let frames = |s: &SensorModel| {
            let half_pel = s.synthesis.has_half_pels() && s.taps == Taps::Cubic;
            // Half-pel frames of `rigid` are made within the surfaces of the last frame, which it keeps.
            let surfaces = s.synthesis == Synthesis::Rigid;
            // A physical pixel's state refers to its own dark level, and to a noise that is there or not.
            let dark_draw = if s.dark_spread_log > 0.0 { s.seed } else { 0 };
            let physical = (s.pixel == Pixel::Physical)
                .then(|| (s.dark_spread_log.to_bits(), dark_draw, s.noise_gain > 0.0));
            let lens = [s.exposure_gain, s.psf_sigma_px, s.vignetting_fov_deg].map(f64::to_bits);
            let planes = (s.intensity, s.dark_level().to_bits(), lens, half_pel, surfaces);
            // What a physical pixel shows lags behind the light, which must not jump between two intervals.
            let lamp = s.flicker().filter(|_| s.pixel == Pixel::Physical);
            let lamp = lamp.map(|lamp| [lamp.hz, lamp.depth, lamp.phase_deg].map(f64::to_bits));
            // What waits for one bus has no place on another.
            (planes, physical, lamp, s.readout)
        };
        let draws = |s: &SensorModel| {
            let drawn =
                [s.contrast_on, s.contrast_off, s.contrast_mismatch, s.leak_rate_hz, s.leak_spread_log];
            (s.seed, s.pixel, s.dark_spread_log.to_bits(), drawn.map(f64::to_bits))
        };
        ChangeEffects {
            resizes: (self.width, self.height) != (next.width, next.height),
            resets_frames: frames(self) != frames(next),
            redraws_pixels: draws(self) != draws(next),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Intensity, ReadoutKind};

    #[test]
    fn each_change_has_the_effects_it_needs_and_no_others() {
        let base = SensorModel { synthesis: Synthesis::Motion, taps: Taps::Cubic, ..SensorModel::default() };
        let nothing = ChangeEffects::default();
        assert_eq!(base.change_to(&base), nothing);
        let change = |change: fn(&mut SensorModel)| {
            let mut next = base.clone();
            change(&mut next);
            assert_ne!(base, next);
            base.change_to(&next)
        };
        assert_eq!(change(|s| s.refractory_ns += 1), nothing);
        assert_eq!(change(|s| s.substeps += 1), nothing);
        assert_eq!(change(|s| s.width += 1), ChangeEffects { resizes: true, ..nothing });
        let resets = ChangeEffects { resets_frames: true, ..nothing };
        assert_eq!(change(|s| s.exposure_gain *= 2.0), resets);
        assert_eq!(change(|s| s.log_offset *= 2.0), resets);
        assert_eq!(change(|s| s.psf_sigma_px = 0.5), resets);
        assert_eq!(change(|s| s.vignetting_fov_deg = 60.0), resets);
        assert_eq!(change(|s| s.flicker_depth = 0.5), nothing);
        assert_eq!(change(|s| s.intensity = Intensity::SiliconFront), resets);
        assert_eq!(change(|s| s.taps = Taps::Bilinear), resets);
        assert_eq!(change(|s| s.synthesis = Synthesis::Rigid), resets);
        assert_eq!(change(|s| s.intensity = Intensity::BayerRggb), resets);
        let redraws = ChangeEffects { redraws_pixels: true, ..nothing };
        assert_eq!(change(|s| s.seed += 1), redraws);
        assert_eq!(change(|s| s.contrast_on *= 2.0), redraws);
        assert_eq!(change(|s| s.leak_rate_hz += 0.5), redraws);
        assert_eq!(change(|s| s.temperature_c += 1.0), nothing, "no parameter of the log pixel");
        let both = ChangeEffects { resets_frames: true, redraws_pixels: true, ..nothing };
        assert_eq!(change(|s| s.pixel = Pixel::Physical), both);
        assert_eq!(change(|s| s.readout = ReadoutKind::Fifo), resets);
        assert_eq!(change(|s| s.readout_event_ns += 1.0), nothing);
        let physical = SensorModel { pixel: Pixel::Physical, ..base.clone() };
        let change = |change: fn(&mut SensorModel)| {
            let mut next = physical.clone();
            change(&mut next);
            physical.change_to(&next)
        };
        assert_eq!(change(|s| s.log_offset *= 2.0), nothing, "no parameter of the physical pixel");
        assert_eq!(change(|s| s.temperature_c += 1.0), resets, "the dark level moves");
        assert_eq!(change(|s| s.second_pole_hz *= 2.0), nothing);
        assert_eq!(change(|s| s.noise_gain = 0.5), nothing);
        assert_eq!(change(|s| s.flicker_depth = 0.5), resets);
        assert_eq!(change(|s| s.flicker_hz = 50.0), nothing, "there is no flicker");
        assert_eq!(change(|s| s.noise_gain = 0.0), resets);
        assert_eq!(change(|s| s.dark_spread_log = 0.5), both);
    }
}
