//! Writes a recording.

use super::late::LateFile;
use super::{BagError, CDR, HASH_KEY, QOS_KEY, ROS2MSG};
use crate::plan::Topic;
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Size at which a chunk is closed.
const CHUNK_BYTES: u64 = 1 << 20;

/// File buffer: large enough for all definitions and for a chunk's index.
const BUFFER_BYTES: usize = 256 << 10;

/// Age at which a chunk is closed and handed to the system. A killed process loses younger messages only.
const CHUNK_AGE: Duration = Duration::from_secs(1);

/// A recording that is being written. Chunks are collected in memory and written as a whole, so the file is
/// always readable up to its last chunk. A file of the same name stays until the first chunk takes its place: a run that
/// fails before its first message leaves it as it was.
pub struct BagWriter {
    path: String,
    writer: Writer<BufWriter<LateFile>>,
    channels: Vec<(u16, u32)>,
    /// Whether a message has come.
    begun: Arc<AtomicBool>,
    /// When the last chunk was closed for its age, or the first message came.
    flushed: Option<Instant>,
}

impl BagWriter {
    /// Opens the file, or creates it. It is overwritten by the first chunk of messages, and removed again if it is new
    /// and none comes.
    pub fn create(path: &Path) -> Result<Self, BagError> {
        let name = path.display().to_string();
        let begun = Arc::new(AtomicBool::new(false));
        let file = LateFile::open(path, Arc::clone(&begun))
            .map_err(|source| BagError::File { path: name.clone(), source })?;
        let writer = WriteOptions::new()
            .profile("ros2")
            .library(concat!("esaac ", env!("CARGO_PKG_VERSION")))
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .create(BufWriter::with_capacity(BUFFER_BYTES, file))
            .map_err(|error| BagError::of(&name, error))?;
        Ok(BagWriter { path: name, writer, channels: Vec::new(), begun, flushed: None })
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Whether no message has come. Then nothing is written.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.begun.load(Ordering::Relaxed)
    }

    /// Adds a topic. Topics are numbered from 0 in this order.
    pub fn add_topic(&mut self, topic: &Topic) -> Result<(), BagError> {
        let fail = |error| BagError::of(&self.path, error);
        let schema =
            self.writer.add_schema(&topic.type_name, ROS2MSG, topic.schema.as_bytes()).map_err(fail)?;
        let mut metadata = BTreeMap::from([(QOS_KEY.to_owned(), topic.qos.to_rosbag_yaml())]);
        if let Some(hash) = &topic.type_hash {
            metadata.insert(HASH_KEY.to_owned(), hash.clone());
        }
        let channel = self.writer.add_channel(schema, &topic.name, CDR, &metadata).map_err(fail)?;
        self.channels.push((channel, 0));
        Ok(())
    }

    /// Adds a message on topic number `topic`. After an error the file ends with the last complete chunk.
    pub fn write(&mut self, topic: usize, log_ns: u64, message: &[u8]) -> Result<(), BagError> {
        let fail = |error| BagError::of(&self.path, error);
        self.begun.store(true, Ordering::Relaxed);
        let (channel_id, sequence) = &mut self.channels[topic];
        let header = MessageHeader {
            channel_id: *channel_id,
            sequence: *sequence,
            log_time: log_ns,
            publish_time: log_ns,
        };
        *sequence = sequence.wrapping_add(1);
        self.writer.write_to_known_channel(&header, message).map_err(fail)?;
        if self.flushed.get_or_insert_with(Instant::now).elapsed() >= CHUNK_AGE {
            self.flushed = Some(Instant::now());
            self.writer.flush().map_err(fail)?;
        }
        Ok(())
    }

    /// Writes the last chunk, the index and the summary. Without a message the file stays as it was.
    pub fn finish(mut self) -> Result<(), BagError> {
        self.writer.finish().map_err(|error| BagError::of(&self.path, error))?;
        // Bytes may be left in the file's buffer.
        let flushed = self.writer.into_inner().flush();
        flushed.map_err(|source| BagError::File { path: self.path, source })
    }
}
