//! A square root of sums and products alone: a kernel that takes the same has the same bits, whatever its device calls a
//! square root.

/// High half of the bits from which the inverse square root is first guessed: less half the number's own, within 4%.
pub const ROOT_SEED: u32 = 0x5fe6_eb50;

/// Steps of Newton's iteration. Each squares the error.
pub const ROOT_STEPS: u32 = 5;

/// The square root of a number that is not negative, within a few roundings.
#[must_use]
pub fn square_root(x: f64) -> f64 {
    let high = (x.to_bits() >> 32) as u32;
    let mut inverse = f64::from_bits(u64::from(ROOT_SEED - (high >> 1)) << 32);
    for _ in 0..ROOT_STEPS {
        inverse *= 1.5 - 0.5 * x * inverse * inverse;
    }
    x * inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_square_root() {
        let mut x = 1e-30;
        while x < 1e30 {
            let error = square_root(x) / x.sqrt() - 1.0;
            assert!(error.abs() < 1e-15, "{x}: {error}");
            x *= 1.0123;
        }
        assert_eq!(square_root(0.0), 0.0);
    }
}
