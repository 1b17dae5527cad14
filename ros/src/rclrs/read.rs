//! Reads CDR, as far as ROS 2 messages need it.

use bytemuck::{AnyBitPattern, NoUninit, cast_slice_mut};
use thiserror::Error;

/// Why bytes are not a message of the expected type.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ReadError {
    /// The encoding is not little-endian CDR.
    #[error("the encoding is {0:?}, expected little-endian CDR [0, 1]")]
    Encoding(Vec<u8>),
    /// The message is too short.
    #[error("the message ends at byte {end}, expected {expected} bytes more from byte {at}")]
    End {
        /// Length of the message.
        end: usize,
        /// Offset of the value.
        at: usize,
        /// Size of the value.
        expected: usize,
    },
    /// A value is invalid.
    #[error("byte {at} is no {expected}")]
    Value {
        /// Offset of the value.
        at: usize,
        /// What it should be.
        expected: &'static str,
    },
    /// A sequence has more elements than its type allows.
    #[error("{actual} elements, expected at most {expected}")]
    Bound {
        /// Bound.
        expected: usize,
        /// Number of elements.
        actual: usize,
    },
}

/// Size of the header. Alignment counts from its end.
const HEADER_BYTES: usize = 4;

/// Reads fields in order.
pub struct CdrReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> CdrReader<'a> {
    /// Starts behind the header of `bytes`.
    pub fn new(bytes: &'a [u8]) -> Result<Self, ReadError> {
        match bytes.get(..HEADER_BYTES) {
            Some([0, 1, ..]) => Ok(CdrReader { bytes, at: HEADER_BYTES }),
            other => Err(ReadError::Encoding(other.unwrap_or(bytes).to_vec())),
        }
    }

    /// The next `count` bytes from the next multiple of `alignment`.
    fn take(&mut self, count: usize, alignment: usize) -> Result<&'a [u8], ReadError> {
        let at = HEADER_BYTES + (self.at - HEADER_BYTES).next_multiple_of(alignment);
        let end = self.bytes.len();
        let taken = at.checked_add(count).and_then(|until| self.bytes.get(at..until));
        let taken = taken.ok_or(ReadError::End { end, at, expected: count })?;
        self.at = at + count;
        Ok(taken)
    }

    /// A number.
    pub fn number<T: AnyBitPattern>(&mut self) -> Result<T, ReadError> {
        let bytes = self.take(size_of::<T>(), size_of::<T>())?;
        Ok(bytemuck::pod_read_unaligned(bytes))
    }

    /// `bool`.
    pub fn bool(&mut self) -> Result<bool, ReadError> {
        match self.take(1, 1)?[0] {
            value @ 0..=1 => Ok(value == 1),
            _ => Err(ReadError::Value { at: self.at - 1, expected: "bool" }),
        }
    }

    /// The numbers of an array or a sequence.
    pub fn numbers<T: AnyBitPattern + NoUninit>(&mut self, out: &mut [T]) -> Result<(), ReadError> {
        if !out.is_empty() {
            let bytes = self.take(size_of_val(out), size_of::<T>())?;
            cast_slice_mut(out).copy_from_slice(bytes);
        }
        Ok(())
    }

    /// The length of a sequence whose elements have at least `element_bytes`. A length that does not fit into
    /// the rest of the message is an error, so that nobody allocates memory for it.
    pub fn length(&mut self, element_bytes: usize) -> Result<usize, ReadError> {
        let length = self.number::<u32>()? as usize;
        let (end, expected) = (self.bytes.len(), length.saturating_mul(element_bytes));
        if expected > end - self.at {
            return Err(ReadError::End { end, at: self.at, expected });
        }
        Ok(length)
    }

    /// `string`.
    pub fn string(&mut self) -> Result<&'a str, ReadError> {
        let length = self.length(1)?;
        let at = self.at;
        let bytes = self.take(length, 1)?;
        // Some writers send empty strings without the closing zero.
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        match std::str::from_utf8(text) {
            Ok(text) if !text.contains('\0') => Ok(text),
            _ => Err(ReadError::Value { at, expected: "text in UTF-8" }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::CdrWriter;

    #[test]
    fn what_was_written_is_read() {
        let mut out = Vec::new();
        CdrWriter::new(&mut out)
            .u8(7)
            .f64s(&[0.5, -1.0])
            .string("ab")
            .bool(true)
            .sequence(&[3_u16, 4])
            .i64(-9);
        let mut cdr = CdrReader::new(&out).unwrap();
        let mut pair = [0.0; 2];
        assert_eq!(cdr.number::<u8>(), Ok(7));
        cdr.numbers(&mut pair).unwrap();
        assert_eq!((pair, cdr.string(), cdr.bool()), ([0.5, -1.0], Ok("ab"), Ok(true)));
        let mut values = vec![0_u16; cdr.length(2).unwrap()];
        cdr.numbers(&mut values).unwrap();
        assert_eq!((values, cdr.number::<i64>()), (vec![3, 4], Ok(-9)));
        assert_eq!(cdr.number::<u8>(), Err(ReadError::End { end: out.len(), at: out.len(), expected: 1 }));
    }

    #[test]
    fn bad_bytes_are_named() {
        assert_eq!(CdrReader::new(&[0, 3, 0, 0]).err(), Some(ReadError::Encoding(vec![0, 3, 0, 0])));
        assert!(CdrReader::new(&[0]).is_err());
        let text = |bytes: &[u8]| CdrReader::new(bytes).unwrap().string().unwrap_err().to_string();
        assert!(text(&[0, 1, 0, 0, 255, 255, 255, 255]).contains("4294967295 bytes more"));
        assert!(text(&[0, 1, 0, 0, 2, 0, 0, 0, 255, 0]).contains("byte 8 is no text"));
        let bool = CdrReader::new(&[0, 1, 0, 0, 2]).unwrap().bool().unwrap_err();
        assert_eq!(bool, ReadError::Value { at: 4, expected: "bool" });
    }
}
