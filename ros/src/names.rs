//! Checks names by the rules of ROS 2, and translates them to names on DDS.

use thiserror::Error;

/// A name that ROS 2 does not allow.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{what} `{name}` {reason}")]
pub struct NameError {
    what: &'static str,
    name: String,
    reason: &'static str,
}

/// Longest topic name on DDS without its prefix `rt`.
const MAX_TOPIC: usize = 255 - 2;

/// Checks that `token` has letters, digits and single underscores only and does not start with a digit.
fn check_token(token: &str) -> Result<(), &'static str> {
    let mut characters = token.chars();
    match characters.next() {
        None => return Err("has an empty part; parts are joined by single slashes"),
        Some(first) if first.is_ascii_digit() => return Err("has a part that starts with a digit"),
        Some(first) if !(first.is_ascii_alphabetic() || first == '_') => {
            return Err("has a character other than letters, digits and underscores");
        }
        Some(_) => {}
    }
    if !characters.all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Err("has a character other than letters, digits and underscores");
    }
    if token.contains("__") { Err("has two underscores in a row") } else { Ok(()) }
}

fn absolute(what: &'static str, name: &str) -> Result<(), NameError> {
    let fail = |reason| NameError { what, name: name.to_owned(), reason };
    let rest = name.strip_prefix('/').ok_or_else(|| fail("does not start with a slash"))?;
    rest.split('/').try_for_each(check_token).map_err(fail)?;
    if name.len() > MAX_TOPIC { Err(fail("is longer than 253 characters")) } else { Ok(()) }
}

/// Checks an absolute topic name.
pub fn check_topic(name: &str) -> Result<(), NameError> {
    absolute("topic", name)
}

/// Checks a namespace; `/` is the root.
pub fn check_namespace(name: &str) -> Result<(), NameError> {
    if name == "/" { Ok(()) } else { absolute("namespace", name) }
}

/// Checks the name of a node.
pub fn check_node(name: &str) -> Result<(), NameError> {
    check_token(name).map_err(|reason| NameError { what: "node", name: name.to_owned(), reason })
}

/// Checks a frame id of tf2.
pub fn check_frame(name: &str) -> Result<(), NameError> {
    let fail = |reason| Err(NameError { what: "frame id", name: name.to_owned(), reason });
    match name {
        "" => fail("is empty"),
        _ if name.starts_with('/') => fail("starts with a slash, which tf2 does not allow"),
        _ if name.contains(|c: char| c.is_whitespace() || c.is_control()) => fail("has white space"),
        _ => Ok(()),
    }
}

/// Joins a namespace and a relative name.
#[must_use]
pub fn join(namespace: &str, name: &str) -> String {
    format!("{}/{name}", namespace.trim_end_matches('/'))
}

/// Topic on DDS: `/a/b` is `rt/a/b`.
#[must_use]
pub fn dds_topic(name: &str) -> String {
    format!("rt{name}")
}

/// Type on DDS: `pkg/msg/Name` is `pkg::msg::dds_::Name_`. `None` if `name` is not a type's name.
#[must_use]
pub fn dds_type(name: &str) -> Option<String> {
    match name.split('/').collect::<Vec<_>>()[..] {
        [package, kind, name] if [package, kind, name].iter().all(|t| check_token(t).is_ok()) => {
            Some(format!("{package}::{kind}::dds_::{name}_"))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_ros_pass_and_others_say_why() {
        for good in ["/a", "/esaac/gray/aps/image_raw", "/_a/b2"] {
            assert_eq!(check_topic(good), Ok(()));
        }
        for (bad, why) in [
            ("a", "slash"),
            ("/", "empty part"),
            ("/a//b", "empty part"),
            ("/a/", "empty part"),
            ("/2a", "digit"),
            ("/a-b", "character"),
            ("/a__b", "underscores"),
            ("/ä", "character"),
        ] {
            let error = check_topic(bad).unwrap_err().to_string();
            assert!(error.contains(why) && error.contains(bad), "{bad}: {error}");
        }
        assert!(check_topic(&format!("/{}", "a".repeat(253))).unwrap_err().to_string().contains("253"));
        assert!(check_namespace("/").is_ok() && check_namespace("").is_err() && check_node("a/b").is_err());
        assert!(check_frame("camera_optical_frame").is_ok());
        assert!(check_frame("/camera").is_err() && check_frame("").is_err() && check_frame("a b").is_err());
    }

    #[test]
    fn dds_has_its_own_names() {
        assert_eq!(dds_topic("/a/b"), "rt/a/b");
        assert_eq!(dds_type("std_msgs/msg/Header").as_deref(), Some("std_msgs::msg::dds_::Header_"));
        assert_eq!((dds_type("Header"), dds_type("a/msg/"), dds_type("a/b/c/d")), (None, None, None));
    }
}
