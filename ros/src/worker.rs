//! The publisher's thread: sends ticks and records them, counts, and tells once a second how it goes.

use crate::bag::{BagError, BagWriter};
use crate::encode;
use crate::payload::{Payload, Release};
use crate::plan::Plan;
use crate::statistics::Statistics;
use crate::transport::Transport;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender};
use std::collections::VecDeque;
use std::sync::Arc;
use std::thread::JoinHandle;
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
    pub messages: Vec<Outgoing>,
    /// Tells when nobody holds one of them any more.
    pub release: Release,
}

/// What the thread works with.
pub(crate) struct Worker {
    pub plan: Arc<Plan>,
    pub node: String,
    pub transport: Option<Box<dyn Transport>>,
    pub bag: Option<BagWriter>,
    pub statistics: Arc<Statistics>,
    pub tell: Sender<String>,
    pub queue: Receiver<Batch>,
    /// A lossless rig is at most so many ticks ahead of its subscribers, so that one that is slow slows it
    /// down instead of being left behind.
    pub ticks_ahead: Option<usize>,
}

/// Time between diagnostics.
const DIAGNOSTICS: Duration = Duration::from_secs(1);

/// How long subscribers may take to fetch the last messages, where topics have no patience of their own.
const DRAIN: Duration = Duration::from_secs(2);

/// Starts it. It ends when nobody can queue any more.
pub(crate) fn start(worker: Worker) -> std::io::Result<JoinHandle<Result<(), BagError>>> {
    std::thread::Builder::new().name("ros publisher".to_owned()).spawn(move || worker.run())
}

impl Worker {
    fn run(mut self) -> Result<(), BagError> {
        let mut recording = Ok(());
        let mut told = Instant::now();
        let mut last: Option<(i64, u64)> = None;
        let mut ahead = VecDeque::new();
        loop {
            match self.queue.recv_timeout(DIAGNOSTICS.saturating_sub(told.elapsed())) {
                Ok(batch) => {
                    let log_ns = batch.messages.iter().map(|m| m.log_ns).max();
                    last = Some((batch.stamp_ns, log_ns.unwrap_or_default()));
                    for outgoing in &batch.messages {
                        self.send(outgoing, &mut recording);
                    }
                    self.flush();
                    self.statistics.count_tick(batch.encoded.elapsed());
                    drop(batch.messages);
                    ahead.push_back(batch.release);
                    self.keep_pace(&mut ahead);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if told.elapsed() >= DIAGNOSTICS {
                told = Instant::now();
                self.tell(last, &mut recording);
            }
        }
        self.tell(last, &mut recording);
        self.drain();
        match self.bag.take() {
            Some(bag) => recording.and(bag.finish()),
            None => recording,
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

    /// Waits where the ticks sent are too far `ahead` of what subscribers have. The last ones may be on their
    /// way meanwhile: a wait for all would take an answer's time, and what queues up in it would be sent at
    /// once, more than receive buffers hold.
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
            // All has been done for these.
            ahead.clear();
        }
    }

    /// Waits until subscribers have all, or have been given the time for it.
    fn drain(&mut self) {
        let patience = self.patience();
        if let Some(transport) = &mut self.transport {
            transport.drain(patience);
        }
    }

    fn send(&mut self, outgoing: &Outgoing, recording: &mut Result<(), BagError>) {
        if let Some(transport) = &mut self.transport {
            let started = Instant::now();
            let sent = transport.publish(outgoing.topic, &outgoing.message);
            self.statistics.count_sent(
                outgoing.topic,
                outgoing.message.len(),
                started.elapsed(),
                sent.is_ok(),
            );
        }
        if let Some(bag) = &mut self.bag {
            match bag.write(outgoing.topic, outgoing.log_ns, &outgoing.message) {
                Ok(()) => self.statistics.count_recorded(outgoing.topic),
                Err(error) => {
                    let _ = self.tell.send(format!("recording stopped: {error}"));
                    *recording = Err(error);
                    // What was written stays; subscribers go on getting what is sent.
                    self.bag = None;
                }
            }
        }
    }

    /// Diagnostics on the wire and in the bag, notices to whoever asks.
    fn tell(&mut self, last: Option<(i64, u64)>, recording: &mut Result<(), BagError>) {
        if let Some(transport) = &mut self.transport {
            for notice in transport.notices() {
                let _ = self.tell.send(notice);
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
        self.send(&Outgoing { topic: self.plan.diagnostics, log_ns, message }, recording);
        self.flush();
    }
}
