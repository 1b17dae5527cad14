//! Bindings of the kernels: descriptor set 0.

use crate::{Camera, Counters, Geometry, Optics, Physical, PoseSegment, Readout, Rest, Track};

/// Whether the binding of a slot is a uniform buffer, a table with a row for each camera; the others are storage
/// buffers.
#[must_use]
pub fn is_table(slot: usize) -> bool {
    matches!(slot, CAMERAS | GEOMETRIES | PHYSICALS | OPTICS | READOUTS | RESTS)
}

/// A binding: slot, name, GLSL element type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BindingSlot {
    /// Slot in descriptor set 0.
    pub slot: u32,
    /// Name in GLSL and of the allocation.
    pub name: &'static str,
    /// Element type in GLSL.
    pub element: &'static str,
    /// Element bytes.
    pub stride: u32,
}

macro_rules! bindings {
    ($($konst:ident = $slot:literal, $name:literal, $element:literal, $stride:expr;)*) => {
        $(#[doc = concat!("Slot of `", $name, "`.")] pub const $konst: usize = $slot;)*
        /// Every binding of the engine's kernels.
        pub const BINDINGS: &[BindingSlot] =
            &[$(BindingSlot { slot: $slot, name: $name, element: $element, stride: $stride },)*];
    };
}

bindings! {
    CAMERAS = 0, "cameras", "Camera", size_of::<Camera>() as u32;
    COUNTERS = 1, "counters", "Counters", size_of::<Counters>() as u32;
    PLANES = 2, "planes", "float", 4;
    MOTION = 3, "motion", "vec2", 8;
    STATE = 4, "state", "uint", 4;
    BLOCKS = 5, "blocks", "uvec4", 16;
    BINS = 6, "bins", "uint", 4;
    BIN_STORAGE = 7, "bin_storage", "uvec2", 8;
    OVERFLOW = 8, "overflow", "uvec2", 8;
    GATHERED = 9, "gathered", "uvec2", 8;
    EVENT_T = 10, "event_t", "uint", 4;
    EVENT_X = 11, "event_x", "uint16_t", 2;
    EVENT_Y = 12, "event_y", "uint16_t", 2;
    EVENT_P = 13, "event_p", "uint8_t", 1;
    APS = 14, "aps", "uint16_t", 2;
    REPORT = 15, "report", "Counters", size_of::<Counters>() as u32;
    SAMPLES = 16, "samples", "int", 4;
    TILE_ORDER = 17, "tile_order", "uint", 4;
    GEOMETRIES = 18, "geometries", "Geometry", size_of::<Geometry>() as u32;
    INSTANCES = 19, "instances", "uvec2", 8;
    POSES = 20, "poses", "vec4", 16;
    PATHS = 21, "paths", "vec4", 16;
    SURFACES = 22, "surfaces", "uvec2", 8;
    SLOPES = 23, "slopes", "uint", 4;
    REPRESENTATIVES = 24, "representatives", "uint", 4;
    PASSING = 25, "passing", "uint", 4;
    PHYSICALS = 26, "physicals", "Physical", size_of::<Physical>() as u32;
    OPTICS = 27, "optics", "Optics", size_of::<Optics>() as u32;
    READOUTS = 28, "readouts", "Readout", size_of::<Readout>() as u32;
    BUS = 29, "bus", "int64_t", 8;
    MEETINGS = 30, "meetings", "uint", 4;
    LEVELS = 31, "levels", "uint", 4;
    LEVEL_WORDS = 32, "level_words", "uvec4", 16;
    LEVEL_ENTRIES = 33, "level_entries", "uvec4", 16;
    RESTS = 34, "rests", "Rest", size_of::<Rest>() as u32;
    TRACKS = 35, "tracks", "Track", size_of::<Track>() as u32;
    SEGMENTS = 36, "segments", "PoseSegment", size_of::<PoseSegment>() as u32;
}

/// A view of a storage buffer that kernels read by texel fetch. The software driver turns a fetch into a vector gather,
/// while it reads the elements of a storage buffer in a loop over lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelSlot {
    /// Slot in descriptor set 0.
    pub slot: u32,
    /// Name in GLSL.
    pub name: &'static str,
    /// Slot of the buffer that it is a view of.
    pub of: usize,
}

/// Every texel view, in the slots after [`BINDINGS`]; a texel is an element of the buffer.
pub const TEXELS: &[TexelSlot] = &[
    TexelSlot { slot: BINDINGS.len() as u32, name: "plane_texels", of: PLANES },
    TexelSlot { slot: BINDINGS.len() as u32 + 1, name: "motion_texels", of: MOTION },
    TexelSlot { slot: BINDINGS.len() as u32 + 2, name: "surface_texels", of: SURFACES },
    TexelSlot { slot: BINDINGS.len() as u32 + 3, name: "slope_texels", of: SLOPES },
    TexelSlot { slot: BINDINGS.len() as u32 + 4, name: "pose_texels", of: POSES },
    TexelSlot { slot: BINDINGS.len() as u32 + 5, name: "path_texels", of: PATHS },
];
