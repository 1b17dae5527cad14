//! Pixels of a frame whose colour or motion vector cannot be used, and what to tell of them.

/// Share of a frame's pixels from which it is told that their colour cannot be used.
const COLOUR_SHARE: f64 = 0.02;

/// Share from which it is told that their vectors cannot be used. Some renderers have none for the background.
const MOTION_SHARE: f64 = 0.5;

/// How many pixels of a frame have something that cannot be used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InvalidInput {
    /// Pixels of the frame.
    pub pixels: u64,
    /// Pixels whose colour is NaN, infinite or negative.
    pub colour: u64,
    /// Pixels whose motion vector is not [usable](crate::synthesis::is_usable), where the synthesis follows vectors.
    pub motion: u64,
}

impl InvalidInput {
    /// What to tell the user, if these are so many that it looks like a mistake.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let share = |count: u64| count as f64 / self.pixels.max(1) as f64;
        let percent = |count: u64| format!("{:.0}% of the pixels", 100.0 * share(count));
        if share(self.colour) >= COLOUR_SHARE {
            return Some(format!(
                "{} have a colour that is NaN, infinite or negative: they keep their last value, and send no events until \
                 they have had one; give colour that is finite and not below 0",
                percent(self.colour)
            ));
        }
        (share(self.motion) >= MOTION_SHARE).then(|| {
            format!(
                "{} have a motion vector that is NaN, infinite or huge: they are blended, and events of what moves there \
                 are false; give vectors in pixels, and 0 for what stands still",
                percent(self.motion)
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_pixels_and_a_background_without_vectors_are_not_told_of() {
        let warning =
            |colour, motion| InvalidInput { pixels: 1000, colour, motion }.warning().unwrap_or_default();
        assert_eq!(warning(0, 0), "");
        assert_eq!(warning(19, 499), "");
        let colour = warning(20, 1000);
        assert!(
            colour.starts_with("2% of the pixels have a colour that is NaN, infinite or neg"),
            "{colour}"
        );
        let motion = warning(19, 500);
        assert!(motion.starts_with("50% of the pixels have a motion vector"), "{motion}");
        assert!(motion.contains("they are blended"), "{motion}");
        assert_eq!(InvalidInput::default().warning(), None, "no frame");
    }
}
