//! The thread that serves the node: its parameter services and the ROS graph.

use ::rclrs::{Executor, ExecutorCommands, RclrsErrorFilter, SpinOptions};
use crossbeam_channel::{Receiver, Sender, unbounded};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Time between two attempts to stop the thread.
const LOOK: Duration = Duration::from_millis(5);

/// Spins the node until it is dropped.
pub struct Spinning {
    commands: Arc<ExecutorCommands>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    /// Errors of callbacks.
    pub errors: Receiver<String>,
}

impl Spinning {
    /// Starts the thread.
    pub fn start(mut executor: Executor) -> std::io::Result<Self> {
        let (commands, over) = (Arc::clone(executor.commands()), Arc::new(AtomicBool::new(false)));
        let (tell, errors) = unbounded();
        let stop = Arc::clone(&over);
        let spin = move || {
            while !stop.load(Ordering::Acquire) {
                spin_once(&mut executor, &tell);
            }
        };
        let thread = std::thread::Builder::new().name("ros executor".to_owned()).spawn(spin)?;
        Ok(Spinning { commands, over, thread: Some(thread), errors })
    }
}

fn spin_once(executor: &mut Executor, tell: &Sender<String>) {
    for error in executor.spin(SpinOptions::default()) {
        if let Err(error) = Err(error).ignore_non_errors() {
            let _ = tell.send(super::explain(&error));
        }
    }
}

impl Drop for Spinning {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        let Some(thread) = self.thread.take() else { return };
        // A halt between two rounds has no effect, so it is repeated.
        while !thread.is_finished() {
            self.commands.halt_spinning();
            std::thread::sleep(LOOK);
        }
        let _ = thread.join();
    }
}
