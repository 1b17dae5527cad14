//! RViz2's configuration for the topics that a command publishes.

use crate::stderr;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The configuration for the default namespace.
const RVIZ: &str = include_str!("../../../../ros/esaac.rviz");

/// A file in `folder` with the configuration for `namespace`. The file is new, only its owner can read it,
/// and nobody can know its name in advance, so no other user's file or link can stand in its place. It stays
/// when the program ends, because users start RViz later.
pub fn configuration(folder: &Path, namespace: &str) -> PathBuf {
    write(folder, namespace).unwrap_or_else(|error| {
        // The file of the sources differs in the namespace alone.
        stderr::line(format_args!("warning: no RViz configuration in {}: {error}", folder.display()));
        PathBuf::from("ros/esaac.rviz")
    })
}

fn write(folder: &Path, namespace: &str) -> std::io::Result<PathBuf> {
    let mut file = tempfile::Builder::new().prefix("esaac-").suffix(".rviz").tempfile_in(folder)?;
    file.write_all(RVIZ.replace("/esaac/", &format!("{namespace}/")).as_bytes())?;
    let (_, path) = file.keep()?;
    Ok(path)
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
    fn the_configuration_is_a_new_private_file_that_overwrites_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let victim = folder.path().join("victim");
        std::fs::write(&victim, "precious").unwrap();
        for name in ["esaac_robot.rviz", "esaac-.rviz"] {
            symlink(&victim, folder.path().join(name)).unwrap();
        }
        let paths = [(); 2].map(|()| configuration(folder.path(), "/robot"));
        assert_ne!(paths[0], paths[1]);
        for path in paths {
            let file = path.symlink_metadata().unwrap();
            assert!(file.is_file() && path.starts_with(folder.path()), "{}", path.display());
            assert_eq!(file.permissions().mode() & 0o777, 0o600);
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.contains("Value: /robot/gray/image_raw\n") && !text.contains("/esaac/"));
        }
        assert_eq!(std::fs::read_to_string(&victim).unwrap(), "precious");
    }

    #[test]
    fn a_folder_that_cannot_be_written_leaves_the_file_of_the_sources() {
        assert_eq!(configuration(Path::new("/nonesuch"), "/robot"), Path::new("ros/esaac.rviz"));
    }
}
