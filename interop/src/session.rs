//! The engine's side of the protocol, without sockets, memory or devices: which message may come when, and
//! which value a slot's timeline has next. Every message of a peer is checked here before it has any effect.

use crate::error::InteropError;
use crate::ring::Images;
use crate::wire::{self, Brought, ErrorCode, FrameNotice, Hello, ImageMemory, Message, WireError};
use esaac_engine::{DeviceChoice, EngineError};
use esaac_model::frame;

/// Largest frame time to either side of zero. The sum or difference of two still fits into 64 bits.
const MAX_T_NS: i64 = 1 << 62;

/// What the engine offers for one camera, from its rig and its device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terms {
    /// Camera.
    pub camera: u32,
    /// Its images.
    pub images: Images,
    /// Slots of its ring.
    pub slots: u32,
    /// [`wire::LOSSLESS`] or [`wire::LATEST`].
    pub backpressure: u32,
    /// The engine's device.
    pub device_uuid: [u8; 16],
    /// Its driver.
    pub driver_uuid: [u8; 16],
    /// Memories that it can use, as bits.
    pub memories: u32,
    /// Timelines that it can use, as bits.
    pub timelines: u32,
}

/// What both sides will use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Agreement {
    /// One memory bit.
    pub memory: u32,
    /// One timeline bit.
    pub timeline: u32,
}

impl Agreement {
    /// Whether the producer hands over memory.
    #[must_use]
    pub fn brings(&self) -> bool {
        matches!(self.memory, wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES)
    }
}

/// What a message asks of the engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Import the memory that came.
    Import(Brought),
    /// A frame is there, or will be at its value.
    Queue(FrameNotice),
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

/// The first message of a connection must be this.
pub fn hello(message: &Message) -> Result<&Hello, InteropError> {
    match message {
        Message::Hello(hello) => Ok(hello),
        other => Err(refused(ErrorCode::Protocol, format!("{} came first, expected HELLO", other.name()))),
    }
}

/// Chooses the best memory and timeline that both sides have.
pub fn agree(hello: &Hello, terms: &Terms) -> Result<Agreement, InteropError> {
    let actual = (hello.width_px, hello.height_px);
    let expected = (terms.images.width_px, terms.images.height_px);
    if actual != (0, 0) && actual != expected {
        return Err(refused(
            ErrorCode::Camera,
            format!(
                "camera {} has {}x{} px in the rig, the producer renders {}x{} px",
                terms.camera, expected.0, expected.1, actual.0, actual.1
            ),
        ));
    }
    // CUDA names its device, but no Vulkan driver.
    let same_driver = hello.driver_uuid == terms.driver_uuid || hello.driver_uuid == wire::NO_DRIVER;
    let same_device = hello.device_uuid == terms.device_uuid && same_driver;
    let both = hello.memories & terms.memories;
    // The best first. A producer that offers its own memory renders there; any other would cost it a copy.
    let kinds = [wire::MEMORY_BROUGHT, wire::MEMORY_IMAGES, wire::MEMORY_EXPORTED, wire::MEMORY_HOST];
    let usable = |kind: &&u32| both & **kind != 0 && (same_device || **kind == wire::MEMORY_HOST);
    let Some(&memory) = kinds.iter().find(usable) else {
        return Err(if both == 0 {
            refused(
                ErrorCode::Unsupported,
                format!(
                    "memories: the producer has {}, the engine {}, none in common",
                    wire::memory_names(hello.memories),
                    wire::memory_names(terms.memories)
                ),
            )
        } else {
            refused(
                ErrorCode::Device,
                format!(
                    "the producer is on device {}, the engine on {}; start both on one device",
                    names(hello.device_uuid, hello.driver_uuid),
                    names(terms.device_uuid, terms.driver_uuid)
                ),
            )
        });
    };
    let shared = hello.timelines & terms.timelines;
    let timeline = if same_device && shared & wire::TIMELINE_EXPORTED != 0 {
        wire::TIMELINE_EXPORTED
    } else if shared & wire::TIMELINE_CARRIED != 0 {
        wire::TIMELINE_CARRIED
    } else {
        return Err(refused(
            ErrorCode::Unsupported,
            format!(
                "timelines: the producer has {}, the engine {}, none in common",
                wire::timeline_names(hello.timelines),
                wire::timeline_names(terms.timelines)
            ),
        ));
    };
    Ok(Agreement { memory, timeline })
}

/// UUID of a device, and of its driver if it has one, in words.
fn names(device: [u8; 16], driver: [u8; 16]) -> String {
    let device = DeviceChoice::Uuid(device);
    if driver == wire::NO_DRIVER {
        return device.to_string();
    }
    format!("{device} with driver {}", DeviceChoice::Uuid(driver))
}

impl Session {
    /// A connection that has agreed.
    #[must_use]
    pub fn new(terms: &Terms, agreement: Agreement) -> Self {
        Session {
            camera: terms.camera,
            images: terms.images,
            state: if agreement.brings() { State::Bringing } else { State::Streaming },
            values: vec![0; terms.slots as usize],
            last_ns: None,
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
                self.values[notice.slot as usize] = notice.value;
                self.last_ns = Some(notice.t_ns);
                Ok(Action::Queue(*notice))
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
        let check = |image: &'static str, memory: &ImageMemory, bytes: u64| {
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
        };
        check("hdr", &brought.hdr, self.images.hdr_bytes())?;
        match self.images.motion {
            Some(_) => check("motion", &brought.motion, self.images.motion_bytes()),
            None => Ok(()),
        }
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
        if !(-MAX_T_NS..=MAX_T_NS).contains(&notice.t_ns) {
            return Err(refused(
                ErrorCode::Time,
                format!("frame time {} ns, expected within +-{MAX_T_NS}", notice.t_ns),
            ));
        }
        frame::check_time(self.camera, self.last_ns, notice.t_ns)
            .map_err(|error| refused(ErrorCode::Time, EngineError::Frame(error).to_string()))
    }
}

fn expect_fds(kind: &'static str, expected: usize, actual: usize) -> Result<(), InteropError> {
    if actual == expected { Ok(()) } else { Err(WireError::Descriptors { kind, expected, actual }.into()) }
}
