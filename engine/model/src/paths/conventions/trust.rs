//! Which poses synthesis `auto` follows, if a renderer's vectors disagree with some.
//!
//! - The vectors' own sign, axis, unit or frame explains all: the poses predict the vectors, so they are right and are
//!   followed.
//! - The static world disagrees otherwise: camera, depth or times are wrong, which concerns all pixels. No pose is
//!   followed; each pixel follows its motion vector.
//! - An instance alone disagrees: its poses are left out, and its pixels follow their vectors. So it is if the depth is
//!   wrong and the static world hardly shows it.
//! - What is wrong is slight, or seen by few pixels: all poses are followed.

use super::ConventionReport;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fmt;

/// The poses that are followed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Trust {
    /// All.
    #[default]
    All,
    /// All but those of these instances.
    Without(BTreeSet<u32>),
    /// None.
    Nothing,
}

impl Trust {
    /// Whether the poses of an instance, or of the static world, are followed.
    #[must_use]
    pub fn follows(&self, id: u32) -> bool {
        match self {
            Trust::All => true,
            Trust::Without(ids) => !ids.contains(&id),
            Trust::Nothing => false,
        }
    }

    /// What neither of two doubts.
    #[must_use]
    pub fn and(self, other: Trust) -> Trust {
        match (self, other) {
            (Trust::Nothing, _) | (_, Trust::Nothing) => Trust::Nothing,
            (Trust::All, other) | (other, Trust::All) => other,
            (Trust::Without(one), Trust::Without(other)) => Trust::Without(&one | &other),
        }
    }
}

impl ConventionReport {
    /// The poses that `auto` follows after this.
    #[must_use]
    pub fn trust(&self) -> Trust {
        if self.world.as_ref().is_some_and(super::Agreement::doubts_poses) {
            return Trust::Nothing;
        }
        let doubted = self.instances.iter().filter(|(_, found)| found.doubts_poses());
        let doubted: BTreeSet<u32> = doubted.map(|(&id, _)| id).collect();
        if doubted.is_empty() { Trust::All } else { Trust::Without(doubted) }
    }
}

impl fmt::Display for Trust {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Trust::All => f.write_str("depth and poses are followed"),
            Trust::Without(ids) => {
                let ids: Vec<String> = ids.iter().map(u32::to_string).collect();
                let (s, their) = if ids.len() == 1 { ("", "its") } else { ("s", "their") };
                write!(
                    f,
                    "instance{s} {}: {their} poses are left out, the pixels follow their vectors",
                    ids.join(", ")
                )
            }
            Trust::Nothing => f.write_str("all poses are left out, each pixel follows its motion vector"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubts_add_up() {
        let without = |ids: &[u32]| Trust::Without(ids.iter().copied().collect());
        assert_eq!(Trust::All.and(without(&[3])), without(&[3]));
        assert_eq!(without(&[3]).and(without(&[7])), without(&[3, 7]));
        assert_eq!(without(&[3]).and(Trust::All), without(&[3]));
        assert_eq!(without(&[3]).and(Trust::Nothing), Trust::Nothing);
        assert!(without(&[3]).follows(0) && !without(&[3]).follows(3) && !Trust::Nothing.follows(0));
        assert!(without(&[3, 7]).to_string().starts_with("instances 3, 7: their poses"));
    }
}
