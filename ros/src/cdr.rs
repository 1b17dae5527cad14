//! Common Data Representation (CDR), version 1, little endian: the bytes that ROS 2 sends and records.
//!
//! A message is a header of four bytes (`00 01 00 00`) and then its fields. Each number is aligned to its own
//! size, counted from the end of the header. Sequences and strings begin with a `u32` length. A string's
//! length includes its closing zero.

use bytemuck::{NoUninit, cast_slice};

/// Header of plain CDR, little endian.
pub const HEADER: [u8; 4] = [0, 1, 0, 0];

#[cfg(not(target_endian = "little"))]
compile_error!("arrays are copied from memory as they are, which must be little endian");

/// Writes fields in order into the buffer that is sent and recorded.
pub struct CdrWriter<'a> {
    out: &'a mut Vec<u8>,
}

impl<'a> CdrWriter<'a> {
    /// Empties the buffer, keeps its storage and writes the header.
    pub fn new(out: &'a mut Vec<u8>) -> Self {
        out.clear();
        out.extend_from_slice(&HEADER);
        CdrWriter { out }
    }

    fn align(&mut self, bytes: usize) {
        let end = HEADER.len() + (self.out.len() - HEADER.len()).next_multiple_of(bytes);
        self.out.resize(end, 0);
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) -> &mut Self {
        self.align(N);
        self.out.extend_from_slice(&bytes);
        self
    }

    /// `bool`.
    pub fn bool(&mut self, value: bool) -> &mut Self {
        self.u8(value.into())
    }

    /// `uint8`, `byte`, `char`.
    pub fn u8(&mut self, value: u8) -> &mut Self {
        self.number([value])
    }

    /// `int32`.
    pub fn i32(&mut self, value: i32) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    /// `uint32`, and the length of a sequence.
    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    /// `int64`.
    pub fn i64(&mut self, value: i64) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    /// `uint64`.
    pub fn u64(&mut self, value: u64) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    /// `float64`.
    pub fn f64(&mut self, value: f64) -> &mut Self {
        self.number(value.to_le_bytes())
    }

    /// `float64[N]`. An array of fixed length does not begin with its length.
    pub fn f64s(&mut self, values: &[f64]) -> &mut Self {
        values.iter().fold(self, |writer, &value| writer.f64(value))
    }

    /// `string`. It ends before its first zero character, because readers end there too.
    pub fn string(&mut self, value: &str) -> &mut Self {
        let value = value.split('\0').next().unwrap_or_default();
        self.u32(length(value.len() + 1));
        self.out.extend_from_slice(value.as_bytes());
        self.out.push(0);
        self
    }

    /// A sequence of numbers.
    pub fn sequence<T: NoUninit>(&mut self, values: &[T]) -> &mut Self {
        self.u32(length(values.len()));
        if !values.is_empty() {
            self.align(size_of::<T>());
            self.out.extend_from_slice(cast_slice(values));
        }
        self
    }

    /// A sequence of bytes that `fill` appends.
    pub fn bytes_with(&mut self, fill: impl FnOnce(&mut Vec<u8>)) -> &mut Self {
        self.u32(0);
        let start = self.out.len();
        fill(self.out);
        let written = length(self.out.len() - start);
        self.out[start - 4..start].copy_from_slice(&written.to_le_bytes());
        self
    }

    /// Reserves room for `bytes` more bytes, so that the buffer grows once.
    pub fn reserve(&mut self, bytes: usize) -> &mut Self {
        self.out.reserve(bytes);
        self
    }

    /// Pads to a multiple of `bytes`, the alignment of what [`CdrWriter::raw`] appends next.
    pub fn align_to(&mut self, bytes: usize) -> &mut Self {
        self.align(bytes);
        self
    }

    /// Appends bytes that are already encoded.
    pub fn raw(&mut self, bytes: &[u8]) -> &mut Self {
        self.out.extend_from_slice(bytes);
        self
    }
}

/// A length as it is sent. CDR has no messages of 4 GiB or more.
fn length(count: usize) -> u32 {
    u32::try_from(count).expect("a message is less than 4 GiB")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_aligned_behind_the_header() {
        let mut out = vec![9; 3];
        CdrWriter::new(&mut out).u8(1).u32(2).string("ab").i64(-1).sequence::<u16>(&[]).sequence(&[3_u16, 4]);
        let expected: &[&[u8]] = &[
            &[0, 1, 0, 0],
            &[1, 0, 0, 0],
            &[2, 0, 0, 0],
            &[3, 0, 0, 0, b'a', b'b', 0, 0],
            &[255; 8],
            &[0, 0, 0, 0],
            &[2, 0, 0, 0, 3, 0, 4, 0],
        ];
        // The i64 begins 16 bytes behind the header: 8 + 4 + 3, padded by one.
        assert_eq!(out, expected.concat());
    }

    #[test]
    fn elements_of_a_sequence_are_aligned_and_an_empty_one_has_no_padding() {
        let mut out = Vec::new();
        CdrWriter::new(&mut out).sequence(&[1.5_f64]).sequence::<f64>(&[]).u8(7);
        let expected: &[&[u8]] =
            &[&[0, 1, 0, 0], &[1, 0, 0, 0], &[0; 4], &1.5_f64.to_le_bytes(), &[0; 4], &[7]];
        assert_eq!(out, expected.concat());
    }

    #[test]
    fn a_string_ends_before_a_zero_character() {
        let mut out = Vec::new();
        CdrWriter::new(&mut out).string("ab\0cd").u8(7);
        assert_eq!(out, [0, 1, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 7]);
    }

    #[test]
    fn a_filled_sequence_knows_its_length() {
        let mut out = Vec::new();
        CdrWriter::new(&mut out).bytes_with(|out| out.extend_from_slice(b"abc")).u32(7);
        assert_eq!(out, [0, 1, 0, 0, 3, 0, 0, 0, b'a', b'b', b'c', 0, 7, 0, 0, 0]);
    }
}
