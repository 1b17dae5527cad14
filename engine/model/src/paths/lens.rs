//! Lenses: from a pixel and its depth to a point before the camera, and back.
//!
//! The camera looks along -z, with x to the right and y up, as in USD, Blender, OpenGL and nerfstudio. In the image, x
//! counts to the right and y **down**. The centre of pixel (i, j) is at (i, j).
//!
//! A point is homogeneous: its position is `xyz / w`, and `w = 1 / depth`. A background at infinity has `w = 0`. A
//! rotation turns it and a translation leaves it where it is, without a case of its own.
//!
//! With `a = ((x - cx) / fx, (y - cy) / fy)`:
//!
//! | lens | ray of pixel (x, y) | pixel of a point (X, Y, Z) | depth |
//! |---|---|---|---|
//! | [`Pinhole`](Projection::Pinhole) | `(a.x, -a.y, -1)` | `a = (X, -Y) / -Z` | `-Z`: along the optical axis |
//! | [`Fisheye`](Projection::Fisheye) | `(sin(r) a.x / r, -sin(r) a.y / r, -cos(r))`, `r = length(a)` | `a = r (X, -Y) / length(X, Y)`, `r` the angle from the axis | `length(X, Y, Z)`: from the camera's centre |
//!
//! **Depth.** A pinhole's is what renderers call depth: Isaac Sim's `distance_to_image_plane`, Newton's
//! `forward_depth`, Blender's Z pass. For a fisheye the distance along the axis says nothing at 90 degrees and is
//! negative beyond, so its depth is the distance from the camera's centre, which is positive and has one point on every
//! ray: Isaac Sim's `distance_to_camera`, Newton's `depth`, Blender's Z pass of a panoramic camera. It also orders the
//! surfaces that one pixel may show. [`Intrinsics::depth_m`] converts one to the other.

use super::unusable_depth;
use glam::{DVec2, DVec3, DVec4};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How a lens maps directions to pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Projection {
    /// Perspective: the distance from the centre goes with the tangent of the angle from the optical axis.
    #[default]
    Pinhole,
    /// Equidistant fisheye: the distance from the centre goes with the angle itself.
    Fisheye,
}

/// What a renderer's depth measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthKind {
    /// Distance along the optical axis.
    AlongAxis,
    /// Distance from the camera's centre.
    FromCentre,
}

/// A lens without distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    projection: Projection,
    focal_px: DVec2,
    centre_px: DVec2,
}

/// Where a point is in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImagePoint {
    /// Position, pixels. It may lie outside the image.
    pub pixel_px: DVec2,
    /// Depth, metres, as the lens measures it. Infinite for a background at infinity.
    pub depth_m: f64,
}

/// Why intrinsics are refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum LensError {
    /// A focal length is not a positive number.
    #[error("focal length {name} is {actual} px, expected a positive number")]
    Focal {
        /// `fx` or `fy`.
        name: &'static str,
        /// The value given.
        actual: f64,
    },
    /// The principal point is not finite.
    #[error("principal point {name} is {actual} px, expected a finite number")]
    Centre {
        /// `cx` or `cy`.
        name: &'static str,
        /// The value given.
        actual: f64,
    },
}

impl Intrinsics {
    /// A lens with focal lengths `fx_px`, `fy_px` and the principal point `(cx_px, cy_px)`, in pixels.
    ///
    /// # Errors
    /// If a focal length is not positive or a number is not finite.
    pub fn new(
        projection: Projection,
        fx_px: f64,
        fy_px: f64,
        cx_px: f64,
        cy_px: f64,
    ) -> Result<Self, LensError> {
        for (name, actual) in [("fx", fx_px), ("fy", fy_px)] {
            if !(actual > 0.0 && actual.is_finite()) {
                return Err(LensError::Focal { name, actual });
            }
        }
        for (name, actual) in [("cx", cx_px), ("cy", cy_px)] {
            if !actual.is_finite() {
                return Err(LensError::Centre { name, actual });
            }
        }
        Ok(Intrinsics { projection, focal_px: DVec2::new(fx_px, fy_px), centre_px: DVec2::new(cx_px, cy_px) })
    }

    /// A pinhole camera; see [`Intrinsics::new`].
    ///
    /// # Errors
    /// As [`Intrinsics::new`].
    pub fn pinhole(fx_px: f64, fy_px: f64, cx_px: f64, cy_px: f64) -> Result<Self, LensError> {
        Intrinsics::new(Projection::Pinhole, fx_px, fy_px, cx_px, cy_px)
    }

    /// An equidistant fisheye; see [`Intrinsics::new`].
    ///
    /// # Errors
    /// As [`Intrinsics::new`].
    pub fn fisheye(fx_px: f64, fy_px: f64, cx_px: f64, cy_px: f64) -> Result<Self, LensError> {
        Intrinsics::new(Projection::Fisheye, fx_px, fy_px, cx_px, cy_px)
    }

    /// How the lens maps directions to pixels.
    #[must_use]
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Focal lengths `(fx, fy)`, pixels. For a fisheye: pixels a radian.
    #[must_use]
    pub fn focal_px(&self) -> DVec2 {
        self.focal_px
    }

    /// Principal point `(cx, cy)`, pixels.
    #[must_use]
    pub fn centre_px(&self) -> DVec2 {
        self.centre_px
    }

    /// The point of depth 1 that a pixel shows, camera axes. `None` where a fisheye has no image: at 180 degrees from
    /// the axis and beyond.
    #[must_use]
    pub fn ray(&self, pixel_px: DVec2) -> Option<DVec3> {
        let a = (pixel_px - self.centre_px) / self.focal_px;
        match self.projection {
            Projection::Pinhole => a.is_finite().then(|| DVec3::new(a.x, -a.y, -1.0)),
            Projection::Fisheye => {
                let angle = a.length();
                let sine_per_angle = if angle > 0.0 { angle.sin() / angle } else { 1.0 };
                (angle < std::f64::consts::PI)
                    .then(|| DVec3::new(a.x * sine_per_angle, -a.y * sine_per_angle, -angle.cos()))
            }
        }
    }

    /// The homogeneous point that a pixel shows, camera axes: position `xyz / w`. A depth of infinity is a background
    /// at infinity (`w = 0`). So is a depth of 0, with which Isaac Sim and Newton mark a ray that hits nothing.
    ///
    /// `None` if the depth is NaN, negative or too small to invert, or if the lens shows nothing there.
    #[must_use]
    pub fn unproject(&self, pixel_px: DVec2, depth_m: f64) -> Option<DVec4> {
        if unusable_depth(depth_m) {
            return None;
        }
        let inverse_depth = if depth_m == 0.0 { 0.0 } else { 1.0 / depth_m };
        self.ray(pixel_px).map(|ray| ray.extend(inverse_depth))
    }

    /// Where a homogeneous point is in the image, which it may lie outside of. `None` for a point that has no image: at
    /// or behind a pinhole's plane, exactly behind a fisheye, or at the camera's centre.
    #[must_use]
    pub fn project(&self, point: DVec4) -> Option<ImagePoint> {
        let forward = -point.z;
        let across = DVec2::new(point.x, -point.y);
        let (a, depth) = match self.projection {
            Projection::Pinhole if forward > 0.0 => (across / forward, forward),
            Projection::Pinhole => return None,
            Projection::Fisheye => {
                let radius = across.length();
                let distance = point.truncate().length();
                if radius > 0.0 {
                    (across * (radius.atan2(forward) / radius), distance)
                } else if forward > 0.0 {
                    (DVec2::ZERO, distance)
                } else {
                    return None;
                }
            }
        };
        let pixel_px = a * self.focal_px + self.centre_px;
        pixel_px.is_finite().then(|| ImagePoint { pixel_px, depth_m: depth / point.w })
    }

    /// The depth of this lens, metres, from a renderer's distance of `kind`. Infinity and 0 (nothing hit) stay as they
    /// are. `None` where the lens shows nothing, and where a distance along the axis says nothing: at 90 degrees and
    /// beyond.
    #[must_use]
    pub fn depth_m(&self, kind: DepthKind, pixel_px: DVec2, distance_m: f64) -> Option<f64> {
        let ray = self.ray(pixel_px)?;
        match (self.projection, kind) {
            (Projection::Pinhole, DepthKind::AlongAxis) | (Projection::Fisheye, DepthKind::FromCentre) => {
                Some(distance_m)
            }
            (Projection::Pinhole, DepthKind::FromCentre) => Some(distance_m / ray.length()),
            (Projection::Fisheye, DepthKind::AlongAxis) => (ray.z < 0.0).then(|| distance_m / -ray.z),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of a projection and its inverse, relative to the size of the image.
    const TOLERANCE: f64 = 1e-10;

    fn lenses() -> [Intrinsics; 2] {
        [
            Intrinsics::pinhole(200.0, 210.0, 119.5, 89.5).unwrap(),
            Intrinsics::fisheye(100.0, 102.0, 119.5, 89.5).unwrap(),
        ]
    }

    #[test]
    fn what_a_pixel_shows_is_seen_at_that_pixel() {
        for lens in lenses() {
            for (x, y) in [(0.0, 0.0), (119.5, 89.5), (239.0, 0.0), (17.25, 160.5), (-40.0, 300.0)] {
                for depth_m in [0.01, 1.0, 7.5, 1e10] {
                    let pixel_px = DVec2::new(x, y);
                    let point = lens.unproject(pixel_px, depth_m).unwrap();
                    let image = lens.project(point * 3.0).unwrap();
                    assert!((image.pixel_px - pixel_px).length() < TOLERANCE * 300.0, "{lens:?} {pixel_px}");
                    assert!((image.depth_m / depth_m - 1.0).abs() < TOLERANCE, "{}", image.depth_m);
                }
            }
        }
    }

    #[test]
    fn right_is_right_up_is_up_and_forward_is_minus_z() {
        for lens in lenses() {
            let centre = lens.project(DVec4::new(0.0, 0.0, -2.0, 1.0)).unwrap();
            assert_eq!((centre.pixel_px, centre.depth_m), (lens.centre_px(), 2.0));
            assert!(lens.project(DVec4::new(0.1, 0.0, -2.0, 1.0)).unwrap().pixel_px.x > 119.5);
            assert!(lens.project(DVec4::new(0.0, 0.1, -2.0, 1.0)).unwrap().pixel_px.y < 89.5, "rows go down");
        }
    }

    #[test]
    fn a_pinhole_sees_nothing_behind_it_and_a_fisheye_all_but_one_direction() {
        let [pinhole, fisheye] = lenses();
        for z in [0.0, 1e-9, 3.0] {
            assert_eq!(pinhole.project(DVec4::new(1.0, 1.0, z, 1.0)), None);
        }
        let sideways = fisheye.project(DVec4::new(2.0, 0.0, 0.0, 1.0)).unwrap();
        let quarter_turn_px = 100.0 * std::f64::consts::FRAC_PI_2;
        assert!((sideways.pixel_px - DVec2::new(119.5 + quarter_turn_px, 89.5)).length() < TOLERANCE);
        assert_eq!(sideways.depth_m, 2.0, "a depth at 90 degrees");
        let behind = fisheye.project(DVec4::new(1.0, 0.0, 1.0, 1.0)).unwrap();
        assert!(behind.pixel_px.x > sideways.pixel_px.x);
        assert_eq!(fisheye.project(DVec4::new(0.0, 0.0, 1.0, 1.0)), None);
        assert_eq!(fisheye.ray(DVec2::new(119.5 + 100.0 * 3.2, 89.5)), None);
        assert_eq!(fisheye.project(DVec4::ZERO), None);
    }

    #[test]
    fn background_is_at_infinity_whether_a_renderer_says_infinite_or_nought() {
        for lens in lenses() {
            for depth_m in [f64::INFINITY, 0.0, -0.0] {
                let point = lens.unproject(DVec2::new(30.0, 40.0), depth_m).unwrap();
                assert_eq!(point.w, 0.0);
                assert_eq!(lens.project(point).unwrap().depth_m, f64::INFINITY);
            }
            for depth_m in [f64::NAN, -1.0, f64::NEG_INFINITY, f64::MIN_POSITIVE * f64::EPSILON] {
                assert_eq!(lens.unproject(DVec2::new(30.0, 40.0), depth_m), None, "{depth_m}");
            }
            assert_eq!(lens.unproject(DVec2::new(f64::NAN, 0.0), 1.0), None);
        }
    }

    #[test]
    fn both_kinds_of_distance_give_the_same_point() {
        let pixel_px = DVec2::new(10.0, 150.0);
        for lens in lenses() {
            let point = lens.unproject(pixel_px, 4.0).unwrap();
            let position = point.truncate() / point.w;
            for (kind, distance_m) in
                [(DepthKind::AlongAxis, -position.z), (DepthKind::FromCentre, position.length())]
            {
                let depth_m = lens.depth_m(kind, pixel_px, distance_m).unwrap();
                assert!((depth_m - 4.0).abs() < TOLERANCE, "{lens:?} {kind:?}");
                assert_eq!(lens.depth_m(kind, pixel_px, 0.0), Some(0.0));
                assert_eq!(lens.depth_m(kind, pixel_px, f64::INFINITY), Some(f64::INFINITY));
            }
        }
        let wide = Intrinsics::fisheye(60.0, 60.0, 119.5, 89.5).unwrap();
        let beyond = DVec2::new(119.5 + 60.0 * 1.6, 89.5);
        assert_eq!(wide.depth_m(DepthKind::AlongAxis, beyond, 1.0), None);
    }

    #[test]
    fn wrong_intrinsics_are_named() {
        let error = |fx, fy, cx, cy| Intrinsics::pinhole(fx, fy, cx, cy).unwrap_err().to_string();
        assert!(error(0.0, 1.0, 0.0, 0.0).contains("fx is 0"));
        assert!(error(1.0, -3.0, 0.0, 0.0).contains("fy is -3"));
        assert!(error(f64::INFINITY, 1.0, 0.0, 0.0).contains("fx is inf"));
        assert!(error(1.0, 1.0, f64::NAN, 0.0).contains("cx is NaN"));
    }
}
