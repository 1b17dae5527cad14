//! The readout of [`esaac_model::physical::Readout`], as a queue that serves one after the other ([`Queue`]). Its tests have
//! it as prefix scans too, repeated until nothing changes, which is how many threads can do it.
//!
//! # The scan
//! Services that follow one another with durations `c_k` on a bus end at `end_k = max(end_(k-1), t_k) + c_k`. With the sum
//! `C_k` of the durations up to `k` this is a prefix maximum: `end_k = C_k + max over j <= k of (t_j - C_(j-1))`.
//!
//! Which events are lost, and which row an event is read with, depends on the ends in turn. So the scan begins with a
//! guess and is repeated with what follows from its ends. An event's fate depends on earlier events only: after `r`
//! rounds at least the first `r` are right, and a round that changes nothing has found the queue's own result, the only
//! one there is. In practice rounds are few: a chain of losses, each because the one before it was not, is short.

use esaac_model::packet::Event;
use esaac_model::physical::{Bus, Readout};
use std::collections::{HashMap, VecDeque};

const PS_PER_NS: i128 = 1000;

/// Events that have left the sensor, stamped when they did, and those that have not.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Served {
    /// Events in the order that they were served, not yet floored to the sensor's tick.
    pub events: Vec<Event>,
    /// Events lost because their pixel had one waiting.
    pub lost: u64,
    /// Events dropped by the rate controller.
    pub capped: u64,
}

/// A sensor's bus, event by event. It keeps its state from one interval to the next.
#[derive(Clone, Debug)]
pub struct Queue {
    readout: Readout,
    /// When the bus is free, picoseconds.
    free_ps: i128,
    /// When the last event of a pixel left, picoseconds.
    left_ps: HashMap<(u16, u16), i128>,
    /// Events that wait for a row's service, by row, oldest first.
    rows: Vec<VecDeque<Event>>,
    /// Rows with events waiting, in the order that they began to.
    open: VecDeque<u16>,
    /// The rate controller's period, and how many events were served in it.
    period: (i64, u64),
}

impl Queue {
    /// A free bus.
    #[must_use]
    pub fn new(readout: Readout) -> Self {
        Queue {
            readout,
            free_ps: i128::MIN,
            left_ps: HashMap::new(),
            rows: Vec::new(),
            open: VecDeque::new(),
            period: (i64::MIN, 0),
        }
    }

    /// Changes what the bus does from now on. What waits goes on waiting; the kind of bus stays.
    pub fn set_readout(&mut self, readout: Readout) {
        self.readout = readout;
    }

    /// Events that wait for their row.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.rows.iter().map(VecDeque::len).sum()
    }

    /// Takes the events up to `end_ns` in the order (t, y, x, polarity), and serves all whose service begins before
    /// the nanosecond after it.
    pub fn serve(&mut self, events: &[Event], end_ns: i64) -> Served {
        let mut served = Served::default();
        match self.readout.bus {
            Bus::Ideal => {
                for &event in events {
                    self.leave(&[event], ps(event), &mut served);
                }
            }
            Bus::Fifo { event_ps } => {
                for &event in events {
                    let t_ps = ps(event);
                    if self.is_taken(event) {
                        served.lost += 1;
                        continue;
                    }
                    self.free_ps = self.free_ps.max(t_ps) + i128::from(event_ps);
                    self.leave(&[event], self.free_ps, &mut served);
                }
            }
            Bus::Rows { row_ps, event_ps } => {
                let mut arrivals = events.iter().copied().peekable();
                loop {
                    if self.open.is_empty() {
                        let Some(event) = arrivals.next() else { break };
                        self.wait(event, &mut served);
                        continue;
                    }
                    let oldest = self.rows[usize::from(self.open[0])][0];
                    let start_ps = self.free_ps.max(ps(oldest));
                    while let Some(event) = arrivals.next_if(|&event| ps(event) <= start_ps) {
                        self.wait(event, &mut served);
                    }
                    // No event of the next interval can join a service that begins before its first nanosecond.
                    if start_ps >= (i128::from(end_ns) + 1) * PS_PER_NS {
                        break;
                    }
                    let row = self.open.pop_front().map_or(0, usize::from);
                    let read = std::mem::take(&mut self.rows[row]);
                    self.free_ps = start_ps + i128::from(row_ps) + i128::from(event_ps) * read.len() as i128;
                    let mut read: Vec<Event> = read.into();
                    read.sort_unstable_by_key(|event| event.x);
                    self.leave(&read, self.free_ps, &mut served);
                }
            }
        }
        // What left before the interval's end takes no place any more.
        self.left_ps.retain(|_, &mut left_ps| left_ps > i128::from(end_ns) * PS_PER_NS);
        served
    }

    /// Whether the event's pixel has another on its way.
    fn is_taken(&self, event: Event) -> bool {
        self.left_ps.get(&(event.y, event.x)).is_some_and(|&left_ps| left_ps >= ps(event))
    }

    /// Lets an event wait for its row.
    fn wait(&mut self, event: Event, served: &mut Served) {
        let row = usize::from(event.y);
        if self.rows.len() <= row {
            self.rows.resize(row + 1, VecDeque::new());
        }
        if self.is_taken(event) || self.rows[row].iter().any(|waiting| waiting.x == event.x) {
            served.lost += 1;
            return;
        }
        if self.rows[row].is_empty() {
            self.open.push_back(event.y);
        }
        self.rows[row].push_back(event);
    }

    /// Counts `events` that leave at a time for the rate controller. Returns whether it drops them.
    fn is_capped(&mut self, t_ns: i64, events: u64) -> bool {
        let period = t_ns.div_euclid(i64::from(self.readout.cap_period_ns));
        if self.period.0 != period {
            self.period = (period, 0);
        }
        let before = self.period.1;
        self.period.1 += events;
        before >= u64::from(self.readout.cap_events)
    }

    /// Lets the events of one service leave.
    fn leave(&mut self, service: &[Event], left_ps: i128, served: &mut Served) {
        if self.readout.bus != Bus::Ideal {
            self.left_ps.extend(service.iter().map(|event| ((event.y, event.x), left_ps)));
        }
        let t_ns = to_ns(left_ps);
        if self.readout.cap_events > 0 && self.is_capped(t_ns, service.len() as u64) {
            served.capped += service.len() as u64;
            return;
        }
        served.events.extend(service.iter().map(|&event| Event { t_ns, ..event }));
    }
}

fn ps(event: Event) -> i128 {
    i128::from(event.t_ns) * PS_PER_NS
}

/// Rounds down to a nanosecond.
fn to_ns(t_ps: i128) -> i64 {
    t_ps.div_euclid(PS_PER_NS) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Polarity;
    use esaac_model::random::philox4x32_10;

    /// The result of a scan.
    #[derive(Clone, Debug, PartialEq, Eq)]
    struct Scan {
        /// When each event leaves, nanoseconds; `None` if it is lost.
        left_ns: Vec<Option<i64>>,
        /// Rounds until nothing changed.
        rounds: u32,
    }

    /// Word-serial readout of events in the order (t, y, x, polarity) by a free bus.
    fn scan_fifo(events: &[Event], event_ps: u64) -> Scan {
        let previous = previous_of_pixel(events);
        let mut lost = vec![false; events.len()];
        for rounds in 1.. {
            let kept = lost.iter().enumerate().filter(|&(_, &lost)| !lost).map(|(i, _)| i);
            let services: Vec<Service> =
                kept.map(|opener| Service { opener, duration_ps: i128::from(event_ps) }).collect();
            let ends = scan_services(events, &services);
            let mut left_ps = vec![None; events.len()];
            for (service, &end_ps) in services.iter().zip(&ends) {
                left_ps[service.opener] = Some(end_ps);
            }
            let next: Vec<bool> =
                (0..events.len()).map(|i| is_lost(events, &previous, &left_ps, i)).collect();
            if next == lost {
                return Scan { left_ns: left_ps.into_iter().map(|left| left.map(to_ns)).collect(), rounds };
            }
            lost = next;
        }
        unreachable!("after as many rounds as events nothing changes any more")
    }

    /// Readout by row of events in the order (t, y, x, polarity) by a free bus.
    fn scan_rows(events: &[Event], row_ps: u64, event_ps: u64) -> Scan {
        let previous = previous_of_pixel(events);
        // The guess: every event is kept and opens a service of its row.
        let mut fate = vec![(false, true); events.len()];
        for rounds in 1.. {
            // The service of each kept event, and how many each has.
            let mut services: Vec<Service> = Vec::new();
            let mut service_of = vec![None; events.len()];
            let mut latest: HashMap<u16, usize> = HashMap::new();
            for (i, &(lost, opens)) in fate.iter().enumerate() {
                if lost {
                    continue;
                }
                if opens || !latest.contains_key(&events[i].y) {
                    latest.insert(events[i].y, services.len());
                    services.push(Service { opener: i, duration_ps: i128::from(row_ps) });
                }
                let service = latest[&events[i].y];
                services[service].duration_ps += i128::from(event_ps);
                service_of[i] = Some(service);
            }
            let ends = scan_services(events, &services);
            let left_ps: Vec<Option<i128>> =
                service_of.iter().map(|service| service.map(|service| ends[service])).collect();
            // An event joins the service of the kept event before it in its row if that has not begun.
            let mut before_in_row: HashMap<u16, usize> = HashMap::new();
            let next: Vec<(bool, bool)> = (0..events.len())
                .map(|i| {
                    let before = before_in_row.get(&events[i].y).copied();
                    if let Some(service) = service_of[i] {
                        before_in_row.insert(events[i].y, service);
                    }
                    let lost = is_lost(events, &previous, &left_ps, i);
                    let begun = |service: usize| ends[service] - services[service].duration_ps;
                    (lost, !lost && before.is_none_or(|service| ps(events[i]) > begun(service)))
                })
                .collect();
            if next == fate {
                return Scan { left_ns: left_ps.into_iter().map(|left| left.map(to_ns)).collect(), rounds };
            }
            fate = next;
        }
        unreachable!("after as many rounds as events nothing changes any more")
    }

    /// A service: the event that asks for it, and how long it takes.
    struct Service {
        opener: usize,
        duration_ps: i128,
    }

    /// When services end that follow one another: a prefix maximum.
    fn scan_services(events: &[Event], services: &[Service]) -> Vec<i128> {
        let before: Vec<i128> = services
            .iter()
            .scan(0, |sum, service| {
                let before = *sum;
                *sum += service.duration_ps;
                Some(before)
            })
            .collect();
        let begin = services.iter().zip(&before).map(|(service, before)| ps(events[service.opener]) - before);
        let latest = begin.scan(i128::MIN, |latest, begin| {
            *latest = begin.max(*latest);
            Some(*latest)
        });
        let ends = latest.zip(services.iter().zip(&before));
        ends.map(|(latest, (service, before))| latest + before + service.duration_ps).collect()
    }

    /// Whether the latest kept event of the same pixel is still on its way when event `i` happens.
    fn is_lost(events: &[Event], previous: &[Option<usize>], left_ps: &[Option<i128>], i: usize) -> bool {
        let mut earlier = previous[i];
        while let Some(j) = earlier {
            if let Some(left_ps) = left_ps[j] {
                return left_ps >= ps(events[i]);
            }
            earlier = previous[j];
        }
        false
    }

    /// For each event the one before it at its pixel.
    fn previous_of_pixel(events: &[Event]) -> Vec<Option<usize>> {
        let mut latest = HashMap::new();
        events.iter().enumerate().map(|(i, event)| latest.insert((event.y, event.x), i)).collect()
    }

    fn event(t_ns: i64, y: u16, x: u16) -> Event {
        Event { t_ns, y, x, polarity: Polarity::On }
    }

    fn readout(bus: Bus) -> Readout {
        Readout { bus, ..Readout::default() }
    }

    /// Events of `pixels` pixels in `rows` rows over `span_ns`, in order, from a seed.
    fn stream(seed: u32, count: u32, rows: u32, columns: u32, span_ns: u32) -> Vec<Event> {
        let mut events: Vec<Event> = (0..count)
            .map(|i| {
                let words = philox4x32_10([i, 0, 0, 0], [seed, 0]);
                let polarity = if words[3] & 1 == 0 { Polarity::Off } else { Polarity::On };
                let (y, x) = ((words[1] % rows) as u16, (words[2] % columns) as u16);
                Event { t_ns: i64::from(words[0] % span_ns), y, x, polarity }
            })
            .collect();
        events.sort_unstable();
        events
    }

    /// What a queue makes of a stream, as the time at which each event leaves.
    fn queued(bus: Bus, events: &[Event]) -> (Vec<Event>, u64) {
        let served = Queue::new(readout(bus)).serve(events, i64::MAX);
        let mut left = served.events;
        left.sort_unstable();
        (left, served.lost)
    }

    fn scanned(scan: &Scan, events: &[Event]) -> (Vec<Event>, u64) {
        let mut left: Vec<Event> = events
            .iter()
            .zip(&scan.left_ns)
            .filter_map(|(&event, left)| left.map(|t_ns| Event { t_ns, ..event }))
            .collect();
        left.sort_unstable();
        (left, scan.left_ns.iter().filter(|left| left.is_none()).count() as u64)
    }

    #[test]
    fn ten_thousand_simultaneous_events_take_a_davis_most_of_a_millisecond() {
        let events: Vec<Event> = (0..10_000).map(|i| event(0, (i / 100) as u16, (i % 100) as u16)).collect();
        let (left, lost) = queued(Bus::Fifo { event_ps: 83_000 }, &events);
        assert_eq!((left.len(), lost), (10_000, 0));
        assert_eq!((left[0].t_ns, left[9_999].t_ns), (83, 830_000));
        let per_second = 10_000.0 / (left[9_999].t_ns as f64 * 1e-9);
        assert!((per_second / 12e6 - 1.0).abs() < 0.01, "{per_second} events a second");
    }

    #[test]
    fn a_pixel_waits_and_what_it_would_have_sent_is_lost() {
        let events = [event(0, 0, 0), event(0, 0, 1), event(150, 0, 1), event(200, 0, 1), event(201, 0, 1)];
        let served = Queue::new(readout(Bus::Fifo { event_ps: 100_000 })).serve(&events, 1000);
        assert_eq!(served.lost, 2);
        let times: Vec<i64> = served.events.iter().map(|event| event.t_ns).collect();
        assert_eq!(times, [100, 200, 301]);
    }

    #[test]
    fn a_row_is_read_together_and_the_oldest_row_first() {
        let bus = Bus::Rows { row_ps: 100_000, event_ps: 1_000 };
        // Row 1 begins at 0. Rows 3 and 0 wait meanwhile; an event of row 3 joins before its service begins at 101.
        let events = [event(0, 1, 5), event(10, 3, 0), event(20, 0, 0), event(101, 3, 7), event(102, 3, 8)];
        let (left, lost) = queued(bus, &events);
        assert_eq!(lost, 0);
        let times: Vec<(u16, u16, i64)> = left.iter().map(|event| (event.y, event.x, event.t_ns)).collect();
        assert_eq!(times, [(1, 5, 101), (3, 0, 203), (3, 7, 203), (0, 0, 304), (3, 8, 405)]);
    }

    #[test]
    fn the_rate_controller_counts_what_it_drops() {
        let bus = Bus::Fifo { event_ps: 10_000 };
        let capped = Readout { bus, cap_events: 3, cap_period_ns: 100 };
        let events: Vec<Event> = (0..20).map(|x| event(0, 0, x)).collect();
        let served = Queue::new(capped).serve(&events, 1000);
        // They leave at 10, 20, ..., 200: nine in the first period, ten in the second, one in the third.
        let times: Vec<i64> = served.events.iter().map(|event| event.t_ns).collect();
        assert_eq!(times, [10, 20, 30, 100, 110, 120, 200]);
        assert_eq!((served.lost, served.capped), (0, 13));
    }

    #[test]
    fn a_cap_that_is_switched_on_counts_from_then_on() {
        let bus = Bus::Fifo { event_ps: 10_000 };
        let free = Readout { bus, cap_events: 0, cap_period_ns: 100 };
        let mut queue = Queue::new(free);
        let times = |served: &Served| served.events.iter().map(|event| event.t_ns).collect::<Vec<_>>();
        assert_eq!(times(&queue.serve(&[event(0, 0, 0), event(0, 0, 1)], 20)), [10, 20]);
        queue.set_readout(Readout { cap_events: 2, ..free });
        let served = queue.serve(&[event(21, 0, 0), event(21, 0, 1), event(21, 0, 2)], 60);
        assert_eq!((times(&served), served.capped), (vec![31, 41], 1));
    }

    #[test]
    fn scans_agree_with_the_queues_for_random_streams() {
        let mut most_rounds = 0;
        for seed in 0..120 {
            // From an idle bus to one that is asked for ten times what it can do.
            let span_ns = [200_000, 20_000, 2_000, 200][seed as usize % 4];
            let (rows, columns) = [(1, 1), (2, 8), (16, 4), (40, 40)][seed as usize / 4 % 4];
            let events = stream(seed, 300, rows, columns, span_ns);
            let fifo = scan_fifo(&events, 50_500);
            assert_eq!(scanned(&fifo, &events), queued(Bus::Fifo { event_ps: 50_500 }, &events), "{seed}");
            let by_row = scan_rows(&events, 130_000, 330);
            let queue = queued(Bus::Rows { row_ps: 130_000, event_ps: 330 }, &events);
            assert_eq!(scanned(&by_row, &events), queue, "{seed}");
            assert_eq!(queue.0.len() as u64 + queue.1, 300, "{seed}: served and lost add up");
            most_rounds = most_rounds.max(fifo.rounds).max(by_row.rounds);
        }
        assert!(most_rounds > 3, "the streams saturate the bus: {most_rounds} rounds");
    }

    #[test]
    fn intervals_do_not_change_what_is_served() {
        for bus in [Bus::Fifo { event_ps: 70_000 }, Bus::Rows { row_ps: 130_000, event_ps: 330 }] {
            for seed in 0..8 {
                let events = stream(seed, 400, 10, 10, 20_000);
                let capped = Readout { bus, cap_events: 5, cap_period_ns: 1_000 };
                let whole = Queue::new(capped).serve(&events, i64::MAX);
                let mut queue = Queue::new(capped);
                let mut parts = Served::default();
                for end_ns in (0..).step_by(1_700).take_while(|&end_ns| end_ns < 100_000) {
                    let in_part: Vec<Event> = events
                        .iter()
                        .copied()
                        .filter(|e| e.t_ns <= end_ns && e.t_ns > end_ns - 1_700)
                        .collect();
                    let part = queue.serve(&in_part, end_ns);
                    parts.events.extend(part.events);
                    parts.lost += part.lost;
                    parts.capped += part.capped;
                }
                assert_eq!((queue.waiting(), parts), (0, whole), "{bus:?} {seed}");
            }
        }
    }
}
