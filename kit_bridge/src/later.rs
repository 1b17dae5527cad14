//! The second half of a step, on a thread of its own: the caller goes on meanwhile and asks for the packets later.

use crate::bank::Frames;
use crate::error::Fault;
use crate::state::Events;
use std::sync::mpsc::{Receiver, Sender, channel};

type Job = Box<dyn FnOnce() -> Done + Send>;

/// The end of a step.
pub struct Done {
    /// Its arrays, which the engine has read by now.
    pub frames: Option<Frames>,
    /// Its packets.
    pub events: Result<Events, Fault>,
}

/// The steps that were submitted: at most one, under way or done, until its packets are taken.
#[derive(Default)]
pub struct Later {
    thread: Option<Sender<(Job, Sender<Done>)>>,
    running: Option<Receiver<Done>>,
    done: Option<Done>,
}

impl Later {
    /// Waits for a step that is under way.
    pub fn wait(&mut self) {
        let Some(running) = self.running.take() else { return };
        self.done = Some(running.recv().unwrap_or_else(|_| {
            // A job that panics ends its thread. The next one gets another.
            self.thread = None;
            let events = Err(Fault::Device("the thread of a submitted step failed".to_owned()));
            Done { frames: None, events }
        }));
    }

    /// Fails if the packets of a submitted step were not taken.
    pub fn check_taken(&self) -> Result<(), Fault> {
        if self.running.is_none() && self.done.is_none() {
            return Ok(());
        }
        let message =
            "the packets of the step that was submitted have not been taken, expected packet() first";
        Err(Fault::Argument(message.to_owned()))
    }

    /// Starts the thread, if there is none.
    pub fn prepare(&mut self) -> Result<(), Fault> {
        if self.thread.is_none() {
            self.thread =
                Some(start().map_err(|error| Fault::Device(format!("no thread for a step: {error}")))?);
        }
        Ok(())
    }

    /// Runs `job` on the thread.
    pub fn submit(&mut self, job: impl FnOnce() -> Done + Send + 'static) -> Result<(), Fault> {
        self.prepare()?;
        let (done, running) = channel();
        let thread = self.thread.as_ref().expect("it was started");
        let failed = |_| Fault::Device("the thread of submitted steps has ended".to_owned());
        thread.send((Box::new(job), done)).map_err(failed)?;
        self.running = Some(running);
        Ok(())
    }

    /// The step that was submitted last, once it is done.
    pub fn take(&mut self) -> Result<Done, Fault> {
        self.wait();
        self.done
            .take()
            .ok_or_else(|| Fault::Argument("no step was submitted, expected submit() first".to_owned()))
    }
}

/// Starts a thread that runs jobs until nobody can send any.
fn start() -> std::io::Result<Sender<(Job, Sender<Done>)>> {
    let (jobs, given) = channel::<(Job, Sender<Done>)>();
    std::thread::Builder::new().name("esaac step".to_owned()).spawn(move || {
        for (job, done) in given {
            // Nobody waits if the cameras were closed meanwhile.
            let _ = done.send(job());
        }
    })?;
    Ok(jobs)
}
