//! Stage `sort`: sorts stamped events into a packet.

use esaac_model::Packet;
use esaac_model::packet::Event;

/// Appends events to `packet`, whose header is set, in the order (t, y, x, polarity). With a cap (`max_events` above 0)
/// the earliest events are kept; the others are counted as dropped.
pub fn sort(mut events: Vec<Event>, max_events: u32, packet: &mut Packet) {
    events.sort_unstable();
    if max_events > 0 {
        packet.dropped = events.len().saturating_sub(max_events as usize) as u64;
        events.truncate(max_events as usize);
    }
    for event in events {
        packet.push(event);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Polarity;

    #[test]
    fn the_cap_keeps_the_earliest_and_counts_the_rest() {
        let event = |t_ns, x| Event { t_ns, y: 0, x, polarity: Polarity::On };
        let events = vec![event(9, 0), event(5, 1), event(7, 0), event(5, 0)];
        let mut all = Packet::default();
        sort(events.clone(), 0, &mut all);
        assert_eq!(
            (all.t_offset_ns.clone(), all.x.clone(), all.dropped),
            (vec![5, 5, 7, 9], vec![0, 1, 0, 0], 0)
        );
        let mut capped = Packet::default();
        sort(events, 3, &mut capped);
        assert_eq!((capped.len(), capped.dropped), (3, 1));
        assert_eq!(capped.event(2).t_ns, 7);
    }
}
