//! How half-pel frames are read: with the kernels' approximations, or without.

/// Approximations by which the kernels save loads. Each can be switched off, so that tests can measure what it costs in
/// accuracy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// The outer two of the four rows of taps are interpolated linearly, without the corners: twelve loads, not
    /// sixteen.
    pub twelve_taps: bool,
    /// In the first transfer a pixel and its three half-pel neighbours share one footprint of 21 loads, placed by the
    /// pixel's motion. Otherwise each has the sixteen (or twelve) taps around its own position.
    pub shared_footprint: bool,
}

impl Sampling {
    /// The approximations of the engine's kernels.
    pub const ENGINE: Sampling = Sampling { twelve_taps: true, shared_footprint: true };

    /// No approximation: Keys' kernel over all sixteen taps around each position.
    pub const IDEAL: Sampling = Sampling { twelve_taps: false, shared_footprint: false };
}
