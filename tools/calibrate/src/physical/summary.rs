//! What a fit compares: rates of an exposure.

use super::exposure::{Exposure, Shape};
use esaac_model::Polarity;
use esaac_model::packet::Event;
use serde::Serialize;

/// Rates of an exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// ON events of a pixel: a second, or a period of the flicker.
    pub on: f64,
    /// OFF events of a pixel, likewise.
    pub off: f64,
    /// Events in all.
    pub events: f64,
    /// Standard deviation of both rates by the choice of pixels and by chance, as a share. Pixels differ in how much noise they
    /// send by more than the square root of their count says.
    pub rate_error: f64,
    /// Spread of the pixels' counts that is the same in both halves of the exposure, as a share of the count: thresholds
    /// that differ.
    pub spread: f64,
    /// Time between two events of a pixel that one in a hundred falls short of, nanoseconds; infinite with less than a
    /// thousand.
    pub short_gap_ns: f64,
    /// Standard deviation of its sampling, as a share.
    pub short_gap_error: f64,
    /// Median time from a step up to a pixel's first ON event, nanoseconds; infinite without steps, or if not even half of the
    /// pixels answer.
    pub rise_ns: f64,
    /// The same from a step down to an OFF event.
    pub fall_ns: f64,
}

impl Summary {
    /// Sums up an exposure.
    #[must_use]
    pub fn of(exposure: &Exposure) -> Self {
        let half_ns = (0.5e9 * exposure.seconds) as i64;
        let mut counts = vec![[0.0_f64; 2]; exposure.pixels];
        let mut last_ns = vec![None; exposure.pixels];
        let mut gaps_ns = Vec::new();
        let mut on_off = [0.0; 2];
        for event in &exposure.events {
            let pixel = usize::from(event.y) * exposure.width_px as usize + usize::from(event.x);
            counts[pixel][usize::from(event.t_ns > half_ns)] += 1.0;
            on_off[usize::from(event.polarity == Polarity::On)] += 1.0;
            if let Some(before_ns) = last_ns[pixel].replace(event.t_ns) {
                gaps_ns.push(event.t_ns - before_ns);
            }
        }
        let units = exposure.flicker.map_or(exposure.seconds, |flicker| exposure.seconds * flicker.hz);
        let [off, on] = on_off.map(|events| events / (units * exposure.pixels as f64));
        let sums: Vec<f64> = counts.iter().map(|c| c[0] + c[1]).collect();
        let rate_error = error_of_mean(&sums);
        let mean = |half: usize| counts.iter().map(|c| c[half]).sum::<f64>() / counts.len() as f64;
        let means = [mean(0), mean(1)];
        let product: f64 = counts.iter().map(|c| (c[0] - means[0]) * (c[1] - means[1])).sum();
        let covariance = product / counts.len() as f64;
        let spread = (covariance / (means[0] * means[1]).max(1e-9)).max(0.0).sqrt();
        gaps_ns.sort_unstable();
        let (short_gap_ns, short_gap_error) = match gaps_ns.len() {
            0..1000 => (f64::INFINITY, 0.0),
            count => {
                // The number of gaps below a time has a deviation of its square root.
                let rank = count / 100;
                let deviation = (rank as f64).sqrt().ceil() as usize;
                let [low, middle, high] =
                    [rank - deviation, rank, rank + deviation].map(|rank| gaps_ns[rank].max(1) as f64);
                (middle, 0.5 * (high / low).ln())
            }
        };
        let [rise_ns, fall_ns] = [Polarity::On, Polarity::Off].map(|polarity| latency_ns(exposure, polarity));
        let events = exposure.events.len() as f64;
        Summary { on, off, events, rate_error, spread, short_gap_ns, short_gap_error, rise_ns, fall_ns }
    }
}

/// Standard deviation of the mean of these counts, as a share of it.
fn error_of_mean(counts: &[f64]) -> f64 {
    let number = counts.len() as f64;
    let mean = counts.iter().sum::<f64>() / number;
    let variance = counts.iter().map(|count| (count - mean).powi(2)).sum::<f64>() / number;
    // Even if all pixels send alike, one event more or less among all of them is chance.
    (variance.max(1.0 / number) / number).sqrt() / mean.max(1.0 / number)
}

/// Median time from steps to the first events of this polarity, nanoseconds.
fn latency_ns(exposure: &Exposure, polarity: Polarity) -> f64 {
    let Some(flicker) = exposure.flicker.filter(|flicker| flicker.shape == Shape::Step) else {
        return f64::INFINITY;
    };
    let half_ns = 0.5e9 / flicker.hz;
    let halves = (2.0 * exposure.seconds * flicker.hz).round() as usize;
    // The answers of the pixels that gave one: events are in time order, so the first of a half is the answer.
    let mut answers_ns = Vec::new();
    let mut answered = vec![0; exposure.pixels];
    let pixel = |event: &Event| usize::from(event.y) * exposure.width_px as usize + usize::from(event.x);
    for event in exposure.events.iter().filter(|event| event.polarity == polarity) {
        let half = (event.t_ns as f64 / half_ns) as usize;
        // The light is up in odd halves. It has always been down before the first one.
        if half > 0
            && half < halves
            && (half % 2 == 1) == (polarity == Polarity::On)
            && std::mem::replace(&mut answered[pixel(event)], half) != half
        {
            answers_ns.push(event.t_ns as f64 - half as f64 * half_ns);
        }
    }
    // ON answers odd halves, OFF even ones from the second on. Who does not answer takes forever.
    let asked = if polarity == Polarity::On { halves / 2 } else { halves.saturating_sub(1) / 2 };
    answers_ns.sort_unstable_by(f64::total_cmp);
    answers_ns.get(exposure.pixels.saturating_mul(asked) / 2).copied().unwrap_or(f64::INFINITY)
}

#[cfg(test)]
mod tests {
    use super::super::exposure::Flicker;
    use super::*;

    /// Steps before three pixels that send ON events at these times: pixel and nanoseconds.
    fn rise_ns(hz: f64, seconds: f64, events: &[(u16, i64)]) -> f64 {
        let event = |&(x, t_ns): &(u16, i64)| Event { t_ns, x, y: 0, polarity: Polarity::On };
        let flicker = Some(Flicker { hz, depth: 0.5, shape: Shape::Step });
        let events = events.iter().map(event).collect();
        let name = String::new();
        Summary::of(&Exposure { name, lux: 1.0, flicker, pixels: 3, width_px: 3, seconds, events }).rise_ns
    }

    #[test]
    fn latencies_are_of_the_first_answers_and_who_does_not_answer_takes_forever() {
        const UP_NS: i64 = 500_000_000;
        let first = [(0, 7), (0, UP_NS + 10), (1, UP_NS + 20), (1, UP_NS + 25), (2, UP_NS + 30)];
        assert_eq!(rise_ns(1.0, 1.0, &first), 20.0);
        let again = 1_000_000_000 + UP_NS;
        let both = [&first[..], &[(0, again + 40), (0, again + 50)]].concat();
        assert_eq!(rise_ns(1.0, 2.0, &both), 40.0, "the fourth of six");
        assert_eq!(rise_ns(1.0, 2.0, &first), f64::INFINITY, "three of six");
    }

    #[test]
    fn the_most_steps_that_a_list_may_have_take_no_memory() {
        assert_eq!(rise_ns(1e5, 1e6, &[(0, 5_010)]), f64::INFINITY);
    }
}
