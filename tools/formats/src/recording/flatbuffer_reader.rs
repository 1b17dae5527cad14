//! Reads the part of FlatBuffers that a recording needs: tables, their scalars, vectors of bytes and of structs. It
//! checks every offset, so a broken file gives an error and never a panic. (The format's own runtime needs a schema at
//! build time, and reads without one only through unsafe code.)

/// What is wrong with a buffer.
pub(super) type Broken = String;

/// A table in a buffer.
#[derive(Clone, Copy)]
pub(super) struct Table<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Offsets of the fields from `at`; 0 for a field that is absent and so has its default.
    fields: &'a [u8],
}

/// A number in a buffer, little-endian.
pub(super) trait Scalar: Sized {
    fn at(bytes: &[u8], at: usize) -> Result<Self, Broken>;
}

macro_rules! scalars {
    ($($type:ty),*) => {
        $(impl Scalar for $type {
            fn at(bytes: &[u8], at: usize) -> Result<Self, Broken> {
                let end = at.checked_add(size_of::<$type>());
                let slice = end.and_then(|end| bytes.get(at..end)).ok_or_else(|| {
                    format!("byte {at} is pointed at, expected one below {}", bytes.len())
                })?;
                Ok(<$type>::from_le_bytes(slice.try_into().expect("the slice has this length")))
            }
        })*
    };
}
scalars!(i8, u16, i16, u32, i32, i64);

impl<'a> Table<'a> {
    /// The root table of a buffer. A `sized` buffer begins with its own length.
    pub(super) fn root(bytes: &'a [u8], sized: bool) -> Result<Self, Broken> {
        let bytes = if sized { bytes.get(4..).ok_or("a packet of less than four bytes")? } else { bytes };
        let at = u32::at(bytes, 0)? as usize;
        Table::new(bytes, at)
    }

    fn new(bytes: &'a [u8], at: usize) -> Result<Self, Broken> {
        let back = i32::at(bytes, at)?;
        let start = usize::try_from(at as i64 - i64::from(back)).map_err(|_| "a table without fields")?;
        let length = usize::from(u16::at(bytes, start)?);
        let fields = start.checked_add(length).and_then(|end| bytes.get(start..end));
        Ok(Table { bytes, at, fields: fields.ok_or("a table's fields end beyond the packet")? })
    }

    /// Position of field `index`; `None` if it is absent.
    fn position(&self, index: usize) -> Result<Option<usize>, Broken> {
        let entry = 4 + 2 * index;
        if entry + 2 > self.fields.len() {
            return Ok(None);
        }
        Ok(match u16::at(self.fields, entry)? {
            0 => None,
            offset => Some(self.at + usize::from(offset)),
        })
    }

    /// A number; 0 if the field is absent.
    pub(super) fn scalar<T: Scalar + Default>(&self, index: usize) -> Result<T, Broken> {
        self.position(index)?.map_or_else(|| Ok(T::default()), |at| T::at(self.bytes, at))
    }

    /// The bytes of a vector whose elements have `element_bytes` each; empty if the field is absent.
    pub(super) fn vector(&self, index: usize, element_bytes: usize) -> Result<&'a [u8], Broken> {
        let Some(at) = self.position(index)? else { return Ok(&[]) };
        let start = at + u32::at(self.bytes, at)? as usize;
        let count = u32::at(self.bytes, start)? as usize;
        let end = count.checked_mul(element_bytes).and_then(|bytes| bytes.checked_add(start + 4));
        end.and_then(|end| self.bytes.get(start + 4..end))
            .ok_or_else(|| format!("a vector of {count} elements ends beyond its packet"))
    }

    /// A text; empty if the field is absent.
    pub(super) fn text(&self, index: usize) -> Result<&'a str, Broken> {
        std::str::from_utf8(self.vector(index, 1)?).map_err(|e| format!("a text is not UTF-8: {e}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A table with an i64, an absent field and a vector of three bytes.
    fn buffer() -> Vec<u8> {
        let mut bytes = Vec::new();
        bytes.extend(16_u32.to_le_bytes()); // root at 16
        bytes.extend([10_u16, 16, 4, 0, 12].iter().flat_map(|v| v.to_le_bytes())); // fields, at 4
        bytes.extend([0; 2]);
        bytes.extend(12_i32.to_le_bytes()); // the table, at 16: its fields are 12 before it
        bytes.extend((-5_i64).to_le_bytes()); // at 20
        bytes.extend(4_u32.to_le_bytes()); // at 28: the vector is 4 further
        bytes.extend(3_u32.to_le_bytes());
        bytes.extend(*b"abc");
        bytes
    }

    #[test]
    fn fields_are_read_and_absent_ones_have_their_default() {
        let bytes = buffer();
        let table = Table::root(&bytes, false).unwrap();
        assert_eq!(table.scalar::<i64>(0), Ok(-5));
        assert_eq!(table.scalar::<i32>(1), Ok(0));
        assert_eq!(table.text(2), Ok("abc"));
        assert_eq!(table.scalar::<i16>(9), Ok(0));
    }

    #[test]
    fn no_broken_buffer_is_read_beyond_its_end() {
        let good = buffer();
        let visit = |bytes: &[u8]| {
            let table = Table::root(bytes, false)?;
            table.scalar::<i64>(0)?;
            table.vector(2, 16)?;
            table.text(2).map(str::len)
        };
        for length in 0..good.len() {
            assert!(visit(&good[..length]).is_err(), "{length} bytes");
        }
        for at in 0..good.len() {
            for value in [0, 1, 0x7f, 0x80, 0xff] {
                let mut bad = good.clone();
                bad[at] = value;
                let _ = visit(&bad);
            }
        }
    }
}
