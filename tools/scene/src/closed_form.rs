//! Event times of the `sinusoid` scene in closed form, by inverting its formula.

use crate::object::Object;
use crate::registry::SceneKind;
use crate::scene::{Scene, seconds};
use crate::texture::CUTOFF_PER_PX;
use esaac_model::SensorModel;
use esaac_model::packet::{Event, Polarity};
use std::f64::consts::TAU;

/// Events of a pixel of the `sinusoid` scene in `(t0_ns, t1_ns]`, as
/// [`exact_events`](crate::exact_events) defines them. `None` for any other scene, and for a sensor with a refractory
/// period.
#[must_use]
pub fn sinusoid_events(
    scene: &Scene,
    sensor: &SensorModel,
    x: u32,
    y: u32,
    t0_ns: i64,
    t1_ns: i64,
) -> Option<Vec<Event>> {
    let (SceneKind::Sinusoid, [card], 0) = (scene.kind, scene.objects.as_slice(), sensor.refractory_ns)
    else {
        return None;
    };
    let curve = Sinusoid::new(scene, sensor, card, x, y);
    let (t0_s, t1_s) = (seconds(t0_ns), seconds(t1_ns));
    let mut events = Vec::new();
    let mut reference = curve.log(t0_s);
    let quarter = |t_s: f64| 2.0 * (curve.turns(t_s) - 0.25);
    let mut half_cycle = quarter(t0_s).min(quarter(t1_s)).floor();
    let last_half_cycle = quarter(t0_s).max(quarter(t1_s)).ceil();
    let mut pieces = Vec::new();
    while half_cycle < last_half_cycle {
        let (a, b) = (curve.time_s(0.5 * half_cycle + 0.25), curve.time_s(0.5 * half_cycle + 0.75));
        pieces.push((a.min(b).max(t0_s), a.max(b).min(t1_s), half_cycle));
        half_cycle += 1.0;
    }
    pieces.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (_, end_s, half_cycle) in pieces {
        let end = curve.log(end_s);
        loop {
            let (level, polarity) = if end >= reference + sensor.contrast_on {
                (reference + sensor.contrast_on, Polarity::On)
            } else if end <= reference - sensor.contrast_off {
                (reference - sensor.contrast_off, Polarity::Off)
            } else {
                break;
            };
            let t_s = curve.time_s(curve.turns_at(level, half_cycle));
            events.push(Event {
                t_ns: t0_ns + ((t_s - t0_s) * 1e9).ceil() as i64,
                y: y as u16,
                x: x as u16,
                polarity,
            });
            reference = level;
        }
    }
    Some(events)
}

/// `L = ln(gain exp(base + amplitude sin(TAU turns)) + offset)`, turns linear in time.
struct Sinusoid {
    turns_at_zero: f64,
    turns_per_s: f64,
    base_log: f64,
    amplitude_log: f64,
    gain: f64,
    offset: f64,
}

impl Sinusoid {
    fn new(scene: &Scene, sensor: &SensorModel, card: &Object, x: u32, y: u32) -> Sinusoid {
        let layer = card.layers[0];
        let wave = layer.waves[0];
        let from_centre_px = glam::DVec3::new(
            f64::from(x) - 0.5 * f64::from(scene.width_px - 1),
            f64::from(y) - 0.5 * f64::from(scene.height_px - 1),
            0.0,
        );
        let relative2 = wave.frequency.length_squared() / (CUTOFF_PER_PX * CUTOFF_PER_PX);
        Sinusoid {
            turns_at_zero: wave.frequency.dot(from_centre_px - card.motion.centre) + wave.phase_turns,
            turns_per_s: -wave.frequency.dot(card.motion.velocity),
            base_log: card.base_log.x,
            amplitude_log: layer.amplitude.x * (1.0 - relative2) * (1.0 - relative2),
            gain: sensor.exposure_gain,
            offset: sensor.log_offset,
        }
    }

    fn turns(&self, t_s: f64) -> f64 {
        self.turns_at_zero + self.turns_per_s * t_s
    }

    fn time_s(&self, turns: f64) -> f64 {
        (turns - self.turns_at_zero) / self.turns_per_s
    }

    fn log(&self, t_s: f64) -> f64 {
        let radiance = (self.base_log + self.amplitude_log * (TAU * self.turns(t_s)).sin()).exp();
        (self.gain * radiance + self.offset).ln()
    }

    /// Phase in turns at which `L` equals `level`, between the extrema at `h / 2 + 1/4` and `h / 2 + 3/4` turns.
    fn turns_at(&self, level: f64, h: f64) -> f64 {
        let sine = (((level.exp() - self.offset) / self.gain).ln() - self.base_log) / self.amplitude_log;
        let principal = sine.clamp(-1.0, 1.0).asin() / TAU;
        let falling = h.rem_euclid(2.0) == 0.0;
        0.5 * (h + 1.0) + if falling { -principal } else { principal }
    }
}
