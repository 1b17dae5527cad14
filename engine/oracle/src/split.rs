//! A sum held as two floats (double-double). The leak moves a reference away from zero for as long as a camera runs.
//! Its small difference from the log intensity must not lose digits meanwhile.

/// An unevaluated sum `high + low` (double-double), `|low|` at most half an ulp of `high`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Split {
    high: f64,
    low: f64,
}

impl Split {
    /// A single float.
    #[must_use]
    pub fn new(value: f64) -> Self {
        Split { high: value, low: 0.0 }
    }

    /// `a * b` without rounding (Dekker's product, by fused multiply-add).
    #[must_use]
    pub fn product(a: f64, b: f64) -> Self {
        let high = a * b;
        Split { high, low: a.mul_add(b, -high) }
    }

    /// `self + value`.
    #[must_use]
    pub fn plus(self, value: f64) -> Self {
        // Knuth's two-sum computes the rounding error of the leading addition, which goes into the low part.
        let sum = self.high + value;
        let part = sum - self.high;
        let error = (self.high - (sum - part)) + (value - part) + self.low;
        let high = sum + error;
        Split { high, low: error - (high - sum) }
    }

    /// `self + other`.
    #[must_use]
    pub fn plus_split(self, other: Split) -> Self {
        self.plus(other.high).plus(other.low)
    }

    /// `self - other`.
    #[must_use]
    pub fn minus_split(self, other: Split) -> Self {
        self.plus(-other.high).plus(-other.low)
    }

    /// The sum, rounded once.
    #[must_use]
    pub fn value(self) -> f64 {
        self.high + self.low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_million_thresholds_up_and_down_cancel() {
        let mut reference = Split::new(1e7);
        for _ in 0..1_000_000 {
            reference = reference.plus(0.2);
        }
        for _ in 0..1_000_000 {
            reference = reference.plus(-0.2);
        }
        assert_eq!(reference.value(), 1e7);
    }

    #[test]
    fn product_keeps_what_a_float_loses() {
        // (1 + 2^-30)^2 needs 60 bits.
        let a = 1.0 + f64::powi(2.0, -30);
        let rest = Split::product(a, a).minus_split(Split::new(1.0 + f64::powi(2.0, -29)));
        assert_eq!(rest.value(), f64::powi(2.0, -60));
    }
}
