//! Parses message definitions (`.msg` files). Type hashes, schemas in recordings and the encoding of
//! `SensorModel` follow from them.

use std::collections::BTreeMap;
use thiserror::Error;

/// A type of a field, without its array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Base {
    /// `bool`, `byte`, `char`, an integer or a float, by its name.
    Primitive(&'static str),
    /// `string`, with its bound.
    String(Option<u64>),
    /// `wstring`, with its bound.
    WString(Option<u64>),
    /// Another message, as `pkg/msg/Name`.
    Message(String),
}

/// Number of elements in a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// One.
    One,
    /// This number.
    Array(u64),
    /// Any number.
    Sequence,
    /// At most this number.
    Bounded(u64),
}

/// One field of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name.
    pub name: String,
    /// Type of an element.
    pub base: Base,
    /// Number of elements.
    pub extent: Extent,
}

/// A `.msg` text that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("message definition {message}, line {line}: {reason}")]
pub struct DefinitionError {
    message: String,
    line: usize,
    reason: String,
}

const PRIMITIVES: &[&str] = &[
    "bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
    "float32", "float64",
];

/// The fields of the message `name` (`pkg/msg/Name`). Constants and comments are skipped.
pub fn parse(name: &str, text: &str) -> Result<Vec<Field>, DefinitionError> {
    let package = name.split('/').next().unwrap_or_default();
    let mut fields = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let fail = |reason: &str| DefinitionError {
            message: name.to_owned(),
            line: index + 1,
            reason: reason.to_owned(),
        };
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let (kind, rest) = line.split_once(char::is_whitespace).ok_or_else(|| fail("no field name"))?;
        let mut words = rest.split_whitespace();
        let field = words.next().ok_or_else(|| fail("no field name"))?;
        if field.contains('=') || words.next().is_some_and(|word| word.starts_with('=')) {
            continue;
        }
        let (kind, extent) = extent(kind).ok_or_else(|| fail("bad array bound"))?;
        let base = base(package, kind).ok_or_else(|| fail("bad type"))?;
        fields.push(Field { name: field.to_owned(), base, extent });
    }
    Ok(fields)
}

fn extent(kind: &str) -> Option<(&str, Extent)> {
    let Some(inner) = kind.strip_suffix(']') else { return Some((kind, Extent::One)) };
    let (kind, bound) = inner.rsplit_once('[')?;
    let extent = match bound.strip_prefix("<=") {
        Some(bound) => Extent::Bounded(bound.parse().ok()?),
        None if bound.is_empty() => Extent::Sequence,
        None => Extent::Array(bound.parse().ok()?),
    };
    Some((kind, extent))
}

fn base(package: &str, kind: &str) -> Option<Base> {
    if let Some(primitive) = PRIMITIVES.iter().find(|p| **p == kind) {
        return Some(Base::Primitive(primitive));
    }
    let (word, bound) = match kind.split_once("<=") {
        Some((word, bound)) => (word, Some(bound.parse().ok()?)),
        None => (kind, None),
    };
    Some(match word {
        "string" => Base::String(bound),
        "wstring" => Base::WString(bound),
        _ if bound.is_some() => return None,
        "Header" => Base::Message("std_msgs/msg/Header".to_owned()),
        _ => match word.split('/').collect::<Vec<_>>()[..] {
            [name] => Base::Message(format!("{package}/msg/{name}")),
            [package, name] | [package, "msg", name] => Base::Message(format!("{package}/msg/{name}")),
            _ => return None,
        },
    })
}

/// Definitions by message name.
pub type Texts = BTreeMap<String, String>;

/// The fields of the message `name` and of every message that it contains, directly or not.
pub fn closure(name: &str, texts: &Texts) -> Result<BTreeMap<String, Vec<Field>>, DefinitionError> {
    let mut found = BTreeMap::new();
    let mut wanted = vec![name.to_owned()];
    while let Some(next) = wanted.pop() {
        if found.contains_key(&next) {
            continue;
        }
        let text = texts.get(&next).ok_or_else(|| DefinitionError {
            message: next.clone(),
            line: 0,
            reason: format!("`{name}` refers to it, and it is not there"),
        })?;
        let fields = parse(&next, text)?;
        wanted.extend(fields.iter().filter_map(|field| match &field.base {
            Base::Message(message) => Some(message.clone()),
            _ => None,
        }));
        found.insert(next, fields);
    }
    Ok(found)
}

/// What stands between two definitions of a schema.
const SEPARATOR: &str = "================================================================================\n";

/// The text that a bag's schema holds: the definition, and those of all that it refers to.
pub fn schema(name: &str, texts: &Texts) -> Result<String, DefinitionError> {
    let mut out = texts.get(name).cloned().unwrap_or_default();
    for other in closure(name, texts)?.keys().filter(|other| *other != name) {
        if !out.ends_with('\n') {
            out.push('\n');
        }
        out += &format!("{SEPARATOR}MSG: {}\n{}", other.replacen("/msg/", "/", 1), texts[other]);
    }
    Ok(out)
}

/// The texts of a bag's schema.
#[must_use]
pub fn texts_of_schema(name: &str, schema: &str) -> Texts {
    let mut texts = Texts::new();
    let mut parts = schema.split(SEPARATOR);
    texts.insert(name.to_owned(), parts.next().unwrap_or_default().to_owned());
    for part in parts {
        if let Some((head, text)) = part.strip_prefix("MSG: ").and_then(|part| part.split_once('\n')) {
            let full = match head.trim().split('/').collect::<Vec<_>>()[..] {
                [package, name] => format!("{package}/msg/{name}"),
                _ => head.trim().to_owned(),
            };
            texts.insert(full, text.to_owned());
        }
    }
    texts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_have_names_types_and_extents() {
        let text =
            "byte OK=0 # constant\n\nHeader header\nstring<=8 s 'a=b'\nfloat64[9] k\nOther[<=3] o # c\n";
        let fields = parse("pkg/msg/M", text).unwrap();
        let field = |name: &str, base, extent| Field { name: name.to_owned(), base, extent };
        assert_eq!(fields[0], field("header", Base::Message("std_msgs/msg/Header".into()), Extent::One));
        assert_eq!(fields[1], field("s", Base::String(Some(8)), Extent::One));
        assert_eq!(fields[2], field("k", Base::Primitive("float64"), Extent::Array(9)));
        assert_eq!(fields[3], field("o", Base::Message("pkg/msg/Other".into()), Extent::Bounded(3)));
        assert!(parse("pkg/msg/M", "int32\n").unwrap_err().to_string().contains("line 1"));
        assert!(parse("pkg/msg/M", "int32[x] y\n").is_err());
    }

    #[test]
    fn a_schema_gives_back_its_texts() {
        let texts: Texts = [("a/msg/A", "a/B b\n"), ("a/msg/B", "int32 x\n"), ("a/msg/C", "int8 unused\n")]
            .map(|(name, text)| (name.to_owned(), text.to_owned()))
            .into();
        let schema = schema("a/msg/A", &texts).unwrap();
        let back = texts_of_schema("a/msg/A", &schema);
        assert_eq!(back.keys().collect::<Vec<_>>(), ["a/msg/A", "a/msg/B"]);
        assert_eq!(back["a/msg/B"], texts["a/msg/B"]);
        assert!(closure("a/msg/D", &texts).is_err());
    }
}
