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
    /// Shaken camera.
    Shake,
    /// Thin poles and wires.
    Poles,
    /// Leaves before a wall.
    Foliage,
    /// Turning propeller.
    Propeller,
    /// Bouncing ball.
    Bounce,
}

/// Kind of objects in a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Family {
    /// A patterned image plane.
    Card,
    /// Solids, ground, hills and sky.
    World,
    /// Sheets and solids before an endless wall.
    Wall,
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
    pub const ALL: [SceneKind; 12] = [
        SceneKind::Edge,
        SceneKind::Sinusoid,
        SceneKind::Lamp,
        SceneKind::Flight,
        SceneKind::Hdr,
        SceneKind::Dark,
        SceneKind::Still,
        SceneKind::Shake,
        SceneKind::Poles,
        SceneKind::Foliage,
        SceneKind::Propeller,
        SceneKind::Bounce,
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
            SceneKind::Shake => "shake",
            SceneKind::Poles => "poles",
            SceneKind::Foliage => "foliage",
            SceneKind::Propeller => "propeller",
            SceneKind::Bounce => "bounce",
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
            SceneKind::Shake => "the flight's world, its camera shaken at 9 and 11 Hz by 9 and 6 px",
            SceneKind::Poles => "poles and wires 1.2 px wide that move 5 to 13 px a frame before a wall",
            SceneKind::Foliage => "leaves that move 8 px a frame before a wall that moves 1.7",
            SceneKind::Propeller => "three blades that turn 18 degrees a frame before a still wall",
            SceneKind::Bounce => "a turning ball that bounces between frames before a panning wall",
        }
    }

    /// Kind of objects in the scene.
    #[must_use]
    pub fn family(self) -> Family {
        match self {
            SceneKind::Edge | SceneKind::Sinusoid | SceneKind::Lamp | SceneKind::Hdr => Family::Card,
            SceneKind::Flight | SceneKind::Dark | SceneKind::Still | SceneKind::Shake => Family::World,
            SceneKind::Poles | SceneKind::Foliage | SceneKind::Propeller | SceneKind::Bounce => Family::Wall,
        }
    }

    /// Builds the scene for an image of `width_px` by `height_px` pixels, each at least 1.
    #[must_use]
    pub fn scene(self, width_px: u32, height_px: u32) -> Scene {
        match self.family() {
            Family::Card => crate::cards::scene(self, width_px, height_px),
            Family::World => crate::flight::scene(self, width_px, height_px),
            Family::Wall => crate::wall::scene(self, width_px, height_px),
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
