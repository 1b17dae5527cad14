//! Recordings in rosbag2's format: MCAP files with the profile `ros2`. They contain CDR messages, complete
//! definitions, and the quality of service that each topic offered.

mod late;
mod reader;
mod writer;

pub use reader::{BagReader, RecordedMessage};
pub use writer::BagWriter;

use thiserror::Error;

/// Why a recording cannot be written or read.
#[derive(Debug, Error)]
pub enum BagError {
    /// The file cannot be created, written or read.
    #[error("recording {path}: {source}")]
    File {
        /// Path.
        path: String,
        /// Reason.
        source: std::io::Error,
    },
    /// A record that cannot be read.
    #[error("recording {path} is damaged: {reason}")]
    Record {
        /// Path.
        path: String,
        /// Reason.
        reason: String,
    },
    /// The file is damaged or not an MCAP file.
    #[error("recording {path} is no MCAP file, or damaged: {source}")]
    Format {
        /// Path.
        path: String,
        /// Reason.
        source: Box<mcap::McapError>,
    },
    /// The bytes of a chunk are not those that were written. Its messages are not read.
    #[error(
        "recording {path} is damaged: a chunk has the checksum {actual:08x}, expected {expected:08x}; the messages \
         before it are whole"
    )]
    Checksum {
        /// Path.
        path: String,
        /// As the file says.
        expected: u32,
        /// Of the bytes in the file.
        actual: u32,
    },
    /// The file ends before its first message.
    #[error("recording {path} is cut off within its first chunk: no message of it can be read")]
    CutOff {
        /// Path.
        path: String,
    },
    /// The file has no ROS 2 messages.
    #[error("recording {path} holds no message of ROS 2 (encoding `cdr`); it has: {}", found.join(", "))]
    Foreign {
        /// Path.
        path: String,
        /// The encodings in it.
        found: Vec<String>,
    },
}

impl BagError {
    fn of(path: &str, error: mcap::McapError) -> Self {
        match error {
            mcap::McapError::Io(source) => BagError::File { path: path.to_owned(), source },
            mcap::McapError::BadChunkCrc { saved: expected, calculated: actual } => {
                BagError::Checksum { path: path.to_owned(), expected, actual }
            }
            // Its whole text is a drawing of many lines, in colours.
            mcap::McapError::Parse(error) => {
                BagError::Record { path: path.to_owned(), reason: error.root_cause().to_string() }
            }
            source => BagError::Format { path: path.to_owned(), source: Box::new(source) },
        }
    }
}

/// Encoding of messages.
const CDR: &str = "cdr";
/// Encoding of definitions.
const ROS2MSG: &str = "ros2msg";
/// Key under which rosbag2 keeps the quality of service.
const QOS_KEY: &str = "offered_qos_profiles";
/// Key under which rosbag2 keeps the type hash.
const HASH_KEY: &str = "topic_type_hash";
