//! Scenes by name.

use crate::scene::Scene;
use std::str::FromStr;
use thiserror::Error;

/// A built-in scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SceneKind {
    /// Moving soft edges.
    Edge,
    /// Translating log-sinusoid.
    Sinusoid,
    /// Blinking lamp.
    Lamp,
    /// Camera flight.
    Flight,
    /// Wide radiance range.
    Hdr,
    /// Near-dark flight.
    Dark,
    /// Flight at a standstill.
    Still,
}

/// Kind of objects in a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Family {
    /// A patterned image plane.
    Card,
    /// Solids, ground, hills and sky.
    World,
}

/// Error of a name that no scene has.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("unknown scene `{actual}`, expected one of {}", SceneKind::names())]
pub struct UnknownScene {
    /// The name given.
    pub actual: String,
}

impl SceneKind {
    /// Every scene.
    pub const ALL: [SceneKind; 7] = [
        SceneKind::Edge,
        SceneKind::Sinusoid,
        SceneKind::Lamp,
        SceneKind::Flight,
        SceneKind::Hdr,
        SceneKind::Dark,
        SceneKind::Still,
    ];

    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            SceneKind::Edge => "edge",
            SceneKind::Sinusoid => "sinusoid",
            SceneKind::Lamp => "lamp",
            SceneKind::Flight => "flight",
            SceneKind::Hdr => "hdr",
            SceneKind::Dark => "dark",
            SceneKind::Still => "still",
        }
    }

    /// What it shows.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            SceneKind::Edge => "soft edges moving at constant velocity",
            SceneKind::Sinusoid => "a translating log-sinusoid, event times in closed form",
            SceneKind::Lamp => "a blinking lamp over a still pattern: change without motion",
            SceneKind::Flight => "a 6-DoF flight around turning spheres and panels over textured ground",
            SceneKind::Hdr => "a moving pattern from 1e-3 to 1e5 radiance",
            SceneKind::Dark => "the flight at a hundredth of its light, about the dark level of a sensor",
            SceneKind::Still => "the flight at a standstill",
        }
    }

    /// Kind of objects in the scene.
    #[must_use]
    pub fn family(self) -> Family {
        match self {
            SceneKind::Edge | SceneKind::Sinusoid | SceneKind::Lamp | SceneKind::Hdr => Family::Card,
            SceneKind::Flight | SceneKind::Dark | SceneKind::Still => Family::World,
        }
    }

    /// Builds the scene for an image of `width_px` by `height_px` pixels, each at least 1.
    #[must_use]
    pub fn scene(self, width_px: u32, height_px: u32) -> Scene {
        match self.family() {
            Family::Card => crate::cards::scene(self, width_px, height_px),
            Family::World => crate::flight::scene(self, width_px, height_px),
        }
    }

    fn names() -> String {
        Self::ALL.map(SceneKind::name).join(", ")
    }
}

impl FromStr for SceneKind {
    type Err = UnknownScene;

    fn from_str(name: &str) -> Result<Self, UnknownScene> {
        Self::ALL
            .into_iter()
            .find(|kind| kind.name() == name)
            .ok_or_else(|| UnknownScene { actual: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_found_by_its_name() {
        for kind in SceneKind::ALL {
            assert_eq!(kind.name().parse(), Ok(kind));
        }
        let error = "egde".parse::<SceneKind>().unwrap_err().to_string();
        assert!(error.contains("egde") && error.contains("sinusoid"), "{error}");
    }
}
