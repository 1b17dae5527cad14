//! Time measurements that suites print.

use std::fmt;
use std::time::Duration;

/// Times, of which quantiles are printed.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    ns: Vec<u64>,
}

impl Figures {
    /// An empty set.
    #[must_use]
    pub const fn new() -> Self {
        Figures { ns: Vec::new() }
    }

    /// Adds a time.
    pub fn add(&mut self, time: Duration) {
        self.add_ns(time.as_nanos() as u64);
    }

    /// Adds a time in nanoseconds.
    pub fn add_ns(&mut self, ns: u64) {
        self.ns.push(ns);
    }

    /// Quantile: the time that a share `q` (0 to 1) of all does not exceed, microseconds.
    ///
    /// # Panics
    /// If no time was added.
    #[must_use]
    pub fn quantile_us(&self, q: f64) -> f64 {
        let mut sorted = self.ns.clone();
        sorted.sort_unstable();
        sorted[((sorted.len() - 1) as f64 * q) as usize] as f64 * 1e-3
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "p50 {:.1} us, p99 {:.1} us", self.quantile_us(0.5), self.quantile_us(0.99))
    }
}
