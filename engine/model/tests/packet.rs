//! Order, counts and views of packets.

use esaac_model::packet::Event;
use esaac_model::{Packet, Polarity};

fn event(t_ns: i64, y: u16, x: u16, polarity: Polarity) -> Event {
    Event { t_ns, y, x, polarity }
}

fn events() -> [Event; 5] {
    [
        event(-93, 2, 1, Polarity::Off),
        event(-90, 0, 7, Polarity::On),
        event(-90, 3, 4, Polarity::Off),
        event(-90, 3, 4, Polarity::On),
        event(4_294_967_195, 3, 5, Polarity::On),
    ]
}

fn packet(events: &[Event]) -> Packet {
    let mut packet = Packet { sequence: 9, width_px: 8, height_px: 4, base_ns: -100, ..Packet::default() };
    events.iter().for_each(|&event| packet.push(event));
    packet
}

#[test]
fn events_come_out_as_they_were_put_in() {
    let packet = packet(&events());
    assert!(packet.iter().eq(events()));
    assert_eq!(packet.t_offset_ns, [7, 10, 10, 10, u32::MAX], "from the base on, which may lie before zero");
    assert_eq!((packet.len(), packet.is_empty()), (5, false));
    assert_eq!(packet.on_off(), (3, 2));
    assert_eq!(packet.view().to_packet(), packet);
}

#[test]
fn a_part_has_the_events_of_its_range_and_the_rest_of_the_packet() {
    let whole = packet(&events());
    for (first, end) in [(0, 5), (1, 3), (4, 5), (2, 2)] {
        let part = whole.view().part(first..end);
        assert!(part.to_packet().iter().eq(events()[first..end].iter().copied()), "{first}..{end}");
        assert_eq!((part.sequence, part.width_px, part.height_px, part.base_ns), (9, 8, 4, -100));
    }
}

#[test]
fn equal_events_are_in_order_and_each_key_counts() {
    let twice = [events()[1], events()[1]];
    assert!(packet(&twice).is_sorted());
    let in_order = events();
    assert!(packet(&in_order).is_sorted());
    for first in 0..in_order.len() - 1 {
        let mut swapped = in_order;
        swapped.swap(first, first + 1);
        assert!(!packet(&swapped).is_sorted(), "events {first} and {}", first + 1);
    }
    // Rows sort before columns.
    assert!(packet(&[event(0, 1, 9, Polarity::On), event(0, 2, 3, Polarity::Off)]).is_sorted());
}

#[test]
fn an_emptied_packet_holds_nothing() {
    let mut packet = Packet { dropped: 3, ..packet(&events()) };
    packet.clear();
    assert!(packet.is_empty() && packet.iter().len() == 0);
    assert_eq!((packet.on_off(), packet.dropped), ((0, 0), 0));
}
