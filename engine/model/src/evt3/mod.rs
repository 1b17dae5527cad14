//! EVT3, the encoding of Prophesee's sensors: words of 16 bits, little-endian. The upper four bits are the kind:
//!
//! | kind | the other 12 bits |
//! |---|---|
//! | 0 | row, 11 bits |
//! | 2 | column, 11 bits, and polarity: an event |
//! | 3 | column, 11 bits, and polarity: where the next vector begins |
//! | 4, 5 | a vector: an event for each of 12 (8) columns whose bit is set; the next vector begins after them |
//! | 6, 8 | lower and upper 12 bits of the time in microseconds |
//! | 7, 10, 14, 15 | triggers, and what else is no event |
//!
//! An unchanged time or row is not repeated. [`Words`] and [`write_file`] write kinds 0, 2, 6 and 8; [`Decoder`] and
//! [`read_file`] read all.

mod read;
mod write;

pub use read::{Decoder, Evt3Error, Evt3File, read_file};
pub use write::{Words, write_file};

/// Largest number of rows or columns: a coordinate has 11 bits.
pub const SIDE_PX: u32 = 2048;

/// Kinds of words.
mod kind {
    pub const ROW: u16 = 0x0;
    pub const COLUMN: u16 = 0x2;
    pub const VECTOR_START: u16 = 0x3;
    pub const VECTOR_12: u16 = 0x4;
    pub const VECTOR_8: u16 = 0x5;
    pub const LOW: u16 = 0x6;
    pub const HIGH: u16 = 0x8;
    /// Triggers, other words, and how those go on.
    pub const NO_EVENTS: [u16; 4] = [0x7, 0xa, 0xe, 0xf];
}
