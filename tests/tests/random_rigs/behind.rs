//! What comes behind the pixels is exact: the packets of a sensor with a bus and a cap follow, bit for bit, from those
//! of the same sensor without.

use crate::case::{Case, Change};
use crate::findings::Findings;
use crate::play::Steps;
use esaac_model::packet::Event;
use esaac_model::substeps::quantise_ns;
use esaac_model::{ReadoutKind, SensorModel};
use esaac_oracle::physical::readout::Queue;
use esaac_tests::run::Step;

/// A bus, what is on its way out, and the sensor that it is of.
struct Behind {
    sensor: SensorModel,
    queue: Queue,
    leaving: Vec<Event>,
}

/// What a camera sends in a tick.
#[derive(Debug, PartialEq)]
struct Sent {
    dropped: u64,
    lost: u64,
    capped: u64,
    waiting: u64,
    events: Vec<Event>,
}

impl Behind {
    fn new(sensor: &SensorModel) -> Self {
        let queue = Queue::new(sensor.readout_model());
        Behind { sensor: sensor.clone(), queue, leaving: Vec::new() }
    }

    fn change(&mut self, sensor: SensorModel) {
        self.queue.set_readout(sensor.readout_model());
        self.sensor = sensor;
    }

    /// What becomes of the events that pixels send up to `t_ns`.
    fn send(&mut self, step: &Step, t_ns: i64) -> Sent {
        let arrived: Vec<Event> = step.packet.iter().collect();
        let mut sent = Sent {
            dropped: 0,
            lost: 0,
            capped: 0,
            waiting: step.diagnostics.deferred_events,
            events: arrived.clone(),
        };
        if self.sensor.readout != ReadoutKind::None {
            let served = self.queue.serve(&arrived, t_ns);
            self.leaving.extend(served.events);
            let (out, later): (Vec<Event>, Vec<Event>) =
                std::mem::take(&mut self.leaving).into_iter().partition(|event| event.t_ns <= t_ns);
            self.leaving = later;
            let quantum_ns = i64::from(self.sensor.timestamp_quantum_ns);
            sent.events =
                out.into_iter().map(|e| Event { t_ns: quantise_ns(e.t_ns, quantum_ns), ..e }).collect();
            sent.events.sort_unstable();
            (sent.lost, sent.capped) = (served.lost, served.capped);
            sent.waiting += (self.queue.waiting() + self.leaving.len()) as u64;
        }
        let most = self.sensor.max_events_per_interval as usize;
        if most > 0 && sent.events.len() > most {
            sent.dropped = (sent.events.len() - most) as u64;
            sent.events.truncate(most);
        }
        sent
    }
}

/// Compares what a camera sends with what follows from what its pixels send.
pub fn check(case: &Case, camera: usize, pixels: &Steps, whole: &Steps, findings: &mut Findings) {
    let of = &case.cameras[camera];
    let mut behind = Behind::new(&of.resolved(&of.sensor));
    for (index, tick) in case.ticks.iter().enumerate() {
        for change in &tick.changes {
            match change {
                Change::Reset(number) if *number == camera => behind = Behind::new(&behind.sensor),
                Change::Sensor(number, sensor) if *number == camera => {
                    let sensor = of.resolved(sensor);
                    match behind.sensor.change_to(&sensor).resets_frames {
                        true => behind = Behind::new(&sensor),
                        false => behind.change(sensor),
                    }
                }
                _ => {}
            }
        }
        let (Some(frame), Some(arrived), Some(step)) =
            (tick.frames[camera], &pixels[index][camera], &whole[index][camera])
        else {
            continue;
        };
        let expected = behind.send(arrived, frame.t_ns);
        let actual = Sent {
            dropped: step.packet.dropped,
            lost: step.diagnostics.lost_events,
            capped: step.diagnostics.capped_events,
            waiting: step.diagnostics.deferred_events,
            events: step.packet.iter().collect(),
        };
        findings.check(expected == actual, || {
            let counts = |s: &Sent| (s.events.len(), s.dropped, s.lost, s.capped, s.waiting);
            let first = expected.events.iter().zip(&actual.events).find(|(a, b)| a != b);
            format!(
                "tick {index}, camera {camera}: behind the pixels {:?} (events, dropped, lost, capped, waiting), expected \
                 {:?}; first other event {first:?}",
                counts(&actual),
                counts(&expected)
            )
        });
    }
}
