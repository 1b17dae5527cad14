//! Reads a recording from front to back. A recording whose writer was killed is read up to its last complete
//! chunk.

use super::{BagError, CDR, QOS_KEY, ROS2MSG};
use crate::definition::texts_of_schema;
use crate::plan::Topic;
use crate::qos::Qos;
use crate::type_hash::type_hash;
use mcap::records::{Channel, Record, SchemaHeader};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::Duration;

/// A recorded message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedMessage {
    /// Number of its topic in [`BagReader::topics`].
    pub topic: usize,
    /// Time of recording, nanoseconds.
    pub log_ns: u64,
    /// CDR bytes.
    pub bytes: Vec<u8>,
}

/// A longer record or chunk means that the file is damaged.
const MOST_BYTES: usize = 1 << 30;

struct Schema {
    name: String,
    encoding: String,
    text: String,
}

/// A recording that is being read.
pub struct BagReader {
    path: String,
    file: File,
    reader: LinearReader,
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, usize>,
    topics: Vec<Topic>,
    foreign: BTreeSet<String>,
    /// Whether the file has begun as the format does.
    has_record: bool,
    truncated: bool,
}

impl BagReader {
    /// Opens the file.
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let name = path.display().to_string();
        let file = File::open(path).map_err(|source| BagError::File { path: name.clone(), source })?;
        Ok(BagReader {
            path: name,
            file,
            reader: LinearReader::new_with_options(
                LinearReaderOptions::default()
                    .with_record_length_limit(MOST_BYTES)
                    .with_prevalidate_chunk_crcs(true),
            ),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            topics: Vec::new(),
            foreign: BTreeSet::new(),
            has_record: false,
            truncated: false,
        })
    }

    /// Topics read so far. A recording by this crate has all of them before its first message.
    #[must_use]
    pub fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// Encodings and topics of messages that were skipped because they are not ROS 2's.
    #[must_use]
    pub fn foreign(&self) -> Vec<String> {
        self.foreign.iter().cloned().collect()
    }

    /// Whether the end of the file is missing, because its writer was stopped.
    #[must_use]
    pub fn is_truncated(&self) -> bool {
        self.truncated
    }

    /// The error for a recording of which no ROS 2 message was read; `None` for one that holds none.
    pub(crate) fn without_messages(&self) -> Option<BagError> {
        let path = self.path.clone();
        if !self.foreign.is_empty() {
            return Some(BagError::Foreign { path, found: self.foreign() });
        }
        self.truncated.then_some(BagError::CutOff { path })
    }

    /// The next message; `None` at the end.
    pub fn next_message(&mut self) -> Result<Option<RecordedMessage>, BagError> {
        while let Some(event) = self.reader.next_event() {
            let record = match event.map_err(|error| BagError::of(&self.path, error))? {
                LinearReadEvent::ReadRequest(bytes) => {
                    let read = self.file.read(self.reader.insert(bytes));
                    let read = read.map_err(|source| BagError::File { path: self.path.clone(), source })?;
                    if read == 0 {
                        return self.cut_short();
                    }
                    self.reader.notify_read(read);
                    continue;
                }
                LinearReadEvent::Record { data, opcode } => mcap::parse_record(opcode, data)
                    .map_err(|error| BagError::of(&self.path, error))?
                    .into_owned(),
            };
            self.has_record = true;
            match record {
                Record::Schema { header, data } => self.add_schema(header, &data),
                Record::Channel(channel) => self.add_channel(channel),
                Record::Message { header, data } => {
                    if let Some(&topic) = self.channels.get(&header.channel_id) {
                        let (log_ns, bytes) = (header.log_time, data.into_owned());
                        return Ok(Some(RecordedMessage { topic, log_ns, bytes }));
                    }
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// The file ends before the format does.
    fn cut_short(&mut self) -> Result<Option<RecordedMessage>, BagError> {
        if !self.has_record {
            return Err(BagError::of(&self.path, mcap::McapError::UnexpectedEof));
        }
        self.truncated = true;
        Ok(None)
    }

    fn add_schema(&mut self, header: SchemaHeader, data: &[u8]) {
        let text = String::from_utf8_lossy(data).into_owned();
        self.schemas.insert(header.id, Schema { name: header.name, encoding: header.encoding, text });
    }

    fn add_channel(&mut self, channel: Channel) {
        if self.channels.contains_key(&channel.id) {
            return;
        }
        let schema = self.schemas.get(&channel.schema_id);
        let Some(schema) = schema.filter(|_| channel.message_encoding == CDR) else {
            self.foreign.insert(format!("`{}` on {}", channel.message_encoding, channel.topic));
            return;
        };
        // The type hash follows from a `.msg` definition, not from other languages.
        let hash = (schema.encoding == ROS2MSG)
            .then(|| type_hash(&schema.name, &texts_of_schema(&schema.name, &schema.text)).ok())
            .flatten();
        let qos = channel.metadata.get(QOS_KEY);
        let default = Qos::sensor_data(10);
        self.channels.insert(channel.id, self.topics.len());
        self.topics.push(Topic {
            name: channel.topic,
            type_name: schema.name.clone(),
            type_hash: hash,
            schema: schema.text.clone(),
            qos: qos.map_or(default, |yaml| default.with_rosbag_yaml(yaml)),
            patience: Duration::ZERO,
        });
    }
}
