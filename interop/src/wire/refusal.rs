//! Why a connection is closed, in a code and in words.

use super::Header;
use bytemuck::{Pod, Zeroable};

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
    /// Poses that are none, or that do not span the frame's interval. Version 2.
    Poses = 13,
}

impl ErrorCode {
    /// All of them.
    pub const ALL: [ErrorCode; 14] = [
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
        ErrorCode::Poses,
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
