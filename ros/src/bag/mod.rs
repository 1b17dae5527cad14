//! Recordings as rosbag2 makes them: MCAP files with the profile `ros2`, messages in CDR, definitions in
//! full, and the quality of service that each topic was offered with.

mod reader;
mod writer;

pub use reader::{BagReader, RecordedMessage};
pub use writer::BagWriter;

use thiserror::Error;

/// Why a recording cannot be written or read.
#[derive(Debug, Error)]
pub enum BagError {
    /// The file cannot be made, written or read.
    #[error("recording {path}: {source}")]
    File {
        /// Path.
        path: String,
        /// Reason.
        source: std::io::Error,
    },
    /// It is no MCAP file, or a damaged one.
    #[error("recording {path}: {source}")]
    Format {
        /// Path.
        path: String,
        /// Reason.
        source: Box<mcap::McapError>,
    },
    /// Nothing in it is a message of ROS 2.
    #[error("recording {path} holds no message of ROS 2 (encoding `cdr`); it has: {}", found.join(", "))]
    Foreign {
        /// Path.
        path: String,
        /// Encodings that it has.
        found: Vec<String>,
    },
}

impl BagError {
    fn of(path: &str, error: mcap::McapError) -> Self {
        match error {
            mcap::McapError::Io(source) => BagError::File { path: path.to_owned(), source },
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
