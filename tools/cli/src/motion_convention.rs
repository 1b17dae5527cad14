//! Conventions of motion vectors, and their conversion to the engine's.

use clap::ValueEnum;

/// Meaning of a motion vector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum MotionConvention {
    /// Previous position = position + motion.
    #[default]
    Previous,
    /// Previous position = position - motion.
    Negated,
    /// Blender's Vector pass (channels X and Y): previous position = position + motion, y up.
    Blender,
}

/// Direction of a motion vector's y.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum VerticalAxis {
    /// Rows count downwards.
    Down,
    /// Rows count upwards.
    Up,
}

impl MotionConvention {
    /// Factors for x and y that convert to the engine's convention: previous position = position + motion, y
    /// down. `vertical` overrides the axis that the convention implies.
    #[must_use]
    pub fn factors(self, vertical: Option<VerticalAxis>) -> [f32; 2] {
        let implied = if self == MotionConvention::Blender { VerticalAxis::Up } else { VerticalAxis::Down };
        let sign = if self == MotionConvention::Negated { -1.0 } else { 1.0 };
        match vertical.unwrap_or(implied) {
            VerticalAxis::Down => [sign, sign],
            VerticalAxis::Up => [sign, -sign],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_convention_turns_into_previous_y_down() {
        use MotionConvention::{Blender, Negated, Previous};
        assert_eq!(Previous.factors(None), [1.0, 1.0]);
        assert_eq!(Negated.factors(None), [-1.0, -1.0]);
        assert_eq!(Blender.factors(None), [1.0, -1.0]);
        assert_eq!(Blender.factors(Some(VerticalAxis::Down)), [1.0, 1.0]);
        assert_eq!(Negated.factors(Some(VerticalAxis::Up)), [-1.0, 1.0]);
    }
}
