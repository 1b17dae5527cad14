//! Streams with known faults, to test the comparators with.

use esaac_model::Polarity;
use esaac_model::packet::Event;

/// A fault: its name and a copy of a stream that has it. The copy is in time order.
pub struct Fault {
    /// What is wrong with the copy.
    pub name: &'static str,
    /// Makes the copy. The number is the sensor's width, in pixels.
    pub apply: fn(&[Event], u32) -> Vec<Event>,
}

fn sorted(mut events: Vec<Event>) -> Vec<Event> {
    events.sort_unstable();
    events
}

fn each(events: &[Event], change: impl Fn(usize, Event) -> Option<Event>) -> Vec<Event> {
    sorted(events.iter().enumerate().filter_map(|(i, e)| change(i, *e)).collect())
}

/// Known faults. Each is so small that a coarse measure would overlook it.
pub const FAULTS: [Fault; 7] = [
    Fault {
        name: "polarities swapped",
        apply: |events, _| {
            each(events, |_, e| {
                let polarity = if e.polarity == Polarity::On { Polarity::Off } else { Polarity::On };
                Some(Event { polarity, ..e })
            })
        },
    },
    Fault { name: "a tenth missing", apply: |events, _| each(events, |i, e| (i % 10 != 0).then_some(e)) },
    Fault {
        name: "a tenth doubled",
        apply: |events, _| {
            let twice = |(i, e): (usize, &Event)| std::iter::repeat_n(*e, if i % 10 == 0 { 2 } else { 1 });
            sorted(events.iter().enumerate().flat_map(twice).collect())
        },
    },
    Fault {
        name: "300 us late",
        apply: |events, _| each(events, |_, e| Some(Event { t_ns: e.t_ns + 300_000, ..e })),
    },
    Fault {
        name: "times on a grid of 1 ms",
        apply: |events, _| {
            each(events, |_, e| Some(Event { t_ns: e.t_ns.div_euclid(1_000_000) * 1_000_000, ..e }))
        },
    },
    Fault {
        name: "one pixel to the right",
        apply: |events, width| {
            each(events, |_, e| Some(Event { x: ((u32::from(e.x) + 1) % width) as u16, ..e }))
        },
    },
    Fault {
        name: "one event in a hundred noise",
        apply: |events, width| {
            // A pixel elsewhere, at the time of another event.
            let stray = |e: &Event| Event { x: ((u32::from(e.x) * 7 + 13) % width) as u16, ..*e };
            sorted(events.iter().copied().chain(events.iter().step_by(100).map(stray)).collect())
        },
    },
];
