//! What a camera is given beside colour, and what follows from what is missing.

mod check;
mod grain;
mod image_motion;
mod invalid;
mod without_path;

pub use check::{InputCheck, InputReport};
pub use invalid::InvalidInput;
pub use without_path::WithoutPath;

/// What exact paths need and a camera does not get; `None` if it gets all.
#[must_use]
pub fn missing_paths(has_depth: bool, has_lens: bool, has_poses: bool) -> Option<&'static str> {
    match (has_depth, has_lens, has_poses) {
        (_, _, false) => Some("no poses"),
        (false, _, true) => Some("poses without depth"),
        (true, false, true) => Some("depth without a lens"),
        (true, true, true) => None,
    }
}

/// Why synthesis `auto` comes to what [`Synthesis::resolve`](crate::Synthesis::resolve) says, from what is missing for
/// exact paths and for motion vectors.
#[must_use]
pub fn auto_reason(missing_paths: Option<&str>, missing_motion: Option<&str>) -> String {
    match (missing_paths, missing_motion) {
        (None, _) => "there are depth and poses".to_owned(),
        (Some(paths), None) => format!("there are motion vectors, but {paths}"),
        (Some(paths), Some(motion)) => format!("there are {motion}, and {paths}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_named_by_what_the_user_has_to_add() {
        assert_eq!(missing_paths(true, true, true), None);
        assert_eq!(missing_paths(true, true, false), Some("no poses"));
        assert_eq!(missing_paths(false, true, true), Some("poses without depth"));
        assert_eq!(missing_paths(true, false, true), Some("depth without a lens"));
        assert_eq!(auto_reason(None, Some("no motion vectors")), "there are depth and poses");
        assert_eq!(auto_reason(Some("no poses"), None), "there are motion vectors, but no poses");
        assert_eq!(auto_reason(Some("no poses"), Some("no vectors")), "there are no vectors, and no poses");
    }
}
