//! The scene seen from its camera at one instant, and the radiance of a pixel.
//!
//! Everything is in camera axes (x right, y down, z forward, origin at the camera's centre) and computed in f64. The
//! shader reads the same numbers as f32 and evaluates the same formulas in the same order. Pixel centres are at whole
//! numbers; the first pixel is (0, 0).

use crate::cut::Cut;
use crate::object::Finish;
use crate::scene::{Lamp, Lighting};
use crate::texture::{EDGE_PX, Footprint, Layer, Wave, coverage};
use glam::{DMat3, DVec3};

/// Depth of hills and sky, metres.
pub const SKY_DEPTH_M: f64 = f64::INFINITY;

/// Distance outside its border beyond which an object does not affect a pixel (coverage below 1e-12), pixels.
pub const REACH_PX: f64 = 14.0;

/// Coverage below which a sheet does not affect a pixel.
pub const LEAST_COVERAGE: f64 = 1e-12;

/// Uncovered share of a pixel below which surfaces further back are ignored.
pub const OPAQUE: f64 = 1e-10;

/// Half-width of a shadow's edge, metres.
pub const SHADOW_EDGE_M: f64 = 0.12;

/// Limit to which a pixel's footprint widens a shadow's edge, metres per pixel.
pub const SHADOW_FOOTPRINT_M: f64 = 0.3;

/// An object in camera axes.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewObject {
    /// The object's number in the scene.
    pub id: usize,
    /// Instance id: 0 for what stands still in the world.
    pub instance: u32,
    /// Geometry.
    pub shape: ViewShape,
    /// Origin, metres. Zero for objects at infinity.
    pub origin: DVec3,
    /// Rotation from the object's own axes to camera axes.
    pub rotation: DMat3,
    /// Log (nepers) of the mean albedo or radiance, R, G, B.
    pub base_log: DVec3,
    /// Change of `base_log` towards the zenith, nepers.
    pub gradient_log: DVec3,
    /// Texture, with its waves in camera axes.
    pub layers: Vec<Layer>,
    /// How the surface reflects light.
    pub finish: Finish,
}

/// Geometry in camera axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewShape {
    /// A sphere around the object's origin.
    Sphere {
        /// Radius, metres.
        radius_m: f64,
    },
    /// A rectangle in the plane `normal . p = offset_m`. The normal points towards the camera.
    Panel {
        /// Unit normal.
        normal: DVec3,
        /// Offset of the plane, metres. Negative.
        offset_m: f64,
        /// Unit vectors along the sides.
        axes: [DVec3; 2],
        /// Half extents, metres.
        half_m: [f64; 2],
        /// One vector per border. Its dot product with a pixel's ray is the distance from the border, pixels, positive
        /// inside.
        borders: [DVec3; 4],
    },
    /// A part of the plane `normal . p = offset_m`. The normal points towards the camera.
    Sheet {
        /// Unit normal.
        normal: DVec3,
        /// Offset of the plane, metres. Negative.
        offset_m: f64,
        /// Which part, with its waves in camera axes.
        cut: Cut,
    },
    /// The plane `up . p = -height_m`.
    Ground {
        /// Height of the camera above the ground, metres.
        height_m: f64,
        /// The horizon as a border, as for a panel.
        horizon: DVec3,
    },
    /// A range of hills at infinity.
    Ridge {
        /// Sine of the mean elevation.
        elevation: f64,
        /// Waves in camera axes.
        waves: [Wave; 4],
        /// Amplitude of each wave, sine of elevation.
        amplitudes: [f64; 4],
    },
    /// The sky, at infinity.
    Sky,
    /// An image plane. Positions on it are in pixels.
    Card,
}

/// The light at one instant. Directions are in camera axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewLight {
    /// Up.
    pub up: DVec3,
    /// Towards the sun.
    pub sun_direction: DVec3,
    /// Lamp of the world scenes: position, metres.
    pub lamp_m: DVec3,
    /// Colours and sizes.
    pub lighting: Lighting,
    /// Lamp of a card.
    pub card_lamp: Lamp,
    /// How brightly the card's lamp is lit, 0 to 1.
    pub card_lamp_level: f64,
    /// Factor of all radiance.
    pub exposure: f64,
}

/// The scene at one instant, seen by its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Image width, pixels.
    pub width_px: u32,
    /// Image height, pixels.
    pub height_px: u32,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Objects, each before all that it can hide. The last one covers every pixel.
    pub objects: Vec<ViewObject>,
    /// Number of spheres and panels. They are the first objects; sheets follow.
    pub solids: usize,
    /// Light.
    pub light: ViewLight,
}

/// Radiance and nearest surface of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelSample {
    /// Linear R, G, B.
    pub radiance: DVec3,
    /// Index in [`View::objects`] of the nearest surface that covers at least half of the pixel.
    pub object: usize,
    /// Instance id of that surface: 0 for what stands still in the world.
    pub instance: u32,
    /// The point on that surface, camera axes: metres, a unit direction at infinity, or pixels on a card.
    pub position: DVec3,
    /// Distance along the view axis, metres.
    pub depth_m: f64,
}

/// The rigid motion of an object from one view to another: `p' = p + (matrix_minus_one p + shift)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// Rotation less the identity.
    pub matrix_minus_one: DMat3,
    /// Translation.
    pub shift: DVec3,
}

struct Ray {
    direction: DVec3,
    per_px: f64,
    position_px: DVec3,
}

struct Hit {
    coverage: f64,
    position: DVec3,
    normal: DVec3,
    footprint: Footprint,
    depth_m: f64,
}

impl View {
    /// Samples the pixel at `(x_px, y_px)`.
    #[must_use]
    pub fn sample(&self, x_px: f64, y_px: f64) -> PixelSample {
        let x = x_px - 0.5 * f64::from(self.width_px - 1);
        let y = y_px - 0.5 * f64::from(self.height_px - 1);
        let per_px = 1.0 / self.focal_px;
        let ray = Ray {
            direction: DVec3::new(x * per_px, y * per_px, 1.0),
            per_px,
            position_px: DVec3::new(x, y, 1.0),
        };
        let mut radiance = DVec3::ZERO;
        let mut left = 1.0;
        let mut seen: Option<(usize, Hit)> = None;
        for (index, object) in self.objects.iter().enumerate() {
            let Some(hit) = self.hit(object, &ray) else { continue };
            radiance += self.colour(index, &hit) * (left * hit.coverage);
            left *= 1.0 - hit.coverage;
            if seen.is_none() && hit.coverage >= 0.5 {
                seen = Some((index, hit));
            }
            if left < OPAQUE {
                break;
            }
        }
        let (object, hit) = seen.expect("the last object covers every pixel");
        PixelSample {
            radiance: radiance * self.light.exposure,
            object,
            instance: self.objects[object].instance,
            position: hit.position,
            depth_m: hit.depth_m,
        }
    }

    /// Radiance of the pixel at `(x_px, y_px)`, linear R, G, B.
    #[must_use]
    pub fn radiance(&self, x_px: f64, y_px: f64) -> [f64; 3] {
        self.sample(x_px, y_px).radiance.to_array()
    }

    /// Rigid motion of object `index` from this view to `other`.
    #[must_use]
    pub fn displacement(&self, index: usize, other: &View) -> Displacement {
        let here = &self.objects[index];
        let there = other.objects.iter().find(|o| o.id == here.id).expect("both views hold every object");
        if (here.rotation, here.origin) == (there.rotation, there.origin) {
            return Displacement { matrix_minus_one: DMat3::ZERO, shift: DVec3::ZERO };
        }
        let rotation = there.rotation * here.rotation.transpose();
        let matrix_minus_one = rotation - DMat3::IDENTITY;
        Displacement { matrix_minus_one, shift: there.origin - here.origin - matrix_minus_one * here.origin }
    }

    /// Position in `previous` less the position here of the surface point seen by a pixel, pixels, y down.
    #[must_use]
    pub fn motion(&self, sample: &PixelSample, previous: &View) -> [f64; 2] {
        let displacement = self.displacement(sample.object, previous);
        let p = sample.position;
        let delta = displacement.matrix_minus_one * p + displacement.shift;
        if matches!(self.objects[sample.object].shape, ViewShape::Card) {
            return [delta.x, delta.y];
        }
        let scale = self.focal_px / (p.z + delta.z);
        [(delta.x - p.x / p.z * delta.z) * scale, (delta.y - p.y / p.z * delta.z) * scale]
    }

    fn hit(&self, object: &ViewObject, ray: &Ray) -> Option<Hit> {
        let d = ray.direction;
        match object.shape {
            ViewShape::Sphere { radius_m } => {
                let centre = object.origin;
                let along = centre.dot(d);
                if along <= 0.0 {
                    return None;
                }
                let length2 = d.length_squared();
                let nearest = along / length2;
                let offset = centre - d * nearest;
                let miss_m = offset.length();
                let direction_xy = offset.truncate().length() / miss_m.max(1e-12 * radius_m);
                let miss_per_px = nearest * ray.per_px * direction_xy.max(0.5);
                let distance_px = (radius_m - miss_m) / miss_per_px;
                if distance_px < -REACH_PX {
                    return None;
                }
                let chord2 = soft_positive((radius_m - miss_m) * (radius_m + miss_m), radius_m * miss_per_px);
                let position = d * (nearest - (chord2 / length2).sqrt());
                let normal = (position - centre).normalize();
                Some(flat_hit(coverage(distance_px), position, normal, normal.dot(d), ray))
            }
            ViewShape::Panel { normal, offset_m, borders, .. } => {
                let mut covered = 1.0;
                for border in borders {
                    let distance_px = border.dot(d);
                    if distance_px < -REACH_PX {
                        return None;
                    }
                    covered *= coverage(distance_px);
                }
                let slope = normal.dot(d).min(-1e-3);
                Some(flat_hit(covered, d * (offset_m / slope), normal, slope, ray))
            }
            ViewShape::Sheet { normal, offset_m, cut } => {
                let slope = normal.dot(d).min(-1e-3);
                let mut hit = flat_hit(1.0, d * (offset_m / slope), normal, slope, ray);
                hit.coverage = cut.coverage(hit.position, &hit.footprint, object.origin, object.rotation);
                (hit.coverage >= LEAST_COVERAGE).then_some(hit)
            }
            ViewShape::Ground { height_m, horizon } => {
                let distance_px = horizon.dot(d);
                if distance_px < -REACH_PX {
                    return None;
                }
                let up = self.light.up;
                let slope_per_px = up.truncate().length() * ray.per_px;
                let slope = -soft_positive(-up.dot(d), 0.5 * slope_per_px);
                Some(flat_hit(coverage(distance_px), d * (-height_m / slope), up, slope, ray))
            }
            ViewShape::Ridge { elevation, waves, amplitudes } => {
                let mut hit = far_hit(ray);
                let mut height = elevation;
                for (wave, amplitude) in waves.iter().zip(amplitudes) {
                    height +=
                        amplitude * wave.value(crate::texture::Profile::Sine, hit.position, &hit.footprint);
                }
                let distance_px = (height - hit.position.dot(self.light.up)) * self.focal_px;
                if distance_px < -REACH_PX {
                    return None;
                }
                hit.coverage = coverage(distance_px);
                Some(hit)
            }
            ViewShape::Sky => Some(far_hit(ray)),
            ViewShape::Card => Some(Hit {
                coverage: 1.0,
                position: ray.position_px,
                normal: -DVec3::Z,
                footprint: Footprint { dx: DVec3::X, dy: DVec3::Y },
                depth_m: 1.0,
            }),
        }
    }

    fn colour(&self, index: usize, hit: &Hit) -> DVec3 {
        let object = &self.objects[index];
        let light = &self.light;
        let lighting = &light.lighting;
        let mut log = object.base_log;
        for layer in &object.layers {
            log += layer.log_rgb(hit.position, &hit.footprint);
        }
        if matches!(object.shape, ViewShape::Sky) {
            let rise = hit.position.dot(light.up);
            log += object.gradient_log * (rise / (rise.abs() + 0.25));
        }
        let texture = log.exp();
        let p = hit.position;
        match object.shape {
            ViewShape::Card => {
                let lamp = &light.card_lamp;
                let away2 =
                    (p - lamp.centre_px).truncate().length_squared() / (lamp.radius_px * lamp.radius_px);
                let fall = 1.0 / (1.0 + away2);
                return texture * (DVec3::ONE + lamp.rgb * (light.card_lamp_level * fall * fall));
            }
            ViewShape::Sky => {
                let away2 = 0.5 * (p - light.sun_direction).length_squared();
                return texture
                    + lighting.halo_rgb * (-lighting.halo_sharpness * away2).exp()
                    + lighting.disc_rgb * (-lighting.disc_sharpness * away2).exp();
            }
            ViewShape::Ridge { .. } => return texture,
            _ => {}
        }
        let finish = &object.finish;
        if finish.emission > 0.0 {
            return texture * finish.emission;
        }
        let n = hit.normal;
        let skyward = 0.5 + 0.5 * n.dot(light.up);
        let ambient = lighting.ground_rgb.lerp(lighting.sky_rgb, skyward);
        let shadow = self.shadow(index, hit);
        let to_lamp = light.lamp_m - p;
        let lamp_distance2 = to_lamp.length_squared();
        let lamp_angle = n.dot(to_lamp) / lamp_distance2.sqrt();
        let lamp = wrapped(lamp_angle) / (lamp_distance2 + 0.25);
        let irradiance = ambient * finish.ambient
            + lighting.sun_rgb * (finish.sun * shadow * wrapped(n.dot(light.sun_direction)))
            + lighting.lamp_rgb * (finish.lamp * lamp);
        let distance_m = p.length();
        let half_way = (light.sun_direction - p / distance_m).normalize();
        let off_highlight = 0.5 * (n - half_way).length_squared();
        let highlight = finish.gloss * shadow * (-finish.gloss_sharpness * off_highlight).exp();
        let lit = texture * irradiance + lighting.sun_rgb * highlight;
        let clear = (-distance_m * finish.haze / lighting.haze_m).exp();
        lighting.haze_rgb.lerp(lit, clear)
    }

    /// Share of the sun's light that reaches a point.
    fn shadow(&self, receiver: usize, hit: &Hit) -> f64 {
        let footprint2 = hit.footprint.dx.length_squared() + hit.footprint.dy.length_squared();
        let capped2 = footprint2 / (1.0 + footprint2 / (SHADOW_FOOTPRINT_M * SHADOW_FOOTPRINT_M));
        let edge_m = (SHADOW_EDGE_M * SHADOW_EDGE_M + capped2).sqrt();
        let sun = self.light.sun_direction;
        let mut share = 1.0;
        for (index, object) in self.objects[..self.solids].iter().enumerate() {
            if index == receiver || object.finish.emission > 0.0 {
                continue;
            }
            let to_object = object.origin - hit.position;
            let hidden = match object.shape {
                ViewShape::Sphere { radius_m } => {
                    let along = to_object.dot(sun);
                    let miss = (to_object - sun * along).length();
                    coverage((radius_m - miss) / edge_m) * coverage(along / edge_m)
                }
                ViewShape::Panel { normal, axes, half_m, .. } => {
                    let slope = normal.dot(sun);
                    let steep = slope / (slope * slope + 1e-4);
                    let along = normal.dot(to_object) * steep;
                    let landing = sun * along - to_object;
                    let (a, b) = (landing.dot(axes[0]), landing.dot(axes[1]));
                    coverage(along / edge_m)
                        * coverage((half_m[0] - a.abs()) / edge_m)
                        * coverage((half_m[1] - b.abs()) / edge_m)
                }
                _ => 0.0,
            };
            share *= 1.0 - hidden;
        }
        share
    }
}

/// A hit on a surface with the given normal. `slope` is `normal . ray`.
fn flat_hit(coverage: f64, position: DVec3, normal: DVec3, slope: f64, ray: &Ray) -> Hit {
    let depth_m = position.z;
    let step = depth_m * ray.per_px;
    let dx = (DVec3::X - ray.direction * (normal.x / slope)) * step;
    let dy = (DVec3::Y - ray.direction * (normal.y / slope)) * step;
    Hit { coverage, position, normal, footprint: Footprint { dx, dy }, depth_m }
}

/// A hit at infinity: the position is the unit direction.
fn far_hit(ray: &Ray) -> Hit {
    let length = ray.direction.length();
    let unit = ray.direction / length;
    let step = ray.per_px / length;
    Hit {
        coverage: 1.0,
        position: unit,
        normal: -unit,
        footprint: Footprint { dx: (DVec3::X - unit * unit.x) * step, dy: (DVec3::Y - unit * unit.y) * step },
        depth_m: SKY_DEPTH_M,
    }
}

/// Smooth `max(x, 0)`, rounded off within `width` of 0. Always positive.
fn soft_positive(x: f64, width: f64) -> f64 {
    let root = (x * x + width * width).sqrt();
    if x >= 0.0 { 0.5 * (x + root) } else { 0.5 * width * width / (root - x) }
}

/// Share of light received at a cosine of incidence. It falls smoothly to 0 beyond the terminator.
fn wrapped(cosine: f64) -> f64 {
    let x = ((cosine + 0.3) / 1.3).max(0.0);
    x * x
}

/// Borders of a panel as seen from the origin: see [`ViewShape::Panel`].
pub(crate) fn borders(centre: DVec3, axes: [DVec3; 2], half_m: [f64; 2], focal_px: f64) -> [DVec3; 4] {
    let (u, v) = (axes[0] * half_m[0], axes[1] * half_m[1]);
    let corners = [centre - u - v, centre + u - v, centre + u + v, centre - u + v];
    std::array::from_fn(|i| {
        let plane = corners[i].cross(corners[(i + 1) % 4]);
        let plane = plane * plane.dot(centre).signum();
        plane * (focal_px / plane.truncate().length().max(1e-9))
    })
}

/// The ground's horizon as a border.
pub(crate) fn horizon(up: DVec3, focal_px: f64) -> DVec3 {
    -up * (focal_px / up.truncate().length().max(1e-9))
}

const _: () = assert!(EDGE_PX == 1.0, "the shader's edges are one pixel wide");
