//! Poses: where a rigid body is and how it is turned.

use glam::{DMat3, DQuat, DVec3, DVec4, Vec4Swizzles as _};
use std::ops::Mul;
use thiserror::Error;

/// How far a matrix may be from a rotation, and a quaternion from unit length, to count as rounded. Single precision
/// and six printed digits are well within; a scale of a percent is well outside.
pub const RIGID_TOLERANCE: f64 = 1e-3;

/// What the squared length of a normalised quaternion differs from 1 by.
const UNIT_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Steps of Newton's iteration to the nearest rotation. Each squares the error, so that three take
/// [`RIGID_TOLERANCE`] below rounding.
const NEAREST_ROTATION_STEPS: u32 = 3;

/// A rigid transform: world from body (or from camera).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    rotation: DQuat,
    translation_m: DVec3,
}

/// Why numbers are no pose.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PoseError {
    /// A number is NaN or infinite.
    #[error("{place} is {actual}, expected a finite number")]
    NonFinite {
        /// Which number.
        place: String,
        /// Its value.
        actual: f64,
    },
    /// The translation stands in the last row.
    #[error(
        "the last row is {actual:?} and the last column holds no translation, expected a last row of [0, 0, 0, 1]: \
         the matrix is transposed (USD and Direct3D keep the translation in the last row)"
    )]
    Transposed {
        /// The last row.
        actual: [f64; 4],
    },
    /// The last row is not `0 0 0 1`.
    #[error("the last row is {actual:?}, expected [0, 0, 0, 1]: the matrix is no rigid transform")]
    LastRow {
        /// The last row.
        actual: [f64; 4],
    },
    /// The upper left 3x3 matrix has no inverse.
    #[error("the rotation's determinant is {determinant}, expected 1: the matrix is singular")]
    Singular {
        /// Its determinant.
        determinant: f64,
    },
    /// The axes do not have unit length.
    #[error(
        "the axes have the lengths {actual:?}, expected 1: the matrix is scaled; a body moves by its rigid part, so \
         divide each column by its length"
    )]
    Scaled {
        /// Lengths of the columns.
        actual: [f64; 3],
    },
    /// The axes are not perpendicular.
    #[error("the cosines of the angles between the axes are {actual:?}, expected 0: the matrix is sheared")]
    Sheared {
        /// Cosines between x and y, y and z, z and x.
        actual: [f64; 3],
    },
    /// The axes are left-handed.
    #[error(
        "the rotation's determinant is {determinant}, expected 1: the matrix reflects (one axis is turned round)"
    )]
    Reflected {
        /// Its determinant.
        determinant: f64,
    },
    /// A quaternion does not have unit length.
    #[error("the quaternion has length {actual}, expected 1 (the order is qx qy qz qw)")]
    Quaternion {
        /// Its length.
        actual: f64,
    },
}

impl Pose {
    /// The world's own.
    pub const IDENTITY: Pose = Pose { rotation: DQuat::IDENTITY, translation_m: DVec3::ZERO };

    /// A pose from a unit quaternion and a translation, metres.
    ///
    /// # Errors
    /// If a number is not finite, or the quaternion's length is not 1 within [`RIGID_TOLERANCE`].
    pub fn new(rotation: DQuat, translation_m: DVec3) -> Result<Self, PoseError> {
        let [x, y, z] = translation_m.to_array();
        let [qx, qy, qz, qw] = rotation.to_array();
        Pose::from_xyz_qxyzw(&[x, y, z, qx, qy, qz, qw])
    }

    /// A pose from `[x, y, z, qx, qy, qz, qw]`: metres, and a unit quaternion with its scalar **last**. Newton, Warp,
    /// PhysX and ROS keep it so, and so does Newton's `body_q` in Isaac Lab. Isaac Sim's own arrays of orientations and
    /// MuJoCo have the scalar first.
    ///
    /// # Errors
    /// As [`Pose::new`].
    pub fn from_xyz_qxyzw(numbers: &[f64; 7]) -> Result<Self, PoseError> {
        const NAMES: [&str; 7] = ["x", "y", "z", "qx", "qy", "qz", "qw"];
        // All at once: the usual case has no branch for each number.
        if !numbers.iter().fold(true, |all, n| all & n.is_finite()) {
            let i = numbers.iter().position(|n| !n.is_finite()).expect("one of them");
            return Err(PoseError::NonFinite { place: NAMES[i].to_owned(), actual: numbers[i] });
        }
        let [x, y, z, qx, qy, qz, qw] = *numbers;
        let quaternion = DQuat::from_xyzw(qx, qy, qz, qw);
        let translation_m = DVec3::new(x, y, z);
        // One that is of unit length but for rounding stays as it is, so that a pose that is sent on is the same.
        if (quaternion.length_squared() - 1.0).abs() <= UNIT_ROUNDING {
            return Ok(Pose { rotation: quaternion, translation_m });
        }
        let length = quaternion.length();
        if (length - 1.0).abs() > RIGID_TOLERANCE {
            return Err(PoseError::Quaternion { actual: length });
        }
        Ok(Pose { rotation: quaternion.normalize(), translation_m })
    }

    /// A pose from a 4x4 matrix, row by row, that transforms columns: its last column is the translation, its last row
    /// `0 0 0 1`. Rounding within [`RIGID_TOLERANCE`] is removed: the nearest rotation is taken.
    ///
    /// # Errors
    /// If the matrix is not rigid. The error says in which way.
    pub fn from_rows(rows: &[[f64; 4]; 4]) -> Result<Self, PoseError> {
        for (i, row) in rows.iter().enumerate() {
            if let Some(j) = row.iter().position(|n| !n.is_finite()) {
                let place = format!("row {i}, column {j}");
                return Err(PoseError::NonFinite { place, actual: row[j] });
            }
        }
        let translation_m = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
        let last = rows[3];
        if last != [0.0, 0.0, 0.0, 1.0] {
            return Err(if translation_m == DVec3::ZERO && last[3] == 1.0 {
                PoseError::Transposed { actual: last }
            } else {
                PoseError::LastRow { actual: last }
            });
        }
        let [x, y, z] = [0, 1, 2].map(|j| DVec3::new(rows[0][j], rows[1][j], rows[2][j]));
        let matrix = DMat3::from_cols(x, y, z);
        let lengths = [x.length(), y.length(), z.length()];
        let determinant = matrix.determinant();
        // Relative to the lengths, so that a small scale is not taken for a missing direction.
        if determinant.abs() <= RIGID_TOLERANCE * lengths.iter().product::<f64>() {
            return Err(PoseError::Singular { determinant });
        }
        if lengths.iter().any(|length| (length - 1.0).abs() > RIGID_TOLERANCE) {
            return Err(PoseError::Scaled { actual: lengths });
        }
        let cosines = [x.dot(y), y.dot(z), z.dot(x)];
        if cosines.iter().any(|cosine| cosine.abs() > RIGID_TOLERANCE) {
            return Err(PoseError::Sheared { actual: cosines });
        }
        if determinant < 0.0 {
            return Err(PoseError::Reflected { determinant });
        }
        let mut rotation = matrix;
        for _ in 0..NEAREST_ROTATION_STEPS {
            rotation = (rotation + rotation.inverse().transpose()) * 0.5;
        }
        Ok(Pose { rotation: DQuat::from_mat3(&rotation).normalize(), translation_m })
    }

    /// The 4x4 matrix, row by row, as [`Pose::from_rows`] reads it.
    #[must_use]
    pub fn to_rows(&self) -> [[f64; 4]; 4] {
        let [x, y, z] = DMat3::from_quat(self.rotation).to_cols_array_2d();
        let t = self.translation_m;
        [[x[0], y[0], z[0], t.x], [x[1], y[1], z[1], t.y], [x[2], y[2], z[2], t.z], [0.0, 0.0, 0.0, 1.0]]
    }

    /// Rotation, a unit quaternion.
    #[must_use]
    pub fn rotation(&self) -> DQuat {
        self.rotation
    }

    /// Translation, metres: where the body's origin is in the world.
    #[must_use]
    pub fn translation_m(&self) -> DVec3 {
        self.translation_m
    }

    /// Body from world.
    #[must_use]
    pub fn inverse(&self) -> Pose {
        let rotation = self.rotation.conjugate();
        Pose { rotation, translation_m: -(rotation * self.translation_m) }
    }

    /// Transforms a homogeneous point; one at infinity (`w = 0`) is turned only.
    #[must_use]
    pub fn apply(&self, point: DVec4) -> DVec4 {
        (self.rotation * point.xyz() + self.translation_m * point.w).extend(point.w)
    }

    /// Transforms a point, metres.
    #[must_use]
    pub fn point(&self, point_m: DVec3) -> DVec3 {
        self.rotation * point_m + self.translation_m
    }

    /// Turns a direction.
    #[must_use]
    pub fn direction(&self, direction: DVec3) -> DVec3 {
        self.rotation * direction
    }

    /// A pose whose parts are known to be right: a unit quaternion, finite numbers.
    pub(super) fn from_parts(rotation: DQuat, translation_m: DVec3) -> Pose {
        Pose { rotation: renormalised(rotation), translation_m }
    }
}

/// A quaternion that is of unit length but for rounding, as long as it should be: a step of Newton's iteration for the
/// inverse square root, which is exact there.
fn renormalised(rotation: DQuat) -> DQuat {
    rotation * (1.5 - 0.5 * rotation.length_squared())
}

/// `a * b` is `b`, then `a`.
impl Mul for Pose {
    type Output = Pose;

    fn mul(self, inner: Pose) -> Pose {
        Pose {
            // Products of many would drift from unit length.
            rotation: renormalised(self.rotation * inner.rotation),
            translation_m: self.point(inner.translation_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Pose {
        Pose::new(DQuat::from_scaled_axis(DVec3::new(0.3, -1.1, 2.0)), DVec3::new(1.0, -2.0, 0.5)).unwrap()
    }

    fn error(change: impl FnOnce(&mut [[f64; 4]; 4])) -> PoseError {
        let mut rows = example().to_rows();
        change(&mut rows);
        Pose::from_rows(&rows).unwrap_err()
    }

    #[test]
    fn matrices_and_quaternions_are_the_same_pose() {
        let pose = example();
        let again = Pose::from_rows(&pose.to_rows()).unwrap();
        let p = DVec3::new(0.4, 3.0, -7.0);
        assert!((again.point(p) - pose.point(p)).length() < 1e-14);
        let [x, y, z, w] = pose.rotation().to_array();
        assert_eq!(Pose::from_xyz_qxyzw(&[1.0, -2.0, 0.5, x, y, z, w]).unwrap(), pose);
        // A quarter turn about z takes x to y, in both.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let turn = Pose::from_xyz_qxyzw(&[0.0, 0.0, 0.0, 0.0, 0.0, half, half]).unwrap();
        assert!((turn.direction(DVec3::X) - DVec3::Y).length() < 1e-15);
        let rows = [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        assert!((Pose::from_rows(&rows).unwrap().direction(DVec3::X) - DVec3::Y).length() < 1e-15);
    }

    #[test]
    fn a_pose_that_is_read_back_is_the_same() {
        for k in 0..1000 {
            let turn = DVec3::new(0.1 * f64::from(k), (0.3 * f64::from(k)).sin(), -0.7);
            let pose = Pose::new(DQuat::from_scaled_axis(turn) * 1.0001, DVec3::ONE).unwrap();
            let [x, y, z, w] = pose.rotation().to_array();
            assert_eq!(Pose::from_xyz_qxyzw(&[1.0, 1.0, 1.0, x, y, z, w]).unwrap(), pose);
        }
    }

    #[test]
    fn a_pose_and_its_inverse_cancel() {
        let pose = example();
        let p = DVec3::new(0.4, 3.0, -7.0);
        assert!(((pose.inverse() * pose).point(p) - p).length() < 1e-14);
        assert!((pose.inverse().point(pose.point(p)) - p).length() < 1e-14);
        assert_eq!(
            pose.apply(DVec4::new(1.0, 2.0, 3.0, 0.0)).xyz(),
            pose.direction(DVec3::new(1.0, 2.0, 3.0))
        );
    }

    #[test]
    fn rounding_is_removed_and_a_percent_is_not_rounding() {
        let rows = example().to_rows();
        let rounded = rows.map(|row| row.map(|n| (n * 1e4).round() / 1e4));
        let pose = Pose::from_rows(&rounded).unwrap();
        assert!((pose.rotation().length() - 1.0).abs() < 1e-15);
        assert!(pose.rotation().dot(example().rotation()).abs() > 1.0 - 1e-8);
        let mut scaled = rows;
        scaled[0][0] *= 1.01;
        scaled[1][0] *= 1.01;
        scaled[2][0] *= 1.01;
        assert!(matches!(Pose::from_rows(&scaled), Err(PoseError::Scaled { .. })));
    }

    #[test]
    fn each_wrong_matrix_is_named() {
        let singular = error(|rows| rows[2][..3].fill(0.0));
        assert!(matches!(singular, PoseError::Singular { .. }) && singular.to_string().contains("singular"));
        let nought = error(|rows| rows[..3].iter_mut().for_each(|row| row[..3].fill(0.0)));
        assert!(matches!(nought, PoseError::Singular { .. }));
        let small =
            error(|rows| rows[..3].iter_mut().for_each(|row| row[..3].iter_mut().for_each(|n| *n *= 0.01)));
        let PoseError::Scaled { actual } = small else { panic!("{small}") };
        assert!(actual.iter().all(|length| (length - 0.01).abs() < 1e-12));
        let reflected = error(|rows| rows[..3].iter_mut().for_each(|row| row[1] = -row[1]));
        assert!(
            matches!(reflected, PoseError::Reflected { determinant } if (determinant + 1.0).abs() < 1e-12)
        );
        let sheared = error(|rows| {
            for row in &mut rows[..3] {
                row[1] = 0.8 * row[1] + 0.6 * row[0];
            }
        });
        assert!(matches!(sheared, PoseError::Sheared { .. }), "{sheared}");
        let nan = error(|rows| rows[1][2] = f64::NAN);
        assert!(nan.to_string().contains("row 1, column 2 is NaN"), "{nan}");
        let transposed = error(|rows| {
            let copy = *rows;
            for (i, row) in rows.iter_mut().enumerate() {
                *row = [copy[0][i], copy[1][i], copy[2][i], copy[3][i]];
            }
        });
        assert_eq!(transposed, PoseError::Transposed { actual: [1.0, -2.0, 0.5, 1.0] });
        assert!(transposed.to_string().contains("transposed"));
        assert!(matches!(error(|rows| rows[3][0] = 0.1), PoseError::LastRow { .. }));
    }

    #[test]
    fn each_wrong_quaternion_is_named() {
        let error = |numbers: [f64; 7]| Pose::from_xyz_qxyzw(&numbers).unwrap_err().to_string();
        assert!(error([0.0; 7]).contains("length 0"));
        assert!(error([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]).contains("qx qy qz qw"));
        assert!(error([0.0, f64::INFINITY, 0.0, 0.0, 0.0, 0.0, 1.0]).contains("y is inf"));
        assert!(error([0.0, 0.0, 0.0, 0.0, f64::NAN, 0.0, 1.0]).contains("qy is NaN"));
        assert!(Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0), DVec3::ZERO).is_err());
    }
}
