//! Structs that lie in GPU memory.

use crate::sizes::{MAX_CAMERAS, UNIFORM_BYTES};
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

/// A struct whose layout the GLSL generator and the reflection checks know.
pub trait GpuStruct: Pod {
    /// Name in Rust and GLSL.
    const NAME: &'static str;
    /// Field, Rust type, byte offset.
    const FIELDS: &'static [(&'static str, &'static str, usize)];
}

// A message of a constant assertion is what the compiler prints, so it says what to do.
const _: () = assert!(
    size_of::<Camera>() * MAX_CAMERAS <= UNIFORM_BYTES,
    "the table of cameras is larger than a uniform buffer: put the new field into a side table, as `Optics` does"
);
const _: () = assert!(
    size_of::<Geometry>() * MAX_CAMERAS <= UNIFORM_BYTES,
    "the table of geometries is larger than a uniform buffer: put the new field into a table of its own"
);

gpu_struct! {
    /// Parameters of a camera in one tick, as kernels read them: a row of the table of cameras.
    ///
    /// The row is full: the table has room for [`MAX_CAMERAS`] rows of this size and no larger ones. What a new effect
    /// needs goes into a side table with a row for each camera, as [`Optics`], [`Rest`] and [`Physical`] are.
    Camera {
        /// Device address of the colour image.
        hdr_address: u64,
        /// Device address of the motion image.
        motion_address: u64,
        /// Device address of `planes`.
        planes_address: u64,
        /// Start of the interval: time of the previous frame.
        start_ns: i64,
        /// Time from which leak is counted: that of the first frame.
        epoch_ns: i64,
        /// A [`FrameKind`].
        frame_kind: u32,
        /// Length of the interval.
        interval_ns: u32,
        /// Length of the previous interval, 0 if there is none.
        previous_interval_ns: u32,
        /// Time from the packet's base to the interval's start.
        base_to_start_ns: u32,
        /// Earliest time stamp, from the packet's base on: packets before are complete up to the nanosecond before it.
        first_stamp_ns: u32,
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
        /// Which of the two sets of planes holds the current frame.
        frame_slot: u32,
        /// Whether this frame has motion.
        has_motion: u32,
        /// Whether the previous frame has motion.
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
        /// Bins of the packet; one more counts deferred events.
        bin_count: u32,
        /// Nanoseconds of a time step; 0 if the ends of sub-steps are the only event times, each a time step of its own.
        bin_width: u32,
        /// Bins of a time step, each a range of pixels in row-major order.
        bin_rows: u32,
        /// Pixels of such a range.
        bin_row_px: u32,
        /// First element in the event buffers.
        event_base: u32,
        /// Events that fit the camera's part of the event buffers.
        event_capacity: u32,
        /// First element in `aps`.
        aps_base: u32,
        /// Largest number of sub-steps.
        substeps: u32,
        /// Whether every block has that many sub-steps.
        substeps_fixed: u32,
        /// Whether no block may be skipped in this tick.
        no_skip: u32,
        /// Factor from radiance to intensity.
        exposure_gain: f32,
        /// Dark level, added to intensity before the logarithm.
        log_offset: f32,
        /// Refractory period.
        refractory_ns: u32,
        /// Constant delay.
        latency_ns: u32,
        /// Standard deviation of the delay.
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
        /// Start of the APS exposure after the interval's start.
        aps_start_ns: u32,
        /// End of the APS exposure after the interval's start.
        aps_end_ns: u32,
        /// Factor from mean intensity to APS value.
        aps_scale: f32,
        /// Largest APS value.
        aps_max: f32,
        /// The camera's place in `counters`, whatever its place in `cameras`.
        slot: u32,
        /// First element in `samples`.
        samples_base: u32,
        /// `ln(log_offset)`: log intensity in the dark.
        log_dark: f32,
        /// Words in `planes` of one frame of one colour component.
        frame_words: u32,
        /// Words from one row of a half-pel frame to the next; 0 without half-pel frames.
        half_pel_stride: u32,
        /// First element in `tile_order`.
        tile_base: u32,
        /// Tiles with more sub-steps than this are first in `tile_order`.
        many_substeps: u32,
        /// First element in `bin_storage`.
        bin_storage_base: u32,
        /// Events that a bin has storage for; further ones go to the overflow buffer.
        bin_capacity: u32,
    }
}

gpu_struct! {
    /// What synthesis `rigid` knows of a camera in one tick: a row of the table of geometries, in the camera's `slot`.
    Geometry {
        /// Device address of the depth image.
        depth_address: u64,
        /// Device address of the image of instance ids; 0 if there are none.
        id_address: u64,
        /// Focal length along x, pixels; a radian for a fisheye.
        focal_x_px: f32,
        /// Focal length along y.
        focal_y_px: f32,
        /// 1 / focal length along x.
        inverse_focal_x: f32,
        /// 1 / focal length along y.
        inverse_focal_y: f32,
        /// Principal point, column.
        centre_x_px: f32,
        /// Principal point, row.
        centre_y_px: f32,
        /// First element in `surfaces` and in `slopes`, which have two sets of `pixels`, used in turn.
        surface_base: u32,
        /// First word in `representatives`, which has two sets of [`REPRESENTATIVE_WORDS`](crate::REPRESENTATIVE_WORDS)
        /// a block, used in turn.
        representative_base: u32,
        /// First word in `passing`: two sets of heads, used in turn, then the entries of each block.
        passing_base: u32,
        /// First element in `instances`.
        instance_base: u32,
        /// Elements in `instances`: ids that have poses, ascending, each with its row.
        known_ids: u32,
        /// Rows of instances in `poses` and `paths`. Row 0 is the static world.
        instances: u32,
        /// First element in `poses`.
        pose_base: u32,
        /// First element in `paths`.
        path_base: u32,
        /// Instants of sub-steps of an instance in `paths`: those within the interval for every number of sub-steps up
        /// to the sensor's.
        path_instants: u32,
        /// First element in `tracks`: the camera's own, and after it those of its instances.
        track_base: u32,
    }
}

gpu_struct! {
    /// A camera's own track in one tick, or that of an instance, for `poses`.
    Track {
        /// A [`TrackKind`].
        kind: u32,
        /// In which of its segments the instants lie: a bit for each after the first, set where the next segment begins.
        next: u32,
        /// Mean focal length of a camera; unused of instances.
        focal_px: f64,
    }
}

gpu_struct! {
    /// What lies between two samples of a track, for `poses`: an [`esaac_model::paths::Segment`].
    PoseSegment {
        /// Time of its first sample after the interval's start.
        start_ns: i64,
        /// Part of the segment that a nanosecond is; 0 where the body stands.
        per_ns: f64,
        /// Rotation of its first sample.
        rotation_x: f64,
        /// See there.
        rotation_y: f64,
        /// See there.
        rotation_z: f64,
        /// See there.
        rotation_w: f64,
        /// Translation of its first sample, metres.
        translation_x_m: f64,
        /// See there.
        translation_y_m: f64,
        /// See there.
        translation_z_m: f64,
        /// The way from there to the next sample, metres.
        shift_x_m: f64,
        /// See there.
        shift_y_m: f64,
        /// See there.
        shift_z_m: f64,
        /// Its slope at the first sample.
        shift_start_x_m: f64,
        /// See there.
        shift_start_y_m: f64,
        /// See there.
        shift_start_z_m: f64,
        /// Its slope at the next sample.
        shift_end_x_m: f64,
        /// See there.
        shift_end_y_m: f64,
        /// See there.
        shift_end_z_m: f64,
        /// The rotation vector from the first sample to the next.
        turn_x: f64,
        /// See there.
        turn_y: f64,
        /// See there.
        turn_z: f64,
        /// Its slope at the first sample.
        turn_start_x: f64,
        /// See there.
        turn_start_y: f64,
        /// See there.
        turn_start_z: f64,
        /// Its slope at the next sample.
        turn_end_x: f64,
        /// See there.
        turn_end_y: f64,
        /// See there.
        turn_end_z: f64,
    }
}

/// What is known of a track in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum TrackKind {
    /// The instance has no poses.
    None = 0,
    /// The body stands. Of a camera that stands there is a segment nevertheless.
    Stands = 1,
    /// The body moves.
    Moves = 2,
}

gpu_struct! {
    /// What kernels of the physical pixel know of a camera besides its row: a row of the table of physical pixels, in the
    /// camera's `slot`.
    Physical {
        /// Logarithm of the rate, per second, that an intensity of 1 drives.
        drive_log: f32,
        /// The second pole, radians per second.
        second_per_s: f32,
        /// Variance of the noise behind the first pole, squared nepers.
        variance: f32,
        /// Nominal leak in the dark, Q7.24 per second.
        dark_leak_q24_per_s: f32,
        /// Leak that the light of the nominal dark current would cause, Q7.24 per second.
        dark_light_q24_per_s: f32,
        /// Leak for each unit of charge that light and dark current drive, Q7.24.
        light_q24_per_charge: f32,
        /// Fills the row up to a multiple of 16 bytes.
        padding: u64,
    }
}

gpu_struct! {
    /// What `readout` knows of a camera: a row of the table of readouts, in the camera's `slot`.
    Readout {
        /// Service of an event, picoseconds.
        event_ps: u64,
        /// Service of a row besides its events, picoseconds; 0 if events are served one by one.
        row_ps: u64,
        /// The rate controller's period in which the interval begins.
        first_period: i64,
        /// Time from that period's start to the interval's, nanoseconds.
        period_to_start_ns: u32,
        /// Length of a period, nanoseconds.
        cap_period_ns: u32,
        /// Events of a period at which the rate controller begins to drop; 0 for never.
        cap_events: u32,
        /// Whether the camera has a bus.
        has_bus: u32,
        /// Row of the camera's outlet in the table of cameras.
        outlet_row: u32,
        /// First element in `bus`.
        bus_base: u32,
    }
}

gpu_struct! {
    /// What lens and lamp do to a camera's light in one tick, and what sub-steps need for it: a row of the table of optics,
    /// in the camera's `slot`.
    Optics {
        /// Weight of a pixel's own light in the blur, along one axis.
        psf_0: f32,
        /// That of either neighbour.
        psf_1: f32,
        /// That of the next.
        psf_2: f32,
        /// That of the last.
        psf_3: f32,
        /// Square of the tangent of the angle to the optical axis, for each square pixel from the centre.
        vignetting_per_px2: f32,
        /// Factor of the lamp's light at the interval's start.
        lamp_start: f32,
        /// Factor of the lamp's light at the frame's time, the interval's end.
        lamp_end: f32,
        /// Depth of the flicker.
        flicker_depth: f32,
        /// Phase of the flicker at the interval's start, in 2^-32 turns.
        flicker_phase: u32,
        /// What the phase gains in a nanosecond, in turns of [`FLICKER_FRACTION_BITS`](crate::FLICKER_FRACTION_BITS).
        flicker_step: u32,
        /// Least number of sub-steps of the adaptive policy.
        least_substeps: u32,
        /// How far a crossing may be off between two sub-steps, as a share of the interval; 0 in a camera's first frame.
        substep_error_share: f32,
    }
}

gpu_struct! {
    /// What a camera's pixels at rest know of past intervals: a row of the table of rests, in the camera's `slot`.
    Rest {
        /// A [`RestMode`].
        mode: u32,
        /// How often intervals had the first length, modulo 2^8, and 8 bits above it the second; before this interval,
        /// and 16 bits above it with this interval.
        counts: u32,
        /// The first length.
        first_ns: u32,
        /// The second length.
        second_ns: u32,
    }
}

gpu_struct! {
    /// Counters of a camera or its outlet in one tick; two sets, used in turn.
    Counters {
        /// Events emitted, whether they fit or not.
        emitted: u32,
        /// Events emitted before those of the first sub-tile whose events do not fit; `u32::MAX` if all fit.
        emitted_fit: u32,
        /// Events in the packet.
        packet: u32,
        /// Events deferred to later packets.
        deferred: u32,
        /// Pixels that keep their last value because of a NaN, infinite or negative colour.
        invalid_pixels: u32,
        /// Pixels without a usable motion vector.
        invalid_motion: u32,
        /// Pixels that have never had a valid colour.
        unarmed_pixels: u32,
        /// Blocks that were skipped.
        skipped_blocks: u32,
        /// Sub-steps, summed over blocks.
        substeps: u32,
        /// Blocks in and around which nothing moves or changes, of those whose pixels may rest.
        still_blocks: u32,
        /// Sub-tiles that are left, with more events than the event queue holds; but for those that a second run in the same
        /// submission has done.
        queue_overflows: u32,
        /// Sub-tiles with more events than the event queue holds that are in the list for the second run, or were walked
        /// again at once.
        crowded_sub_tiles: u32,
        /// Sub-tiles for whose levels there was no room; they run again.
        without_levels: u32,
        /// Rows of `levels` that tiles took.
        level_rows: u32,
        /// Events in the largest bin of the packet.
        largest_bin: u32,
        /// Tiles with more sub-steps than `many_substeps`; they fill `tile_order` from the front.
        slow_tiles: u32,
        /// The other tiles; they fill `tile_order` from the back.
        quick_tiles: u32,
        /// Events in the overflow buffer: those that do not fit their bin, and deferred ones.
        overflow: u32,
        /// Whether the packet takes `merge` after the first `sort`.
        heavy: u32,
        /// Deferred events that `sort` has gathered so far.
        gathered_deferred: u32,
        /// Pixels of the frame without a path because their depth is NaN, negative or too small to invert.
        without_depth: u32,
        /// Pixels without a path because their instance has no poses.
        without_poses: u32,
        /// Pixels without a path because the lens shows nothing there.
        without_lens: u32,
        /// Sub-steps of pixels that show what neither key frame shows.
        unseen_samples: u32,
        /// Blocks that pairs of motions that meet pass.
        meeting_blocks: u32,
        /// Physical pixels that would have sent more events than a pixel may.
        overrun_pixels: u32,
        /// Events lost because their pixel had one waiting for the bus. An outlet's, as the next three.
        lost: u32,
        /// Events dropped by the rate controller.
        capped: u32,
        /// Events that wait for their row's service.
        waiting: u32,
        /// A [`ReadoutProgress`].
        progress: u32,
    }
}

gpu_struct! {
    /// Push constants of a dispatch.
    Push {
        /// First camera of the dispatch. Its cameras are neighbours in the table; `gl_WorkGroupID.y` counts them.
        first_camera: u32,
        /// Number of the transfer of `detail_transfer`, or of the pass of `synthesize`, `cross`, `merge` or `voxel_grid`; unused by other kernels.
        level: u32,
        /// Device address of a [`Slice`] for each camera, for kernels that read packets.
        slices: u64,
        /// Device address of the buffer that these kernels write.
        target: u64,
        /// Events of all cameras that write to the target.
        events: u32,
        /// Time bins of `voxel_grid`.
        bins: u32,
        /// Whether the rows are of outlets, which send packets; else of cameras, whose events may have a bus before them.
        outlets: u32,
        /// For `readout`, whether heavy packets are sorted; for `sort`, whether `merge` has brought their events together.
        merged: u32,
        /// Cameras of the dispatch, for kernels whose workgroups belong to no one camera.
        cameras: u32,
        /// Passes of `synthesize` and `cross` in this submission.
        passes: u32,
    }
}

gpu_struct! {
    /// A camera's packet, for kernels that read packets: `gather`, `event_frame`, `voxel_grid`, `event_ids`.
    Slice {
        /// Time from which the events' offsets count.
        base_ns: i64,
        /// For `event_ids`, the device address of the camera's lists, [`EVENT_IDS_LIST_WORDS`](crate::EVENT_IDS_LIST_WORDS)
        /// words for each block, and that of the ids of its rows of instances.
        lists: u64,
        /// See `lists`.
        ids: u64,
        /// First event in the packet's arrays.
        event_base: u32,
        /// Number of events.
        events: u32,
        /// Columns.
        width: u32,
        /// Columns times rows.
        pixels: u32,
        /// Time from the base to the interval's start.
        base_to_start_ns: u32,
        /// Length of the interval, at least 1.
        interval_ns: u32,
        /// First element of the camera's part of the target.
        first: u32,
        /// Number of events of the cameras before.
        events_before: u32,
        /// For `event_ids`, the camera's row in the table of cameras.
        row: u32,
        /// For `event_ids`, whether the lens is an equidistant fisheye; else a pinhole.
        fisheye: u32,
    }
}

/// How far `readout` is with the events of a camera in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ReadoutProgress {
    /// Not begun; nothing waits for it.
    None = 0,
    /// It has to go on.
    Undone = 1,
    /// It has finished.
    Done = 2,
}

/// The part that a camera takes in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum FrameKind {
    /// No frame: the camera is not stepped.
    None = 0,
    /// Its first frame, which ends no interval.
    First = 1,
    /// A frame that ends an interval.
    Interval = 2,
    /// No frame: pixels that rest are brought up to date.
    CatchUp = 3,
}

/// What the words of rest of a camera's pixels are good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum RestMode {
    /// Nothing: each pixel was walked in the last interval.
    Unknown = 0,
    /// They tell how many intervals each pixel has passed over, and all pixels are walked now.
    Ends = 1,
    /// They tell that, and which pixels are passed over now if their light is still.
    Allowed = 2,
}
