//! GPU data layouts and binding slots: the one source from which the GLSL declarations are generated
//! ([`glsl`]) and against which every compiled kernel's reflection is checked.

use bytemuck::{Pod, Zeroable};

/// A struct that lies in GPU memory: Rust and GLSL declarations from one list.
macro_rules! gpu_struct {
    ($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ident,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
        #[repr(C)]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }

        impl GpuStruct for $name {
            const NAME: &'static str = stringify!($name);
            const FIELDS: &'static [(&'static str, &'static str, usize)] =
                &[$((stringify!($field), stringify!($type), std::mem::offset_of!($name, $field)),)*];
        }
    };
}

/// What the generator and the checks need to know of a layout.
pub trait GpuStruct: Pod {
    /// Name in Rust and GLSL.
    const NAME: &'static str;
    /// Field, Rust type, byte offset.
    const FIELDS: &'static [(&'static str, &'static str, usize)];
}

gpu_struct! {
    /// Everything a kernel knows of a camera in one tick.
    Camera {
        /// Device address of the colour image.
        hdr_address: u64,
        /// Device address of the motion image.
        motion_address: u64,
        /// Device address of `planes`.
        planes_address: u64,
        /// Start of the interval.
        start_ns: i64,
        /// Time that leak counts from.
        epoch_ns: i64,
        /// 0 not in this tick, 1 first frame, 2 interval.
        phase: u32,
        /// Length of the interval.
        interval_ns: u32,
        /// Length of the interval before, 0 if there was none.
        previous_interval_ns: u32,
        /// From the packet's base to the interval's start.
        base_to_start_ns: u32,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Columns times rows.
        pixels: u32,
        /// Blocks in a row.
        blocks_x: u32,
        /// Blocks in all.
        blocks: u32,
        /// The camera's number in random counters.
        camera: u32,
        /// Seed, low word.
        seed_low: u32,
        /// Seed, high word.
        seed_high: u32,
        /// Which of the two frame planes holds the current frame.
        parity: u32,
        /// Whether this frame has motion.
        has_motion: u32,
        /// Whether the frame before had motion.
        has_previous_motion: u32,
        /// First element in `planes`.
        plane_base: u32,
        /// First element in `motion`.
        motion_base: u32,
        /// First word in `state`.
        state_base: u32,
        /// First element in `blocks`.
        block_base: u32,
        /// First element in `bins`, of which there are two sets, used in turn.
        bin_base: u32,
        /// Bins of the packet; one more holds what is late.
        bin_count: u32,
        /// Nanoseconds a bin, or samples.
        bin_width: u32,
        /// Bins a time step is cut into by rows of pixels.
        bin_rows: u32,
        /// Pixels in one of these.
        bin_row_px: u32,
        /// Sub-steps whose ends are the only event times; 0 if times are free.
        bin_samples: u32,
        /// First element in the event buffers.
        event_base: u32,
        /// Events that fit.
        event_capacity: u32,
        /// First element in `aps`.
        aps_base: u32,
        /// Largest number of sub-steps.
        substeps: u32,
        /// Whether it is also the least.
        substeps_fixed: u32,
        /// Whether no block may be skipped in this tick.
        no_skip: u32,
        /// Radiance to intensity.
        exposure_gain: f32,
        /// Dark level.
        log_offset: f32,
        /// Refractory period.
        refractory_ns: u32,
        /// Constant delay.
        latency_ns: u32,
        /// Deviation of the delay.
        latency_jitter_ns: u32,
        /// Time-stamp quantum.
        timestamp_quantum_ns: u32,
        /// Nominal ON threshold, Q7.24.
        contrast_on_q24: i32,
        /// Nominal OFF threshold, Q7.24.
        contrast_off_q24: i32,
        /// Shot-noise hazard of one polarity in the dark, Q27 per nanosecond.
        hazard_q27_per_ns: f32,
        /// 1 / white level.
        inverse_white: f32,
        /// Exposure start in the interval.
        aps_start_ns: u32,
        /// Exposure end in the interval.
        aps_end_ns: u32,
        /// Mean intensity to APS value.
        aps_scale: f32,
        /// Largest APS value.
        aps_max: f32,
        /// The camera's place in `counters`, whatever its place in `cameras`.
        slot: u32,
        /// First element in `samples`.
        samples_base: u32,
        /// `ln(log_offset)`: what a pixel sees in the dark.
        log_dark: f32,
        /// Words that `planes` keeps of a frame of one colour component.
        frame_words: u32,
        /// Words from one row of a lattice to the next, 0 where frames have none.
        lattice_stride: u32,
        /// First element in `strip_order`.
        strip_base: u32,
        /// Sub-steps of a strip beyond which it goes first.
        many_substeps: u32,
        /// First element in `rooms`.
        rooms_base: u32,
        /// Events that a bin has room for; others are spilled.
        bin_room: u32,
    }
}

gpu_struct! {
    /// What a camera's kernels count in one tick; two sets, used in turn.
    Counters {
        /// Events found, put into bins or not.
        staged: u32,
        /// Events before those of the first part of a strip that did not fit, `u32::MAX` if all fitted.
        staged_fit: u32,
        /// Events in the packet.
        packet: u32,
        /// Events for later packets.
        late: u32,
        /// Pixels held for a NaN, infinite or negative colour.
        invalid_pixels: u32,
        /// Pixels without a usable motion vector.
        invalid_motion: u32,
        /// Pixels that never had a valid colour.
        unarmed_pixels: u32,
        /// Blocks that were skipped.
        skipped_blocks: u32,
        /// Sub-steps, summed over blocks.
        substeps: u32,
        /// Strips of blocks that had more events than their list holds; `cross` takes them again without one.
        crowded_strips: u32,
        /// Events in the largest bin of the packet.
        largest_bin: u32,
        /// Strips with more than `many_substeps`, in line from the front.
        slow_strips: u32,
        /// The others, in line from the back.
        quick_strips: u32,
        /// Events that found no room in their bin, and late ones.
        spilled: u32,
        /// Whether `sort` has left the packet to `merge`.
        heavy: u32,
        /// Events of such a packet that `sort` has gathered.
        gathered: u32,
        /// Late events that it has gathered.
        gathered_late: u32,
    }
}

gpu_struct! {
    /// What a dispatch is told.
    Push {
        /// Cameras of one dispatch are neighbours in the table: the first of them; `gl_WorkGroupID.y`
        /// counts them.
        first_camera: u32,
        /// Which pass of `merge` or `voxel_grid` it is; nothing to the other kernels.
        level: u32,
        /// Device address of a [`Slice`] for each camera, for kernels that read packets.
        slices: u64,
        /// Device address of what they write.
        target: u64,
        /// Events of all cameras that write there.
        events: u32,
        /// Time bins of `voxel_grid`.
        bins: u32,
    }
}

gpu_struct! {
    /// A camera's packet, for kernels that read packets: `gather`, `event_frame`, `voxel_grid`.
    Slice {
        /// Time that the events' offsets count from.
        base_ns: i64,
        /// First event in the packet's arrays.
        event_base: u32,
        /// Events.
        events: u32,
        /// Columns.
        width: u32,
        /// Columns times rows.
        pixels: u32,
        /// From the base to the interval's start.
        base_to_start_ns: u32,
        /// Length of the interval, at least 1.
        interval_ns: u32,
        /// First element of what is written.
        first: u32,
        /// Events of the cameras before.
        events_before: u32,
    }
}

/// Fractional bits of a vote in `voxel_grid`, which sums integers so that their order does not matter.
pub const VOTE_FRACTION_BITS: u32 = 14;

/// Events that a workgroup of `merge` sorts or merges in shared memory.
pub const RUN_EVENTS: u32 = 2048;

/// Bins next to each other that one workgroup of `sort` takes on a GPU: several of its lines on the bus.
pub const GROUP_BINS: u32 = 8;

/// The same in a rig of [`MANY_BINS`]: each workgroup adds up all bins of its camera, and there are enough of them to
/// fill a GPU.
pub const GROUP_BINS_OF_MANY: u32 = 16;

/// Bins of a rig that has many, see [`GROUP_BINS_OF_MANY`].
pub const MANY_BINS: u32 = 1 << 13;

/// The same on a processor, which has few cores to keep busy and for which a workgroup is dear.
pub const SOFTWARE_GROUP_BINS: u32 = 32;

/// Events that a workgroup of `sort` has room for in shared memory; `merge` sorts packets that have a larger bin.
pub const SORTABLE_EVENTS: u32 = 2048;

/// Spilled events at the most that a workgroup of `sort` looks through for those of its bins; `merge` sorts packets
/// that have more.
pub const SEARCHED_EVENTS: u32 = 1 << 15;

/// Blocks side by side that one workgroup takes: 32 pixels in a row, a subgroup's width.
pub const STRIP_BLOCKS: u32 = 4;

/// Threads of a workgroup of `cross` on a GPU, one a pixel of half a strip: small workgroups end at their own time, and
/// leave their place on the device to others.
pub const CROSS_THREADS: u32 = STRIP_BLOCKS * crate::substeps::BLOCK_PX * 4;

/// Threads of a workgroup of `ingest` and `enhance` on a GPU: one a pixel of a strip.
pub const INGEST_THREADS: u32 = STRIP_BLOCKS * crate::substeps::BLOCK_PX * crate::substeps::BLOCK_PX;

/// Threads of a workgroup of `sort` on a GPU.
pub const SORT_THREADS: u32 = 256;

/// The same on a processor. Fewer would be faster, but the software driver ends a thread's loops, all of them together,
/// after 65535 rounds.
pub const SOFTWARE_SORT_THREADS: u32 = 64;

/// Threads of a workgroup of `ingest` and `cross` on a processor, one a pixel of a row of a strip: there a thread is dear
/// before it comes to its first pixel, and takes many.
pub const SOFTWARE_THREADS: u32 = STRIP_BLOCKS * crate::substeps::BLOCK_PX;

/// Cameras that the table holds: 64 KiB, which every device grants a uniform buffer.
pub const MAX_CAMERAS: usize = 256;

/// A binding, uniform for `cameras` and storage for the rest: slot, name, GLSL element type.
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
    ROOMS = 7, "rooms", "uvec2", 8;
    SPILLED = 8, "spilled", "uvec2", 8;
    GATHERED = 9, "gathered", "uvec2", 8;
    EVENT_T = 10, "event_t", "uint", 4;
    EVENT_X = 11, "event_x", "uint16_t", 2;
    EVENT_Y = 12, "event_y", "uint16_t", 2;
    EVENT_P = 13, "event_p", "uint8_t", 1;
    APS = 14, "aps", "uint16_t", 2;
    REPORT = 15, "report", "Counters", size_of::<Counters>() as u32;
    SAMPLES = 16, "samples", "int", 4;
    STRIP_ORDER = 17, "strip_order", "uint", 4;
}

/// A view of a storage buffer that kernels read by texel fetch, which the software driver turns into vector
/// gathers: reading a buffer's elements costs it a loop over lanes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelSlot {
    /// Slot in descriptor set 0.
    pub slot: u32,
    /// Name in GLSL.
    pub name: &'static str,
    /// Slot of the buffer that it shows.
    pub of: usize,
}

/// Every such view, in the slots after [`BINDINGS`]; a texel is an element of the buffer.
pub const TEXELS: &[TexelSlot] = &[
    TexelSlot { slot: BINDINGS.len() as u32, name: "plane_texels", of: PLANES },
    TexelSlot { slot: BINDINGS.len() as u32 + 1, name: "motion_texels", of: MOTION },
];

/// Words of state a pixel has, each a plane of `pixels` words: the log-intensity pixel's. Another
/// pixel model lists its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum StateWord {
    /// Reference, Q7.24; `i32::MIN` while unarmed.
    Reference = 0,
    /// ON threshold, Q7.24.
    ContrastOn = 1,
    /// OFF threshold, Q7.24.
    ContrastOff = 2,
    /// Leak, Q24 of a neper per nanosecond, times 2^32.
    Leak = 3,
    /// End of the refractory period, absolute nanoseconds, low word.
    HeldLow = 4,
    /// Its high word; `i64::MIN` in both when not held.
    HeldHigh = 5,
    /// Hazard left to the next OFF shot event, Q5.27.
    ShotOffHazard = 6,
    /// Hazard left to the next ON shot event, Q5.27.
    ShotOnHazard = 7,
    /// OFF shot draws made.
    ShotOffDraws = 8,
    /// ON shot draws made.
    ShotOnDraws = 9,
    /// Events sent.
    Events = 10,
}

/// Words of state a pixel has.
pub const STATE_WORDS: u32 = 11;

/// Reference of a pixel that never had a valid colour.
pub const UNARMED: i32 = i32::MIN;

/// Reference of a pixel whose first valid colour came with this frame.
pub const ARMING: i32 = i32::MIN + 1;

fn glsl_type(rust: &str) -> &'static str {
    match rust {
        "u32" => "uint",
        "i32" => "int",
        "f32" => "float",
        "u64" => "uint64_t",
        "i64" => "int64_t",
        other => unreachable!("no GLSL type for {other}"),
    }
}

fn glsl_members<T: GpuStruct>(out: &mut String) {
    out.push_str(&format!("{} {{\n", T::NAME));
    for (field, rust, _) in T::FIELDS {
        out.push_str(&format!("    {} {field};\n", glsl_type(rust)));
    }
    out.push('}');
}

fn glsl_struct<T: GpuStruct>(out: &mut String) {
    out.push_str("struct ");
    glsl_members::<T>(out);
    out.push_str(";\n");
}

/// The declarations that every kernel includes: structs, slots, constants.
#[must_use]
pub fn glsl() -> String {
    let mut out = String::from("// Generated from the model crate's layout module.\n");
    glsl_struct::<Camera>(&mut out);
    glsl_struct::<Counters>(&mut out);
    glsl_struct::<Slice>(&mut out);
    out.push_str("layout(push_constant) uniform ");
    glsl_members::<Push>(&mut out);
    out.push_str(" push;\n");
    for binding in BINDINGS {
        let upper = binding.name.to_uppercase();
        out.push_str(&format!(
            "#define SLOT_{upper} {}\n#define TYPE_{upper} {}\n",
            binding.slot, binding.element
        ));
    }
    for texels in TEXELS {
        out.push_str(&format!("#define SLOT_{} {}\n", texels.name.to_uppercase(), texels.slot));
    }
    let coefficients = crate::random::LOG2_COEFFICIENTS_Q30.map(|c| c.to_string()).join(", ");
    out.push_str(&format!(
        "const int LOG2_COEFFICIENTS_Q30[{}] = int[]({coefficients});\n",
        crate::random::LOG2_COEFFICIENTS_Q30.len()
    ));
    for (name, word) in [
        ("REFERENCE", StateWord::Reference),
        ("CONTRAST_ON", StateWord::ContrastOn),
        ("CONTRAST_OFF", StateWord::ContrastOff),
        ("LEAK", StateWord::Leak),
        ("HELD_LOW", StateWord::HeldLow),
        ("HELD_HIGH", StateWord::HeldHigh),
        ("SHOT_OFF_HAZARD", StateWord::ShotOffHazard),
        ("SHOT_ON_HAZARD", StateWord::ShotOnHazard),
        ("SHOT_OFF_DRAWS", StateWord::ShotOffDraws),
        ("SHOT_ON_DRAWS", StateWord::ShotOnDraws),
        ("EVENTS", StateWord::Events),
    ] {
        out.push_str(&format!("#define STATE_{name} {}\n", word as u32));
    }
    for (name, value) in [
        ("BLOCK_PX", crate::substeps::BLOCK_PX.to_string()),
        ("MAX_SUBSTEPS", crate::substeps::MAX_SUBSTEPS.to_string()),
        ("SUBSTEP_MOTION_PX", format!("{:.9}", crate::substeps::SUBSTEP_MOTION_PX)),
        ("SUBSTEP_TIME_ERROR_NS", format!("{:.1}", crate::substeps::SUBSTEP_TIME_ERROR_NS)),
        ("STRIP_BLOCKS", format!("{STRIP_BLOCKS}u")),
        ("CROSS_THREADS", CROSS_THREADS.to_string()),
        ("INGEST_THREADS", INGEST_THREADS.to_string()),
        ("SORT_THREADS", SORT_THREADS.to_string()),
        ("RUN_EVENTS", format!("{RUN_EVENTS}u")),
        ("SORTABLE_EVENTS", format!("{SORTABLE_EVENTS}u")),
        ("SEARCHED_EVENTS", format!("{SEARCHED_EVENTS}u")),
        ("MAX_CAMERAS", MAX_CAMERAS.to_string()),
        ("VOTE_FRACTION_BITS", VOTE_FRACTION_BITS.to_string()),
        ("CUBIC_FRAME", format!("{:.6}", crate::synthesis::CUBIC_FRAME)),
        ("CUBIC_LATTICE", format!("{:.6}", crate::synthesis::CUBIC_LATTICE)),
        ("CELL_SLACK", format!("{:.6}", crate::synthesis::CELL_SLACK)),
        ("TRUST_PX", format!("{:.6}", crate::synthesis::TRUST_PX)),
        ("EDGE_PX", format!("{:.6}", crate::synthesis::EDGE_PX)),
        ("EDGE_WEIGHT", format!("{:.9}", crate::synthesis::EDGE_WEIGHT)),
        ("PATH_STEPS", crate::synthesis::PATH_STEPS.to_string()),
        ("LOG_SCALE", format!("{:.1}", f64::from(1_u32 << crate::LOG_FRACTION_BITS))),
        ("HAZARD_FRACTION_BITS", crate::random::HAZARD_FRACTION_BITS.to_string()),
        ("UNARMED", "(-2147483647 - 1)".to_owned()),
        ("ARMING", "(-2147483647)".to_owned()),
        ("STREAM_SHOT_OFF", (crate::random::Stream::ShotOff as u32).to_string() + "u"),
        ("STREAM_SHOT_ON", (crate::random::Stream::ShotOn as u32).to_string() + "u"),
        ("STREAM_JITTER", (crate::random::Stream::Jitter as u32).to_string() + "u"),
        (
            "REC709",
            format!(
                "vec3({}, {}, {})",
                crate::intensity::REC709[0],
                crate::intensity::REC709[1],
                crate::intensity::REC709[2]
            ),
        ),
        ("HDR_F16X4", (crate::HdrFormat::F16x4 as u32).to_string()),
        ("HDR_F32X4", (crate::HdrFormat::F32x4 as u32).to_string()),
        ("HDR_SRGB8X4", (crate::HdrFormat::Srgb8x4 as u32).to_string()),
        ("MOTION_F16X2", (crate::MotionFormat::F16x2 as u32).to_string()),
        ("MOTION_F32X2", (crate::MotionFormat::F32x2 as u32).to_string()),
        ("MOTION_F32X4", (crate::MotionFormat::F32x4 as u32).to_string()),
        ("INTENSITY_GRAY", (crate::Intensity::Gray as u32).to_string()),
        ("INTENSITY_LUMINANCE", (crate::Intensity::Luminance as u32).to_string()),
        ("INTENSITY_BAYER_RGGB", (crate::Intensity::BayerRggb as u32).to_string()),
        ("SYNTHESIS_MOTION", (crate::Synthesis::Motion as u32).to_string()),
        ("SYNTHESIS_LINEAR", (crate::Synthesis::Linear as u32).to_string()),
        ("SYNTHESIS_PAPER", (crate::Synthesis::Paper as u32).to_string()),
        ("SYNTHESIS_NONE", (crate::Synthesis::None as u32).to_string()),
        ("TAPS_CUBIC", (crate::Taps::Cubic as u32).to_string()),
        ("TAPS_BILINEAR", (crate::Taps::Bilinear as u32).to_string()),
    ] {
        out.push_str(&format!("#define {name} {value}\n"));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_of_structs_have_no_hidden_tail() {
        // Sixteen is a uniform buffer's array alignment.
        assert_eq!(size_of::<Camera>() % 16, 0);
        assert!(size_of::<Camera>() * MAX_CAMERAS <= 65_536);
        assert_eq!(size_of::<Counters>() % 4, 0);
    }

    #[test]
    fn slots_are_dense_and_named_once() {
        for (index, binding) in BINDINGS.iter().enumerate() {
            assert_eq!(binding.slot as usize, index);
            assert_eq!(BINDINGS.iter().filter(|b| b.name == binding.name).count(), 1);
        }
        for (index, texels) in TEXELS.iter().enumerate() {
            assert_eq!(texels.slot as usize, BINDINGS.len() + index);
            assert!(texels.of < BINDINGS.len() && BINDINGS.iter().all(|b| b.name != texels.name));
        }
    }

    #[test]
    fn generated_glsl_names_every_field() {
        let text = glsl();
        for (field, ..) in Camera::FIELDS.iter().chain(Counters::FIELDS).chain(Push::FIELDS) {
            assert!(text.contains(&format!(" {field};")), "{field}");
        }
    }
}
