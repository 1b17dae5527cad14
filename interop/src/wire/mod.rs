//! Messages on the socket: plain structs in the machine's byte order, one a packet, descriptors beside
//! them. `include/esaac_interop.h` declares the same for C; `README.md` says who sends what when.
//!
//! Nothing that arrives is trusted: [`Message::parse`] gives a message whose kind, size, version and
//! number of descriptors are as they must be, and [`crate::session`] judges what it says.

mod framing;

pub use framing::{Message, WireError};

use bytemuck::{Pod, Zeroable};

/// First word of every message: "ESIP" in memory.
pub const MAGIC: u32 = u32::from_le_bytes(*b"ESIP");
/// Version of this protocol.
pub const VERSION: u16 = 1;
/// No message is longer.
pub const MAX_BYTES: usize = 280;
/// No message has more descriptors.
pub const MAX_FDS: usize = 3 * MAX_SLOTS as usize;
/// No ring has more slots.
pub const MAX_SLOTS: u32 = 16;
/// No motion images.
pub const NO_MOTION: u32 = u32::MAX;

/// A producer that has no Vulkan driver, but a device.
pub const NO_DRIVER: [u8; 16] = [0; 16];
/// A memory type that the peer leaves to the importer.
pub const ANY_MEMORY_TYPE: u32 = u32::MAX;

/// The engine exports the ring's memory by `OPAQUE_FD`.
pub const MEMORY_EXPORTED: u32 = 1;
/// The ring lies in anonymous files that both sides map.
pub const MEMORY_HOST: u32 = 2;
/// The producer exports the ring's memory by `OPAQUE_FD`.
pub const MEMORY_BROUGHT: u32 = 4;
/// The producer exports images of optimal tiling by `OPAQUE_FD`; the engine copies each once.
pub const MEMORY_IMAGES: u32 = 8;

/// Timeline values travel over the socket.
pub const TIMELINE_CARRIED: u32 = 1;
/// Timeline semaphores travel by `OPAQUE_FD`.
pub const TIMELINE_EXPORTED: u32 = 2;

/// Memories by name.
#[must_use]
pub fn memory_names(bits: u32) -> String {
    names(bits, &["EXPORTED", "HOST", "BROUGHT", "IMAGES"])
}

/// Timelines by name.
#[must_use]
pub fn timeline_names(bits: u32) -> String {
    names(bits, &["CARRIED", "EXPORTED"])
}

fn names(bits: u32, all: &[&str]) -> String {
    let named: Vec<&str> = (0..).zip(all).filter(|(bit, _)| bits & 1 << bit != 0).map(|(_, n)| *n).collect();
    if named.is_empty() { "none".to_owned() } else { named.join(", ") }
}

/// The producer waits for a free slot; every frame counts.
pub const LOSSLESS: u32 = 0;
/// The newest frame counts; older ones are dropped.
pub const LATEST: u32 = 1;

/// A frame that was stepped.
pub const STEPPED: u32 = 0;
/// A frame that a newer one has replaced.
pub const DROPPED: u32 = 1;

/// Beginning of every message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: u32,
    /// [`VERSION`].
    pub version: u16,
    /// Which message.
    pub kind: u16,
    /// Bytes of the whole message.
    pub bytes: u32,
    /// Descriptors beside it.
    pub fds: u32,
}

/// Memory of each of a ring's images of one kind.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct ImageMemory {
    /// Size of the buffer, or of the image's texels tightly packed.
    pub bytes: u64,
    /// Size of its memory: of the allocation, or of the file.
    pub allocation_bytes: u64,
    /// Vulkan memory type.
    pub memory_type: u32,
    /// `VkImageUsageFlags` of an image, on both sides; zero of a buffer.
    pub image_usage: u32,
}

/// Producer: I am this, and can do that.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Hello {
    /// Header.
    pub header: Header,
    /// `VkPhysicalDeviceIDProperties::deviceUUID`.
    pub device_uuid: [u8; 16],
    /// `VkPhysicalDeviceIDProperties::driverUUID`.
    pub driver_uuid: [u8; 16],
    /// Camera to feed.
    pub camera: u32,
    /// Columns that it renders, 0 for as the rig has it.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Memories that it can use, as bits.
    pub memories: u32,
    /// Timelines that it can use, as bits.
    pub timelines: u32,
    /// Zero.
    pub reserved: u32,
}

/// Engine: this is your ring. Descriptors: memory of each slot's images (unless the producer brings
/// them), then a timeline of each slot if those are exported.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct RingOffer {
    /// Header.
    pub header: Header,
    /// The engine's device.
    pub device_uuid: [u8; 16],
    /// Its driver.
    pub driver_uuid: [u8; 16],
    /// Camera.
    pub camera: u32,
    /// Cameras of the rig.
    pub cameras: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// `HdrFormat`.
    pub hdr_format: u32,
    /// `MotionFormat`, or [`NO_MOTION`].
    pub motion_format: u32,
    /// One of the memory bits.
    pub memory: u32,
    /// One of the timeline bits.
    pub timeline: u32,
    /// Slots.
    pub slots: u32,
    /// [`LOSSLESS`] or [`LATEST`].
    pub backpressure: u32,
    /// `VkBufferUsageFlags` of every buffer of the ring, on both sides.
    pub buffer_usage: u32,
    /// Zero.
    pub reserved: u32,
    /// Colour.
    pub hdr: ImageMemory,
    /// Motion; zero without.
    pub motion: ImageMemory,
}

/// Producer: here is the memory that I bring. Descriptors: each slot's images.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Brought {
    /// Header.
    pub header: Header,
    /// Colour.
    pub hdr: ImageMemory,
    /// Motion; zero without.
    pub motion: ImageMemory,
}

/// Producer: this slot holds, or will hold at this value, a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct FrameNotice {
    /// Header.
    pub header: Header,
    /// Slot.
    pub slot: u32,
    /// Copies on the device between what rendered the frame and the slot.
    pub device_copies: u32,
    /// Copies by way of the host.
    pub host_copies: u32,
    /// Zero.
    pub reserved: u32,
    /// Value of the slot's timeline when the frame is there: 2k + 1 for its k-th.
    pub value: u64,
    /// Time of the frame, nanoseconds.
    pub t_ns: i64,
}

/// Engine: this slot is yours again.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Released {
    /// Header.
    pub header: Header,
    /// Slot.
    pub slot: u32,
    /// [`STEPPED`] or [`DROPPED`].
    pub outcome: u32,
    /// Value of the slot's timeline: 2k + 2 after its k-th frame.
    pub value: u64,
}

/// Either: I close the connection, because of this.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
pub struct Refusal {
    /// Header.
    pub header: Header,
    /// [`ErrorCode`].
    pub code: u32,
    /// Bytes of text.
    pub text_bytes: u32,
    /// UTF-8.
    pub text: [u8; 256],
}

/// Why a connection is closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ErrorCode {
    /// Anything else.
    Internal = 0,
    /// A message that is none, or not now.
    Protocol = 1,
    /// Another version of the protocol.
    Version = 2,
    /// No camera of this number, or of another size.
    Camera = 3,
    /// The camera has a producer.
    Taken = 4,
    /// Another device or driver, and no memory that both can use.
    Device = 5,
    /// No memory or timeline that both can use.
    Unsupported = 6,
    /// Memory that is not what it must be.
    Memory = 7,
    /// A timeline value out of turn.
    Value = 8,
    /// A frame's time.
    Time = 9,
    /// Something that did not come.
    Timeout = 10,
    /// Another user's process.
    User = 11,
    /// More connections than the engine takes.
    Busy = 12,
}

impl ErrorCode {
    const ALL: [ErrorCode; 13] = [
        ErrorCode::Internal,
        ErrorCode::Protocol,
        ErrorCode::Version,
        ErrorCode::Camera,
        ErrorCode::Taken,
        ErrorCode::Device,
        ErrorCode::Unsupported,
        ErrorCode::Memory,
        ErrorCode::Value,
        ErrorCode::Time,
        ErrorCode::Timeout,
        ErrorCode::User,
        ErrorCode::Busy,
    ];

    /// The code of this number; unknown ones are internal.
    #[must_use]
    pub fn from_number(number: u32) -> Self {
        Self::ALL.into_iter().find(|code| *code as u32 == number).unwrap_or(ErrorCode::Internal)
    }
}

impl Refusal {
    /// With as much of the text as there is room for.
    #[must_use]
    pub fn new(code: ErrorCode, text: &str) -> Self {
        let mut refusal =
            Refusal { header: Header::default(), code: code as u32, text_bytes: 0, text: [0; 256] };
        let mut end = text.len().min(refusal.text.len());
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        refusal.text[..end].copy_from_slice(&text.as_bytes()[..end]);
        refusal.text_bytes = end as u32;
        refusal
    }

    /// The words on one line, fit for a terminal and a log, whatever a peer has put there: what cannot be
    /// printed is escaped, so that no text looks like another line or moves the cursor.
    #[must_use]
    pub fn words(&self) -> String {
        let end = (self.text_bytes as usize).min(self.text.len());
        printable(&String::from_utf8_lossy(&self.text[..end]))
    }
}

/// A text without characters that cannot be printed, cut where it becomes long by being escaped.
fn printable(text: &str) -> String {
    let mut printed = String::new();
    for character in text.chars() {
        match character {
            // Only within a string literal would these need it.
            '"' | '\'' => printed.push(character),
            _ => printed.extend(character.escape_debug()),
        }
        if printed.len() > MAX_PRINTED_BYTES {
            printed.push_str("...");
            break;
        }
    }
    printed
}

/// A text that is escaped becomes longer, but not much longer than this.
const MAX_PRINTED_BYTES: usize = 512;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_a_refusal_are_cut_between_characters() {
        let refusal = Refusal::new(ErrorCode::Time, &"\u{e9}".repeat(200));
        assert_eq!(refusal.words(), "\u{e9}".repeat(128));
        let lying = Refusal { text_bytes: u32::MAX, ..refusal };
        assert_eq!(lying.words().len(), 256);
    }

    #[test]
    fn words_of_a_refusal_are_one_bounded_line_of_printable_characters() {
        let quoted = "the camera's \"size\" of 3\u{b5}m";
        assert_eq!(Refusal::new(ErrorCode::Camera, quoted).words(), quoted);
        let hostile = "a\n\x1b[2Jb\r\0\u{202e}c\u{2028}\\";
        let words = Refusal::new(ErrorCode::Camera, hostile).words();
        assert_eq!(words, "a\\n\\u{1b}[2Jb\\r\\0\\u{202e}c\\u{2028}\\\\");
        for filler in ["\u{7f}", "\0", "\u{202e}", "\u{e0001}"] {
            let words = Refusal::new(ErrorCode::Camera, &filler.repeat(256)).words();
            assert!(words.len() <= MAX_PRINTED_BYTES + 16, "{} bytes", words.len());
            assert!(words.chars().all(|c| c.is_ascii_graphic()), "{words}");
        }
        // Bytes that are no text.
        let mut garbage = Refusal::new(ErrorCode::Camera, "");
        garbage.text = std::array::from_fn(|index| index as u8);
        garbage.text_bytes = 256;
        assert!(!garbage.words().chars().any(char::is_control), "{}", garbage.words());
    }

    #[test]
    fn codes_read_back_and_unknown_ones_are_internal() {
        for code in ErrorCode::ALL {
            assert_eq!(ErrorCode::from_number(code as u32), code);
        }
        assert_eq!(ErrorCode::from_number(4_000_000_000), ErrorCode::Internal);
    }
}
