//! Figures of the paper: its table of allocated GPU memory, and the range of its figure of times. The paper measured
//! them on an NVIDIA RTX 4060.

/// The paper's sensors, in its order. Presets of the same names have the same sizes.
pub const SENSORS: [&str; 5] = ["dvs128", "davis240", "atis", "davis346", "genx320"];

/// The paper's interpolation factors.
pub const FACTORS: [u32; 3] = [8, 16, 32];

/// Megabytes, `[sensor][factor][gray, Bayer]`.
pub const MEMORY_MB: [[[f64; 2]; 3]; 5] = [
    [[51.4, 51.4], [55.4, 55.4], [64.0, 64.1]],
    [[135.5, 135.6], [146.0, 146.2], [167.8, 168.0]],
    [[228.7, 229.0], [246.5, 246.8], [282.4, 282.7]],
    [[287.0, 288.5], [310.4, 310.8], [354.3, 354.6]],
    [[324.2, 324.6], [349.2, 349.7], [399.3, 399.7]],
];

/// Least and greatest milliseconds per interval over all sensors and factors: gray, Bayer. The paper shows the single
/// values only as a plot.
pub const TIME_MS: [[f64; 2]; 2] = [[6.98, 27.28], [7.58, 29.16]];
