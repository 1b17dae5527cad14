//! Messages that are sent once and then hold (`sensor`, `/tf_static`): subscribers get the newest of each,
//! however many ticks are dropped and however often the transport refuses to send.

use crate::world;
use esaac_model::SensorModel;
use esaac_ros::encode::{self, Header};
use esaac_ros::{
    Payload, Policy, RigOptions, RigPublisher, Sinks, Summary, Topic, TopicSummary, Transport, TransportError,
};
use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex};

const INTERVAL_NS: i64 = 33_333_333;

/// What a transport was asked to send: topic and bytes, in order.
type Sent = Arc<Mutex<Vec<(String, Vec<u8>)>>>;

/// A transport that waits in its first call until the test opens the gate, and refuses the first messages of
/// some topics.
struct Stalling {
    topics: Vec<String>,
    /// Messages that are refused yet, by the end of a topic's name.
    refusals: BTreeMap<&'static str, usize>,
    sent: Sent,
    gate: Gate,
}

/// Two switches: whether the transport has been called, and whether it may go on.
type Gate = Arc<(Mutex<(bool, bool)>, Condvar)>;

fn wait_until_called(gate: &Gate) {
    let (switches, changed) = &**gate;
    let waited =
        changed.wait_timeout_while(switches.lock().unwrap(), world::PATIENCE, |(called, _)| !*called);
    assert!(!waited.unwrap().1.timed_out(), "the publisher's thread sends nothing");
}

fn open(gate: &Gate) {
    gate.0.lock().unwrap().1 = true;
    gate.1.notify_all();
}

impl Transport for Stalling {
    fn name(&self) -> String {
        "stalling".to_owned()
    }
    fn copies(&self) -> u32 {
        0
    }
    fn advertise(&mut self, topic: &Topic) -> Result<(), TransportError> {
        self.topics.push(topic.name.clone());
        Ok(())
    }
    fn publish(&mut self, topic: usize, message: &Arc<Payload>) -> Result<(), TransportError> {
        let (switches, changed) = &*self.gate;
        let mut switches = switches.lock().unwrap();
        switches.0 = true;
        changed.notify_all();
        drop(changed.wait_while(switches, |(_, open)| !*open).unwrap());
        let name = &self.topics[topic];
        if let Some((_, left)) =
            self.refusals.iter_mut().find(|(end, left)| name.ends_with(*end) && **left > 0)
        {
            *left -= 1;
            return Err(TransportError::Message { topic: name.clone(), reason: "no buffers".to_owned() });
        }
        self.sent.lock().unwrap().push((name.clone(), message.to_vec()));
        Ok(())
    }
    fn subscribers(&self, _: usize) -> usize {
        0
    }
    fn notices(&mut self) -> Vec<String> {
        Vec::new()
    }
    fn drain(&mut self, _: std::time::Duration) {}
}

/// A rig with a queue of two ticks whose transport refuses these messages.
fn rig(policy: Policy, refusals: &[(&'static str, usize)]) -> (RigPublisher, Sent, Gate) {
    let (sent, gate) = (Sent::default(), Gate::default());
    let transport = Stalling {
        topics: Vec::new(),
        refusals: refusals.iter().copied().collect(),
        sent: Arc::clone(&sent),
        gate: Arc::clone(&gate),
    };
    let options = RigOptions { policy, queue_ticks: 2, ..RigOptions::default() };
    let sinks = Sinks { transport: Some(Box::new(transport)), bag: None };
    (world::rig(&[world::camera("left", 32, 24)], &options, sinks), sent, gate)
}

fn sensor(contrast_on: f64) -> SensorModel {
    SensorModel { contrast_on, ..world::camera("left", 32, 24).sensor }
}

/// ON thresholds of the sensors that were sent, in order.
fn thresholds(sent: &Sent) -> Vec<f64> {
    // All that follows the stamp.
    let body = |contrast_on: f64| {
        let mut bytes = Vec::new();
        let header = Header { stamp_ns: 0, frame_id: "esaac_left_optical_frame" };
        encode::sensor_model(&mut bytes, header, &sensor(contrast_on));
        bytes.split_off(12)
    };
    let known = [0.2, 0.3, 0.4].map(|contrast_on| (contrast_on, body(contrast_on)));
    let read = |bytes: &[u8]| known.iter().find(|(_, body)| bytes[12..] == *body).expect("a known sensor").0;
    let sent = sent.lock().unwrap();
    let sensors = sent.iter().filter(|(topic, _)| topic == "/esaac/left/sensor");
    sensors.map(|(_, bytes)| read(bytes)).collect()
}

fn of<'a>(summary: &'a Summary, topic: &str) -> &'a TopicSummary {
    summary.topics.iter().find(|t| t.topic == topic).unwrap()
}

#[test]
fn a_changed_sensor_is_told_though_its_tick_is_dropped() {
    let (mut rig, sent, gate) = rig(Policy::Latest, &[]);
    rig.tick(0).send();
    wait_until_called(&gate);
    // The publisher's thread stands in tick 0; ticks 1 to 7 are dropped, and with them these two sensors.
    for tick in 1..10 {
        match tick {
            1 => rig.set_sensor(0, &sensor(0.3)).unwrap(),
            4 => rig.set_sensor(0, &sensor(0.4)).unwrap(),
            _ => {}
        }
        rig.tick(tick * INTERVAL_NS).send();
    }
    open(&gate);
    let (summary, _, _) = rig.finish();
    assert_eq!(summary.dropped_ticks, 7);
    assert_eq!(thresholds(&sent), [0.2, 0.4], "the first, and the newest");
    // The one between was replaced by a newer one before it could be sent, which is counted.
    let counts = of(&summary, "/esaac/left/sensor");
    assert_eq!((counts.sent, counts.dropped, counts.failed), (2, 1, 0));
    assert_eq!((of(&summary, "/tf_static").sent, of(&summary, "/clock").dropped), (1, 7));
}

#[test]
fn a_sensor_and_the_frames_are_sent_again_until_the_transport_takes_them() {
    let (mut rig, sent, gate) = rig(Policy::Latest, &[("/sensor", 2), ("/tf_static", 1), ("/clock", 1)]);
    open(&gate);
    for tick in 0..3 {
        rig.tick(tick * INTERVAL_NS).send();
        // Each tick is sent before the next one is given.
        let sent = || {
            let summary = rig.summary();
            let clock = of(&summary, "/clock");
            clock.sent + clock.failed
        };
        world::wait_until(|| sent() > tick as u64, || format!("{:?}", rig.summary()));
    }
    let (summary, notices, _) = rig.finish();
    assert_eq!(thresholds(&sent), [0.2]);
    let (sensor, frames) = (of(&summary, "/esaac/left/sensor"), of(&summary, "/tf_static"));
    assert_eq!((sensor.sent, sensor.failed, frames.sent, frames.failed), (1, 0, 1, 0));
    assert_eq!(of(&summary, "/clock").failed, 1, "what passes is not sent again");
    let told = notices.iter().filter(|notice| notice.contains("/esaac/left/sensor")).count();
    assert_eq!(told, 1, "it is told once: {notices:?}");
    assert!(notices.iter().any(|notice| notice.contains("no buffers")), "{notices:?}");
}

#[test]
fn a_newer_sensor_replaces_one_that_could_not_be_sent() {
    let (mut rig, sent, gate) = rig(Policy::Latest, &[("/sensor", 1)]);
    rig.tick(0).send();
    wait_until_called(&gate);
    rig.set_sensor(0, &sensor(0.3)).unwrap();
    rig.tick(INTERVAL_NS).send();
    open(&gate);
    let (summary, _, _) = rig.finish();
    assert_eq!(thresholds(&sent), [0.3]);
    let counts = of(&summary, "/esaac/left/sensor");
    assert_eq!((counts.sent, counts.failed), (1, 1));
}

#[test]
fn the_reason_of_lost_samples_is_told_once_a_topic() {
    let (mut rig, _, gate) = rig(Policy::Lossless, &[("/clock", 3)]);
    open(&gate);
    for tick in 0..5 {
        rig.tick(tick * INTERVAL_NS).send();
    }
    let (summary, notices, _) = rig.finish();
    let clock = of(&summary, "/clock");
    assert_eq!((clock.sent, clock.failed), (2, 3));
    let reasons: Vec<&String> = notices.iter().filter(|notice| notice.contains("`/clock`")).collect();
    assert_eq!(reasons.len(), 1, "{notices:?}");
    assert!(reasons[0].contains("no buffers"), "{reasons:?}");
    assert!(summary.to_text().contains("0 dropped in 0 ticks, 3 failed"), "{}", summary.to_text());
}

#[test]
fn what_the_transport_never_takes_is_counted_as_lost() {
    let (mut rig, sent, gate) = rig(Policy::Lossless, &[("/sensor", usize::MAX)]);
    open(&gate);
    (0..3).for_each(|tick| rig.tick(tick * INTERVAL_NS).send());
    let (summary, notices, _) = rig.finish();
    assert_eq!(thresholds(&sent), [0.0; 0]);
    assert_eq!((of(&summary, "/esaac/left/sensor").failed, summary.lost()), (1, 1));
    assert!(notices.iter().any(|notice| notice.contains("/esaac/left/sensor")), "{notices:?}");
}

#[test]
fn a_tick_that_is_given_up_before_it_is_sent_leaves_its_sensor_to_the_next_one() {
    let (mut rig, sent, gate) = rig(Policy::Lossless, &[]);
    open(&gate);
    drop(rig.tick(0));
    rig.tick(INTERVAL_NS).send();
    let (summary, _, _) = rig.finish();
    assert_eq!(thresholds(&sent), [0.2]);
    assert_eq!((of(&summary, "/tf_static").sent, summary.lost()), (1, 0));
}
