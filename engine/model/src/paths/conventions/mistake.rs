//! Mistakes in conventions, and how each is undone.

use crate::paths::{DepthKind, Intrinsics, Pose, Projection};
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::fmt;

/// One convention that differs from the one expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mistake {
    /// Previous position = position - motion.
    VectorsNegated,
    /// A vector's y counts upwards.
    VectorsYUp,
    /// A vector's x counts to the left.
    VectorsXLeft,
    /// A vector's x and y are exchanged.
    VectorsExchanged,
    /// A vector of 1 is the image's whole width or height.
    VectorsOfImageSize,
    /// A vector of 1 is half of the image's width or height: normalised device coordinates.
    VectorsOfHalfSize,
    /// Vectors are velocities: pixels a second.
    VectorsPerSecond,
    /// The vectors times this are in pixels.
    VectorsTimes(f64),
    /// Vectors lead to the next frame.
    VectorsToNextFrame,
    /// Vectors are those of the frame before, or poses those of the frame after.
    PosesAhead,
    /// Vectors are those of the frame after, or poses those of the frame before.
    PosesBehind,
    /// The poses of a frame are those at its time, since 0, times this: a rate is wrong.
    PosesTimes(f64),
    /// The camera looks along +z, y down.
    CameraOpenCv,
    /// The camera looks along +z, y up, x left.
    CameraAlongZ,
    /// The camera looks along +x, y left, z up.
    CameraAlongX,
    /// The camera looks along -z, y up, and was read as one that looks along +x, y left, z up.
    CameraReadAlongX,
    /// Camera from world, not world from camera.
    CameraInverted,
    /// The camera's rotation is transposed.
    CameraTransposed,
    /// The camera's quaternions have their scalar first.
    CameraScalarFirst,
    /// The lens is a fisheye where a pinhole is expected, or the other way round, and the depth is as it has it.
    LensOfOtherKind,
    /// The depth is the other kind of distance ([`DepthKind`]).
    DepthOfOtherKind,
    /// The depth times this is in the unit of the poses.
    DepthTimes(f64),
    /// The images' first row is the lowest.
    RowsFromBottom,
    /// World to body, not body to world.
    BodyInverted,
    /// The body's rotation is transposed.
    BodyTransposed,
    /// The body's quaternions have their scalar first.
    BodyScalarFirst,
    /// The body does not move as its poses say.
    BodyStill,
    /// The body moves as the poses of this instance say.
    BodyOf(u32),
}

use Mistake as M;

/// Signs of vectors, each with every unit: renderers combine them.
pub(super) const SIGNS: [&[Mistake]; 5] =
    [&[], &[M::VectorsNegated], &[M::VectorsYUp], &[M::VectorsXLeft], &[M::VectorsExchanged]];

/// Units of vectors.
pub(super) const UNITS: [&[Mistake]; 3] = [&[], &[M::VectorsOfImageSize], &[M::VectorsOfHalfSize]];

/// Factors of vectors, each with every sign, but not with mistakes of the camera: two factors explain much by chance.
pub(super) const FACTORS: [Mistake; 3] = [M::VectorsPerSecond, M::VectorsTimes(2.0), M::VectorsTimes(0.5)];

/// What else may be wrong with camera and times. Times and depth may be wrong by the factors of the vectors: where a camera
/// goes steadily or does not turn, these look alike, and then the vectors alone must not have the blame.
pub(super) const CAMERA: [Mistake; 13] = [
    M::VectorsToNextFrame,
    M::PosesAhead,
    M::PosesBehind,
    M::PosesTimes(2.0),
    M::PosesTimes(0.5),
    M::CameraOpenCv,
    M::CameraAlongZ,
    M::CameraAlongX,
    M::CameraReadAlongX,
    M::CameraInverted,
    M::CameraTransposed,
    M::CameraScalarFirst,
    M::RowsFromBottom,
];

/// What may be wrong with the depth or the lens. A static world that is far away may agree all the same.
pub(super) const SURFACE: [Mistake; 8] = [
    M::LensOfOtherKind,
    M::DepthOfOtherKind,
    M::DepthTimes(0.001),
    M::DepthTimes(0.01),
    M::DepthTimes(0.5),
    M::DepthTimes(2.0),
    M::DepthTimes(100.0),
    M::DepthTimes(1000.0),
];

/// What may be wrong with a body's poses alone.
pub(super) const BODY: [Mistake; 6] =
    [M::BodyInverted, M::BodyTransposed, M::BodyScalarFirst, M::BodyStill, M::PosesAhead, M::PosesBehind];

impl Mistake {
    /// Whether the vectors alone have it: depth and poses are right.
    pub(super) fn is_of_vectors(self) -> bool {
        SIGNS.concat().contains(&self)
            || UNITS.concat().contains(&self)
            || FACTORS.contains(&self)
            || self == M::VectorsToNextFrame
    }

    /// The vector in pixels, y down, that leads to the previous position, an interval before.
    pub(super) fn vector_px(self, vector: DVec2, size_px: DVec2, interval_s: f64) -> DVec2 {
        match self {
            M::VectorsNegated => -vector,
            // An image upside down has its vectors upside down too.
            M::VectorsYUp | M::RowsFromBottom => vector * DVec2::new(1.0, -1.0),
            M::VectorsXLeft => vector * DVec2::new(-1.0, 1.0),
            M::VectorsOfImageSize => vector * size_px,
            M::VectorsExchanged => DVec2::new(vector.y, vector.x),
            M::VectorsOfHalfSize => vector * size_px * 0.5,
            M::VectorsPerSecond => vector * interval_s,
            M::VectorsTimes(factor) => vector * factor,
            _ => vector,
        }
    }

    /// Where the pixel is in an image whose first row is the highest.
    pub(super) fn pixel_px(self, pixel_px: DVec2, size_px: DVec2) -> DVec2 {
        match self {
            M::RowsFromBottom => DVec2::new(pixel_px.x, size_px.y - 1.0 - pixel_px.y),
            _ => pixel_px,
        }
    }

    /// The lens that the images were made with.
    pub(super) fn lens(self, lens: Intrinsics) -> Intrinsics {
        match self {
            M::LensOfOtherKind => {
                let other = match lens.projection() {
                    Projection::Pinhole => Projection::Fisheye,
                    Projection::Fisheye => Projection::Pinhole,
                };
                let (focal_px, centre_px) = (lens.focal_px(), lens.centre_px());
                Intrinsics::new(other, focal_px.x, focal_px.y, centre_px.x, centre_px.y)
                    .expect("the numbers of a lens")
            }
            _ => lens,
        }
    }

    /// The depth that the lens expects, in the unit of the poses.
    pub(super) fn depth_m(self, depth_m: f64, pixel_px: DVec2, lens: &Intrinsics) -> f64 {
        match self {
            M::DepthTimes(factor) => depth_m * factor,
            M::DepthOfOtherKind => {
                let other = match lens.projection() {
                    Projection::Pinhole => DepthKind::FromCentre,
                    Projection::Fisheye => DepthKind::AlongAxis,
                };
                lens.depth_m(other, pixel_px, depth_m).unwrap_or(f64::NAN)
            }
            _ => depth_m,
        }
    }

    /// World from camera, the camera looking along -z, y up.
    pub(super) fn camera(self, pose: Pose) -> Pose {
        let axes = |x, y, z| {
            let own = DQuat::from_mat3(&DMat3::from_cols(x, y, z));
            Pose::from_parts(pose.rotation() * own, pose.translation_m())
        };
        match self {
            M::CameraOpenCv => axes(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z),
            M::CameraAlongZ => axes(DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z),
            M::CameraAlongX => axes(DVec3::NEG_Y, DVec3::Z, DVec3::NEG_X),
            M::CameraReadAlongX => axes(DVec3::NEG_Z, DVec3::NEG_X, DVec3::Y),
            M::CameraInverted => pose.inverse(),
            M::CameraTransposed => transposed(pose),
            M::CameraScalarFirst => scalar_first(pose),
            _ => pose,
        }
    }

    /// World from body.
    pub(super) fn body(self, pose: Pose) -> Pose {
        match self {
            M::BodyInverted => pose.inverse(),
            M::BodyTransposed => transposed(pose),
            M::BodyScalarFirst => scalar_first(pose),
            M::BodyStill => Pose::IDENTITY,
            _ => pose,
        }
    }

    /// The time at which the poses have what belongs to `t_ns`.
    pub(super) fn time_ns(self, t_ns: i64) -> i64 {
        match self {
            M::PosesTimes(factor) => (t_ns as f64 * factor).round() as i64,
            _ => t_ns,
        }
    }

    /// Frames by which the poses' times are moved.
    pub(super) fn shift_frames(self) -> i64 {
        match self {
            M::PosesAhead => -1,
            M::PosesBehind => 1,
            _ => 0,
        }
    }
}

fn transposed(pose: Pose) -> Pose {
    Pose::from_parts(pose.rotation().conjugate(), pose.translation_m())
}

/// The pose whose quaternion `w x y z` was read as `x y z w`.
fn scalar_first(pose: Pose) -> Pose {
    let [w, x, y, z] = pose.rotation().to_array();
    Pose::from_parts(DQuat::from_xyzw(x, y, z, w), pose.translation_m())
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match self {
            M::VectorsNegated => "the vectors' sign is flipped (previous position = position - motion)",
            M::VectorsYUp => "the vectors' y counts upwards",
            M::VectorsXLeft => "the vectors' x counts to the left",
            M::VectorsExchanged => "the vectors' x and y are exchanged",
            M::VectorsOfImageSize => "the vectors are fractions of the image's size, not pixels",
            M::VectorsOfHalfSize => {
                "the vectors are fractions of half the image's size (-1 to 1), not pixels"
            }
            M::VectorsPerSecond => {
                "the vectors are velocities in pixels a second, not pixels from frame to frame"
            }
            M::VectorsTimes(factor) if *factor > 1.0 => {
                return write!(f, "the vectors are {factor} times too short");
            }
            M::VectorsTimes(factor) => {
                return write!(f, "the vectors are {} times too long", (1.0 / factor).round());
            }
            M::VectorsToNextFrame => "the vectors lead to the next frame, not the previous one",
            M::PosesAhead => "the poses are one frame ahead of the images",
            M::PosesBehind => "the poses are one frame behind the images",
            M::PosesTimes(factor) if *factor > 1.0 => {
                return write!(f, "the poses are {factor} times too slow for the images: a rate is wrong");
            }
            M::PosesTimes(factor) => {
                let times = (1.0 / factor).round();
                return write!(f, "the poses are {times} times too fast for the images: a rate is wrong");
            }
            M::CameraOpenCv => {
                "the camera's pose is one that looks along +z with y down (OpenCV, ROS), or is none and was read as one"
            }
            M::CameraAlongZ => "the camera's pose is one that looks along +z with y up",
            M::CameraAlongX => "the camera's pose is one that looks along +x with z up",
            M::CameraReadAlongX => {
                "the camera's pose is one that looks along -z with y up (USD), and was read as one that looks along +x \
                 with z up"
            }
            M::CameraInverted => "the camera's matrix is camera from world, not world from camera",
            M::CameraTransposed => "the camera's rotation is transposed",
            M::CameraScalarFirst => "the camera's quaternions are qw qx qy qz, not qx qy qz qw",
            M::LensOfOtherKind => "the lens is a fisheye where a pinhole is expected, or the other way round",
            M::DepthOfOtherKind => {
                "the depth is the other distance: from the camera's centre where along the axis is expected, or the \
                 other way round"
            }
            M::DepthTimes(factor) if *factor > 1.0 => {
                return write!(f, "the depth is {factor} times too small for the poses' unit");
            }
            M::DepthTimes(factor) => {
                return write!(
                    f,
                    "the depth is {} times too large for the poses' unit",
                    (1.0 / factor).round()
                );
            }
            M::RowsFromBottom => "the images' rows run from the bottom up",
            M::BodyInverted => "its matrices are body from world, not world from body",
            M::BodyTransposed => "its rotations are transposed",
            M::BodyScalarFirst => "its quaternions are qw qx qy qz, not qx qy qz qw",
            M::BodyOf(id) => {
                return write!(f, "it moves as the poses of instance {id} say: ids or poses are exchanged");
            }
            M::BodyStill => {
                "it does not move as its poses say: they belong to another body, or its id to the static world"
            }
        };
        f.write_str(text)
    }
}
