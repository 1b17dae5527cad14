//! The engine's side of the protocol, without sockets, memory or devices: which message may come when, and
//! which value a slot's timeline has next. Every message of a peer is checked here before it has any effect.

mod poses;
mod terms;

pub use terms::{Agreement, Terms, agree, hello};

use crate::error::InteropError;
use crate::frame_scene::FrameScene;
use crate::images::Images;
use crate::wire::{Brought, ErrorCode, FrameNotice, Message, WireError};
use esaac_model::{FrameError, frame};
use poses::Poses;

/// What a message asks of the engine.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Import the memory that came.
    Import(Brought),
    /// A frame is there, or will be at its value; with the poses of its interval, if those come.
    Queue(FrameNotice, Option<FrameScene>),
    /// Nothing yet: poses of a frame that will come.
    Nothing,
    /// No more frames will come.
    End,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The engine waits for the producer's memory.
    Bringing,
    Streaming,
    Ended,
}

/// One producer's connection after its first message.
#[derive(Clone, Debug)]
pub struct Session {
    camera: u32,
    images: Images,
    state: State,
    /// Value of each slot's timeline. It is even while the slot is the producer's.
    values: Vec<u64>,
    last_ns: Option<i64>,
    /// Poses of the next frame, if the producer gives them.
    poses: Option<Poses>,
}

/// Whether a frame that was told of with the value `told` is written, if its slot's timeline has `reached` a
/// value. A shared timeline says what its producer lets it say: a value beyond what was told is an error of
/// that producer.
pub fn is_written(slot: u32, told: u64, reached: u64) -> Result<bool, InteropError> {
    if reached > told {
        return Err(InteropError::Value { slot, expected: told, actual: reached });
    }
    Ok(reached == told)
}

/// Whether the engine may signal `value` on a slot's timeline that has `reached` a value: only right after
/// the producer's.
pub fn may_release(slot: u32, value: u64, reached: u64) -> Result<(), InteropError> {
    if reached.checked_add(1) == Some(value) {
        return Ok(());
    }
    Err(InteropError::Value { slot, expected: value - 1, actual: reached })
}

fn refused(code: ErrorCode, text: String) -> InteropError {
    InteropError::Refused { code, text }
}

impl Session {
    /// A connection that has agreed.
    #[must_use]
    pub fn new(terms: &Terms, agreement: Agreement) -> Self {
        Session {
            camera: terms.camera,
            images: terms.images_by(agreement),
            state: if agreement.brings() { State::Bringing } else { State::Streaming },
            values: vec![0; terms.slots as usize],
            last_ns: None,
            poses: agreement.geometry.then(|| Poses::new(terms.max_instances)),
        }
    }

    /// Checks a message that came with `fds` descriptors, and says what the engine must do.
    pub fn receive(&mut self, message: &Message, fds: usize) -> Result<Action, InteropError> {
        match (self.state, message) {
            (State::Bringing, Message::Brought(brought)) => {
                self.check_brought(brought, fds)?;
                self.state = State::Streaming;
                Ok(Action::Import(*brought))
            }
            (State::Streaming, Message::Frame(notice)) => {
                expect_fds("FRAME", 0, fds)?;
                self.check_frame(notice)?;
                let scene = self.scene(notice)?;
                self.values[notice.slot as usize] = notice.value;
                self.last_ns = Some(notice.t_ns);
                Ok(Action::Queue(*notice, scene))
            }
            (State::Streaming, Message::Poses(tracks)) => {
                expect_fds("POSES", 0, fds)?;
                let Some(poses) = &mut self.poses else {
                    let text = format!("POSES came, but camera {} takes no depth and poses", self.camera);
                    return Err(refused(ErrorCode::Protocol, text));
                };
                poses.add(tracks)?;
                Ok(Action::Nothing)
            }
            (State::Bringing | State::Streaming, Message::Bye(_)) => {
                expect_fds("BYE", 0, fds)?;
                self.state = State::Ended;
                Ok(Action::End)
            }
            (_, Message::Refusal(refusal)) => Err(InteropError::Refused {
                code: ErrorCode::from_number(refusal.code),
                text: format!("the producer says: {}", refusal.words()),
            }),
            (state, other) => {
                let when = match state {
                    State::Bringing => "while BROUGHT was awaited",
                    State::Streaming => "between frames",
                    State::Ended => "after BYE",
                };
                Err(refused(ErrorCode::Protocol, format!("{} came {when}", other.name())))
            }
        }
    }

    /// Gives a slot back to the producer and returns the next value of its timeline.
    ///
    /// # Panics
    /// If the slot is the producer's already: the engine gives back what it was given.
    pub fn release(&mut self, slot: u32) -> u64 {
        let value = &mut self.values[slot as usize];
        assert!(*value % 2 == 1, "slot {slot} is the producer's");
        *value += 1;
        *value
    }

    /// Number of slots that the engine holds.
    #[must_use]
    pub fn held(&self) -> usize {
        self.values.iter().filter(|value| *value % 2 == 1).count()
    }

    fn check_brought(&self, brought: &Brought, fds: usize) -> Result<(), InteropError> {
        expect_fds("BROUGHT", self.values.len() * self.images.count(), fds)?;
        let told = [brought.hdr, brought.motion, brought.depth, brought.ids];
        self.images.bytes().paired(told).named().try_for_each(|(image, &(bytes, memory))| {
            // An allocation is longer than its buffer by the driver's rounding, not by more.
            let most = (2 * bytes).max(4 << 20);
            if memory.bytes == bytes && (bytes..=most).contains(&memory.allocation_bytes) {
                return Ok(());
            }
            Err(refused(
                ErrorCode::Memory,
                format!(
                    "{image}: {} bytes in an allocation of {}, expected {bytes} in at most {most}",
                    memory.bytes, memory.allocation_bytes
                ),
            ))
        })
    }

    /// The poses that came for a frame, if they come.
    fn scene(&mut self, notice: &FrameNotice) -> Result<Option<FrameScene>, InteropError> {
        let came = self.poses.as_ref().map_or(0, Poses::samples);
        if notice.poses as usize != came {
            let text = format!("FRAME says that {} poses came for it, {came} did", notice.poses);
            return Err(refused(ErrorCode::Protocol, text));
        }
        let Some((poses, geometry)) = self.poses.as_mut().zip(self.images.geometry) else { return Ok(None) };
        poses.take(geometry.lens, self.last_ns.unwrap_or(notice.t_ns), notice.t_ns).map(Some)
    }

    fn check_frame(&self, notice: &FrameNotice) -> Result<(), InteropError> {
        let Some(&value) = self.values.get(notice.slot as usize) else {
            return Err(refused(
                ErrorCode::Protocol,
                format!("slot {}, expected less than {}", notice.slot, self.values.len()),
            ));
        };
        if value % 2 == 1 {
            return Err(refused(
                ErrorCode::Protocol,
                format!("slot {} holds a frame that the engine has not given back", notice.slot),
            ));
        }
        if notice.value != value + 1 {
            return Err(InteropError::Value { slot: notice.slot, expected: value + 1, actual: notice.value });
        }
        frame::check_time(self.camera, self.last_ns, notice.t_ns).map_err(|error| {
            let text = match error {
                // The producer can reset no camera.
                FrameError::Gap { camera, expected_ns, actual_ns } => format!(
                    "camera {camera}: gap of {actual_ns} ns since the previous frame, expected at most {expected_ns} ns; \
                     connect again to start anew"
                ),
                error => error.to_string(),
            };
            refused(ErrorCode::Time, text)
        })
    }
}

fn expect_fds(kind: &'static str, expected: usize, actual: usize) -> Result<(), InteropError> {
    if actual == expected { Ok(()) } else { Err(WireError::Descriptors { kind, expected, actual }.into()) }
}
