//! ROS 2 type hashes (`RIHS01`, REP 2016): SHA-256 of a type's description as canonical JSON.

use crate::definition::{Base, DefinitionError, Extent, Field, Texts, closure};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;

/// `type_interfaces/msg/FieldType` numbers arrays and sequences at these distances from the element's type.
const ARRAY: u32 = 48;
const BOUNDED: u32 = 96;
const SEQUENCE: u32 = 144;

/// `RIHS01_...` of the message `name`, from its definition and those of all messages that it contains.
pub fn type_hash(name: &str, texts: &Texts) -> Result<String, DefinitionError> {
    let types = closure(name, texts)?;
    let mut json = format!("{{\"type_description\": {}", description(name, &types[name]));
    let others: Vec<String> = types
        .iter()
        .filter(|(other, _)| *other != name)
        .map(|(other, fields)| description(other, fields))
        .collect();
    let _ = write!(json, ", \"referenced_type_descriptions\": [{}]}}", others.join(", "));
    let digest = Sha256::digest(json.as_bytes());
    Ok(digest.iter().fold("RIHS01_".to_owned(), |text, byte| text + &format!("{byte:02x}")))
}

fn description(name: &str, fields: &[Field]) -> String {
    // C has no empty structs, so ROS's generators add a member.
    let empty = [Field {
        name: "structure_needs_at_least_one_member".to_owned(),
        base: Base::Primitive("uint8"),
        extent: Extent::One,
    }];
    let fields = if fields.is_empty() { &empty } else { fields };
    let fields: Vec<String> = fields.iter().map(field).collect();
    format!("{{\"type_name\": \"{name}\", \"fields\": [{}]}}", fields.join(", "))
}

fn field(field: &Field) -> String {
    let (plain, string_capacity, nested) = match &field.base {
        Base::Message(name) => (1, 0, name.as_str()),
        Base::Primitive(name) => (primitive(name), 0, ""),
        Base::String(None) => (17, 0, ""),
        Base::WString(None) => (18, 0, ""),
        Base::String(Some(bound)) => (21, *bound, ""),
        Base::WString(Some(bound)) => (22, *bound, ""),
    };
    let (distance, capacity) = match field.extent {
        Extent::One => (0, 0),
        Extent::Array(count) => (ARRAY, count),
        Extent::Bounded(count) => (BOUNDED, count),
        Extent::Sequence => (SEQUENCE, 0),
    };
    format!(
        "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {capacity}, \"string_capacity\": \
         {string_capacity}, \"nested_type_name\": \"{nested}\"}}}}",
        field.name,
        plain + distance
    )
}

/// Numbers of `type_interfaces/msg/FieldType`. In a `.msg`, `char` is an unsigned byte.
fn primitive(name: &str) -> u32 {
    match name {
        "int8" => 2,
        "uint8" | "char" => 3,
        "int16" => 4,
        "uint16" => 5,
        "int32" => 6,
        "uint32" => 7,
        "int64" => 8,
        "uint64" => 9,
        "float32" => 10,
        "float64" => 11,
        "bool" => 15,
        "byte" => 16,
        other => unreachable!("the parser knows no primitive `{other}`"),
    }
}

#[cfg(test)]
mod tests {
    use crate::message::MessageType;

    #[test]
    fn hashes_are_those_that_ros_publishes() {
        // From the interface packages of ROS 2 Jazzy.
        let published = [
            (MessageType::Clock, "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564"),
            (MessageType::Image, "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"),
            (MessageType::Imu, "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"),
        ];
        for (message, hash) in published {
            assert_eq!(message.type_hash(), hash, "{}", message.name());
        }
    }
}
