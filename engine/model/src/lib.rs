//! What an event camera is. Every other crate of EsaacSim takes its parameters, units and
//! equations from here; nothing here knows Vulkan.
//!
//! # The model
//!
//! A camera is fed rendered frames at instants `t_0 < t_1 < ...` (i64 nanoseconds). Each pair of
//! neighbours spans an **interval** `(t_{k-1}, t_k]` of length `T`, and each interval yields one
//! packet.
//!
//! ## 1. Intensity ([`intensity`])
//! Linear RGB times `exposure_gain` becomes one scalar `S` per pixel: `gray` (mean), `luminance`
//! (Rec. 709) or `bayer_rggb` (one colour component per pixel, R at (0,0); always sampled *after* a
//! warp of the RGB image, never from a warped mosaic). A pixel with a NaN, infinite or negative
//! component keeps the value of its previous frame and is counted. A pixel that never had a valid
//! value is **unarmed**: it sends nothing, and its reference starts at its first valid frame.
//!
//! ## 2. Logarithm
//! `L = ln(S + log_offset)`, held as Q7.24 fixed point ([`log_to_q24`]), so that adding and taking
//! away a threshold cancels exactly and a reference never drifts.
//!
//! ## 3. Frame-gap synthesis ([`substeps`])
//! The interval is cut, per block of 8x8 pixels, into `n <= N` equal **sub-steps** that end at
//! `s_i = t_{k-1} + floor(i T / n)`. `S(s_i)` comes from the chosen [`Synthesis`] ([`synthesis`]); `s_0` and `s_n`
//! are always the rendered frames themselves. Between sub-steps `L` is linear in time. A sub-step of
//! no length (an interval of fewer nanoseconds than sub-steps) joins the next one.
//!
//! ## 4. Crossings
//! With reference `R`, an ON event happens at every instant at which `L = R + C_on`, an OFF event
//! where `L = R - C_off`; touching is crossing. `R` moves by exactly one threshold per event. An
//! event lies in `(s_{i-1}, s_i]`: `t = s_{i-1} + ceil(f dt)` with `f` the crossing's fraction of
//! the sub-step ([`Timestamps::Interpolated`]) or `t = s_i` ([`Timestamps::AtSample`]). If a changed
//! parameter leaves `L` beyond a threshold at the start of a sub-step, the event happens 1 ns into
//! it. `C_on`, `C_off` may vary from pixel to pixel: `N(C, contrast_mismatch)`, drawn once,
//! redrawn until inside `[0.1 C, 1.9 C]` ([`random::threshold_log`]).
//!
//! ## 5. Refractory period
//! After an event at `t` the pixel is held until `t + refractory_ns`, across intervals if need be;
//! at that instant `R` becomes the `L` of that instant and the pixel goes on.
//!
//! ## 6. Leak and shot noise
//! *Leak* lowers `R` at `lambda = leak_rate_hz * C_on` (the nominal one) per second, times `exp(N(0,
//! leak_spread_log))` per pixel. The fall since the epoch is `A(t) = floor(lambda (t - epoch))` in
//! fixed point, evaluated in closed form, so that it depends on nothing but `t`.
//!
//! *Shot noise*: each polarity is a Poisson process with hazard `h_p = (R_shot / 2)(1 - 0.75 clamp(S
//! / white_level, 0, 1)) C_p / C_p,pixel` (v2e's fall with intensity), spent against an exponential draw
//! ([`random::exponential_q27`]): rates depend on neither `N` nor the frame rate. Within an interval the
//! hazard is even, the mean of those at the pixel's intensities in its two frames; draw 0 is made when a pixel
//! is armed, and `C_p,pixel / C_p` multiplies the draw. A shot event sets `R` to the `L` of its
//! instant; one that falls into the refractory period is suppressed, its draw spent.
//!
//! What falls on one nanosecond happens in this order: the refractory period ends, crossings, OFF
//! noise, ON noise.
//!
//! ## 7. Latency and quantisation
//! An event at `t` is stamped `t + max(0, latency_ns + jitter)` with jitter of standard deviation
//! `latency_jitter_ns` ([`random::jitter_ns`], truncated at 3.46 sigma), then floored to a multiple
//! of `timestamp_quantum_ns`. The jitter's draw index is the number of events that the pixel has sent
//! before. Events stamped beyond the interval's end wait for the packet that covers them; a packet is
//! therefore complete up to its watermark: `t_k`, or with quantisation the last nanosecond before the
//! quantum that `t_k + 1` lies in, since later events may still be floored into that one. Its times
//! count from `t_{k-1}`, floored likewise.
//!
//! ## 8. Random numbers ([`random`])
//! Philox4x32-10 with key `seed` and counter `(event index, stream, pixel, camera)`.
//!
//! ## 9. APS
//! The mean of `S` (linear between sub-steps) over `[aps_start_ns, aps_start_ns + aps_exposure_ns)`
//! of the interval, cut at its end (no frame if nothing is left), times `aps_gain / white_level`,
//! quantised to `aps_bits`.
//!
//! # Packets
//! [`Packet`]: struct of arrays sorted by `(t, y, x, polarity)`.

pub mod frame;
pub mod intensity;
pub mod layout;
pub mod packet;
pub mod presets;
pub mod random;
pub mod sensor;
pub mod substeps;
pub mod synthesis;

pub use frame::{DepthFormat, FrameError, HdrFormat, MotionFormat};
pub use packet::{Packet, PacketView, Polarity};
pub use presets::{PRESETS, Preset, Profile};
pub use sensor::{
    Intensity, PARAMETERS, Parameter, SensorError, SensorModel, SubstepPolicy, Synthesis, Taps, Timestamps,
};

/// Fractional bits of a log intensity held as fixed point (Q7.24).
pub const LOG_FRACTION_BITS: u32 = 24;

/// Longest interval between two frames, in nanoseconds. A longer one is an error ("gap in time"):
/// nothing is known of what happened meanwhile, and event offsets must fit their u32.
pub const MAX_INTERVAL_NS: i64 = 1_000_000_000;

/// Longest time by which an event may be delayed (latency plus the jitter's bound), nanoseconds.
pub const MAX_LATENCY_NS: i64 = 1_000_000_000;

/// `L` in nepers as Q7.24, rounded to nearest; saturates outside +-128.
#[must_use]
pub fn log_to_q24(log: f64) -> i32 {
    let scaled = (log * f64::from(1_u32 << LOG_FRACTION_BITS)).round();
    scaled.clamp(f64::from(i32::MIN), f64::from(i32::MAX)) as i32
}

/// Q7.24 back to nepers.
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
