//! Sizes of workgroups, of their shared memory and of the table of cameras.

/// Events that a workgroup of `merge` sorts or merges in shared memory.
pub const RUN_EVENTS: u32 = 2048;

/// Events that fit the shared memory of a workgroup of `sort`; `merge` sorts packets that have a larger bin.
pub const SORTABLE_EVENTS: u32 = 2048;

/// Most overflow events that a workgroup of `sort` searches; where a packet has more, `merge` brings them to their bins.
pub const SEARCHED_EVENTS: u32 = 1 << 15;

/// Bins whose events `bin_sums` sums for `sort`; a multiple of the bins that a workgroup of `sort` takes.
pub const SUMMED_BINS: u32 = 2048;

/// Blocks of a tile, side by side: 32 pixels in a row, a subgroup's width.
pub const TILE_BLOCKS: u32 = 4;

/// Threads of a workgroup of `cross` on a GPU, one for each pixel of half a tile: a small workgroup ends as soon as its
/// own pixels are done, and makes place for the next.
pub const CROSS_THREADS: u32 = TILE_BLOCKS * esaac_model::substeps::BLOCK_PX * 4;

/// Room in the shortest event queue of `cross`, in events for each pixel of a sub-tile.
pub const QUEUE_PER_PX: u32 = 8;

/// Room in the event queue of `cross` where it walks crowded sub-tiles that an earlier run has left, in events for each pixel
/// of a sub-tile. There are few of them, so it may take most of the shared memory that every device has.
pub const CROWDED_QUEUE_PER_PX: u32 = 3 * QUEUE_PER_PX;

/// Threads of a workgroup of `ingest` and `detail_transfer` on a GPU: one for each pixel of a tile.
pub const INGEST_THREADS: u32 =
    TILE_BLOCKS * esaac_model::substeps::BLOCK_PX * esaac_model::substeps::BLOCK_PX;

/// Most time bins of a voxel grid: `voxel_grid` counts its votes' places in 32 bits, which more than 2^18 bins overflow,
/// and its target has so many elements for each pixel.
pub const MOST_BINS: u32 = 256;

/// Sub-tiles of a tile.
pub const SUB_TILES: u32 = INGEST_THREADS / CROSS_THREADS;

/// Threads of a workgroup of `synthesize` that makes levels: some for each pixel of a block.
pub const SYNTHESIZE_THREADS: u32 = 2 * LEVEL_ROW_WORDS;

/// Words of a row of `levels`: one for each pixel of a block.
pub const LEVEL_ROW_WORDS: u32 = esaac_model::substeps::BLOCK_PX * esaac_model::substeps::BLOCK_PX;

/// Rows of `levels` that a block takes beside those of its levels: what its pixels may show, and its list.
pub const LIST_ROWS: u32 = 2;

/// Least sub-steps of an entry of `level_entries`; one of a block with few pixels has more.
pub const LEAST_ENTRY_SUBSTEPS: u32 = 4;

/// Most passes of `synthesize` and `cross` in a submission.
pub const MOST_PASSES: u32 = 16;

/// Threads of a workgroup of `sort` on a GPU.
pub const SORT_THREADS: u32 = 256;

/// In place of a row of `instances`: no instance. `surfaces` has 16 bits for a row.
pub const NO_INSTANCE: u32 = 0xffff;

/// Most instances of a camera: their rows are below [`NO_INSTANCE`].
pub const MOST_INSTANCES: usize = NO_INSTANCE as usize;

/// Rows of an instance in `poses`, four numbers each: for each instant of
/// [`POSE_INSTANTS`](esaac_model::synthesis::rigid::POSE_INSTANTS) the motion from camera axes then to those of key frame
/// 0, a row of its matrix and its translation three times; the motion from key frame 0 to key frame 1 likewise; and
/// its parallax, 0 if the instance has no poses, and whether it moves.
pub const POSE_ROWS: u32 = 3 * esaac_model::synthesis::rigid::POSE_INSTANTS as u32 + 4;

/// Elements of a track in `segments`: each instant may lie in another one.
pub const TRACK_SEGMENTS: u32 = esaac_model::synthesis::rigid::POSE_INSTANTS as u32;

/// Threads of a workgroup of `poses`: one for each instant.
pub const POSES_THREADS: u32 = (esaac_model::synthesis::rigid::POSE_INSTANTS as u32).next_multiple_of(32);

/// Words of a block in `representatives`: their number, and their pixels.
pub const REPRESENTATIVE_WORDS: u32 =
    (esaac_model::synthesis::rigid::BLOCK_SURFACES as u32 + 1).next_power_of_two();

/// Entries of a block in `passing`. A block that more surfaces pass looks for them itself.
pub const PASSING_ENTRIES: u32 = 128;

/// Words of a block's list in `event_ids`: its length, and a pixel for each candidate.
pub const EVENT_IDS_LIST_WORDS: u32 = 1 + esaac_model::synthesis::rigid::BLOCK_CANDIDATES as u32;

/// Words of a block's head in `passing`: the number of surfaces that pass it, the largest motion of them, and the
/// largest bend of their ways.
pub const PASSING_HEAD_WORDS: u32 = 3;

/// Instants in `paths` of an instance of a sensor with at most `substeps` sub-steps: the ends of all but the last
/// sub-step, for every number of them.
#[must_use]
pub const fn path_instants(substeps: u32) -> u32 {
    substeps * substeps.saturating_sub(1) / 2
}

/// Threads of a workgroup of `paths`.
pub const PATHS_THREADS: u32 = 64;

/// Threads of a workgroup of `readout` on a GPU, and events that it takes at once.
pub const READOUT_THREADS: u32 = 256;

/// Elements of a camera in `bus` before those of its pixels and rows.
pub const BUS_HEAD: u32 = 7;

/// Arrays in `bus` with an element for each row of pixels, which as many services can have. Kernels know them as `ROW_NAME`.
pub(crate) const BUS_ROWS: [&str; 7] = [
    // By service: when its first event came, nanoseconds from the interval's start.
    "OPENER",  // By service: its row and, times 2^32, its events.
    "EVENTS",  // By row: number of its service that waits, from 1 on; 0 if there is none.
    "SERVICE", // By service: its begin.
    "BEGIN",   // By service: its end.
    "END",     // By service: events of the chunk that is being read out.
    "JOINED",  // By service: events up to its own.
    "SERVED",
];

/// Elements of a row in `bus`.
pub const BUS_ROW: u32 = BUS_ROWS.len() as u32;

/// The first of them, those that outlive a tick: all up to `SERVICE`.
pub const BUS_KEPT_ROW: u32 = 3;

/// Most events that leave the bus after an interval that `sort` serves.
pub const MOST_CARRIED: u32 = 32;

/// Elements of `bus` for each stretch of half as many events as a workgroup of `readout` has threads.
pub const BUS_STRETCH: u32 = 2;

/// Fractional bits of the turns by which a flicker's phase grows in a nanosecond: 1 kHz fits 32 bits, and over a second the
/// phase is exact to 3e-7 turns.
pub const FLICKER_FRACTION_BITS: u32 = 51;

/// Bytes of the largest uniform buffer: what the engine requires of a device.
pub const UNIFORM_BYTES: usize = 64 << 10;

/// Most cameras of a rig: their table fits a uniform buffer.
pub const MAX_CAMERAS: usize = 256;
