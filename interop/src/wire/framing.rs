//! From bytes to a message of the right shape, and back.

use super::{
    Brought, ErrorCode, FrameNotice, Header, Hello, MAGIC, MAX_BYTES, Refusal, Released, RingOffer, Track,
    Version, poses,
};
use bytemuck::Pod;
use thiserror::Error;

/// Bytes that are no message.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum WireError {
    /// Shorter than a header, or than its kind is.
    #[error("{kind} of {actual} bytes, expected {expected}")]
    Size {
        /// Which message.
        kind: &'static str,
        /// Its size.
        expected: usize,
        /// What came.
        actual: usize,
    },
    /// Not of this protocol.
    #[error("first word {actual:#010x}, expected {MAGIC:#010x}")]
    Magic {
        /// What came.
        actual: u32,
    },
    /// Of another version of it.
    #[error("protocol version {actual}, expected {expected}")]
    Version {
        /// What is spoken.
        expected: &'static str,
        /// What came.
        actual: u16,
    },
    /// No message of this number.
    #[error("message kind {actual}, expected 1 to {last}")]
    Kind {
        /// The last of this version.
        last: u16,
        /// What came.
        actual: u16,
    },
    /// Descriptors that are too few or too many.
    #[error("{kind} with {actual} descriptors, expected {expected}")]
    Descriptors {
        /// Which message.
        kind: &'static str,
        /// How many it must have.
        expected: usize,
        /// How many came.
        actual: usize,
    },
}

impl WireError {
    /// What the peer is told.
    #[must_use]
    pub fn code(&self) -> ErrorCode {
        match self {
            WireError::Version { .. } => ErrorCode::Version,
            _ => ErrorCode::Protocol,
        }
    }
}

/// A message of a fixed size in each version.
trait Body: Pod {
    /// A message of version 1 is the beginning of the same message of version 2: so many bytes.
    const BYTES_1: usize = size_of::<Self>();

    /// Clears what version 1 reserves.
    fn clear_reserved(&mut self) {}
}

impl Body for Hello {
    const BYTES_1: usize = 72;

    fn clear_reserved(&mut self) {
        self.gives = 0;
    }
}

impl Body for RingOffer {
    const BYTES_1: usize = 144;
}

impl Body for Brought {
    const BYTES_1: usize = 64;
}

impl Body for FrameNotice {
    fn clear_reserved(&mut self) {
        self.poses = 0;
    }
}

impl Body for Released {}
impl Body for Header {}
impl Body for Refusal {}

/// Bytes of a message in a version.
fn bytes_of<B: Body>(version: Version) -> usize {
    if version == Version::One { B::BYTES_1 } else { size_of::<B>() }
}

/// The body in `bytes`, whose length is right.
fn read<B: Body>(version: Version, bytes: &[u8]) -> B {
    let mut body = B::zeroed();
    bytemuck::bytes_of_mut(&mut body)[..bytes.len()].copy_from_slice(bytes);
    if version == Version::One {
        body.clear_reserved();
    }
    body
}

fn write<B: Body>(version: Version, mut body: B) -> Vec<u8> {
    if version == Version::One {
        body.clear_reserved();
    }
    bytemuck::bytes_of(&body)[..bytes_of::<B>(version)].to_vec()
}

impl Version {
    /// The version of the message in `bytes`.
    pub fn of(bytes: &[u8]) -> Result<Self, WireError> {
        let header = header(bytes)?;
        let (expected, actual) = ("1 or 2", header.version);
        Version::from_number(actual).ok_or(WireError::Version { expected, actual })
    }

    fn name(self) -> &'static str {
        match self {
            Version::One => "1",
            Version::Two => "2",
        }
    }
}

fn header(bytes: &[u8]) -> Result<Header, WireError> {
    let (expected, actual) = (size_of::<Header>(), bytes.len());
    let head = bytes.get(..expected).ok_or(WireError::Size { kind: "header", expected, actual })?;
    let header: Header = bytemuck::pod_read_unaligned(head);
    if header.magic == MAGIC { Ok(header) } else { Err(WireError::Magic { actual: header.magic }) }
}

/// Number of ERROR.
const ERROR: u16 = 8;
/// Number of POSES.
const POSES: u16 = 9;

macro_rules! messages {
    ($($(#[$doc:meta])* $variant:ident($body:ty) = $number:literal, $name:literal;)*) => {
        /// A message of the right shape.
        #[derive(Clone, Debug, PartialEq)]
        pub enum Message {
            $($(#[$doc])* $variant($body),)*
            /// Tracks for the next frame. Version 2.
            Poses(Vec<Track>),
        }

        impl Message {
            /// Name of the message.
            #[must_use]
            pub fn name(&self) -> &'static str {
                match self {
                    $(Message::$variant(_) => $name,)*
                    Message::Poses(_) => "POSES",
                }
            }

            /// The message with its header, for the socket.
            #[must_use]
            pub fn to_bytes(&self, version: Version, fds: usize) -> Vec<u8> {
                let (kind, mut sent) = match self {
                    $(Message::$variant(body) => ($number, write(version, *body)),)*
                    Message::Poses(tracks) => (POSES, poses::to_bytes(tracks)),
                };
                let (bytes, fds) = (sent.len() as u32, fds as u32);
                let header = Header { magic: MAGIC, version: version as u16, kind, bytes, fds };
                sent[..size_of::<Header>()].copy_from_slice(bytemuck::bytes_of(&header));
                sent
            }

            /// The message in `bytes`, with which so many descriptors came. It must be of the version that was
            /// agreed; an ERROR may be of any.
            pub fn parse(agreed: Version, bytes: &[u8], fds: usize) -> Result<Message, WireError> {
                let (version, header) = (Version::of(bytes)?, header(bytes)?);
                if version != agreed && header.kind != ERROR {
                    return Err(WireError::Version { expected: agreed.name(), actual: header.version });
                }
                let actual = bytes.len();
                // A message that lies about its size and has the right one says what it lies.
                let size = |kind, expected| match (actual, header.bytes as usize) {
                    (actual, told) if actual == expected && told == expected => Ok(()),
                    (actual, told) => {
                        let actual = if actual == expected { told } else { actual };
                        Err(WireError::Size { kind, expected, actual })
                    }
                };
                let (message, kind) = match header.kind {
                    $($number => {
                        size($name, bytes_of::<$body>(version))?;
                        (Message::$variant(read(version, bytes)), $name)
                    })*
                    POSES if version == Version::Two => {
                        size("POSES", actual.min(MAX_BYTES))?;
                        (Message::Poses(poses::parse(bytes)?), "POSES")
                    }
                    actual => {
                        let last = if version == Version::One { ERROR } else { POSES };
                        return Err(WireError::Kind { last, actual });
                    }
                };
                if header.fds as usize != fds {
                    return Err(WireError::Descriptors { kind, expected: header.fds as usize, actual: fds });
                }
                Ok(message)
            }
        }
    };
}

messages! {
    /// The producer's first.
    Hello(Hello) = 1, "HELLO";
    /// The engine's answer.
    Ring(RingOffer) = 2, "RING";
    /// The producer's memory.
    Brought(Brought) = 3, "BROUGHT";
    /// The engine has imported it.
    Accepted(Header) = 4, "ACCEPTED";
    /// A frame.
    Frame(FrameNotice) = 5, "FRAME";
    /// A slot is free.
    Released(Released) = 6, "RELEASED";
    /// The producer has no more frames.
    Bye(Header) = 7, "BYE";
    /// The end, by fault.
    Refusal(Refusal) = 8, "ERROR";
}

#[cfg(test)]
mod tests {
    use super::super::Sample;
    use super::*;

    fn messages() -> Vec<Message> {
        let frame = FrameNotice { slot: 2, value: 9, t_ns: -5, ..FrameNotice::default() };
        vec![
            Message::Hello(Hello { camera: 3, ..Hello::default() }),
            Message::Ring(RingOffer { slots: 4, ..RingOffer::default() }),
            Message::Brought(Brought::default()),
            Message::Accepted(Header::default()),
            Message::Frame(frame),
            Message::Released(Released { value: 10, ..Released::default() }),
            Message::Bye(Header::default()),
            Message::Refusal(Refusal::new(ErrorCode::Taken, "taken")),
            Message::Poses(vec![Track { instance: Some(3), samples: vec![Sample::default(); 2] }]),
        ]
    }

    #[test]
    fn every_message_reads_back_and_none_is_too_long() {
        for version in [Version::One, Version::Two] {
            for message in messages() {
                let bytes = message.to_bytes(version, 3);
                assert!(bytes.len() <= MAX_BYTES, "{} has {} bytes", message.name(), bytes.len());
                if (version, message.name()) == (Version::One, "POSES") {
                    let error = Message::parse(version, &bytes, 3).unwrap_err();
                    assert_eq!(error, WireError::Kind { last: 8, actual: 9 });
                    continue;
                }
                let parsed = Message::parse(version, &bytes, 3).unwrap();
                assert_eq!(parsed.to_bytes(version, 3), bytes);
                let few = Message::parse(version, &bytes, 2);
                assert!(matches!(few, Err(WireError::Descriptors { .. })));
                for end in 0..bytes.len() {
                    let cut = Message::parse(version, &bytes[..end], 3);
                    assert!(matches!(cut, Err(WireError::Size { .. })), "{end}");
                }
                let long = [&bytes[..], &[0]].concat();
                assert!(matches!(Message::parse(version, &long, 3), Err(WireError::Size { .. })));
            }
        }
        let mut other = Message::Bye(Header::default()).to_bytes(Version::One, 0);
        other[4] = 3;
        let unknown = WireError::Version { expected: "1 or 2", actual: 3 };
        assert_eq!(Message::parse(Version::One, &other, 0), Err(unknown));
        other[0] = 0;
        assert!(matches!(Message::parse(Version::One, &other, 0), Err(WireError::Magic { .. })));
    }

    #[test]
    fn a_message_of_another_version_than_agreed_is_refused_unless_it_says_why_it_ends() {
        for (agreed, other, expected) in
            [(Version::One, Version::Two, "1"), (Version::Two, Version::One, "2")]
        {
            for message in messages() {
                let bytes = message.to_bytes(other, 0);
                let read = Message::parse(agreed, &bytes, 0);
                if message.name() == "ERROR" {
                    assert_eq!(read.unwrap().to_bytes(other, 0), bytes);
                } else {
                    assert_eq!(read, Err(WireError::Version { expected, actual: other as u16 }));
                }
            }
        }
    }

    /// A peer of version 1 may have left anything in what version 1 reserves.
    #[test]
    fn what_version_1_reserves_says_nothing() {
        let frame = FrameNotice { slot: 1, poses: 77, ..FrameNotice::default() };
        let hello = Hello { camera: 1, gives: u32::MAX, ..Hello::default() };
        for (message, at) in [(Message::Frame(frame), 28), (Message::Hello(hello), 68)] {
            let mut bytes = message.to_bytes(Version::One, 0);
            assert_eq!(bytes[at..at + 4], [0; 4], "{}", message.name());
            bytes[at..at + 4].copy_from_slice(&[1, 2, 3, 4]);
            match Message::parse(Version::One, &bytes, 0).unwrap() {
                Message::Frame(frame) => assert_eq!((frame.slot, frame.poses), (1, 0)),
                Message::Hello(hello) => assert_eq!((hello.camera, hello.gives), (1, 0)),
                other => panic!("{other:?}"),
            }
        }
    }
}
