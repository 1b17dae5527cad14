//! The model of an event camera: its parameters, units and equations. Every other crate of EsaacSim takes them
//! from here. This crate does not depend on Vulkan.
//!
//! # The model
//!
//! A camera receives rendered frames at instants `t_0 < t_1 < ...` (i64 nanoseconds). Two neighbouring frames span
//! an **interval** `(t_{k-1}, t_k]` of length `T`. Each interval yields one packet.
//!
//! ## 1. Intensity ([`intensity`])
//! Linear RGB times `exposure_gain` becomes one scalar `S` per pixel: `gray` (mean), `luminance`
//! (Rec. 709), `silicon_front` and its kin (what a bare photodiode sees) or `bayer_rggb` (one colour component per pixel, R
//! at (0,0)). Before that, a lens may blur and darken the image ([`optics`]). A mosaic is sampled *after* the RGB
//! image is warped: warping a mosaic would mix the colours. A pixel with a NaN, infinite or negative component, or
//! whose components times the gain add up to more than an f32 holds, keeps
//! the value of its previous frame and is counted. A pixel that never had a valid value is **unarmed**: it emits
//! nothing, and its reference starts at its first valid frame.
//!
//! ## 2. Logarithm
//! `L = ln(S + log_offset)`, with a lamp's flicker `L = ln(S (1 + M sin(2 pi f t)) + log_offset)` ([`optics`]), held as Q7.24 fixed point ([`log_to_q24`]). In fixed point, adding a threshold and
//! subtracting it again cancels exactly, so that a reference never drifts.
//!
//! ## 3. Frame-gap synthesis ([`substeps`])
//! Each block of 8x8 pixels cuts the interval into `n <= N` equal **sub-steps** that end at
//! `s_i = t_{k-1} + floor(i T / n)`. The chosen [`Synthesis`] gives `S(s_i)` ([`synthesis`]). At `s_0` and `s_n` it
//! is that of the rendered frames themselves. Within a sub-step `L` is linear in time. An interval of fewer nanoseconds
//! than sub-steps has sub-steps of length zero; each is merged with the next one.
//!
//! ## 4. Crossings
//! With reference `R`, an ON event happens at every instant at which `L = R + C_on`, an OFF event at every instant at
//! which `L = R - C_off`. Touching a threshold counts as crossing it. `R` moves by exactly one threshold per event. An
//! event lies in `(s_{i-1}, s_i]`: `t = s_{i-1} + ceil(f dt)`, where `dt` is the length of the sub-step and `f` the
//! crossing's fraction of it ([`Timestamps::Interpolated`]), or `t = s_i` ([`Timestamps::AtSample`]). If a changed
//! parameter leaves `L` at or beyond a threshold at the start of a sub-step, the event happens 1 ns after that start
//! (with [`Timestamps::AtSample`] at `s_i`, if `L` still is there). `C_on` and `C_off` may vary from pixel to pixel: they
//! are drawn once from `N(C, contrast_mismatch)`, and drawn again until they lie in `[0.1 C, 1.9 C]`
//! ([`random::threshold_log`]).
//!
//! ## 5. Refractory period
//! After an event at `t` the pixel is held until `t + refractory_ns`, which may lie in a later interval. At that
//! instant `R` is set to the current `L`, and the pixel emits again.
//!
//! ## 6. Leak and shot noise
//! *Leak* lowers `R` by `lambda = leak_rate_hz * C_on * exp(N(0, leak_spread_log))` per second, with the nominal `C_on`
//! and one normal draw per pixel, but by no more than [`random::MOST_LEAK_LOG_PER_S`]. The epoch is the time of the
//! camera's first frame. The fall since then is `A(t) = floor(lambda (t - epoch))` in fixed point. It is computed in
//! closed form, so that it depends on `t` alone. A pixel is armed as if it had looked at still light for long: its
//! reference has leaked a part of the way to the ON threshold already, which is uniform or, among shots, what the time
//! since the last shot makes it ([`random::leak_phase_among_shots`]).
//!
//! *Shot noise*: each polarity `p` is a Poisson process with hazard `h_p = (R_shot / 2)(1 - 0.75 clamp(S / white_level,
//! 0, 1)) C_p / C_p,pixel`, where `R_shot` is `shot_noise_rate_hz`, `C_p` the nominal threshold and `C_p,pixel` the
//! pixel's own. The fall with intensity is v2e's. An event happens when the accumulated hazard reaches an exponential
//! draw ([`random::exponential_q27`]). Rates therefore depend on neither `N` nor the frame rate. The hazard is constant
//! within an interval: the mean of its values at the pixel's intensities in the two frames. The pixel's factor is
//! applied to the draw, as its inverse `C_p,pixel / C_p`. Draw 0 is made when a pixel is armed. A shot event sets `R`
//! to the current `L`. A shot event within the refractory period is suppressed, and the next draw follows.
//!
//! Within one nanosecond the order is: the refractory period ends, crossings, OFF noise, ON noise.
//!
//! ## 7. Latency and quantisation
//! An event at `t` is stamped `t + max(0, latency_ns + jitter)`, floored to a multiple of `timestamp_quantum_ns`. The
//! jitter has the standard deviation `latency_jitter_ns` and is truncated at 3.46 sigma ([`random::jitter_ns`]). Its
//! draw index is the number of events that the pixel has emitted before.
//!
//! An event stamped beyond the interval's end is deferred to the packet that covers its stamp. A packet is therefore
//! complete up to its watermark. Without quantisation that is `t_k`. With quantisation it is the last nanosecond before
//! the quantum that contains `t_k + 1`, because later events may still be floored into that quantum. A packet's times
//! count from `t_{k-1}`, floored to a quantum.
//!
//! The quantum may become coarser between two packets. A watermark never goes back, and no event is stamped at or before
//! the last watermark: where flooring leads there, the stamp is the nanosecond after it. A reset keeps the last watermark; a
//! first frame before it begins a new clock, which forgets it.
//!
//! ## 8. Random numbers ([`random`])
//! Philox4x32-10 with key `seed` and counter `(event index, stream, pixel, camera)`.
//!
//! ## 9. APS
//! The mean of `S` over `[aps_start_ns, aps_start_ns + aps_exposure_ns)` of the interval, times `aps_gain /
//! white_level`, quantised to `aps_bits`. Here `S` is linear within a sub-step. The exposure ends with the interval at
//! the latest; if nothing of it is left, there is no frame.
//!
//! ## 10. The physical pixel ([`physical`])
//! Another pixel in place of sections 4 to 6, with its own equations.
//!
//! # Paths ([`paths`])
//! Where a surface point is at any time, from the depth and instance of each pixel and the poses of camera and bodies.
//!
//! # Packets
//! [`Packet`]: struct of arrays sorted by `(t, y, x, polarity)`.

mod change;
pub mod evt3;
pub mod frame;
pub mod input;
pub mod intensity;
pub mod optics;
pub mod packet;
pub mod paths;
pub mod physical;
mod pixel_draws;
pub mod presets;
mod quantile;
pub mod random;
pub mod sensor;
pub mod substeps;
pub mod synthesis;

pub use change::ChangeEffects;
pub use frame::{DepthFormat, FrameError, HdrFormat, IdFormat, MotionFormat};
pub use packet::{Packet, PacketView, Polarity};
pub use physical::ReadoutKind;
pub use pixel_draws::{FACTOR_UNITS, PixelDraws};
pub use presets::{PRESETS, Preset, Profile};
pub use sensor::{
    CUSTOM, Intensity, PARAMETERS, Parameter, Pixel, SensorError, SensorModel, SubstepPolicy, Synthesis,
    Taps, Timestamps,
};

/// Fractional bits of a log intensity held as fixed point (Q7.24).
pub const LOG_FRACTION_BITS: u32 = 24;

/// Fractional bits of a vote in a voxel grid. Votes are integers, so that their sum does not depend on their order.
pub const VOTE_FRACTION_BITS: u32 = 14;

/// Share of the shot-noise rate in the dark by which the rate has fallen at the white level (v2e).
pub const SHOT_NOISE_FALL: f64 = 0.75;

/// Longest interval between two frames, nanoseconds. A longer gap is an error: two frames say too little about so long
/// a time, and the time offsets of events must fit into u32.
pub const MAX_INTERVAL_NS: i64 = 1_000_000_000;

/// Longest delay of an event: latency plus the bound of the jitter, nanoseconds.
pub const MAX_LATENCY_NS: i64 = 1_000_000_000;

/// Converts a log intensity in nepers to Q7.24, rounded to nearest. Saturates outside +-128.
#[must_use]
pub fn log_to_q24(log: f64) -> i32 {
    let scaled = (log * f64::from(1_u32 << LOG_FRACTION_BITS)).round();
    scaled.clamp(f64::from(i32::MIN), f64::from(i32::MAX)) as i32
}

/// Converts Q7.24 to nepers.
#[must_use]
pub fn q24_to_log(q24: i32) -> f64 {
    f64::from(q24) / f64::from(1_u32 << LOG_FRACTION_BITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fixed_point_log_round_trips_within_half_a_unit() {
        for log in [-13.8, -0.01, 0.0, 0.2, 11.5, 100.0] {
            let error = (q24_to_log(log_to_q24(log)) - log).abs();
            assert!(error <= 0.5 / f64::from(1 << LOG_FRACTION_BITS) + 1e-12, "{log}: {error}");
        }
        assert_eq!(log_to_q24(1e9), i32::MAX);
    }
}
