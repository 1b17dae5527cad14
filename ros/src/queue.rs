//! The queue of ticks between the thread that simulates and the thread that publishes.
//!
//! Two kinds of messages wait in it. Samples (events, images, clock) are worth less the older they are, so a
//! full queue may drop a whole tick of them. States (`sensor`, `/tf_static`) are sent once and hold until the
//! next one: a dropped tick hands its states on to the tick behind it.

use crate::payload::{Payload, Release};
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// One encoded message.
pub(crate) struct Outgoing {
    pub topic: usize,
    /// Time in the bag.
    pub log_ns: u64,
    pub message: Arc<Payload>,
}

/// All messages of one tick.
pub(crate) struct Batch {
    pub stamp_ns: i64,
    /// When the last of them was encoded.
    pub encoded: Instant,
    /// Messages that must arrive, sent before the others.
    pub states: Vec<Outgoing>,
    /// Messages that a full queue may drop, in the order in which they are sent.
    pub samples: Vec<Outgoing>,
    /// Signals that nobody holds one of the messages any more.
    pub release: Release,
}

impl Batch {
    /// Takes over the states of an older tick. Of two states on one topic the newer one stays; the others are
    /// returned, as messages that nobody will send.
    fn inherit(&mut self, older: Vec<Outgoing>) -> Vec<Outgoing> {
        let replaced = |state: &Outgoing| self.states.iter().any(|own| own.topic == state.topic);
        let (replaced, mut kept): (Vec<_>, Vec<_>) = older.into_iter().partition(replaced);
        kept.append(&mut self.states);
        self.states = kept;
        replaced
    }
}

/// What a pop gave.
pub(crate) enum Popped {
    Tick(Batch),
    /// Nothing came in time.
    Nothing,
    /// The sender is gone and every tick has been taken.
    Closed,
}

struct Ticks {
    waiting: VecDeque<Batch>,
    sender_gone: bool,
    receiver_gone: bool,
}

struct Shared {
    capacity: usize,
    ticks: Mutex<Ticks>,
    changed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Ticks> {
        self.ticks.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn close(&self, close: impl FnOnce(&mut Ticks)) {
        close(&mut self.lock());
        self.changed.notify_all();
    }
}

/// The end that the simulation's thread has.
pub(crate) struct TickSender(Arc<Shared>);

/// The end that the publisher's thread has.
pub(crate) struct TickReceiver(Arc<Shared>);

/// A queue of at most `capacity` ticks.
pub(crate) fn queue(capacity: usize) -> (TickSender, TickReceiver) {
    let ticks = Ticks { waiting: VecDeque::new(), sender_gone: false, receiver_gone: false };
    let shared = Arc::new(Shared { capacity, ticks: Mutex::new(ticks), changed: Condvar::new() });
    (TickSender(Arc::clone(&shared)), TickReceiver(shared))
}

/// What a push cost.
#[derive(Default)]
pub(crate) struct Dropped {
    /// Ticks whose samples were dropped.
    pub ticks: u64,
    /// Messages that nobody will send.
    pub messages: Vec<Outgoing>,
}

impl TickSender {
    /// Adds a tick at once. A full queue drops the samples of its oldest ticks, and their states move on.
    pub fn push_latest(&self, mut batch: Batch) -> Dropped {
        let mut dropped = Dropped::default();
        let mut ticks = self.0.lock();
        while ticks.waiting.len() >= self.0.capacity {
            let Some(oldest) = ticks.waiting.pop_front() else { break };
            let next = ticks.waiting.front_mut().unwrap_or(&mut batch);
            dropped.ticks += 1;
            dropped.messages.extend(next.inherit(oldest.states));
            dropped.messages.extend(oldest.samples);
        }
        ticks.waiting.push_back(batch);
        drop(ticks);
        self.0.changed.notify_all();
        dropped
    }

    /// Adds a tick once there is room. Without a receiver there never will be, and the tick is dropped.
    pub fn push_waiting(&self, batch: Batch) -> Dropped {
        let full = |ticks: &mut Ticks| ticks.waiting.len() >= self.0.capacity && !ticks.receiver_gone;
        let waited = self.0.changed.wait_while(self.0.lock(), full);
        let mut ticks = waited.unwrap_or_else(PoisonError::into_inner);
        if ticks.receiver_gone {
            return Dropped { ticks: 1, messages: batch.states.into_iter().chain(batch.samples).collect() };
        }
        ticks.waiting.push_back(batch);
        drop(ticks);
        self.0.changed.notify_all();
        Dropped::default()
    }
}

impl TickReceiver {
    /// Takes the oldest tick, and waits for one at most so long.
    pub fn pop(&self, limit: Duration) -> Popped {
        let empty = |ticks: &mut Ticks| ticks.waiting.is_empty() && !ticks.sender_gone;
        let waited = self.0.changed.wait_timeout_while(self.0.lock(), limit, empty);
        let (mut ticks, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let popped = match ticks.waiting.pop_front() {
            Some(batch) => Popped::Tick(batch),
            None if ticks.sender_gone => Popped::Closed,
            None => Popped::Nothing,
        };
        drop(ticks);
        self.0.changed.notify_all();
        popped
    }
}

impl Drop for TickSender {
    fn drop(&mut self) {
        self.0.close(|ticks| ticks.sender_gone = true);
    }
}

impl Drop for TickReceiver {
    fn drop(&mut self) {
        self.0.close(|ticks| ticks.receiver_gone = true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::payload;

    const EVENTS: usize = 0;
    const SENSOR: usize = 1;
    const FRAMES: usize = 2;

    fn outgoing(topic: usize, tick: u8) -> Outgoing {
        Outgoing { topic, log_ns: tick.into(), message: Arc::new(Payload::new(vec![tick])) }
    }

    /// A tick with one sample and these states.
    fn tick(number: u8, states: &[usize]) -> Batch {
        Batch {
            stamp_ns: number.into(),
            encoded: Instant::now(),
            states: states.iter().map(|&topic| outgoing(topic, number)).collect(),
            samples: vec![outgoing(EVENTS, number)],
            release: payload::hold().1,
        }
    }

    /// Topic and tick of each message.
    type Names = Vec<(usize, u64)>;

    fn names(messages: &[Outgoing]) -> Names {
        messages.iter().map(|message| (message.topic, message.log_ns)).collect()
    }

    /// What is left in a queue whose sender is gone: states and samples of each tick.
    fn rest(receiver: &TickReceiver) -> Vec<(Names, Names)> {
        std::iter::from_fn(|| match receiver.pop(Duration::ZERO) {
            Popped::Tick(batch) => Some((names(&batch.states), names(&batch.samples))),
            Popped::Nothing => panic!("the sender is gone"),
            Popped::Closed => None,
        })
        .collect()
    }

    #[test]
    fn a_dropped_tick_hands_its_states_on_and_the_newest_of_a_topic_stays() {
        let (sender, receiver) = queue(2);
        let mut dropped = Vec::new();
        for batch in
            [tick(0, &[SENSOR, FRAMES]), tick(1, &[]), tick(2, &[SENSOR]), tick(3, &[]), tick(4, &[])]
        {
            let of_push = sender.push_latest(batch);
            assert!(of_push.ticks <= 1);
            dropped.extend(of_push.messages);
        }
        drop(sender);
        let expected = [(vec![(FRAMES, 0), (SENSOR, 2)], vec![(EVENTS, 3)]), (vec![], vec![(EVENTS, 4)])];
        assert_eq!(rest(&receiver), expected);
        assert_eq!(names(&dropped), [(EVENTS, 0), (SENSOR, 0), (EVENTS, 1), (EVENTS, 2)]);
    }

    #[test]
    fn a_queue_of_one_tick_keeps_states_too() {
        let (sender, receiver) = queue(1);
        sender.push_latest(tick(0, &[SENSOR]));
        assert_eq!(names(&sender.push_latest(tick(1, &[])).messages), [(EVENTS, 0)]);
        drop(sender);
        assert_eq!(rest(&receiver), [(vec![(SENSOR, 0)], vec![(EVENTS, 1)])]);
    }

    #[test]
    fn a_waiting_push_ends_when_there_is_room_or_nobody_to_make_it() {
        let (sender, receiver) = queue(1);
        assert_eq!(sender.push_waiting(tick(0, &[])).ticks, 0);
        let pushing = std::thread::spawn(move || {
            let dropped = [tick(1, &[SENSOR]), tick(2, &[FRAMES])].map(|batch| sender.push_waiting(batch));
            (dropped.each_ref().map(|d| d.ticks), names(&dropped[1].messages))
        });
        let Popped::Tick(first) = receiver.pop(Duration::from_secs(20)) else { panic!("no tick") };
        assert_eq!(names(&first.samples), [(EVENTS, 0)]);
        // The second tick has come; the third one waits until the receiver is gone.
        while receiver.0.lock().waiting.is_empty() {
            std::thread::yield_now();
        }
        drop(receiver);
        assert_eq!(pushing.join().unwrap(), ([0, 1], vec![(FRAMES, 2), (EVENTS, 2)]));
    }

    #[test]
    fn a_pop_waits_no_longer_than_it_may() {
        let (sender, receiver) = queue(1);
        assert!(matches!(receiver.pop(Duration::from_millis(1)), Popped::Nothing));
        drop(sender);
        assert!(matches!(receiver.pop(Duration::from_secs(20)), Popped::Closed));
    }
}
