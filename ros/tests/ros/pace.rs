//! How far a rig runs ahead of its subscribers, and how long it keeps their messages.

use crate::world::{self, Subscriber};
use esaac_ros::{Payload, Plan, Policy, RigOptions, Sinks, Topic, Transport, TransportError};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const INTERVAL_NS: i64 = 33_333_333;

#[test]
fn what_has_arrived_is_let_go_while_more_is_sent() {
    let domain = world::domain();
    let mut transport = world::transport(domain);
    let plan = Plan::new(&[world::camera("left", 32, 24)], &RigOptions::default()).unwrap();
    let topic = plan.topics.iter().find(|topic| topic.name.ends_with("/events")).unwrap();
    transport.advertise(topic).unwrap();
    let subscriber =
        Subscriber::on(domain).start(&[(topic.name.clone(), topic.type_name.clone(), "reliable")]);
    subscriber.wait_until_matched(1);
    let mut sent = Vec::new();
    let until = Instant::now() + world::PATIENCE;
    loop {
        let message = Arc::new(Payload::new(vec![sent.len() as u8; 100_000]));
        transport.publish(0, &message).unwrap();
        transport.flush();
        sent.push(message);
        // Never a tenth of a second without a message, as from a rig.
        std::thread::sleep(Duration::from_millis(20));
        let kept = sent.iter().take(40).filter(|message| Arc::strong_count(message) > 1).count();
        if sent.len() >= 60 && kept == 0 {
            break;
        }
        assert!(Instant::now() < until, "{kept} of the first 40 messages are held after {}", sent.len());
    }
    transport.drain(world::PATIENCE);
    let taken = world::taken(&subscriber.finish()).len();
    assert!((40..=sent.len()).contains(&taken), "{taken} of {} messages came", sent.len());
}

/// The messages that a transport holds, with their topics.
type Held = Arc<Mutex<Vec<(usize, Arc<Payload>)>>>;

/// A transport whose subscribers get a message when the test removes it.
struct Holding(Held);

impl Transport for Holding {
    fn name(&self) -> String {
        "holding".to_owned()
    }
    fn copies(&self) -> u32 {
        0
    }
    fn advertise(&mut self, _: &Topic) -> Result<(), TransportError> {
        Ok(())
    }
    fn publish(&mut self, topic: usize, message: &Arc<Payload>) -> Result<(), TransportError> {
        self.0.lock().unwrap().push((topic, Arc::clone(message)));
        Ok(())
    }
    fn subscribers(&self, _: usize) -> usize {
        1
    }
    fn notices(&mut self) -> Vec<String> {
        Vec::new()
    }
    fn drain(&mut self, _: Duration) {}
    fn holds_messages(&self) -> bool {
        true
    }
}

#[test]
fn a_lossless_rig_is_ahead_of_its_subscribers_by_its_queue_and_no_more() {
    let held = Held::default();
    let options = RigOptions { policy: Policy::Lossless, queue_ticks: 2, ..RigOptions::default() };
    let sinks = Sinks { transport: Some(Box::new(Holding(Arc::clone(&held)))), bag: None };
    let mut rig = world::rig(&[world::camera("left", 32, 24)], &options, sinks);
    let clock = rig.plan().topics.iter().position(|topic| topic.name == "/clock").unwrap();
    let ticks = || held.lock().unwrap().iter().filter(|(topic, _)| *topic == clock).count();
    let soon = |expected: usize| {
        world::wait_until(|| ticks() == expected, || format!("{} ticks, expected {expected}", ticks()));
        // And there it stays.
        std::thread::sleep(Duration::from_millis(100));
        assert_eq!(ticks(), expected);
    };
    (1..=4).for_each(|tick| rig.tick(tick * INTERVAL_NS).send());
    soon(2);
    // What is latched is held for good and does not count.
    let first = held.lock().unwrap().iter().position(|(topic, _)| *topic == clock).unwrap();
    drop(held.lock().unwrap().remove(first));
    soon(2);
    assert!(rig.summary().sent() >= 3, "two ticks are on their way again: {:?}", rig.summary());
    held.lock().unwrap().retain(|(topic, _)| *topic != clock);
    soon(1);
    held.lock().unwrap().retain(|(topic, _)| *topic != clock);
    let (summary, _, _) = rig.finish();
    let clocks = summary.topics.iter().find(|topic| topic.topic == "/clock").unwrap();
    assert_eq!((clocks.sent, summary.lost()), (4, 0));
}
