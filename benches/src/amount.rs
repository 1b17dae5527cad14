//! How much of a run is measured.

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub struct Amount {
    /// Frames of a pass, at most as many as the feed has. The first frame ends no interval.
    pub frames: usize,
    /// Intervals at the start of the first pass that are not timed, because pipelines compile and buffers grow in them.
    pub warm_up: usize,
    /// Number of passes. The rig is reset before each.
    pub passes: usize,
    /// Number of intervals of the first pass whose events are kept.
    pub keep: usize,
}
