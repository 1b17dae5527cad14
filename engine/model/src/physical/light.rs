//! From a renderer's unit to light on the focal plane.
//!
//! A lens of F-number `F` and transmission `T` images a scene of luminance `L_v` (cd/m2) with the illuminance
//! `E = pi T L_v / (4 F^2)` at the centre of the image (lux). A scene in radiance (W/m2/sr within the visible) has the
//! luminance `K` times that, with the luminous efficacy `K` of its light.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Luminous efficacy of white light, lm/W, where nothing better is known. Two measurements of one pixel give it: the
/// response to lux that fits the EVK4's noise (Noise2Params) over the response to W/m2 that its latency has (NIST). A black
/// body at 5800 K, cut to 400 to 700 nm, has 251; the renderer Radiance takes 179, of equal energy over all the visible.
pub const WHITE_EFFICACY_LM_PER_W: f64 = 270.0;

/// Transmission of a lens where it is not known.
pub const LENS_TRANSMISSION: f64 = 0.9;

/// Why a lens or a scene's unit is refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum LightError {
    /// A number that no lens or light has.
    #[error("{quantity} is {actual}, expected {expected}")]
    Range {
        /// What is wrong.
        quantity: &'static str,
        /// Allowed range.
        expected: &'static str,
        /// Value given.
        actual: f64,
    },
    /// A unit that is none of [`SceneUnit`]'s.
    #[error("scene unit is `{actual}`, expected luminance (cd/m2) or radiance (W/m2/sr)")]
    Unit {
        /// Name given.
        actual: String,
    },
    /// An efficacy for light that is measured in lumens.
    #[error("a luminous efficacy of {actual} lm/W is given, expected none: luminance needs none")]
    EfficacyOfLuminance {
        /// Value given.
        actual: f64,
    },
}

/// What an intensity of 1 means in the scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneUnit {
    /// 1 cd/m2.
    Luminance,
    /// 1 W/m2/sr within the visible.
    Radiance {
        /// Luminous efficacy of the scene's light, lm/W.
        efficacy_lm_per_w: f64,
    },
}

impl SceneUnit {
    /// The unit of this name, `luminance` or `radiance`; for radiance with the efficacy of its light, or that of white
    /// light.
    pub fn named(name: &str, efficacy_lm_per_w: Option<f64>) -> Result<Self, LightError> {
        match (name, efficacy_lm_per_w) {
            ("luminance", None) => Ok(SceneUnit::Luminance),
            ("luminance", Some(actual)) => Err(LightError::EfficacyOfLuminance { actual }),
            ("radiance", efficacy) => {
                Ok(SceneUnit::Radiance { efficacy_lm_per_w: efficacy.unwrap_or(WHITE_EFFICACY_LM_PER_W) })
            }
            _ => Err(LightError::Unit { actual: name.to_owned() }),
        }
    }
}

/// A lens.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lens {
    /// Focal length over aperture.
    pub f_number: f64,
    /// Share of the light that passes.
    pub transmission: f64,
}

impl Lens {
    /// Focal-plane illuminance of an intensity of 1 at the centre of the image, lux: a camera's `lux_per_unit`, if its
    /// `exposure_gain` is 1; else over that.
    ///
    /// # Errors
    /// `LightError` for an F-number, a transmission or an efficacy that no lens or light has.
    pub fn lux_per_unit(&self, unit: SceneUnit) -> Result<f64, LightError> {
        fn check(
            quantity: &'static str,
            actual: f64,
            expected: &'static str,
            holds: bool,
        ) -> Result<(), LightError> {
            if holds { Ok(()) } else { Err(LightError::Range { quantity, expected, actual }) }
        }
        check("F-number", self.f_number, "0.5 to 100", (0.5..=100.0).contains(&self.f_number))?;
        let transmits = self.transmission > 0.0 && self.transmission <= 1.0;
        check("transmission of the lens", self.transmission, "above 0 and at most 1", transmits)?;
        let efficacy = match unit {
            SceneUnit::Luminance => 1.0,
            SceneUnit::Radiance { efficacy_lm_per_w } => {
                let possible = efficacy_lm_per_w > 0.0 && efficacy_lm_per_w <= 683.0;
                check("luminous efficacy", efficacy_lm_per_w, "above 0 and at most 683 lm/W", possible)?;
                efficacy_lm_per_w
            }
        };
        Ok(std::f64::consts::PI * self.transmission * efficacy / (4.0 * self.f_number * self.f_number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Lens = Lens { f_number: 2.0, transmission: 0.9 };

    #[test]
    fn an_office_puts_ten_lux_on_the_focal_plane() {
        // 1 klux on an 18% grey wall has a luminance of 1000 x .18 / pi.
        let lux = LENS.lux_per_unit(SceneUnit::Luminance).unwrap() * 1000.0 * 0.18 / std::f64::consts::PI;
        assert!((lux - 10.1).abs() < 0.1, "{lux}");
        let radiance = SceneUnit::Radiance { efficacy_lm_per_w: 100.0 };
        let ratio = LENS.lux_per_unit(radiance).unwrap() / LENS.lux_per_unit(SceneUnit::Luminance).unwrap();
        assert!((ratio - 100.0).abs() < 1e-9);
    }

    #[test]
    fn impossible_lenses_and_light_are_refused_by_name() {
        let refused = |lens: Lens, unit| lens.lux_per_unit(unit).unwrap_err().to_string();
        assert!(refused(Lens { f_number: 0.0, ..LENS }, SceneUnit::Luminance).contains("F-number is 0"));
        assert!(refused(Lens { transmission: 1.5, ..LENS }, SceneUnit::Luminance).contains("transmission"));
        assert!(refused(Lens { transmission: f64::NAN, ..LENS }, SceneUnit::Luminance).contains("NaN"));
        let bright = SceneUnit::Radiance { efficacy_lm_per_w: 700.0 };
        assert!(refused(LENS, bright).contains("at most 683"));
    }

    #[test]
    fn units_have_names_and_radiance_a_white_light() {
        let white = SceneUnit::named("radiance", None).unwrap();
        assert_eq!(white, SceneUnit::Radiance { efficacy_lm_per_w: WHITE_EFFICACY_LM_PER_W });
        assert_eq!(SceneUnit::named("luminance", None), Ok(SceneUnit::Luminance));
        let refused = |name, efficacy| SceneUnit::named(name, efficacy).unwrap_err().to_string();
        assert!(refused("nits", None).contains("`nits`, expected luminance"));
        assert!(refused("luminance", Some(270.0)).contains("270 lm/W"));
    }
}
