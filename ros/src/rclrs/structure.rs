//! Checks that the sourced ROS 2 defines a message type as this crate encodes it. Otherwise wrong values
//! would be sent without an error.

use crate::definition::{self, Base, Extent, Field};
use ::rclrs::{BaseType, MessageStructure, ValueKind};
use std::collections::BTreeMap;

/// Returns an error that says how `structure` differs from the message `name` of `schema`.
pub fn check(structure: &MessageStructure, name: &str, schema: &str) -> Result<(), String> {
    let texts = definition::texts_of_schema(name, schema);
    let messages = definition::closure(name, &texts).map_err(|error| error.to_string())?;
    compare(structure, name, &messages)
}

fn compare(
    structure: &MessageStructure,
    name: &str,
    messages: &BTreeMap<String, Vec<Field>>,
) -> Result<(), String> {
    let actual: Vec<&str> = structure.fields.iter().map(|field| field.name.as_str()).collect();
    let mut expected: Vec<&str> = messages[name].iter().map(|field| field.name.as_str()).collect();
    if expected.is_empty() {
        // C has no empty structs.
        expected.push("structure_needs_at_least_one_member");
    }
    if actual != expected {
        return Err(format!("`{name}` has the fields {actual:?}, expected {expected:?}"));
    }
    for (theirs, ours) in structure.fields.iter().zip(&messages[name]) {
        let differs = |what: &str| Err(format!("`{name}` has another {what} for `{}`", ours.name));
        if !is_extent(theirs.value_kind, ours.extent) {
            return differs("number of elements");
        }
        match (&theirs.base_type, &ours.base) {
            (BaseType::WString | BaseType::BoundedWString { .. }, _) => {
                return Err(format!("`{name}` has wide characters (`{}`), which are not sent", ours.name));
            }
            (BaseType::Message(structure), Base::Message(message)) => compare(structure, message, messages)?,
            (theirs, ours) if is_base(theirs, ours) => {}
            _ => return differs("type"),
        }
    }
    Ok(())
}

fn is_extent(kind: ValueKind, extent: Extent) -> bool {
    match (kind, extent) {
        (ValueKind::Simple, Extent::One) | (ValueKind::Sequence, Extent::Sequence) => true,
        (ValueKind::Array { length }, Extent::Array(expected)) => length as u64 == expected,
        (ValueKind::BoundedSequence { upper_bound }, Extent::Bounded(expected)) => {
            upper_bound as u64 == expected
        }
        _ => false,
    }
}

fn is_base(theirs: &BaseType, ours: &Base) -> bool {
    match (theirs, ours) {
        (BaseType::String, Base::String(None)) => true,
        (BaseType::BoundedString { upper_bound }, Base::String(Some(expected))) => {
            upper_bound.get() as u64 == *expected
        }
        (_, Base::Primitive(name)) => {
            let names: &[&str] = match theirs {
                BaseType::Boolean => &["bool"],
                // All are one unsigned byte.
                BaseType::Octet | BaseType::Char | BaseType::Uint8 => &["byte", "char", "uint8"],
                BaseType::Int8 => &["int8"],
                BaseType::Uint16 => &["uint16"],
                BaseType::Int16 => &["int16"],
                BaseType::Uint32 => &["uint32"],
                BaseType::Int32 => &["int32"],
                BaseType::Uint64 => &["uint64"],
                BaseType::Int64 => &["int64"],
                BaseType::Float => &["float32"],
                BaseType::Double => &["float64"],
                _ => &[],
            };
            names.contains(name)
        }
        _ => false,
    }
}
