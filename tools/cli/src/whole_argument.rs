//! Whole numbers on the command line.

/// A parser of whole numbers from `least` to `most`. Its error says which are possible, whatever was given.
pub fn whole(least: u32, most: u32) -> impl Fn(&str) -> Result<u32, String> + Clone + Send + Sync {
    move |text| match text.parse() {
        Ok(number) if (least..=most).contains(&number) => Ok(number),
        _ => Err(format!("expected a whole number, {least} to {most}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_or_beyond_the_range_is_told_the_range() {
        let parse = whole(2, 100);
        assert_eq!([parse("2"), parse("100")], [Ok(2), Ok(100)]);
        for text in ["two", "1", "101", "2.5", ""] {
            assert_eq!(parse(text).unwrap_err(), "expected a whole number, 2 to 100", "{text}");
        }
    }
}
