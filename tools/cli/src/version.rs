//! What this build of the program is: version, commit and features.

use serde::Serialize;

/// Features of the program that a build may have.
const FEATURES: [(&str, bool); 3] = [
    ("rclrs", cfg!(feature = "rclrs")),
    ("tracy", cfg!(feature = "tracy")),
    ("zenoh", cfg!(feature = "zenoh")),
];

/// A build of the program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Build {
    /// Version of the release.
    pub version: &'static str,
    /// Commit, with `-modified` behind it if the sources differ; `None` if the sources were no git checkout.
    pub commit: Option<&'static str>,
    /// Enabled features.
    pub features: Vec<&'static str>,
}

impl Build {
    /// This program.
    #[must_use]
    pub fn this() -> Self {
        Build {
            version: env!("CARGO_PKG_VERSION"),
            commit: Some(env!("ESAAC_COMMIT")).filter(|commit| !commit.is_empty()),
            features: FEATURES.iter().filter(|(_, enabled)| *enabled).map(|(name, _)| *name).collect(),
        }
    }

    fn to_text(&self) -> String {
        let features = if self.features.is_empty() { "none".to_owned() } else { self.features.join(", ") };
        let commit = match self.commit {
            Some(commit) => format!("commit {commit}"),
            None => "commit unknown: not built from a git checkout".to_owned(),
        };
        format!("{} ({commit}; features: {features})", self.version)
    }
}

/// What `esaac --version` prints behind the program's name.
#[must_use]
pub fn text() -> String {
    Build::this().to_text()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_says_what_it_is_and_what_it_does_not_know() {
        let build =
            Build { version: "1.2.3", commit: Some("0123456789ab"), features: vec!["rclrs", "zenoh"] };
        assert_eq!(build.to_text(), "1.2.3 (commit 0123456789ab; features: rclrs, zenoh)");
        let tarball = Build { commit: None, features: Vec::new(), ..build };
        assert_eq!(
            tarball.to_text(),
            "1.2.3 (commit unknown: not built from a git checkout; features: none)"
        );
    }
}
