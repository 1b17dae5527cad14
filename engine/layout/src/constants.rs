//! Specialisation constants. Each list gives a Rust struct, its GLSL declarations and what reflection is checked
//! against. Ids count on through the lists of a kernel: a constant's id is its index in its list plus the lengths of
//! the lists before it.

use esaac_model::{HdrFormat, IdFormat, Intensity, MotionFormat, Synthesis, Taps};

/// Type of a constant in GLSL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpecType {
    /// `uint`.
    Uint,
    /// `bool`.
    Bool,
}

impl SpecType {
    /// Name in GLSL.
    #[must_use]
    pub fn glsl(self) -> &'static str {
        match self {
            SpecType::Uint => "uint",
            SpecType::Bool => "bool",
        }
    }
}

/// A Rust type that a constant can have.
trait SpecValue: Copy {
    const TYPE: SpecType;
    fn word(self) -> u32;
}

impl SpecValue for u32 {
    const TYPE: SpecType = SpecType::Uint;
    fn word(self) -> u32 {
        self
    }
}

impl SpecValue for bool {
    const TYPE: SpecType = SpecType::Bool;
    fn word(self) -> u32 {
        u32::from(self)
    }
}

macro_rules! spec_enums {
    ($($name:ident),*) => {
        $(impl SpecValue for $name {
            const TYPE: SpecType = SpecType::Uint;
            fn word(self) -> u32 {
                self as u32
            }
        })*
    };
}

spec_enums!(Intensity, Synthesis, Taps, HdrFormat, MotionFormat, IdFormat);

/// A constant as kernels declare it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpecConstant {
    /// `constant_id`.
    pub id: u32,
    /// Name of the field.
    pub field: &'static str,
    /// Type.
    pub ty: SpecType,
}

impl SpecConstant {
    /// Name in GLSL; `None` for the number of threads, which GLSL declares as the workgroup's size.
    #[must_use]
    pub fn glsl_name(&self) -> Option<String> {
        (self.field != THREADS).then(|| self.field.to_uppercase())
    }
}

/// Field of the lists that holds the size of a workgroup; GLSL has its id as `THREADS_ID`.
const THREADS: &str = "threads";

/// Constants of one kernel, or those that several kernels share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConstantList {
    /// File that declares them, without `.glsl`.
    pub file: &'static str,
    /// By id.
    pub constants: &'static [SpecConstant],
}

macro_rules! spec_constants {
    ($(#[$meta:meta])* $name:ident in $file:literal from $first:expr;
        $($(#[$field_meta:meta])* $field:ident: $ty:ty,)*) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub struct $name { $($(#[$field_meta])* pub $field: $ty,)* }

        impl $name {
            const NAMES: &'static [&'static str] = &[$(stringify!($field),)*];
            const TYPES: &'static [SpecType] = &[$(<$ty as SpecValue>::TYPE,)*];

            /// The list.
            pub const LIST: ConstantList = ConstantList { file: $file, constants: &{
                let mut constants =
                    [SpecConstant { id: 0, field: "", ty: SpecType::Uint }; Self::NAMES.len()];
                let mut i = 0;
                while i < constants.len() {
                    constants[i] =
                        SpecConstant { id: $first + i as u32, field: Self::NAMES[i], ty: Self::TYPES[i] };
                    i += 1;
                }
                constants
            } };

            /// The values in the order of their ids, as 32-bit words.
            #[must_use]
            pub fn words(&self) -> Vec<u32> {
                vec![$(self.$field.word(),)*]
            }
        }
    };
}

spec_constants! {
    /// Constants of `ingest` that depend on the sensor.
    IngestConstants in "ingest_constants" from 0;
    /// How colour becomes intensity.
    intensity: Intensity,
    /// Whether frames become half-pel frames.
    half_pel: bool,
    /// Format of colour images.
    hdr_format: HdrFormat,
    /// Format of motion images.
    motion_format: MotionFormat,
    /// Format of images of instance ids.
    id_format: IdFormat,
    /// Whether the lens blurs.
    effect_psf: bool,
    /// Whether the corners of the image are darker.
    effect_vignetting: bool,
    /// Whether the lamp flickers.
    effect_flicker: bool,
    /// Whether the lens is an equidistant fisheye; else a pinhole. Only for synthesis `rigid`.
    fisheye: bool,
    /// Whether it is noted where motions meet.
    layered: bool,
    /// Whether sub-steps follow how far levels bend along their motion.
    substeps_by_error: bool,
}

spec_constants! {
    /// Further constants of `ingest_cpu`.
    IngestCpuConstants in "ingest_cpu_constants" from IngestConstants::NAMES.len() as u32;
    /// Whether frames are read by address, not by texel.
    by_address: bool,
    /// Threads of a workgroup.
    threads: u32,
    /// Whether the frame may be a camera's first.
    may_be_first: bool,
}

spec_constants! {
    /// Constants of `detail_transfer`.
    DetailTransferConstants in "detail_transfer_constants" from 0;
    /// How colour becomes intensity.
    intensity: Intensity,
    /// Whether frames are read by address, not by texel.
    by_address: bool,
    /// Whether the lens is an equidistant fisheye; else a pinhole. Only for synthesis `rigid`.
    fisheye: bool,
}

spec_constants! {
    /// Constants of `synthesize`.
    SynthesizeConstants in "synthesize_constants" from 0;
    /// How colour becomes intensity.
    intensity: Intensity,
    /// Whether the lamp flickers.
    effect_flicker: bool,
    /// Frame-gap synthesis.
    synthesis: Synthesis,
    /// Interpolation of warped frames.
    taps: Taps,
    /// Whether the lens is an equidistant fisheye; else a pinhole. Only for synthesis `rigid`.
    fisheye: bool,
    /// Most surfaces that a pixel may show between two frames.
    layers: u32,
    /// Whether `cross` skips tiles without motion and change.
    skips_still_tiles: bool,
}

spec_constants! {
    /// Constants of `cross` that depend on the sensor; code of effects that are off is left out.
    CrossConstants in "cross_constants" from 0;
    /// How colour becomes intensity.
    intensity: Intensity,
    /// Whether thresholds differ from pixel to pixel.
    effect_mismatch: bool,
    /// Whether pixels are held after an event.
    effect_refractory: bool,
    /// Whether references leak.
    effect_leak: bool,
    /// Whether there is shot noise.
    effect_shot: bool,
    /// Whether events are delayed.
    effect_delay: bool,
    /// Whether events are stamped with the ends of sub-steps.
    at_sample: bool,
    /// Whether there are APS frames.
    effect_aps: bool,
    /// Whether the lamp flickers.
    effect_flicker: bool,
    /// Frame-gap synthesis.
    synthesis: Synthesis,
    /// Interpolation of warped frames.
    taps: Taps,
    /// Whether sub-steps are also written to `samples`, for tests.
    dump_samples: bool,
    /// Whether sub-tiles with more events than the queue holds are walked again, which scatters what it does not hold; else
    /// they are left.
    walks_again: bool,
    /// Events that the queue has room for, for each pixel of a sub-tile.
    queue_per_px: u32,
    /// Whether the sub-tiles are walked that the first run has listed.
    second_run: bool,
    /// Whether the lens is an equidistant fisheye; else a pinhole. Only for synthesis `rigid`.
    fisheye: bool,
    /// Most surfaces that a pixel may show between two frames. If more than one, tiles where motions meet are left to
    /// kernels of their own.
    layers: u32,
    /// Whether pixels in still light are passed over until their noise may send something.
    pixels_rest: bool,
    /// Whether settled pixels in still light that send nothing are taken over an interval in closed form.
    passes_still: bool,
}

spec_constants! {
    /// Further constants of `cross_cpu`.
    CrossCpuConstants in "cross_cpu_constants" from CrossConstants::NAMES.len() as u32;
    /// Whether frames are read by address, not by texel.
    by_address: bool,
    /// Threads of a workgroup.
    threads: u32,
    /// Whether pixels may be unarmed.
    may_be_unarmed: bool,
    /// Whether a workgroup takes all sub-tiles of a tile.
    whole_tiles: bool,
}

spec_constants! {
    /// Constants of `sort`.
    SortConstants in "sort_constants" from 0;
    /// Bins that a workgroup takes.
    group_bins: u32,
    /// Threads of a workgroup.
    threads: u32,
    /// Whether the device divides integers as fast as it multiplies floats.
    native_division: bool,
    /// Whether a camera of the rig has a bus.
    has_bus: bool,
    /// Whether events that hardly wait for a bus are served.
    readout_light: bool,
    /// Whether `bin_sums` has summed the bins.
    summed: bool,
}

spec_constants! {
    /// Constants of `readout`.
    ReadoutConstants in "readout_constants" from 0;
    /// Threads of a workgroup.
    threads: u32,
    /// Rounds of loops of a thread after which a dispatch takes no more events.
    most_rounds: u32,
    /// Whether `readout_apart` has served what it can.
    apart: bool,
}

/// Every list.
pub(crate) const LISTS: &[ConstantList] = &[
    IngestConstants::LIST,
    IngestCpuConstants::LIST,
    DetailTransferConstants::LIST,
    SynthesizeConstants::LIST,
    CrossConstants::LIST,
    CrossCpuConstants::LIST,
    SortConstants::LIST,
    ReadoutConstants::LIST,
];

/// The GLSL declarations of a list. Their defaults are never used: the host sets every constant.
pub(crate) fn glsl(list: &ConstantList) -> String {
    let mut out = String::from("// Generated by the crate esaac-layout.\n");
    for constant in list.constants {
        let (id, ty) = (constant.id, constant.ty.glsl());
        match (constant.glsl_name(), constant.ty) {
            (None, _) => out.push_str(&format!("#define THREADS_ID {id}\n")),
            (Some(name), SpecType::Uint) => {
                // As the length of an array, the default must not be 0.
                out.push_str(&format!("layout(constant_id = {id}) const {ty} {name} = 2;\n"));
            }
            (Some(name), SpecType::Bool) => {
                out.push_str(&format!("layout(constant_id = {id}) const {ty} {name} = false;\n"));
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_go_on_where_the_list_before_ends() {
        let ids = |list: ConstantList| list.constants.iter().map(|c| c.id);
        for [first, next] in [
            [IngestConstants::LIST, IngestCpuConstants::LIST],
            [CrossConstants::LIST, CrossCpuConstants::LIST],
        ] {
            let all = (first.constants.len() + next.constants.len()) as u32;
            assert!(ids(first).chain(ids(next)).eq(0..all), "{} and {}", first.file, next.file);
        }
    }

    #[test]
    fn declarations_name_ids_and_types() {
        let text = glsl(&SortConstants::LIST);
        assert!(text.contains("layout(constant_id = 0) const uint GROUP_BINS"), "{text}");
        assert!(text.contains("#define THREADS_ID 1\n"), "{text}");
        assert!(text.contains("layout(constant_id = 2) const bool NATIVE_DIVISION"), "{text}");
    }
}
