//! Quality of service of the topics.

use std::fmt::Write as _;
use std::str::FromStr;
use thiserror::Error;

/// Whether lost messages are sent again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reliability {
    /// Yes.
    Reliable,
    /// No.
    BestEffort,
}

/// Whether late subscribers get earlier messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// Yes, as many as the history holds.
    TransientLocal,
    /// No.
    Volatile,
}

/// The quality of service that a publisher offers.
///
/// Defaults follow REP 2003. Sensor data is published reliably, so reliable and best-effort subscribers both
/// match. The history is short, so a stalled subscriber does not hold back the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// Reliability.
    pub reliability: Reliability,
    /// Durability.
    pub durability: Durability,
    /// Number of messages kept for subscribers that lost or have not read them; at least 1.
    pub depth: u32,
}

/// A quality of service that cannot be parsed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error(
    "quality of service `{given}`: `{word}` is not one of reliable, best_effort, volatile, \
     transient_local, depth:N with N from 1 to 100000"
)]
pub struct QosError {
    given: String,
    word: String,
}

/// Largest history.
const MAX_DEPTH: u32 = 100_000;

impl Qos {
    /// Reliable and volatile.
    #[must_use]
    pub const fn sensor_data(depth: u32) -> Self {
        Qos { reliability: Reliability::Reliable, durability: Durability::Volatile, depth }
    }

    /// Reliable; late subscribers get the last message.
    #[must_use]
    pub const fn latched() -> Self {
        Qos { reliability: Reliability::Reliable, durability: Durability::TransientLocal, depth: 1 }
    }

    /// The format in which rosbag2 writes it, with rmw's numbers.
    #[must_use]
    pub fn to_rosbag_yaml(self) -> String {
        let reliability = if self.reliability == Reliability::Reliable { 1 } else { 2 };
        let durability = if self.durability == Durability::TransientLocal { 1 } else { 2 };
        let mut yaml = format!(
            "- history: 1\n  depth: {}\n  reliability: {reliability}\n  durability: {durability}\n",
            self.depth
        );
        // rmw's infinity.
        for name in ["deadline", "lifespan"] {
            let _ = write!(yaml, "  {name}:\n    sec: 9223372036\n    nsec: 854775807\n");
        }
        yaml += "  liveliness: 1\n  liveliness_lease_duration:\n    sec: 9223372036\n    nsec: 854775807\n";
        yaml += "  avoid_ros_namespace_conventions: false\n";
        yaml
    }

    /// Reads what [`Qos::to_rosbag_yaml`] or rosbag2 wrote, in numbers or in words. Missing keys are as in
    /// `self`.
    #[must_use]
    pub fn with_rosbag_yaml(mut self, yaml: &str) -> Self {
        // The first profile counts; it ends before the next dash.
        for line in yaml.trim_start().trim_start_matches('-').split("\n-").next().unwrap_or_default().lines()
        {
            let Some((key, value)) = line.trim().split_once(':') else { continue };
            match (key.trim(), value.trim()) {
                ("depth", value) => self.depth = value.parse().unwrap_or(self.depth).clamp(1, MAX_DEPTH),
                ("reliability", "1" | "reliable") => self.reliability = Reliability::Reliable,
                ("reliability", "2" | "best_effort") => self.reliability = Reliability::BestEffort,
                ("durability", "1" | "transient_local") => self.durability = Durability::TransientLocal,
                ("durability", "2" | "volatile") => self.durability = Durability::Volatile,
                _ => {}
            }
        }
        self
    }
}

/// Changes to a quality of service, for example `best_effort,depth:10`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QosChange {
    reliability: Option<Reliability>,
    durability: Option<Durability>,
    depth: Option<u32>,
}

impl QosChange {
    /// `qos` with the changes.
    #[must_use]
    pub fn apply(self, qos: Qos) -> Qos {
        Qos {
            reliability: self.reliability.unwrap_or(qos.reliability),
            durability: self.durability.unwrap_or(qos.durability),
            depth: self.depth.unwrap_or(qos.depth),
        }
    }
}

impl FromStr for QosChange {
    type Err = QosError;

    fn from_str(given: &str) -> Result<Self, QosError> {
        let mut change = QosChange::default();
        for word in given.split(',').map(str::trim) {
            match (word, word.strip_prefix("depth:").map(str::parse)) {
                ("reliable", _) => change.reliability = Some(Reliability::Reliable),
                ("best_effort", _) => change.reliability = Some(Reliability::BestEffort),
                ("transient_local", _) => change.durability = Some(Durability::TransientLocal),
                ("volatile", _) => change.durability = Some(Durability::Volatile),
                (_, Some(Ok(depth @ 1..=MAX_DEPTH))) => change.depth = Some(depth),
                _ => return Err(QosError { given: given.to_owned(), word: word.to_owned() }),
            }
        }
        Ok(change)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_change_what_they_name() {
        let change: QosChange = "best_effort, depth:7".parse().unwrap();
        let qos = change.apply(Qos::latched());
        assert_eq!((qos.reliability, qos.durability), (Reliability::BestEffort, Durability::TransientLocal));
        assert_eq!(qos.depth, 7);
        for bad in ["", "reliabel", "depth:0", "depth:x", "depth:100001"] {
            let error = bad.parse::<QosChange>().unwrap_err().to_string();
            assert!(error.contains("best_effort") && error.contains(bad), "{error}");
        }
    }

    #[test]
    fn a_bag_gives_back_what_was_offered() {
        let qos =
            Qos { reliability: Reliability::BestEffort, durability: Durability::TransientLocal, depth: 9 };
        assert_eq!(Qos::sensor_data(1).with_rosbag_yaml(&qos.to_rosbag_yaml()), qos);
        let words = "- history: keep_last\n  depth: 4\n  reliability: best_effort\n- depth: 8\n";
        let read = Qos::latched().with_rosbag_yaml(words);
        assert_eq!((read.depth, read.reliability), (4, Reliability::BestEffort));
    }
}
