//! What the parameters that are choices may be.

use serde::{Deserialize, Serialize};

/// What turns light into events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pixel {
    /// Watches log intensity.
    Log,
    /// A photoreceptor with speed and noise of its own; see [`physical`](crate::physical).
    Physical,
}

/// How RGB becomes the scalar that a pixel sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum Intensity {
    /// Mean of R, G, B.
    Gray = 0,
    /// Rec. 709.
    Luminance = 1,
    /// One component a pixel, R at (0, 0).
    BayerRggb = 2,
    /// Front-illuminated silicon behind an infrared cut filter.
    SiliconFront = 3,
    /// Back-illuminated silicon behind an infrared cut filter.
    SiliconBack = 4,
    /// Front-illuminated silicon without an infrared cut filter.
    SiliconFrontIr = 5,
    /// Back-illuminated silicon without an infrared cut filter.
    SiliconBackIr = 6,
}

impl Intensity {
    /// Every intensity.
    pub const ALL: [Intensity; 7] = [
        Intensity::Gray,
        Intensity::Luminance,
        Intensity::BayerRggb,
        Intensity::SiliconFront,
        Intensity::SiliconBack,
        Intensity::SiliconFrontIr,
        Intensity::SiliconBackIr,
    ];
}

/// How the intensity between two rendered frames is synthesised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum Synthesis {
    /// Both frames warped along the trajectories of surface points.
    Motion = 0,
    /// Blend of the two frames in linear intensity.
    Linear = 1,
    /// The paper's equation as printed.
    Paper = 2,
    /// One sub-step: log-linear from frame to frame.
    None = 3,
    /// Both frames read along the exact paths of a simulator's poses ([`rigid`](crate::synthesis::rigid)).
    Rigid = 4,
    /// The best that a camera's input allows; see [`Synthesis::resolve`]. No kernel knows it.
    Auto = 5,
}

impl Synthesis {
    /// Every synthesis.
    pub const ALL: [Synthesis; 6] = [
        Synthesis::Motion,
        Synthesis::Linear,
        Synthesis::Paper,
        Synthesis::None,
        Synthesis::Rigid,
        Synthesis::Auto,
    ];

    /// The synthesis of a camera that may or may not get depth and poses, and motion vectors: `Auto` is the best of
    /// those that these allow, any other stays.
    #[must_use]
    pub fn resolve(self, has_geometry: bool, has_motion: bool) -> Synthesis {
        match self {
            Synthesis::Auto if has_geometry => Synthesis::Rigid,
            Synthesis::Auto if has_motion => Synthesis::Motion,
            Synthesis::Auto => Synthesis::Linear,
            chosen => chosen,
        }
    }

    /// Name, as in TOML and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Synthesis::Motion => "motion",
            Synthesis::Linear => "linear",
            Synthesis::Paper => "paper",
            Synthesis::None => "none",
            Synthesis::Rigid => "rigid",
            Synthesis::Auto => "auto",
        }
    }

    /// Whether it reads half-pel frames, with cubic taps.
    #[must_use]
    pub fn has_half_pels(self) -> bool {
        matches!(self, Synthesis::Motion | Synthesis::Rigid)
    }

    /// Whether it needs motion vectors.
    #[must_use]
    pub fn needs_motion(self) -> bool {
        matches!(self, Synthesis::Motion | Synthesis::Paper)
    }

    /// Whether it follows motion vectors, if there are some: `rigid` does where a pixel has no path.
    #[must_use]
    pub fn follows_motion(self) -> bool {
        self.needs_motion() || self == Synthesis::Rigid
    }
}

/// Interpolation between pixels of a warped frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum Taps {
    /// Twelve taps.
    Cubic = 0,
    /// Four taps.
    Bilinear = 1,
}

/// How the number of sub-steps is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum SubstepPolicy {
    /// Per block, from its motion and change, `substeps` at the most.
    Adaptive = 0,
    /// Always `substeps`.
    Fixed = 1,
}

/// The time of a crossing within a sub-step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum Timestamps {
    /// The crossing's own instant, interpolated within the sub-step.
    Interpolated = 0,
    /// The end of the sub-step.
    AtSample = 1,
}
