//! The commit that a checkout is at. `build.rs` includes this file.

use std::path::{Path, PathBuf};
use std::process::Command;

/// What is checked out.
pub struct Checkout {
    /// Commit, with `-modified` behind it if files differ from it.
    pub commit: String,
    /// A file that changes with every commit and every checkout.
    pub changes_with: PathBuf,
}

impl Checkout {
    /// The checkout whose top folder is `root`. `None` if `root` is no checkout, for example an unpacked
    /// tarball, even if it lies inside the checkout of another project.
    pub fn at(root: &Path) -> Option<Self> {
        let git = |arguments: &[&str]| {
            let output = Command::new("git").arg("-C").arg(root).args(arguments).output().ok()?;
            let text = String::from_utf8(output.stdout).ok()?;
            output.status.success().then(|| text.trim().to_owned())
        };
        let top = PathBuf::from(git(&["rev-parse", "--show-toplevel"])?);
        if top.canonicalize().ok()? != root.canonicalize().ok()? {
            return None;
        }
        let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
        let changes = git(&["status", "--porcelain", "--untracked-files=no"])?;
        let file = |name| Some(root.join(git(&["rev-parse", "--git-path", name])?));
        let log = file("logs/HEAD").filter(|log| log.exists());
        Some(Checkout {
            commit: if changes.is_empty() { commit } else { commit + "-modified" },
            changes_with: log.or_else(|| file("HEAD"))?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn git(folder: &Path, arguments: &[&str]) {
        let mut command = Command::new("git");
        command.arg("-C").arg(folder).args(["-c", "user.name=a", "-c", "user.email=a@example.org"]);
        let output = command.args(arguments).output().expect("git runs");
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }

    #[test]
    fn a_checkout_has_a_commit_and_a_tarball_inside_it_has_none() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        assert!(Checkout::at(root).is_none(), "no checkout at all");
        git(root, &["init", "--quiet"]);
        assert!(Checkout::at(root).is_none(), "no commit yet");
        let tarball = root.join("tarball");
        std::fs::create_dir(&tarball).unwrap();
        std::fs::write(tarball.join("file"), "as released").unwrap();
        git(root, &["add", "."]);
        git(root, &["commit", "--quiet", "--message=first"]);
        let first = Checkout::at(root).unwrap();
        assert!(first.commit.len() == 12 && first.commit.chars().all(|c| c.is_ascii_hexdigit()));
        assert!(first.changes_with.exists(), "{}", first.changes_with.display());
        std::fs::write(tarball.join("file"), "edited").unwrap();
        assert_eq!(Checkout::at(root).unwrap().commit, first.commit.clone() + "-modified");
        let log = std::fs::read(&first.changes_with).unwrap();
        git(root, &["commit", "--quiet", "--all", "--message=second"]);
        assert_ne!(Checkout::at(root).unwrap().commit, first.commit);
        assert_ne!(std::fs::read(&first.changes_with).unwrap(), log);
        assert!(Checkout::at(&tarball).is_none(), "inside another project's checkout");
    }
}
