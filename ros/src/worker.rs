//! The publisher's thread: sends and records ticks, counts messages, and publishes diagnostics once a second.

use crate::bag::{BagError, BagWriter};
use crate::encode;
use crate::payload::{Payload, Release};
use crate::plan::Plan;
use crate::queue::{Batch, Outgoing, Popped, TickReceiver};
use crate::statistics::Statistics;
use crate::transport::Transport;
use crossbeam_channel::Sender;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What the thread works with.
pub(crate) struct Worker {
    pub plan: Arc<Plan>,
    pub node: String,
    pub transport: Option<Box<dyn Transport>>,
    pub bag: Option<BagWriter>,
    pub statistics: Arc<Statistics>,
    /// Where notices for the user go.
    pub notices: Sender<String>,
    pub queue: TickReceiver,
    /// The number of ticks that a lossless rig may be ahead of its subscribers. A slow subscriber then slows
    /// the rig down and misses nothing. `None` for a rig that never waits.
    pub ticks_ahead: Option<usize>,
    pub states: UnsentStates,
}

/// States that the transport refused. They are sent again before each tick and with the diagnostics, until
/// the transport takes them or a newer state of the same topic replaces them.
#[derive(Default)]
pub(crate) struct UnsentStates {
    by_topic: BTreeMap<usize, Arc<Payload>>,
    /// Topics, also of samples, whose failure the user has been told of.
    reported: BTreeSet<usize>,
}

/// Time between two diagnostics messages.
const DIAGNOSTICS: Duration = Duration::from_secs(1);

/// How long subscribers may take to fetch the last messages, if no topic is more patient.
const DRAIN: Duration = Duration::from_secs(2);

/// Starts the thread. It ends when the queue's sender is gone and every tick has been sent.
pub(crate) fn start(worker: Worker) -> std::io::Result<JoinHandle<Result<(), BagError>>> {
    std::thread::Builder::new().name("ros publisher".to_owned()).spawn(move || worker.run())
}

impl Worker {
    fn run(mut self) -> Result<(), BagError> {
        let mut recording = Ok(());
        let mut reported = Instant::now();
        // Stamp and recording's time of the furthest tick: one of a camera that is behind is older.
        let mut last: Option<(i64, u64)> = None;
        let mut ahead = VecDeque::new();
        loop {
            match self.queue.pop(DIAGNOSTICS.saturating_sub(reported.elapsed())) {
                Popped::Tick(batch) => {
                    let messages = batch.states.iter().chain(&batch.samples);
                    let log_ns = messages.map(|m| m.log_ns).max().unwrap_or_default();
                    if last.is_none_or(|(_, furthest_ns)| log_ns >= furthest_ns) {
                        last = Some((batch.stamp_ns, log_ns));
                    }
                    self.send_tick(&batch, &mut recording);
                    // `keep_pace` waits for the release of messages: this thread must not hold them.
                    drop((batch.states, batch.samples));
                    ahead.push_back(batch.release);
                    self.keep_pace(&mut ahead);
                }
                Popped::Nothing => {}
                Popped::Closed => break,
            }
            if reported.elapsed() >= DIAGNOSTICS {
                reported = Instant::now();
                self.report(last, &mut recording);
            }
        }
        self.send_states_again();
        for (topic, _) in std::mem::take(&mut self.states.by_topic) {
            self.statistics.count_failed(topic);
        }
        self.report(last, &mut recording);
        self.drain();
        match self.bag.take() {
            Some(bag) => {
                if bag.is_empty() {
                    let notice = format!("no message came: recording {} is not written", bag.path());
                    let _ = self.notices.send(notice);
                }
                recording.and(bag.finish())
            }
            None => recording,
        }
    }

    fn send_tick(&mut self, batch: &Batch, recording: &mut Result<(), BagError>) {
        for state in &batch.states {
            if self.states.by_topic.remove(&state.topic).is_some() {
                // The newer state replaces the one that could not be sent.
                self.statistics.count_failed(state.topic);
            }
        }
        self.send_states_again();
        for state in &batch.states {
            self.send_state(state.topic, &state.message);
        }
        for sample in &batch.samples {
            self.send_sample(sample);
        }
        // A recording is in the order of its times; inertial samples lie before the tick that brings them.
        let mut in_order: Vec<&Outgoing> = batch.states.iter().chain(&batch.samples).collect();
        in_order.sort_by_key(|message| message.log_ns);
        in_order.into_iter().for_each(|message| self.record(message, recording));
        self.flush();
        self.statistics.count_tick(batch.encoded.elapsed());
    }

    fn send_states_again(&mut self) {
        for (topic, message) in std::mem::take(&mut self.states.by_topic) {
            self.send_state(topic, &message);
        }
    }

    fn flush(&mut self) {
        if let Some(transport) = &mut self.transport {
            transport.flush();
        }
    }

    /// How long subscribers are waited for.
    fn patience(&self) -> Duration {
        self.plan.topics.iter().map(|topic| topic.patience).max().unwrap_or_default().max(DRAIN)
    }

    /// Waits if the sent ticks are too far `ahead` of what subscribers have. It waits for the oldest tick
    /// only: waiting for all of them would cost a round trip, and the ticks that queue up meanwhile would be
    /// sent in one burst, which is more than receive buffers hold.
    fn keep_pace(&mut self, ahead: &mut VecDeque<Release>) {
        let Some(most) = self.ticks_ahead else { return ahead.clear() };
        if ahead.len() < most {
            return;
        }
        let arrived = match self.transport.as_ref().is_none_or(|transport| transport.holds_messages()) {
            true => ahead.pop_front().is_some_and(|oldest| oldest.wait(self.patience())),
            false => {
                self.drain();
                false
            }
        };
        if !arrived {
            // The wait for these ticks is over, whether they arrived or not.
            ahead.clear();
        }
    }

    /// Waits until subscribers have all messages, or have had the time to fetch them.
    fn drain(&mut self) {
        let patience = self.patience();
        if let Some(transport) = &mut self.transport {
            transport.drain(patience);
        }
    }

    /// Sends a state, and keeps it for later if the transport refuses it.
    fn send_state(&mut self, topic: usize, message: &Arc<Payload>) {
        let Some(transport) = &mut self.transport else { return };
        let started = Instant::now();
        match transport.publish(topic, message) {
            Ok(()) => self.statistics.count_sent(topic, message.len(), started.elapsed()),
            Err(error) => {
                self.states.by_topic.insert(topic, Arc::clone(message));
                if self.states.reported.insert(topic) {
                    let _ = self.notices.send(format!("{error}; trying again until it is sent"));
                }
            }
        }
    }

    fn send_sample(&mut self, sample: &Outgoing) {
        let Some(transport) = &mut self.transport else { return };
        let started = Instant::now();
        match transport.publish(sample.topic, &sample.message) {
            Ok(()) => self.statistics.count_sent(sample.topic, sample.message.len(), started.elapsed()),
            Err(error) => {
                self.statistics.count_failed(sample.topic);
                if self.states.reported.insert(sample.topic) {
                    let _ = self.notices.send(format!("{error}; others of this topic are counted alone"));
                }
            }
        }
    }

    fn record(&mut self, outgoing: &Outgoing, recording: &mut Result<(), BagError>) {
        let Some(bag) = &mut self.bag else { return };
        match bag.write(outgoing.topic, outgoing.log_ns, &outgoing.message) {
            Ok(()) => self.statistics.count_recorded(outgoing.topic),
            Err(error) => {
                let _ = self.notices.send(format!("recording stopped: {error}"));
                *recording = Err(error);
                // The file keeps what was written; subscribers still get what is sent.
                self.bag = None;
            }
        }
    }

    /// Publishes and records diagnostics, and passes the transport's notices on.
    fn report(&mut self, last: Option<(i64, u64)>, recording: &mut Result<(), BagError>) {
        self.send_states_again();
        if let Some(transport) = &mut self.transport {
            for notice in transport.notices() {
                let _ = self.notices.send(notice);
            }
            self.statistics.set_wire_copies(transport.copies());
            for topic in 0..self.plan.topics.len() {
                self.statistics.set_subscribers(topic, transport.subscribers(topic));
            }
        }
        let Some((stamp_ns, log_ns)) = last else { return };
        let statuses = self.statistics.statuses(&self.plan, &self.node);
        let mut bytes = Vec::new();
        encode::diagnostics(&mut bytes, stamp_ns, "esaac", &statuses);
        let message = Arc::new(Payload::new(bytes));
        let diagnostics = Outgoing { topic: self.plan.diagnostics, log_ns, message };
        self.send_sample(&diagnostics);
        self.record(&diagnostics, recording);
        self.flush();
    }
}
