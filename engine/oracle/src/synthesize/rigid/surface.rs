//! What a key frame shows: the surface of each pixel, and which pixels belong to a surface.

use esaac_model::paths::{Intrinsics, NoPath, Pose, SceneMotion};
use esaac_model::synthesis::rigid::BELONG_PX;
use glam::{DMat3, DVec2, DVec3};

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
            if depth_m.is_nan() || depth_m < 0.0 {
                return Err(NoPath::Depth);
            }
            let ray = rays[i].ok_or(NoPath::OutsideLens)?;
            let unprojected = lens.unproject(position(size, i), depth_m).ok_or(NoPath::Depth)?;
            Ok((ray, unprojected.w))
        };
        let points: Vec<_> = (0..size.0 * size.1).map(point).collect();
        let elements = (0..points.len())
            .map(|i| {
                let (ray, inverse_depth) = points[i]?;
                let slope = |step: (usize, usize)| slope(size, ids, &points, i, step);
                let plane =
                    plane(lens, position(size, i), ray, inverse_depth, [slope((1, 0)), slope((0, 1))]);
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

/// Change of inverse depth from a pixel to the next along one axis: the smaller of the differences to both neighbours,
/// or 0 where they disagree in sign or a neighbour is of another instance.
fn slope(
    (width, height): (usize, usize),
    ids: &[u32],
    points: &[Result<(DVec3, f64), NoPath>],
    pixel: usize,
    (dx, dy): (usize, usize),
) -> f64 {
    let (x, y) = (pixel % width, pixel / width);
    if x < dx || y < dy || x + dx >= width || y + dy >= height {
        return 0.0;
    }
    let (before, after) = (pixel - dy * width - dx, pixel + dy * width + dx);
    if ids[before] != ids[pixel] || ids[after] != ids[pixel] {
        return 0.0;
    }
    let (Ok((_, first)), Ok((_, here)), Ok((_, last))) = (points[before], points[pixel], points[after])
    else {
        return 0.0;
    };
    let (fall, rise) = (here - first, last - here);
    if fall * rise <= 0.0 {
        0.0
    } else if fall.abs() < rise.abs() {
        fall
    } else {
        rise
    }
}

/// The plane through a pixel's point with the given slopes of inverse depth along the image's axes.
fn plane(lens: &Intrinsics, at: DVec2, ray: DVec3, inverse_depth: f64, [across, down]: [f64; 2]) -> DVec3 {
    let facing = ray * inverse_depth / ray.length_squared();
    let (Some(right), Some(below)) = (lens.ray(at + DVec2::X), lens.ray(at + DVec2::Y)) else {
        return facing;
    };
    // m . ray = w, m . right = w + across, m . below = w + down.
    let rays = DMat3::from_cols(ray, right, below).transpose();
    let solved = rays.inverse() * DVec3::new(inverse_depth, inverse_depth + across, inverse_depth + down);
    if solved.is_finite() { solved } else { facing }
}
