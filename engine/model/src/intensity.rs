//! From linear RGB to the scalar intensity of a pixel (paper, section "Log-Intensity Event Model").

use crate::Intensity;

/// Rec. 709 luminance weights of linear R, G, B.
pub const REC709: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Weights of linear R, G, B as a photodiode of front-illuminated silicon sees them, which loses blue light in its wiring.
/// Integrated over the spectra that PECS renders R, G and B by. `lux_per_unit` stays that of luminance, so a grey scene
/// keeps its light.
pub const SILICON_FRONT: [f64; 3] = [0.415, 0.292, 0.293];

/// As [`SILICON_FRONT`] for back-illuminated silicon: an even response has (.40, .24, .36); times a quantum efficiency of
/// .75 (red), .90 (green), .78 (blue), which is assumed.
pub const SILICON_BACK: [f64; 3] = [0.376, 0.271, 0.353];

/// [`SILICON_FRONT`] without an infrared cut filter. RGB says nothing of the near infrared; assumed is that a scene has as
/// much of it from 700 to 1000 nm as it has red light, seen with a mean quantum efficiency of .20 against .45 in the
/// visible.
pub const SILICON_FRONT_IR: [f64; 3] = [0.594, 0.203, 0.203];

/// As [`SILICON_FRONT_IR`] for back-illuminated silicon: .30 against .80.
pub const SILICON_BACK_IR: [f64; 3] = [0.546, 0.197, 0.257];

/// Weights of linear R, G, B in the intensity of pixel `(x, y)`. They sum to 1.
#[must_use]
pub fn weights(intensity: Intensity, x: u32, y: u32) -> [f64; 3] {
    match intensity {
        Intensity::Gray => [1.0 / 3.0; 3],
        Intensity::Luminance => REC709,
        Intensity::SiliconFront => SILICON_FRONT,
        Intensity::SiliconBack => SILICON_BACK,
        Intensity::SiliconFrontIr => SILICON_FRONT_IR,
        Intensity::SiliconBackIr => SILICON_BACK_IR,
        Intensity::BayerRggb => {
            let mut one_component = [0.0; 3];
            one_component[bayer_component(x, y)] = 1.0;
            one_component
        }
    }
}

/// Colour component (0 R, 1 G, 2 B) of pixel `(x, y)` of an RGGB mosaic with R at (0, 0).
#[must_use]
pub fn bayer_component(x: u32, y: u32) -> usize {
    ((x & 1) + (y & 1)) as usize
}

/// Decodes an sRGB byte to linear, 0 to 1 (IEC 61966-2-1).
#[must_use]
pub fn srgb_to_linear(byte: u8) -> f64 {
    let encoded = f64::from(byte) / 255.0;
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mosaic_is_rggb() {
        assert_eq!([(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| bayer_component(x, y)), [0, 1, 1, 2]);
    }

    #[test]
    fn weights_of_every_mode_sum_to_one() {
        for mode in Intensity::ALL {
            let sum: f64 = weights(mode, 1, 0).iter().sum();
            assert!((sum - 1.0).abs() < 1e-12, "{mode:?}: {sum}");
        }
    }

    #[test]
    fn srgb_endpoints() {
        assert_eq!(srgb_to_linear(0), 0.0);
        assert!((srgb_to_linear(255) - 1.0).abs() < 1e-12);
        assert!((srgb_to_linear(188) - 0.5029).abs() < 1e-4);
    }
}
