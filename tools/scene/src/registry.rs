//! Scenes by name.

use crate::scene::Scene;
use std::str::FromStr;
use thiserror::Error;

/// The scenes from one list: the enum, all of it, and what is known of each.
macro_rules! scenes {
    ($($(#[$meta:meta])* $kind:ident: $name:literal, $family:ident, $about:literal;)*) => {
        /// A built-in scene.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum SceneKind { $($(#[$meta])* $kind,)* }

        impl SceneKind {
            /// Every scene.
            pub const ALL: [SceneKind; [$($name),*].len()] = [$(SceneKind::$kind),*];

            /// Name on the command line.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(SceneKind::$kind => $name,)* }
            }

            /// What it shows.
            #[must_use]
            pub fn about(self) -> &'static str {
                match self { $(SceneKind::$kind => $about,)* }
            }

            /// Kind of objects in the scene.
            #[must_use]
            pub fn family(self) -> Family {
                match self { $(SceneKind::$kind => Family::$family,)* }
            }
        }
    };
}

// Tests at random draw scenes by their place in this list: a new one is the last.
scenes! {
    /// Moving soft edges.
    Edge: "edge", Card, "soft edges moving at constant velocity";
    /// Translating log-sinusoid.
    Sinusoid: "sinusoid", Card, "a translating log-sinusoid, event times in closed form";
    /// Blinking lamp.
    Lamp: "lamp", Card, "a blinking lamp over a still pattern: change without motion";
    /// Camera flight.
    Flight: "flight", World, "a 6-DoF flight around turning spheres and panels over textured ground";
    /// Wide radiance range.
    Hdr: "hdr", Card, "a moving pattern from 1e-3 to 1e5 radiance";
    /// Near-dark flight.
    Dark: "dark", World, "the flight at a hundredth of its light, about the dark level of a sensor";
    /// Flight at a standstill.
    Still: "still", World, "the flight at a standstill";
    /// Shaken camera.
    Shake: "shake", World, "the flight's world, its camera shaken at 9 and 11 Hz by 9 and 6 px";
    /// Thin poles and wires.
    Poles: "poles", Wall, "poles and wires 1.2 px wide that move 5 to 13 px a frame before a wall";
    /// Leaves before a wall.
    Foliage: "foliage", Wall, "leaves that move 8 px a frame before a wall that moves 1.7";
    /// Turning propeller.
    Propeller: "propeller", Wall, "three blades that turn 18 degrees a frame before a still wall";
    /// Bouncing ball.
    Bounce: "bounce", Wall, "a turning ball that bounces between frames before a panning wall";
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
