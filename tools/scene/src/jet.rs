//! Functions of time with their exact first and second derivatives (automatic differentiation).

use std::ops::{Add, Mul, Sub};

/// A value with its first and second derivative with respect to time in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jet {
    /// Value.
    pub value: f64,
    /// First derivative, 1/s.
    pub rate: f64,
    /// Second derivative, 1/s^2.
    pub acceleration: f64,
}

impl Jet {
    /// The function `t` itself, at `t_s` seconds.
    #[must_use]
    pub fn time(t_s: f64) -> Jet {
        Jet { value: t_s, rate: 1.0, acceleration: 0.0 }
    }

    /// A constant.
    #[must_use]
    pub fn constant(value: f64) -> Jet {
        Jet { value, rate: 0.0, acceleration: 0.0 }
    }

    /// Sine, argument in radians.
    #[must_use]
    pub fn sin(self) -> Jet {
        let (sin, cos) = self.value.sin_cos();
        self.chain(sin, cos, -sin)
    }

    /// Cosine, argument in radians.
    #[must_use]
    pub fn cos(self) -> Jet {
        let (sin, cos) = self.value.sin_cos();
        self.chain(cos, -sin, -cos)
    }

    fn chain(self, value: f64, first: f64, second: f64) -> Jet {
        Jet {
            value,
            rate: first * self.rate,
            acceleration: first * self.acceleration + second * self.rate * self.rate,
        }
    }
}

impl Add for Jet {
    type Output = Jet;
    fn add(self, other: Jet) -> Jet {
        Jet {
            value: self.value + other.value,
            rate: self.rate + other.rate,
            acceleration: self.acceleration + other.acceleration,
        }
    }
}

impl Sub for Jet {
    type Output = Jet;
    fn sub(self, other: Jet) -> Jet {
        self + other * -1.0
    }
}

impl Mul for Jet {
    type Output = Jet;
    fn mul(self, other: Jet) -> Jet {
        Jet {
            value: self.value * other.value,
            rate: self.rate * other.value + self.value * other.rate,
            acceleration: self.acceleration * other.value
                + 2.0 * self.rate * other.rate
                + self.value * other.acceleration,
        }
    }
}

impl Mul<f64> for Jet {
    type Output = Jet;
    fn mul(self, factor: f64) -> Jet {
        self * Jet::constant(factor)
    }
}

impl Add<f64> for Jet {
    type Output = Jet;
    fn add(self, constant: f64) -> Jet {
        self + Jet::constant(constant)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_agree_with_differences() {
        let f = |t_s: f64| {
            let t = Jet::time(t_s);
            ((t * 1.3 + (t * 0.7).sin() * 0.4).cos() * (t * t + 2.0)) - t * 0.5
        };
        let h = 1e-4;
        for t_s in [-1.0, 0.0, 0.37, 2.5] {
            let (a, b, c) = (f(t_s - h).value, f(t_s).value, f(t_s + h).value);
            assert!((f(t_s).rate - (c - a) / (2.0 * h)).abs() < 1e-6);
            assert!((f(t_s).acceleration - (c - 2.0 * b + a) / (h * h)).abs() < 1e-5);
        }
    }
}
