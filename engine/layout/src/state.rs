//! A pixel's state, which is kept between intervals.

/// Words of state of a log-intensity pixel; each is a plane of `pixels` words. Another pixel model lists its own.
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
}

/// Number of words of state per pixel.
pub const STATE_WORDS: u32 = 11;

/// Reference of a pixel that has never had a valid colour.
pub const UNARMED: i32 = i32::MIN;

/// Reference of a pixel whose first valid colour is in the current frame.
pub const ARMING: i32 = i32::MIN + 1;
