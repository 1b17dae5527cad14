//! RViz2's configuration for the topics that a command publishes.

use crate::{output_file, stderr};
use anyhow::{Result, ensure};
use std::fs::DirBuilder;
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

/// The configuration for the default namespace.
const RVIZ: &str = include_str!("../../../../ros/esaac.rviz");

/// A file with the configuration for `namespace`, in a folder of this user's own in `parent`. It stays when the program
/// ends, because users start RViz later; the next run with this namespace overwrites it.
pub fn configuration(parent: &Path, namespace: &str) -> PathBuf {
    write(parent, namespace).unwrap_or_else(|error| {
        // The file of the sources differs in the namespace alone.
        stderr::line(format_args!("warning: no RViz configuration in {}: {error:#}", parent.display()));
        PathBuf::from("ros/esaac.rviz")
    })
}

fn write(parent: &Path, namespace: &str) -> Result<PathBuf> {
    let path = own_folder(parent)?.join(format!("topics{}.rviz", namespace.replace('/', "_")));
    let text = RVIZ.replace("/esaac/", &format!("{namespace}/"));
    output_file::write(&path, |out| Ok(out.write_all(text.as_bytes())?))?;
    Ok(path)
}

/// A folder that this user alone can enter. Everybody knows its name, so it is an error if another user was first.
fn own_folder(parent: &Path) -> Result<PathBuf> {
    let user = std::fs::metadata("/proc/self")?.uid();
    let folder = parent.join(format!("esaac-{user}"));
    match DirBuilder::new().mode(0o700).create(&folder) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        made => made?,
    }
    let found = folder.symlink_metadata()?;
    let is_own = found.is_dir() && found.uid() == user && found.mode() & 0o077 == 0;
    ensure!(is_own, "{} is not a folder of yours alone", folder.display());
    Ok(folder)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{PermissionsExt, symlink};

    #[test]
    fn the_configuration_shows_topics_of_the_demo() {
        for topic in ["gray/image_raw", "gray/aps/image_raw", "bayer/aps/image_raw", "gray/depth/image_raw"] {
            assert!(RVIZ.contains(&format!("Value: /esaac/{topic}\n")), "{topic}");
        }
    }

    #[test]
    fn runs_of_one_namespace_share_a_file_that_others_cannot_reach() {
        let parent = tempfile::tempdir().unwrap();
        let path = configuration(parent.path(), "/robot");
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("Value: /robot/gray/image_raw\n") && !text.contains("/esaac/"));
        let folder = path.parent().unwrap();
        assert!(folder.starts_with(parent.path()));
        assert_eq!(folder.metadata().unwrap().permissions().mode() & 0o777, 0o700);
        assert_eq!(configuration(parent.path(), "/robot"), path);
        assert_ne!(configuration(parent.path(), "/robot/arm"), path);
        assert_eq!(std::fs::read_dir(folder).unwrap().count(), 2);
    }

    #[test]
    fn a_folder_that_is_not_this_users_alone_leaves_the_file_of_the_sources() {
        let sources = Path::new("ros/esaac.rviz");
        assert_eq!(configuration(Path::new("/nonesuch"), "/robot"), sources);
        let parent = tempfile::tempdir().unwrap();
        let folder = own_folder(parent.path()).unwrap();
        std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o755)).unwrap();
        assert_eq!(configuration(parent.path(), "/robot"), sources);
        std::fs::remove_dir(&folder).unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        symlink(elsewhere.path(), &folder).unwrap();
        assert_eq!(configuration(parent.path(), "/robot"), sources);
        assert_eq!(std::fs::read_dir(elsewhere.path()).unwrap().count(), 0);
    }
}
