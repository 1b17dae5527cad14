//! A comparison in words.

use super::{Agreement, ConventionReport, Mistake, Nearest, Trust, Verdict};
use std::fmt;

impl ConventionReport {
    /// What disagrees and why, in words; `None` if nothing does.
    #[must_use]
    pub fn disagreement(&self) -> Option<String> {
        let wrong: Vec<String> = self.parts().filter_map(|(what, found)| found.disagreement(&what)).collect();
        let disagrees = !wrong.is_empty();
        disagrees
            .then(|| format!("depth and poses do not predict the motion vectors of {}", wrong.join("; of ")))
    }

    /// What synthesis `auto` makes of it, in words, if it follows the poses that `trust` says.
    #[must_use]
    pub fn consequence(&self, trust: &Trust) -> String {
        let disagrees = |found: &&Agreement| {
            matches!(found.verdict, Verdict::Mistaken { .. } | Verdict::Unexplained { .. })
        };
        let mut wrong = self.world.iter().chain(self.instances.values()).filter(disagrees);
        match trust {
            Trust::All if wrong.all(Agreement::blames_vectors) => {
                "depth and poses are right by that and are followed".to_owned()
            }
            Trust::All => {
                "depth and poses are followed as they are, for an error so slight, or of so few pixels, is \
                           hardly seen in the events"
                    .to_owned()
            }
            Trust::Without(_) | Trust::Nothing => trust.to_string(),
        }
    }

    /// The static world and the instances, with their names.
    fn parts(&self) -> impl Iterator<Item = (String, &Agreement)> {
        let world = self.world.iter().map(|world| ("the static world".to_owned(), world));
        world.chain(self.instances.iter().map(|(id, one)| (format!("instance {id}"), one)))
    }
}

impl fmt::Display for ConventionReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(wrong) = self.disagreement() {
            f.write_str(&wrong)?;
        } else if self.parts().all(|(_, found)| found.verdict == Verdict::Still) {
            f.write_str(
                "depth and poses agree with the motion vectors, but nothing moves, so that little is checked",
            )?;
        } else {
            let within = |(what, found): (String, &Agreement)| {
                format!("{what} {} px", significant(found.median_error_px))
            };
            let parts: Vec<String> = self.parts().map(within).collect();
            write!(f, "depth and poses predict the motion vectors within (median): {}", parts.join(", "))?;
        }
        match self.pixels_without_poses {
            0 => Ok(()),
            n => write!(f, "; {n} pixels of instances without poses"),
        }
    }
}

impl Agreement {
    /// How far vectors and paths are apart and why, if they are.
    fn disagreement(&self, what: &str) -> Option<String> {
        let apart = format!(
            "{what}: {} px apart where {} px are predicted (medians)",
            significant(self.median_error_px),
            significant(self.median_motion_px)
        );
        match &self.verdict {
            Verdict::Unexplained { nearest: None } => {
                Some(format!("{apart}, and no known mistake explains it"))
            }
            Verdict::Unexplained { nearest: Some(Nearest { cause, left_px }) } => Some(format!(
                "{apart}, and no known mistake explains it; nearest is that {} (then {} px are left)",
                words(cause),
                significant(*left_px)
            )),
            Verdict::Mistaken { causes, left_px } => {
                let causes: Vec<String> = causes.iter().map(|cause| words(cause)).collect();
                let causes = causes.join(", or ");
                Some(format!("{apart}; likely {causes} (then {} px are left)", significant(*left_px)))
            }
            Verdict::Agrees | Verdict::Still => None,
        }
    }
}

/// Mistakes that are made together.
fn words(cause: &[Mistake]) -> String {
    let words: Vec<String> = cause.iter().map(ToString::to_string).collect();
    words.join(", and ")
}

/// A length with two significant digits. Less than a millionth is 0: it is the rounding of the files.
fn significant(value: f64) -> String {
    let digits = if value >= 1e-6 { (1.0 - value.log10().floor()).clamp(0.0, 7.0) as usize } else { 0 };
    format!("{value:.digits$}")
}
