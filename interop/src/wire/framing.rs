//! From bytes to a message of the right shape, and back.

use super::{Brought, ErrorCode, FrameNotice, Header, Hello, MAGIC, Refusal, Released, RingOffer, VERSION};
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
    #[error("protocol version {actual}, expected {VERSION}")]
    Version {
        /// What came.
        actual: u16,
    },
    /// No message of this number.
    #[error("message kind {actual}, expected 1 to 8")]
    Kind {
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

macro_rules! messages {
    ($($(#[$doc:meta])* $variant:ident($body:ty) = $number:literal, $name:literal;)*) => {
        /// A message of the right shape.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Message {
            $($(#[$doc])* $variant($body),)*
        }

        impl Message {
            /// Name of the message.
            #[must_use]
            pub fn name(&self) -> &'static str {
                match self { $(Message::$variant(_) => $name,)* }
            }

            /// The message with its header, for the socket.
            #[must_use]
            pub fn to_bytes(&self, fds: usize) -> Vec<u8> {
                match *self {
                    $(Message::$variant(mut body) => {
                        let bytes = size_of::<$body>() as u32;
                        let header =
                            Header { magic: MAGIC, version: VERSION, kind: $number, bytes, fds: fds as u32 };
                        bytemuck::bytes_of_mut(&mut body)[..size_of::<Header>()]
                            .copy_from_slice(bytemuck::bytes_of(&header));
                        bytemuck::bytes_of(&body).to_vec()
                    })*
                }
            }

            /// The message in `bytes`, with which so many descriptors came.
            pub fn parse(bytes: &[u8], fds: usize) -> Result<Message, WireError> {
                let actual = bytes.len();
                let expected = size_of::<Header>();
                let head = bytes.get(..expected).ok_or(WireError::Size { kind: "header", expected, actual })?;
                let header: Header = bytemuck::pod_read_unaligned(head);
                if header.magic != MAGIC {
                    return Err(WireError::Magic { actual: header.magic });
                }
                if header.version != VERSION {
                    return Err(WireError::Version { actual: header.version });
                }
                let (message, kind) = match header.kind {
                    $($number => {
                        let expected = size_of::<$body>();
                        if actual != expected || header.bytes as usize != expected {
                            let actual = if actual == expected { header.bytes as usize } else { actual };
                            return Err(WireError::Size { kind: $name, expected, actual });
                        }
                        (Message::$variant(bytemuck::pod_read_unaligned(bytes)), $name)
                    })*
                    actual => return Err(WireError::Kind { actual }),
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
    use super::super::MAX_BYTES;
    use super::*;

    #[test]
    fn every_message_reads_back_and_none_is_too_long() {
        let frame = FrameNotice { slot: 2, value: 9, t_ns: -5, ..FrameNotice::default() };
        let messages = [
            Message::Hello(Hello { camera: 3, ..Hello::default() }),
            Message::Ring(RingOffer { slots: 4, ..RingOffer::default() }),
            Message::Brought(Brought::default()),
            Message::Accepted(Header::default()),
            Message::Frame(frame),
            Message::Released(Released { value: 10, ..Released::default() }),
            Message::Bye(Header::default()),
            Message::Refusal(Refusal::new(ErrorCode::Taken, "taken")),
        ];
        for message in messages {
            let bytes = message.to_bytes(3);
            assert!(bytes.len() <= MAX_BYTES, "{} has {} bytes", message.name(), bytes.len());
            let parsed = Message::parse(&bytes, 3).unwrap();
            assert_eq!(parsed.to_bytes(3), bytes);
            assert!(matches!(Message::parse(&bytes, 2), Err(WireError::Descriptors { .. })));
            for end in 0..bytes.len() {
                assert!(matches!(Message::parse(&bytes[..end], 3), Err(WireError::Size { .. })), "{end}");
            }
            let long = [&bytes[..], &[0]].concat();
            assert!(matches!(Message::parse(&long, 3), Err(WireError::Size { .. })));
        }
        let mut other = Message::Bye(Header::default()).to_bytes(0);
        other[4] = 2;
        assert_eq!(Message::parse(&other, 0), Err(WireError::Version { actual: 2 }));
        other[0] = 0;
        assert!(matches!(Message::parse(&other, 0), Err(WireError::Magic { .. })));
    }
}
