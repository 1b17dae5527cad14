//! Turns radiance, depth and event counts into colours.

/// Eight bits each of red, green, blue.
pub type Rgb = [u8; 3];

/// Colour of an ON event.
pub const ON: Rgb = [0xd7, 0x2f, 0x3c];
/// Colour of an OFF event.
pub const OFF: Rgb = [0x1f, 0x5f, 0xc4];
/// Colour of no event.
pub const NO_EVENT: Rgb = [0xff, 0xff, 0xff];

/// Linear to sRGB, 8 bits.
#[must_use]
pub fn encode_srgb(linear: f32) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let encoded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

/// Rec. 709 luminance.
#[must_use]
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// The exposure that maps the geometric mean of `luminances` to middle gray.
#[must_use]
pub fn exposure(luminances: impl Iterator<Item = f32>) -> f32 {
    const MIDDLE_GRAY: f32 = 0.18;
    let (mut sum, mut count) = (0.0_f64, 0_u64);
    for luminance in luminances.filter(|l| l.is_finite() && *l > 0.0) {
        sum += f64::from(luminance).ln();
        count += 1;
    }
    if count == 0 { 1.0 } else { MIDDLE_GRAY / (sum / count as f64).exp() as f32 }
}

/// Tone-maps a colour with the extended Reinhard operator on its luminance. Luminances above `WHITE`, in
/// units of the exposure, are white. The hue is kept; colours outside the gamut move towards white.
#[must_use]
pub fn tone_map(radiance: [f32; 3], exposure: f32) -> Rgb {
    const WHITE: f32 = 6.0;
    let [r, g, b] = radiance.map(|v| if v.is_finite() { v.max(0.0) * exposure } else { 0.0 });
    let luminance = luminance([r, g, b]);
    if luminance <= 0.0 {
        return [0; 3];
    }
    let mapped = (luminance * (1.0 + luminance / (WHITE * WHITE)) / (1.0 + luminance)).min(1.0);
    let scaled = [r, g, b].map(|v| v * mapped / luminance);
    let peak = scaled.iter().copied().fold(0.0, f32::max);
    let towards_white = if peak > 1.0 { (peak - 1.0) / (peak - mapped).max(1e-6) } else { 0.0 };
    scaled.map(|v| encode_srgb(v + (mapped - v) * towards_white))
}

/// Colour of a pixel with `on` and `off` events: white without, deeper with each.
#[must_use]
pub fn events(on: u32, off: u32) -> Rgb {
    let total = on + off;
    if total == 0 {
        return NO_EVENT;
    }
    let depth = 1.0 - 0.45_f32.powi(i32::try_from(total).unwrap_or(i32::MAX));
    let share_on = on as f32 / total as f32;
    std::array::from_fn(|c| {
        let event = f32::from(ON[c]) * share_on + f32::from(OFF[c]) * (1.0 - share_on);
        (f32::from(NO_EVENT[c]) + (event - f32::from(NO_EVENT[c])) * depth).round() as u8
    })
}

/// Colour map for depth, from 0 (near) to 1 (far): lightness falls evenly from pale yellow to black-violet.
#[must_use]
pub fn depth(near_to_far: f32) -> Rgb {
    const STOPS: [Rgb; 11] = [
        [0xfc, 0xfd, 0xbf],
        [0xfe, 0xcf, 0x92],
        [0xfe, 0x9f, 0x6d],
        [0xf7, 0x70, 0x5c],
        [0xde, 0x49, 0x68],
        [0xb7, 0x37, 0x79],
        [0x8c, 0x29, 0x81],
        [0x64, 0x1a, 0x80],
        [0x3b, 0x0f, 0x70],
        [0x14, 0x0e, 0x36],
        [0x00, 0x00, 0x04],
    ];
    let position = near_to_far.clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
    let index = (position as usize).min(STOPS.len() - 2);
    mix(STOPS[index], STOPS[index + 1], position - index as f32)
}

/// Mixes `from` and `to`; `amount` is the share of `to`, 0 to 1.
#[must_use]
pub fn mix(from: Rgb, to: Rgb, amount: f32) -> Rgb {
    std::array::from_fn(|c| {
        (f32::from(from[c]) + (f32::from(to[c]) - f32::from(from[c])) * amount).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tone_map_keeps_order_and_survives_anything() {
        let gray = |v: f32| tone_map([v; 3], 1.0)[1];
        assert!(gray(0.01) < gray(0.1) && gray(0.1) < gray(1.0) && gray(1.0) < gray(10.0));
        assert_eq!(gray(1e9), 255);
        assert_eq!(tone_map([f32::NAN, -1.0, f32::INFINITY], 1.0), [0; 3]);
        let hot = tone_map([1e5, 1.0, 1.0], 1.0);
        assert!(hot[0] == 255 && hot[1] <= hot[0], "{hot:?}");
    }

    #[test]
    fn exposure_puts_the_mean_at_middle_gray() {
        assert!((exposure([1.0, 100.0].into_iter()) - 0.018).abs() < 1e-6);
        assert_eq!(exposure([0.0, f32::NAN].into_iter()), 1.0);
    }

    #[test]
    fn more_events_are_deeper_and_polarity_shows() {
        assert_eq!(events(0, 0), NO_EVENT);
        assert!(events(1, 0)[0] > events(1, 0)[2], "ON is red");
        assert!(events(0, 1)[2] > events(0, 1)[0], "OFF is blue");
        assert!(events(3, 0)[1] < events(1, 0)[1]);
    }
}
