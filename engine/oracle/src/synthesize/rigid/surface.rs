//! What a key frame shows: the surface of each pixel, and which pixels belong to a surface.

use esaac_model::paths::{Intrinsics, NoPath, Pose, Projection, SceneMotion};
use esaac_model::synthesis::rigid::{BELONG_PX, HALF_THICK, LEAST_MOTION_PX};
use glam::{DVec2, DVec3};

/// A key frame's geometry.
#[derive(Clone, Copy, Debug)]
pub struct Geometry<'a> {
    /// Columns and rows.
    pub size: (usize, usize),
    /// Depth of each pixel, metres, as the lens measures it.
    pub depth_m: &'a [f64],
    /// Instance of each pixel.
    pub ids: &'a [u32],
}

/// The surface that a pixel shows: an instance and a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    /// Its instance.
    pub id: u32,
    /// Inverse depth at the pixel, 1/m.
    pub inverse_depth: f64,
    /// `m` with `m . X = 1` for the plane's points, in camera axes of the key frame.
    pub plane: DVec3,
}

/// How a pixel of a key frame lies to a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Relation {
    /// The pixel shows it.
    Belongs,
    /// The pixel shows something nearer, or nothing that is known: the surface may be hidden.
    Hides,
    /// The pixel shows something farther: the surface is not there.
    Farther,
}

/// The surfaces of a key frame.
#[derive(Clone, Debug)]
pub struct Surfaces {
    /// Columns and rows.
    pub size: (usize, usize),
    rays: Vec<Option<DVec3>>,
    elements: Vec<Result<Element, NoPath>>,
}

impl Surfaces {
    /// The surfaces of a key frame.
    #[must_use]
    pub fn new(scene: &SceneMotion, geometry: &Geometry<'_>) -> Self {
        let Geometry { size, depth_m, ids } = *geometry;
        let lens = scene.lens();
        let rays: Vec<_> = (0..size.0 * size.1).map(|i| lens.ray(position(size, i))).collect();
        let has_poses = |id: u32| {
            if id == esaac_model::paths::STATIC_WORLD || scene.instance(id).is_some() {
                Ok(())
            } else {
                Err(NoPath::NoPoses { id })
            }
        };
        let point = |i: usize| -> Result<(DVec3, f64), NoPath> {
            has_poses(ids[i])?;
            let depth_m = depth_m[i];
            // Kernels keep the inverse in single precision.
            let has_inverse = depth_m == 0.0 || (1.0 / depth_m).abs() <= f64::from(f32::MAX);
            if depth_m.is_nan() || depth_m < 0.0 || !has_inverse {
                return Err(NoPath::Depth);
            }
            let ray = rays[i].ok_or(NoPath::OutsideLens)?;
            let unprojected = lens.unproject(position(size, i), depth_m).ok_or(NoPath::Depth)?;
            Ok((ray, unprojected.w))
        };
        let points: Vec<_> = (0..size.0 * size.1).map(point).collect();
        let elements = (0..points.len())
            .map(|i| {
                let (_, inverse_depth) = points[i]?;
                let slope = |step: (usize, usize)| inverse_depth * slope(size, ids, &points, i, step);
                let plane = plane(lens, position(size, i), inverse_depth, [slope((1, 0)), slope((0, 1))]);
                Ok(Element { id: ids[i], inverse_depth, plane })
            })
            .collect();
        Surfaces { size, rays, elements }
    }

    /// The surface that a pixel (`y * width + x`) shows, or why it has none.
    ///
    /// # Errors
    /// Why the pixel has no path.
    pub fn element(&self, pixel: usize) -> Result<Element, NoPath> {
        self.elements[pixel]
    }

    /// The ray of a pixel.
    #[must_use]
    pub fn ray(&self, pixel: usize) -> Option<DVec3> {
        self.rays[pixel]
    }

    /// Whether pixel `b` continues the surface that pixel `a` shows: its inverse depth is that of the surface there, to
    /// what [`LEAST_MOTION_PX`] of motion would tell apart. At infinity that is nothing: a pixel there continues only others
    /// there.
    #[must_use]
    pub fn continues(&self, a: usize, b: usize) -> bool {
        let (Ok(own), Ok(other), Some(ray)) = (self.elements[a], self.elements[b], self.rays[b]) else {
            return false;
        };
        let behind = (other.inverse_depth - own.plane.dot(ray)).abs();
        let ends_before = other.inverse_depth == 0.0 && own.inverse_depth != 0.0;
        own.id == other.id && !ends_before && behind * LEAST_MOTION_PX <= BELONG_PX * other.inverse_depth
    }

    /// Whether the pixels up to `reach` around `centre`, clamped to the image, continue the surface of pixel `of`.
    #[must_use]
    pub fn all_continue(&self, of: usize, centre: usize, reach: usize) -> bool {
        let (width, height) = self.size;
        let (x, y) = (centre % width, centre / width);
        let columns = x.saturating_sub(reach)..=(x + reach).min(width - 1);
        (y.saturating_sub(reach)..=(y + reach).min(height - 1))
            .all(|row| columns.clone().all(|column| self.continues(of, row * width + column)))
    }

    /// The front of a pixel: of the pixels around that do not continue its surface, the nearest to the camera, if that is
    /// nearer than the pixel. One without a surface counts as nearest of all.
    #[must_use]
    pub fn front(&self, pixel: usize) -> Option<usize> {
        let (width, height) = self.size;
        let (x, y) = (pixel % width, pixel / width);
        let mut nearest = (self.elements[pixel].ok()?.inverse_depth, None);
        for row in y.saturating_sub(1)..=(y + 1).min(height - 1) {
            for column in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                let around = row * width + column;
                let inverse_depth = self.elements[around].map_or(f64::INFINITY, |e| e.inverse_depth);
                if inverse_depth > nearest.0 && !self.continues(pixel, around) {
                    nearest = (inverse_depth, Some(around));
                }
            }
        }
        nearest.1
    }

    /// How thick a pixel's surface is there: 1 if some 3x3 pixels that hold the pixel continue it, [`HALF_THICK`] if some
    /// 2x2 do, else 0. Beyond the image the border goes on.
    #[must_use]
    pub fn thickness(&self, pixel: usize) -> f64 {
        let (width, height) = self.size;
        let clamped = |at: usize, step: usize, size: usize| (at + step).saturating_sub(2).min(size - 1);
        let continues = |i: usize, j: usize| {
            let (x, y) = (clamped(pixel % width, i, width), clamped(pixel / width, j, height));
            self.continues(pixel, y * width + x)
        };
        // Of the 5x5 around: the squares of `n` by `n` pixels whose corners are `from` the first column and row on.
        let any_square = |n: usize, from: usize| {
            let firsts = from..from + n;
            firsts.clone().any(|top| {
                firsts.clone().any(|left| (top..top + n).all(|j| (left..left + n).all(|i| continues(i, j))))
            })
        };
        if any_square(3, 0) {
            1.0
        } else if any_square(2, 1) {
            HALF_THICK
        } else {
            0.0
        }
    }

    /// How a pixel lies to the surface of instance `id` and plane `plane`, in this key frame's axes.
    #[must_use]
    pub fn relation(&self, pixel: usize, id: u32, plane: DVec3, parallax_px_m: f64) -> Relation {
        let (Ok(element), Some(ray)) = (self.elements[pixel], self.rays[pixel]) else {
            return Relation::Hides;
        };
        let behind = element.inverse_depth - plane.dot(ray);
        if element.id == id && behind.abs() * parallax_px_m < BELONG_PX {
            Relation::Belongs
        } else if behind > 0.0 {
            Relation::Hides
        } else {
            Relation::Farther
        }
    }
}

/// A plane given in the axes before a rigid motion, in those after it.
#[must_use]
pub fn moved_plane(plane: DVec3, motion: &Pose) -> Option<DVec3> {
    let turned = motion.direction(plane);
    let scale = 1.0 + turned.dot(motion.translation_m());
    (scale > 0.0).then(|| turned / scale)
}

/// Centre of a pixel.
#[must_use]
pub fn position(size: (usize, usize), pixel: usize) -> DVec2 {
    DVec2::new((pixel % size.0) as f64, (pixel / size.0) as f64)
}

/// Change of inverse depth from a pixel to the next along one axis, as a fraction of it: the smaller of the differences
/// to both neighbours, or 0 where they disagree in sign or a neighbour is of another instance. A pixel at the border has
/// those of the pixel beside it. Rounded to f16.
fn slope(
    (width, height): (usize, usize),
    ids: &[u32],
    points: &[Result<(DVec3, f64), NoPath>],
    pixel: usize,
    (dx, dy): (usize, usize),
) -> f64 {
    if width <= 2 * dx || height <= 2 * dy {
        return 0.0;
    }
    let (x, y) = (pixel % width, pixel / width);
    let middle = y.clamp(dy, height - 1 - dy) * width + x.clamp(dx, width - 1 - dx);
    let (before, after) = (middle - dy * width - dx, middle + dy * width + dx);
    if [before, middle, after].iter().any(|&other| ids[other] != ids[pixel]) {
        return 0.0;
    }
    let (Ok((_, first)), Ok((_, here)), Ok((_, last)), Ok((_, own))) =
        (points[before], points[middle], points[after], points[pixel])
    else {
        return 0.0;
    };
    let (fall, rise) = (here - first, last - here);
    if fall * rise <= 0.0 || here == 0.0 || own == 0.0 {
        return 0.0;
    }
    let smaller = if fall.abs() < rise.abs() { fall } else { rise };
    half::f16::from_f64(smaller / own).to_f64()
}

/// The plane through the point of depth `1 / inverse_depth` at a pixel, with the given slopes of inverse depth along the
/// image's axes.
fn plane(lens: &Intrinsics, at: DVec2, inverse_depth: f64, [across, down]: [f64; 2]) -> DVec3 {
    let Some(ray) = lens.ray(at) else { return DVec3::ZERO };
    // Slopes over tangents, or over angles.
    let slopes = DVec2::new(across, down) * lens.focal_px();
    let a = (at - lens.centre_px()) / lens.focal_px();
    match lens.projection() {
        Projection::Pinhole => {
            DVec3::new(slopes.x, -slopes.y, slopes.x * ray.x - slopes.y * ray.y - inverse_depth)
        }
        Projection::Fisheye => {
            let facing = inverse_depth * ray;
            let angle = a.length();
            if angle == 0.0 {
                return facing + DVec3::new(slopes.x, -slopes.y, 0.0);
            }
            // The ray turns outwards with the angle, and around the axis by its sine for each angle.
            let (sine, cosine) = angle.sin_cos();
            let away = a / angle;
            let outwards = DVec3::new(cosine * away.x, -cosine * away.y, sine);
            let around = DVec3::new(-away.y, -away.x, 0.0);
            let by_angle = if sine > LEAST_SINE { angle / sine } else { 0.0 };
            facing + outwards * away.dot(slopes) + around * (away.perp_dot(slopes) * by_angle)
        }
    }
}

/// Sine of a fisheye's angle below which, behind the camera, slopes around the axis say nothing.
const LEAST_SINE: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::paths::PoseTrack;

    /// A wall that is slanted in both directions fills the image, so that the plane of every pixel is the wall's: also at the
    /// border and in the corners.
    #[test]
    fn a_slanted_wall_is_one_plane_up_to_the_border() {
        let wall = DVec3::new(0.05, -0.08, -0.3);
        let lens = Intrinsics::pinhole(80.0, 85.0, 7.5, 5.5).unwrap();
        let still = PoseTrack::new(vec![0, 1], vec![Pose::IDENTITY; 2]).unwrap();
        let scene = SceneMotion::new(lens, still);
        for size in [(16, 12), (3, 3), (2, 12)] {
            let count = size.0 * size.1;
            let rays = (0..count).map(|i| lens.ray(position(size, i)).unwrap());
            let depth_m: Vec<f64> = rays.map(|ray| 1.0 / wall.dot(ray)).collect();
            let surfaces = Surfaces::new(&scene, &Geometry { size, depth_m: &depth_m, ids: &vec![0; count] });
            for pixel in 0..count {
                let found = surfaces.element(pixel).unwrap().plane;
                // Of two columns none has neighbours on both sides.
                let expected = if size.0 > 2 { wall } else { DVec3::new(0.0, wall.y, found.z) };
                assert!((found - expected).length() < 1e-4, "{size:?}, pixel {pixel}: {found}");
            }
        }
    }

    /// The plane that a pixel shows gives back the inverse depths of a plane at the pixels around, as far as the slopes
    /// are kept.
    #[test]
    fn a_plane_is_found_again_through_both_lenses() {
        let truth = DVec3::new(0.05, -0.08, -0.3);
        for lens in [
            Intrinsics::pinhole(80.0, 85.0, 15.5, 11.5).unwrap(),
            Intrinsics::fisheye(40.0, 42.0, 15.0, 11.0).unwrap(),
        ] {
            for at in [DVec2::new(15.0, 11.0), DVec2::new(3.0, 20.0), DVec2::new(29.0, 7.0)] {
                let w = |at: DVec2| truth.dot(lens.ray(at).unwrap());
                let slope = |step: DVec2| (w(at + step * 1e-4) - w(at - step * 1e-4)) / 2e-4;
                let found = plane(&lens, at, w(at), [slope(DVec2::X), slope(DVec2::Y)]);
                assert!((found - truth).length() < 1e-6, "{lens:?} {at}: {found}");
            }
        }
    }
}
