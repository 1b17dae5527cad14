//! What comes behind the pixels is exact: the packets of a sensor with a bus and a cap follow, bit for bit, from those
//! of the same sensor without.

use crate::case::{Case, Change};
use crate::findings::Findings;
use crate::play::Steps;
use esaac_model::packet::Event;
use esaac_model::{ReadoutKind, SensorModel};
use esaac_oracle::physical::readout::Queue;
use esaac_oracle::stamp::{complete_before, stamp_ns, watermark_ns};
use esaac_tests::run::Step;

/// A bus, what is on its way out, and the sensor that it is of.
struct Behind {
    sensor: SensorModel,
    queue: Queue,
    leaving: Vec<Event>,
    /// Watermark of the last packet.
    watermark_ns: Option<i64>,
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
        Behind { sensor: sensor.clone(), queue, leaving: Vec::new(), watermark_ns: None }
    }

    /// As [`Behind::new`]; packets stay complete up to their watermarks.
    fn reset(&mut self, sensor: &SensorModel) {
        *self = Behind { watermark_ns: self.watermark_ns, ..Behind::new(sensor) };
    }

    fn change(&mut self, sensor: SensorModel) {
        self.queue.set_readout(sensor.readout_model());
        self.sensor = sensor;
    }

    /// What becomes of the events that pixels send up to `t_ns`.
    fn send(&mut self, step: &Step, t_ns: i64) -> Sent {
        let mut events: Vec<Event> = step.packet.iter().collect();
        let (mut lost, mut capped) = (0, 0);
        let mut waiting = step.diagnostics.deferred_events;
        if self.sensor.readout != ReadoutKind::None {
            let served = self.queue.serve(&events, t_ns);
            self.leaving.extend(served.events);
            (events, self.leaving) =
                std::mem::take(&mut self.leaving).into_iter().partition(|event| event.t_ns <= t_ns);
            (lost, capped) = (served.lost, served.capped);
            waiting += (self.queue.waiting() + self.leaving.len()) as u64;
        }
        // Without a bus as well: packets of the same sensor without its bus may have been complete up to another time.
        let complete_ns = complete_before(self.watermark_ns, t_ns);
        events.iter_mut().for_each(|event| event.t_ns = stamp_ns(&self.sensor, event.t_ns, complete_ns));
        events.sort_unstable();
        self.watermark_ns = Some(watermark_ns(&self.sensor, t_ns, complete_ns));
        let most = match self.sensor.max_events_per_interval {
            0 => usize::MAX,
            most => most as usize,
        };
        let dropped = events.len().saturating_sub(most) as u64;
        events.truncate(most);
        Sent { dropped, lost, capped, waiting, events }
    }
}

/// Compares what a camera sends with what follows from what its pixels send.
pub fn check(case: &Case, camera: usize, pixels: &Steps, whole: &Steps, findings: &mut Findings) {
    let of = &case.cameras[camera];
    let mut behind = Behind::new(&of.resolved(&of.sensor));
    for (index, tick) in case.ticks.iter().enumerate() {
        for change in &tick.changes {
            match change {
                Change::Reset(number) if *number == camera => behind.reset(&behind.sensor.clone()),
                Change::Sensor(number, sensor) if *number == camera => {
                    let sensor = of.resolved(sensor);
                    match behind.sensor.change_to(&sensor).resets_frames {
                        true => behind.reset(&sensor),
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
