//! A pixel's state, which is kept between intervals. Each pixel model has a list of words, each a plane of `pixels` words.
//! `ingest` and the event sink know no model: reference, thresholds and events have the same place in each list.

/// Words of state of a log-intensity pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum StateWord {
    /// Reference, Q7.24; `i32::MIN` while unarmed.
    Reference = 0,
    /// ON threshold, Q7.24.
    ContrastOn = 1,
    /// OFF threshold, Q7.24.
    ContrastOff = 2,
    /// Leak, Q24 of a neper per nanosecond, times 2^32.
    Leak = 3,
    /// End of the refractory period, absolute nanoseconds, low word.
    HeldLow = 4,
    /// High word of the end of the refractory period; both words together are `i64::MIN` if the pixel is not held.
    HeldHigh = 5,
    /// Hazard left to the next OFF shot event, Q5.27.
    ShotOffHazard = 6,
    /// Hazard left to the next ON shot event, Q5.27.
    ShotOnHazard = 7,
    /// Number of OFF shot draws so far.
    ShotOffDraws = 8,
    /// Number of ON shot draws so far.
    ShotOnDraws = 9,
    /// Number of events emitted so far.
    Events = 10,
    /// Until when the pixel rests, and since when: see `resting.glsl`. Of no use unless pixels rest.
    Rest = 11,
}

/// Words of state of a physical pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum PhysicalWord {
    /// Reference, Q7.24; `i32::MIN` while unarmed.
    Reference = 0,
    /// ON threshold, Q7.24.
    ContrastOn = 1,
    /// OFF threshold, Q7.24.
    ContrastOff = 2,
    /// Logarithms of the factors of dark current and leak, see [`SensorModel::pixel_factors`].
    ///
    /// [`SensorModel::pixel_factors`]: esaac_model::SensorModel::pixel_factors
    Factors = 3,
    /// Excess of the photoreceptor's first stage, f32.
    Excess = 4,
    /// Lag of its second stage, nepers, f32.
    Lag = 5,
    /// Noise at the last release or, while the pixel is held, at its event; nepers, f32.
    Noise = 6,
    /// Phase of the first stage since then, f32.
    Phase = 7,
    /// Time from the interval's end to the release of a held pixel; of another, minus the time since its release.
    /// Nanoseconds.
    Release = 8,
    /// Hazard left to a noise event, Q5.27. While the pixel is held: slope of the noise at its event, f32.
    Clock = 9,
    /// Number of events emitted so far.
    Events = 10,
    /// Fraction of the reference below Q7.24, in units of 2^-32.
    Fraction = 11,
}

/// Number of words of state per pixel: those of the longest list, so that a camera can change its pixel.
pub const STATE_WORDS: u32 = 12;

/// Reference of a pixel that has never had a valid colour.
pub const UNARMED: i32 = i32::MIN;

/// Reference of a pixel whose first valid colour is in the current frame.
pub const ARMING: i32 = i32::MIN + 1;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_every_pixel_has_is_in_the_same_place() {
        assert_eq!(StateWord::Reference as u32, PhysicalWord::Reference as u32);
        assert_eq!(StateWord::ContrastOn as u32, PhysicalWord::ContrastOn as u32);
        assert_eq!(StateWord::ContrastOff as u32, PhysicalWord::ContrastOff as u32);
        assert_eq!(StateWord::Leak as u32, PhysicalWord::Factors as u32, "drawn once, and written together");
        assert_eq!(StateWord::Events as u32, PhysicalWord::Events as u32);
        assert!((StateWord::Rest as u32) < STATE_WORDS && (PhysicalWord::Fraction as u32) < STATE_WORDS);
    }
}
