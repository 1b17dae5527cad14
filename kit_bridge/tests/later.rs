//! Steps on a thread of their own, without Python and a device.

#[path = "../src/later.rs"]
mod later;

/// Stand-ins for what a step works with.
mod bank {
    pub struct Frames;
}

mod error {
    #[derive(Debug)]
    pub enum Fault {
        Device(String),
        Argument(String),
    }
}

mod state {
    #[derive(Debug, PartialEq)]
    pub struct Events(pub u32);
}

use error::Fault;
use later::{Done, Later};
use state::Events;

fn done(events: u32) -> Done {
    Done { frames: None, events: Ok(Events(events)) }
}

#[test]
fn after_a_step_that_panics_the_next_one_runs() {
    let mut later = Later::default();
    for number in 0..3 {
        later.submit(|| panic!("as a step might")).expect("a thread");
        let failed = later.take().expect("a step was submitted");
        assert!(failed.frames.is_none());
        assert!(matches!(failed.events, Err(Fault::Device(message)) if message.contains("failed")));
        later.submit(move || done(number)).expect("a thread");
        assert!(matches!(later.check_taken(), Err(Fault::Argument(message)) if message.contains("taken")));
        assert_eq!(later.take().expect("a step was submitted").events.expect("its events"), Events(number));
    }
    assert!(later.check_taken().is_ok() && later.take().is_err());
}
