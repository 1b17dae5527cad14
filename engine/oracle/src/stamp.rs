//! Stage `stamp`: the time stamp of an event, and the packet that it belongs to.

use esaac_model::SensorModel;
use esaac_model::packet::Event;
use esaac_model::random::{PixelKey, Stream, draw, jitter_ns};
use esaac_model::substeps::quantise_ns;

/// When the event that happens at `t_ns`, at a pixel that has emitted `index` events before it, has passed the latency,
/// nanoseconds.
#[must_use]
pub fn delayed_ns(sensor: &SensorModel, key: PixelKey, index: u32, t_ns: i64) -> i64 {
    let jitter = match sensor.latency_jitter_ns {
        0 => 0,
        sigma_ns => jitter_ns(draw(key, Stream::Jitter, index), sigma_ns),
    };
    t_ns + (i64::from(sensor.latency_ns) + jitter).max(0)
}

/// Removes the events at or before `end_ns` from `deferred` and returns them. The others stay for a later
/// packet.
pub fn due(deferred: &mut Vec<Event>, end_ns: i64) -> Vec<Event> {
    let (due, later) = std::mem::take(deferred).into_iter().partition(|event| event.t_ns <= end_ns);
    *deferred = later;
    due
}

/// Base time of the packet of an interval that begins at `start_ns`, nanoseconds. No event of the interval is stamped
/// earlier.
#[must_use]
pub fn base_ns(sensor: &SensorModel, start_ns: i64) -> i64 {
    quantise_ns(start_ns, i64::from(sensor.timestamp_quantum_ns))
}

/// Watermark of the packet of an interval that ends at `end_ns`: the last nanosecond before the earliest stamp that a
/// later event can get. `complete_ns`: see [`complete_before`].
#[must_use]
pub fn watermark_ns(sensor: &SensorModel, end_ns: i64, complete_ns: Option<i64>) -> i64 {
    let watermark_ns = quantise_ns(end_ns + 1, i64::from(sensor.timestamp_quantum_ns)) - 1;
    complete_ns.map_or(watermark_ns, |complete_ns| complete_ns.max(watermark_ns))
}

/// Up to when the packets before that of a frame at `t_ns` were said to be complete: the watermark of the last one,
/// unless the frame is earlier. Then it is a first frame, and a new clock begins.
#[must_use]
pub fn complete_before(last_watermark_ns: Option<i64>, t_ns: i64) -> Option<i64> {
    last_watermark_ns.filter(|&watermark_ns| watermark_ns <= t_ns)
}

/// Time stamp of an event that leaves the sensor at `t_ns`: floored to a quantum, but after `complete_ns`. Floored alone it
/// could lie before that where the quantum has become coarser.
#[must_use]
pub fn stamp_ns(sensor: &SensorModel, t_ns: i64, complete_ns: Option<i64>) -> i64 {
    let floored_ns = quantise_ns(t_ns, i64::from(sensor.timestamp_quantum_ns));
    complete_ns.map_or(floored_ns, |complete_ns| floored_ns.max(complete_ns + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Polarity;

    const KEY: PixelKey = PixelKey { seed: 1, camera: 2, pixel: 3 };

    #[test]
    fn a_watermark_is_the_last_nanosecond_before_the_next_stamp() {
        let sensor = SensorModel { latency_ns: 700, timestamp_quantum_ns: 1000, ..SensorModel::default() };
        assert_eq!([-700, 300].map(|t_ns| delayed_ns(&sensor, KEY, 0, t_ns)), [0, 1000]);
        assert_eq!(watermark_ns(&sensor, 998, None), -1);
        assert_eq!(watermark_ns(&sensor, 999, None), 999);
        assert_eq!(watermark_ns(&SensorModel::default(), 999, None), 999);
    }

    #[test]
    fn after_a_finer_quantum_no_stamp_is_at_or_before_the_last_watermark() {
        let sensor = SensorModel { timestamp_quantum_ns: 1000, ..SensorModel::default() };
        // Under a quantum of 1 the last packet, to 2300, was complete to its end.
        let complete_ns = complete_before(Some(2300), 3500);
        assert_eq!(
            [2301, 2999, 3000, 3500].map(|t_ns| stamp_ns(&sensor, t_ns, complete_ns)),
            [2301, 2301, 3000, 3000]
        );
        assert_eq!(watermark_ns(&sensor, 2800, complete_ns), 2300);
        assert_eq!(watermark_ns(&sensor, 2999, complete_ns), 2999);
        assert_eq!(stamp_ns(&sensor, -1, None), -1000);
    }

    #[test]
    fn a_frame_before_the_last_watermark_begins_a_new_clock() {
        assert_eq!([2299, 2300].map(|t_ns| complete_before(Some(2300), t_ns)), [None, Some(2300)]);
        assert_eq!(complete_before(None, 0), None);
    }

    #[test]
    fn a_delay_is_never_negative() {
        let sensor = SensorModel { latency_jitter_ns: 1000, ..SensorModel::default() };
        let stamps: Vec<i64> = (0..1000).map(|index| delayed_ns(&sensor, KEY, index, 50)).collect();
        let undelayed = stamps.iter().filter(|&&t_ns| t_ns == 50).count();
        assert!(stamps.iter().all(|&t_ns| t_ns >= 50));
        assert!((400..600).contains(&undelayed), "{undelayed} of 1000 draws are negative");
    }

    #[test]
    fn deferred_events_wait() {
        let event = |t_ns| Event { t_ns, y: 0, x: 0, polarity: Polarity::Off };
        let mut deferred = vec![event(5), event(11), event(10)];
        assert_eq!(due(&mut deferred, 10), [event(5), event(10)]);
        assert_eq!(deferred, [event(11)]);
    }
}
