//! Shot noise of one pixel and polarity: a Poisson process simulated by next-event times. An exponential draw gives the
//! hazard to accumulate until the next event. The hazard rate depends on the light.

use super::PixelConstants;
use esaac_model::random::{PixelKey, Stream, draw, exponential};
use esaac_model::{Polarity, SHOT_NOISE_FALL, SensorModel};

/// Hazard left until the next event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShotClock {
    /// Hazard to accumulate from the current sub-step's start to the next event. The factor of the pixel's threshold is
    /// in this draw, not in the rate.
    pub left: f64,
    /// Index of the next draw.
    pub next_draw: u32,
}

impl ShotClock {
    /// The clock of a pixel that is being armed. Makes draw 0.
    #[must_use]
    pub fn start(
        sensor: &SensorModel,
        constants: &PixelConstants,
        key: PixelKey,
        polarity: Polarity,
    ) -> Self {
        let mut clock = ShotClock { left: 0.0, next_draw: 0 };
        clock.redraw(sensor, constants, key, polarity);
        clock
    }

    /// Draws the wait from this event to the next and adds it.
    pub fn redraw(
        &mut self,
        sensor: &SensorModel,
        constants: &PixelConstants,
        key: PixelKey,
        polarity: Polarity,
    ) {
        let (stream, nominal) = match polarity {
            Polarity::Off => (Stream::ShotOff, sensor.contrast_off),
            Polarity::On => (Stream::ShotOn, sensor.contrast_on),
        };
        let word = draw(key, stream, self.next_draw)[0];
        // A pixel's threshold divides its hazard. Multiplying the wait instead is equivalent, and is done once per
        // event.
        self.left += exponential(word) * constants.threshold_log[polarity as usize] / nominal;
        self.next_draw = self.next_draw.wrapping_add(1);
    }

    /// Time of the next event, nanoseconds from the sub-step's start, if it lies in the sub-step.
    #[must_use]
    pub fn next_ns(&self, hazard_per_ns: f64, duration_ns: i64) -> Option<i64> {
        let falls_due = hazard_per_ns > 0.0 && self.left <= hazard_per_ns * duration_ns as f64;
        falls_due.then(|| ((self.left / hazard_per_ns).ceil() as i64).clamp(1, duration_ns))
    }

    /// Subtracts the hazard of a whole sub-step.
    pub fn advance(&mut self, hazard: f64) {
        self.left -= hazard;
    }
}

/// Mean hazard of one polarity over an interval from intensity `from` to `to`, per nanosecond, without the factor of
/// the pixel's threshold.
#[must_use]
pub fn mean_hazard_per_ns(sensor: &SensorModel, from: f64, to: f64) -> f64 {
    let hazard_hz = |intensity: f64| {
        let of_white = (intensity / sensor.white_level).clamp(0.0, 1.0);
        0.5 * sensor.shot_noise_rate_hz * (1.0 - SHOT_NOISE_FALL * of_white)
    };
    0.5 * (hazard_hz(from) + hazard_hz(to)) * 1e-9
}
