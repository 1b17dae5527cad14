//! Writes the part of FlatBuffers that a recording needs: a table with numbers, texts and vectors. The format's own
//! runtime writes structs through unsafe code.

/// Alignment of tables, in bytes. No field needs more.
const ALIGNMENT: usize = 8;

/// A field of a table. The order of fields gives their numbers.
pub(super) enum Field {
    I8(i8),
    I16(i16),
    I32(i32),
    I64(i64),
    F32(f32),
    /// UTF-8.
    Text(String),
    /// A vector of numbers or structs: the count and the bytes of its elements.
    Vector(usize, Vec<u8>),
    /// A vector of tables.
    Tables(Vec<Vec<Field>>),
}

impl Field {
    /// The field's bytes in the table itself. A text or a vector lies outside, and its offset is set later.
    fn inline(&self) -> Vec<u8> {
        match self {
            Field::I8(v) => v.to_le_bytes().to_vec(),
            Field::I16(v) => v.to_le_bytes().to_vec(),
            Field::I32(v) => v.to_le_bytes().to_vec(),
            Field::I64(v) => v.to_le_bytes().to_vec(),
            Field::F32(v) => v.to_le_bytes().to_vec(),
            Field::Text(_) | Field::Vector(..) | Field::Tables(_) => vec![0; 4],
        }
    }
}

/// Makes a buffer: its length, the offset of its root table, the identifier of its type, and the tables.
pub(super) fn buffer(identifier: &[u8; 4], root: &[Field]) -> Vec<u8> {
    // Length, offset of the root, identifier.
    let mut bytes = vec![0; 12];
    bytes[8..12].copy_from_slice(identifier);
    let at = table(&mut bytes, root);
    set(&mut bytes, 4, at);
    let length = bytes.len() as u32 - 4;
    bytes[..4].copy_from_slice(&length.to_le_bytes());
    bytes
}

/// Appends a table and returns its position.
fn table(bytes: &mut Vec<u8>, fields: &[Field]) -> usize {
    let (mut offsets, mut body) = (Vec::new(), vec![0; 4]);
    for inline in fields.iter().map(Field::inline) {
        body.resize(body.len().next_multiple_of(inline.len()), 0);
        offsets.push(body.len());
        body.extend(inline);
    }
    let field_table_bytes = 4 + 2 * fields.len();
    let at = (bytes.len() + field_table_bytes).next_multiple_of(ALIGNMENT);
    bytes.resize(at - field_table_bytes, 0);
    for entry in [field_table_bytes, body.len()].iter().chain(&offsets) {
        bytes.extend((*entry as u16).to_le_bytes());
    }
    body[..4].copy_from_slice(&(field_table_bytes as i32).to_le_bytes());
    bytes.extend(body);
    for (field, offset) in fields.iter().zip(offsets) {
        let position = match field {
            Field::Text(text) => {
                let position = vector(bytes, text.len(), text.as_bytes());
                bytes.push(0);
                position
            }
            Field::Vector(count, elements) => vector(bytes, *count, elements),
            Field::Tables(tables) => {
                let position = vector(bytes, tables.len(), &vec![0; 4 * tables.len()]);
                for (index, fields) in tables.iter().enumerate() {
                    let child = table(bytes, fields);
                    set(bytes, position + 4 + 4 * index, child);
                }
                position
            }
            _ => continue,
        };
        set(bytes, at + offset, position);
    }
    at
}

/// Appends a vector and returns its position.
fn vector(bytes: &mut Vec<u8>, count: usize, elements: &[u8]) -> usize {
    let elements_at = (bytes.len() + 4).next_multiple_of(ALIGNMENT);
    bytes.resize(elements_at - 4, 0);
    bytes.extend((count as u32).to_le_bytes());
    bytes.extend(elements);
    elements_at - 4
}

/// Makes the offset at `at` point to `target`.
fn set(bytes: &mut [u8], at: usize, target: usize) {
    bytes[at..at + 4].copy_from_slice(&((target - at) as u32).to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::super::flatbuffer_reader::Table;
    use super::*;

    #[test]
    fn the_reader_finds_every_field() {
        let fields = [
            Field::I8(-3),
            Field::I64(i64::MIN),
            Field::Text("Grüße".to_owned()),
            Field::I16(-300),
            Field::Vector(2, vec![1, 2, 3, 4, 5, 6]),
            Field::I32(7),
        ];
        let bytes = buffer(b"TEST", &fields);
        assert_eq!(bytes.len(), 4 + u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize);
        let table = Table::root(&bytes, true).unwrap();
        assert_eq!(table.scalar::<i8>(0), Ok(-3));
        assert_eq!(table.scalar::<i64>(1), Ok(i64::MIN));
        assert_eq!(table.text(2), Ok("Grüße"));
        assert_eq!(table.scalar::<i16>(3), Ok(-300));
        assert_eq!(table.vector(4, 3), Ok(&[1, 2, 3, 4, 5, 6][..]));
        assert_eq!(table.scalar::<i32>(5), Ok(7));
        assert_eq!(table.scalar::<i32>(6), Ok(0), "a field that is not there");
    }
}
