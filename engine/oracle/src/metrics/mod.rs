//! How far one stream of events is from another. Streams are compared pixel by pixel, and matches are made within one
//! polarity, so that an event never matches one of another pixel or polarity.

pub mod matching;
pub mod victor_purpura;

use esaac_model::Polarity;
use esaac_model::packet::Event;
use matching::matched_errors_ns;
use victor_purpura::distance;

/// Largest time between two matching events of one pixel and polarity, nanoseconds.
pub const MATCH_WINDOW_NS: i64 = 1_000_000;

/// Time shift that costs as much as adding or deleting an event, nanoseconds.
pub const SHIFT_NS: f64 = 1e6;

/// Distribution of time errors, microseconds. All zero without errors to count.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimeError {
    /// Mean of the magnitudes.
    pub mean_us: f64,
    /// Half of them are at most this.
    pub p50_us: f64,
    /// 99% of them are at most this.
    pub p99_us: f64,
    /// The largest.
    pub max_us: f64,
}

/// Result of comparing a tested stream with the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Comparison {
    /// ON and OFF events of the truth.
    pub truth_on_off: (u64, u64),
    /// ON and OFF events of the tested stream.
    pub tested_on_off: (u64, u64),
    /// Events of the tested stream per event of the truth; 1 if both are empty.
    pub count_ratio: f64,
    /// Harmonic mean of precision and recall of the matches within [`MATCH_WINDOW_NS`]; 1 if both are
    /// empty.
    pub f1: f64,
    /// Victor-Purpura distance per event of the truth (of the tested stream, if that is empty).
    pub victor_purpura: f64,
    /// Share of (pixel, polarity) channels with the same number of events.
    pub exact_channels: f64,
    /// Share of pixels with the same sequence of polarities.
    pub same_sequence: f64,
    /// Time between matched events.
    pub matched: TimeError,
    /// Time between events of the same index, in pixels with the same sequence of polarities.
    pub ranked: TimeError,
}

/// Compares two streams of a sensor of `width_px` by `height_px`. The events of each pixel must be in time order.
///
/// # Panics
/// If an event lies outside the sensor.
#[must_use]
pub fn compare(
    (width_px, height_px): (u32, u32),
    truth: impl IntoIterator<Item = Event>,
    tested: impl IntoIterator<Item = Event>,
) -> Comparison {
    let truth = by_pixel(width_px, height_px, truth);
    let tested = by_pixel(width_px, height_px, tested);
    let mut result =
        Comparison { truth_on_off: on_off(&truth), tested_on_off: on_off(&tested), ..Comparison::default() };
    let mut matched_ns = Vec::new();
    let mut ranked_ns = Vec::new();
    let mut total_distance = 0.0;
    let (mut exact_channels, mut same_sequences) = (0_usize, 0_usize);
    for (a, b) in truth.iter().zip(&tested) {
        for polarity in [Polarity::Off, Polarity::On] {
            let (a, b) = (times(a, polarity), times(b, polarity));
            exact_channels += usize::from(a.len() == b.len());
            total_distance += distance(&a, &b, SHIFT_NS);
            matched_ns.extend(matched_errors_ns(&a, &b, MATCH_WINDOW_NS));
        }
        if a.iter().map(|e| e.1).eq(b.iter().map(|e| e.1)) {
            same_sequences += 1;
            ranked_ns.extend(a.iter().zip(b).map(|(a, b)| a.0.abs_diff(b.0)));
        }
    }
    let count = |(on, off): (u64, u64)| (on + off) as f64;
    let (truth_count, tested_count) = (count(result.truth_on_off), count(result.tested_on_off));
    let share = |part: usize, of: usize| if of == 0 { 1.0 } else { part as f64 / of as f64 };
    let ratio = |part: f64, of: f64| if of == 0.0 && part == 0.0 { 1.0 } else { part / of };
    result.count_ratio = ratio(tested_count, truth_count);
    result.f1 = ratio(2.0 * matched_ns.len() as f64, truth_count + tested_count);
    let events = if truth_count > 0.0 { truth_count } else { tested_count.max(1.0) };
    result.victor_purpura = total_distance / events;
    result.exact_channels = share(exact_channels, 2 * truth.len());
    result.same_sequence = share(same_sequences, truth.len());
    result.matched = spread(matched_ns);
    result.ranked = spread(ranked_ns);
    result
}

type PixelEvents = Vec<(i64, Polarity)>;

fn by_pixel(width_px: u32, height_px: u32, events: impl IntoIterator<Item = Event>) -> Vec<PixelEvents> {
    let mut pixels = vec![Vec::new(); width_px as usize * height_px as usize];
    for event in events {
        assert!(u32::from(event.x) < width_px, "event at x = {} of a {width_px} px row", event.x);
        pixels[usize::from(event.y) * width_px as usize + usize::from(event.x)]
            .push((event.t_ns, event.polarity));
    }
    pixels
}

fn times(events: &PixelEvents, polarity: Polarity) -> Vec<i64> {
    events.iter().filter(|e| e.1 == polarity).map(|e| e.0).collect()
}

fn on_off(pixels: &[PixelEvents]) -> (u64, u64) {
    let count = |polarity| pixels.iter().flatten().filter(|e| e.1 == polarity).count() as u64;
    (count(Polarity::On), count(Polarity::Off))
}

fn spread(mut errors_ns: Vec<u64>) -> TimeError {
    errors_ns.sort_unstable();
    let Some(&max_ns) = errors_ns.last() else { return TimeError::default() };
    // Nearest rank: the smallest error that the given share does not exceed.
    let rank = |percent: usize| errors_ns[(errors_ns.len() * percent).div_ceil(100) - 1] as f64 * 1e-3;
    let sum_ns: f64 = errors_ns.iter().map(|&e| e as f64).sum();
    TimeError {
        mean_us: sum_ns / errors_ns.len() as f64 * 1e-3,
        p50_us: rank(50),
        p99_us: rank(99),
        max_us: max_ns as f64 * 1e-3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (3, 2);

    fn event(t_us: i64, x: u16, y: u16, polarity: Polarity) -> Event {
        Event { t_ns: t_us * 1000, y, x, polarity }
    }

    /// Ten events, alternating, at each of two pixels.
    fn stream() -> Vec<Event> {
        (0..10)
            .flat_map(|i| {
                let polarity = if i % 2 == 0 { Polarity::On } else { Polarity::Off };
                [event(5000 * i, 0, 0, polarity), event(5000 * i + 100, 2, 1, polarity)]
            })
            .collect()
    }

    #[test]
    fn a_stream_equals_itself() {
        let same = compare(SIZE, stream(), stream());
        assert_eq!((same.count_ratio, same.f1, same.victor_purpura), (1.0, 1.0, 0.0));
        assert_eq!((same.exact_channels, same.same_sequence), (1.0, 1.0));
        assert_eq!((same.truth_on_off, same.tested_on_off), ((10, 10), (10, 10)));
        assert_eq!((same.matched, same.ranked), (TimeError::default(), TimeError::default()));
        let nothing = compare(SIZE, [], []);
        assert_eq!((nothing.count_ratio, nothing.f1, nothing.victor_purpura), (1.0, 1.0, 0.0));
    }

    #[test]
    fn swapped_polarities_are_found() {
        let swapped = stream().into_iter().map(|e| Event {
            polarity: if e.polarity == Polarity::On { Polarity::Off } else { Polarity::On },
            ..e
        });
        let bad = compare(SIZE, stream(), swapped);
        assert_eq!((bad.count_ratio, bad.f1), (1.0, 0.0));
        assert_eq!(bad.victor_purpura, 2.0);
        assert_eq!(bad.exact_channels, 1.0, "ten of each: a count alone cannot see it");
        assert_eq!(bad.same_sequence, 4.0 / 6.0);
    }

    #[test]
    fn events_at_the_neighbour_pixel_are_found() {
        let moved = stream().into_iter().map(|e| Event { x: (e.x + 1) % 3, ..e });
        let bad = compare(SIZE, stream(), moved);
        assert_eq!((bad.f1, bad.victor_purpura), (0.0, 2.0));
        assert_eq!(bad.exact_channels, 4.0 / 12.0);
        assert_eq!(bad.same_sequence, 2.0 / 6.0);
    }

    #[test]
    fn missing_and_doubled_events_are_found() {
        let half: Vec<Event> = stream().into_iter().filter(|e| e.x == 0).collect();
        let bad = compare(SIZE, stream(), half.clone());
        assert_eq!((bad.count_ratio, bad.victor_purpura), (0.5, 0.5));
        assert!((bad.f1 - 2.0 / 3.0).abs() < 1e-12);
        assert_eq!(bad.exact_channels, 10.0 / 12.0);
        let bad = compare(SIZE, half, stream());
        assert_eq!((bad.count_ratio, bad.victor_purpura), (2.0, 1.0));
        let doubled = stream().into_iter().flat_map(|e| [e, e]);
        let bad = compare(SIZE, stream(), doubled);
        assert_eq!((bad.count_ratio, bad.victor_purpura, bad.same_sequence), (2.0, 1.0, 4.0 / 6.0));
    }

    #[test]
    fn shifts_are_measured_and_beyond_the_window_unmatched() {
        let shifted = |us: i64| stream().into_iter().map(move |e| Event { t_ns: e.t_ns + us * 1000, ..e });
        let late = compare(SIZE, stream(), shifted(400));
        assert_eq!((late.f1, late.same_sequence), (1.0, 1.0));
        assert!((late.victor_purpura - 0.4).abs() < 1e-12);
        assert_eq!([late.matched.mean_us, late.matched.p50_us, late.matched.max_us], [400.0; 3]);
        let later = compare(SIZE, stream(), shifted(1500));
        assert_eq!((later.f1, later.matched), (0.0, TimeError::default()));
        assert_eq!(later.ranked.max_us, 1500.0, "the window hides nothing from the ranks");
        assert!((later.victor_purpura - 1.5).abs() < 1e-12);
    }

    #[test]
    fn one_late_event_shows_in_the_tail_only() {
        let mut late = stream();
        late[7].t_ns += 300_000;
        let bad = compare(SIZE, stream(), late);
        assert_eq!((bad.matched.p50_us, bad.matched.p99_us, bad.matched.max_us), (0.0, 300.0, 300.0));
        assert!((bad.matched.mean_us - 15.0).abs() < 1e-9);
    }

    #[test]
    fn order_of_polarities_counts_where_counts_agree() {
        let a = [event(0, 0, 0, Polarity::On), event(10, 0, 0, Polarity::Off)];
        let b = [event(0, 0, 0, Polarity::Off), event(10, 0, 0, Polarity::On)];
        let bad = compare(SIZE, a, b);
        assert_eq!((bad.f1, bad.exact_channels), (1.0, 1.0));
        assert_eq!(bad.same_sequence, 5.0 / 6.0);
    }
}
