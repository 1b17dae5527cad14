//! Numbers of things in words.

/// `1 camera`, `2 cameras`.
#[must_use]
pub fn counted(count: impl Into<u64>, one: &str) -> String {
    let count = count.into();
    format!("{count} {one}{}", if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_not_many() {
        let of = |count: u32| counted(count, "camera");
        assert_eq!([of(0), of(1), of(2)], ["0 cameras", "1 camera", "2 cameras"]);
    }
}
