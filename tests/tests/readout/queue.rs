//! Sensors with a bus, and what a queue makes of the events that come to it.

use esaac_engine::{KernelPolicy, RigOptions};
use esaac_model::packet::Event;
use esaac_model::random::philox4x32_10;
use esaac_model::substeps::quantise_ns;
use esaac_model::{ReadoutKind, SensorModel, Synthesis};
use esaac_oracle::physical::readout::Queue;
use esaac_tests::device::{assert_silent, policy};
use esaac_tests::frames::{Sequence, gray, intensity_of, times};
use esaac_tests::run::{Step, engine_of_many, events};

pub const SIZE: (u32, u32) = (61, 43);

pub fn sensor(readout: ReadoutKind, readout_event_ns: f64) -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis: Synthesis::None,
        substeps: 1,
        readout,
        readout_event_ns,
        readout_row_ns: 4.0 * readout_event_ns,
        ..SensorModel::default()
    }
}

/// The sensor whose events come to the bus.
pub fn without_bus(sensor: &SensorModel) -> SensorModel {
    SensorModel {
        readout: ReadoutKind::None,
        readout_cap_events: 0,
        timestamp_quantum_ns: 1,
        ..sensor.clone()
    }
}

/// Pixels that go to a new random level with each frame, a few thresholds away: times without any order.
pub fn random(sensor: &SensorModel, frames: usize, thresholds: f64) -> Sequence {
    random_by_pixel(sensor, frames, |_| thresholds)
}

/// The same where each pixel goes as many thresholds away at most as `thresholds` says.
pub fn random_by_pixel(sensor: &SensorModel, frames: usize, thresholds: impl Fn(usize) -> f64) -> Sequence {
    gray(sensor, &times(-50_000_001, frames), |frame, pixel| {
        let [word, ..] = philox4x32_10([pixel as u32, frame as u32, 0, 0], [7, 0]);
        let level = f64::from(word) / f64::from(u32::MAX) * thresholds(pixel) * sensor.contrast_on;
        intensity_of(sensor, level - 1.0)
    })
}

/// Sequences with so many events in an interval, at about the same time; one pixel each.
pub fn few(sensor: &SensorModel, counts: &[usize]) -> Sequence {
    gray(sensor, &times(0, 1 + 2 * counts.len()), |frame, pixel| {
        // Every second interval is still.
        let level = |index: usize| if pixel < counts[index] { 1.5 * sensor.contrast_on } else { 0.0 };
        intensity_of(sensor, (0..frame.div_ceil(2)).map(level).sum::<f64>() - 3.0)
    })
}

/// What a queue lets out in an interval.
#[derive(Debug, PartialEq)]
pub struct Served {
    pub events: Vec<Event>,
    pub lost: u64,
    pub capped: u64,
    pub waiting: u64,
}

/// What a queue makes of the packets of the sensor without a bus.
pub fn queued(sensor: &SensorModel, sequence: &Sequence, arrivals: &[Step]) -> Vec<Served> {
    let mut queue = Queue::new(sensor.readout_model());
    let mut leaving: Vec<Event> = Vec::new();
    let quantum_ns = i64::from(sensor.timestamp_quantum_ns);
    let serve = |(step, frame): (&Step, &esaac_tests::frames::Frame)| {
        let arrived: Vec<Event> = step.packet.iter().collect();
        let served = queue.serve(&arrived, frame.t_ns);
        leaving.extend(served.events);
        let (out, later): (Vec<Event>, Vec<Event>) =
            std::mem::take(&mut leaving).into_iter().partition(|event| event.t_ns <= frame.t_ns);
        leaving = later;
        let mut events: Vec<Event> =
            out.into_iter().map(|e| Event { t_ns: quantise_ns(e.t_ns, quantum_ns), ..e }).collect();
        events.sort_unstable();
        let waiting = step.diagnostics.deferred_events + (queue.waiting() + leaving.len()) as u64;
        Served { events, lost: served.lost, capped: served.capped, waiting }
    };
    arrivals.iter().zip(&sequence.frames).map(serve).collect()
}

pub fn served(step: &Step) -> Served {
    Served {
        events: step.packet.iter().collect(),
        lost: step.diagnostics.lost_events,
        capped: step.diagnostics.capped_events,
        waiting: step.diagnostics.deferred_events,
    }
}

/// Runs the cameras with and without their buses, and holds the first against the queue. Returns what left the buses.
pub fn check(cameras: &[(SensorModel, Sequence)], options: RigOptions) -> Vec<Vec<Served>> {
    let plain: Vec<_> = cameras.iter().map(|(s, frames)| (without_bus(s), frames.clone())).collect();
    let arrivals = engine_of_many(&plain, options);
    let got = engine_of_many(cameras, options);
    assert_silent();
    let mut all = Vec::new();
    for (((sensor, sequence), arrivals), got) in cameras.iter().zip(&arrivals).zip(&got) {
        let expected = queued(sensor, sequence, arrivals);
        let got: Vec<Served> = got.iter().map(served).collect();
        let what = format!("{} {} ns", sensor.readout.name(), sensor.readout_event_ns);
        for (index, (got, expected)) in got.iter().zip(&expected).enumerate() {
            let counts = |s: &Served| (s.events.len(), s.lost, s.capped, s.waiting);
            assert_eq!(counts(got), counts(expected), "packet {index}, {what}");
            let first = got.events.iter().zip(&expected.events).position(|(a, b)| a != b);
            assert!(first.is_none(), "packet {index}, {what}: event {first:?} differs");
        }
        let sum = |count: fn(&Served) -> u64| got.iter().map(count).sum::<u64>();
        let left = sum(|s| s.events.len() as u64) + sum(|s| s.lost) + sum(|s| s.capped);
        let emitted = events(arrivals).len() as u64;
        let late = arrivals.last().map_or(0, |step| step.diagnostics.deferred_events);
        let waiting = got.last().map_or(0, |s| s.waiting);
        assert_eq!(left + waiting, emitted + late, "{what}: served, lost, capped and waiting add up");
        all.push(got);
    }
    all
}

/// Chunks of a packet one after the other, as on the software driver; side by side; as on GPUs, where the whole packet is
/// served at once if events hardly wait; and the same with a submission for each chunk.
pub fn orders() -> [RigOptions; 4] {
    let kernels = policy();
    let software = KernelPolicy::software_driver();
    let one_by_one = KernelPolicy {
        readout_threads: software.readout_threads,
        readout_rounds: software.readout_rounds,
        readout_dispatches: software.readout_dispatches,
        readout_light: false,
        readout_apart: false,
        ..kernels
    };
    let gpu = KernelPolicy::gpu();
    let side_by_side = KernelPolicy {
        readout_threads: gpu.readout_threads,
        // The software driver ends longer loops.
        readout_rounds: software.readout_rounds,
        readout_dispatches: gpu.readout_dispatches,
        readout_light: false,
        readout_apart: gpu.readout_apart,
        ..kernels
    };
    let at_once = KernelPolicy {
        readout_light: gpu.readout_light,
        sort_threads: gpu.sort_threads,
        group_bins: gpu.group_bins,
        ..side_by_side
    };
    let chunk_by_chunk = KernelPolicy { readout_rounds: 1, ..at_once };
    [one_by_one, side_by_side, at_once, chunk_by_chunk]
        .map(|policy| RigOptions { policy: Some(policy), ..RigOptions::default() })
}

/// The third of [`orders`].
pub fn at_once() -> RigOptions {
    let [_, _, at_once, _] = orders();
    at_once
}
