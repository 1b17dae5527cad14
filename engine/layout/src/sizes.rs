//! Sizes of workgroups, of their shared memory and of the table of cameras.

/// Events that a workgroup of `merge` sorts or merges in shared memory.
pub const RUN_EVENTS: u32 = 2048;

/// Events that fit the shared memory of a workgroup of `sort`; `merge` sorts packets that have a larger bin.
pub const SORTABLE_EVENTS: u32 = 2048;

/// Most overflow events that a workgroup of `sort` searches; `merge` sorts packets that have more.
pub const SEARCHED_EVENTS: u32 = 1 << 15;

/// Blocks of a tile, side by side: 32 pixels in a row, a subgroup's width.
pub const TILE_BLOCKS: u32 = 4;

/// Threads of a workgroup of `cross` on a GPU, one for each pixel of half a tile: a small workgroup ends as soon as its
/// own pixels are done, and makes place for the next.
pub const CROSS_THREADS: u32 = TILE_BLOCKS * esaac_model::substeps::BLOCK_PX * 4;

/// Threads of a workgroup of `ingest` and `backward_transfer` on a GPU: one for each pixel of a tile.
pub const INGEST_THREADS: u32 =
    TILE_BLOCKS * esaac_model::substeps::BLOCK_PX * esaac_model::substeps::BLOCK_PX;

/// Threads of a workgroup of `sort` on a GPU.
pub const SORT_THREADS: u32 = 256;

/// Most cameras of a rig: their table fits 64 KiB, the uniform-buffer size that the engine requires of a device.
pub const MAX_CAMERAS: usize = 256;
