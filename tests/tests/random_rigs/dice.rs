//! Draws from a seed. The same seed gives the same draws on every machine.

use esaac_model::random::philox4x32_10;

/// How many seeds in a row share what selects kernels.
pub const BLOCK: u64 = 10;

/// Two sources of draws. Kernels take far longer to compile than to run, so that ten seeds in a row share what selects
/// them and differ in all the rest.
pub struct Dice {
    /// For what selects kernels: ten seeds in a row have the same draws.
    pub shared: Source,
    /// For all the rest.
    pub own: Source,
}

impl Dice {
    pub fn new(seed: u64) -> Self {
        Dice { shared: Source { key: [seed / BLOCK, 0], drawn: 0 }, own: Source { key: [seed, 1], drawn: 0 } }
    }
}

/// A source of draws.
pub struct Source {
    key: [u64; 2],
    drawn: u32,
}

impl Source {
    fn word(&mut self) -> u32 {
        self.drawn += 1;
        let [seed, purpose] = self.key;
        philox4x32_10([self.drawn, purpose as u32, 0, 0], [seed as u32, (seed >> 32) as u32])[0]
    }

    pub fn below(&mut self, bound: u32) -> u32 {
        ((u64::from(self.word()) * u64::from(bound)) >> 32) as u32
    }

    pub fn chance(&mut self, share: f64) -> bool {
        self.between(0.0, 1.0) < share
    }

    pub fn pick<T: Copy>(&mut self, values: &[T]) -> T {
        values[self.below(values.len() as u32) as usize]
    }

    /// A number whose every value is as likely.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.word()) / (f64::from(u32::MAX) + 1.0)
    }

    /// A number whose every order of magnitude is as likely.
    pub fn magnitude(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// As [`Source::magnitude`], a whole number.
    pub fn whole(&mut self, low: u32, high: u32) -> u32 {
        (self.magnitude(f64::from(low), f64::from(high)).round() as u32).clamp(low, high)
    }

    /// A seed of a sensor, which has 63 bits.
    pub fn seed(&mut self) -> u64 {
        (u64::from(self.word()) << 31) ^ u64::from(self.word())
    }
}
