//! Pixels that synthesis `rigid` finds no exact path for, and what to tell of them.

/// Share of a frame's pixels from which they are told of, where they are blended.
const BLENDED_SHARE: f64 = 0.02;

/// Share of a frame's pixels from which they are told of, where they follow motion vectors instead.
const FOLLOWING_SHARE: f64 = 0.5;

/// How many pixels of a frame have no exact path, by what they lack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WithoutPath {
    /// Pixels of the frame.
    pub pixels: u64,
    /// Pixels whose depth is NaN, negative or too small to invert.
    pub depth: u64,
    /// Pixels of instances without poses.
    pub poses: u64,
}

impl WithoutPath {
    /// What to tell the user, if so many pixels lack something that it looks like a mistake. Without motion vectors such
    /// pixels are blended, and a small share is told of. With vectors they follow these: that is how instances without
    /// poses are meant to move, but nobody gives depth of which most is unusable.
    #[must_use]
    pub fn warning(&self, has_motion: bool) -> Option<String> {
        let share = |count: u64| count as f64 / self.pixels.max(1) as f64;
        let percent = |count: u64| format!("{:.0}% of the pixels", 100.0 * share(count));
        let (least, follow) = match has_motion {
            true => (FOLLOWING_SHARE, "they follow their motion vectors"),
            false => (
                BLENDED_SHARE,
                "there are no motion vectors that they could follow, so they are blended, and events of what moves there \
                 are false",
            ),
        };
        if share(self.depth) >= least {
            return Some(format!(
                "{} have a depth that is NaN, negative or too small to invert: {follow}; give depth in metres, and infinity or 0 for a \
                 background",
                percent(self.depth)
            ));
        }
        (!has_motion && share(self.poses) >= least).then(|| {
            format!(
                "{} have the id of a body without poses: {follow}; give its poses, or id 0 for what stands still",
                percent(self.poses)
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_pixels_and_those_that_follow_vectors_are_not_told_of() {
        let warning = |depth, poses, has_motion| {
            WithoutPath { pixels: 1000, depth, poses }.warning(has_motion).unwrap_or_default()
        };
        assert_eq!(warning(0, 0, false), "");
        assert_eq!(warning(19, 19, false), "");
        assert_eq!(warning(499, 1000, true), "", "a deforming body may fill the view");
        let poses = warning(19, 370, false);
        assert!(poses.starts_with("37% of the pixels have the id of a body without poses"), "{poses}");
        let depth = warning(20, 370, false);
        assert!(
            depth.starts_with("2% of the pixels have a depth that is NaN, negative or too small to invert"),
            "{depth}"
        );
        assert!(depth.contains("no motion vectors"), "{depth}");
        let depth = warning(1000, 0, true);
        assert!(
            depth.contains("100% of the pixels") && depth.contains("they follow their motion"),
            "{depth}"
        );
        assert_eq!(WithoutPath { pixels: 0, depth: 0, poses: 0 }.warning(false), None, "no frame");
    }
}
