//! The paths of surface points from what a simulator knows: the depth and instance of each pixel, and where the camera
//! and every body were. A path is exact wherever bodies are rigid; it needs no motion vectors.
//!
//! **Path.** A key frame shows at time `t0`, at pixel `x`, a surface of instance `b` at depth `z`. Let `C(t)` be the
//! pose of the camera and `B(t)` that of the instance, both world from body; the static world ([`STATIC_WORLD`]) has
//! `B(t) = 1`. At time `t` the point is at
//!
//! `project(C(t)^-1 B(t) B(t0)^-1 C(t0) unproject(x, z))`.
//!
//! The poses in the middle depend on the instance and the two times only: [`SceneMotion::relative`] gives their
//! product, one rigid transform that holds for all pixels of an instance. The lens is in [`Intrinsics`], which also
//! says what depth means. [`PoseTrack`] has the poses between samples.
//!
//! **Background at infinity** has an infinite depth, or 0. It moves with the camera's rotation only. Of an instance it
//! is turned with that instance, which means nothing; renderers give background the static world's id.
//!
//! **No path.** A pixel without a usable depth, an instance without poses, a point that goes behind the camera:
//! [`NoPath`] says which, so that a synthesis that falls back can count each apart.
//!
//! **Conventions.** Units are metres, pixels and nanoseconds. The camera looks along -z, x right, y up.
//! Where a renderer gives motion vectors as well, [`conventions`] tells whether depth and poses predict them and, if
//! not, which mistake explains the difference.

pub mod conventions;
mod flow;
mod lens;
mod pose;
mod root;
pub mod spacing;
mod track;
pub mod turn;

pub use lens::{DepthKind, ImagePoint, Intrinsics, LensError, Projection};
pub use pose::{Pose, PoseError, RIGID_TOLERANCE};
pub use root::{ROOT_SEED, ROOT_STEPS, square_root};
pub use track::{Curve, NEIGHBOURS, PoseTimes, PoseTrack, Segment, TrackError, TrackMemory};

use glam::DVec2;
use thiserror::Error;

/// Instance id of all that never moves.
pub const STATIC_WORLD: u32 = 0;

/// The motion of a scene and its camera: everything but the images.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneMotion {
    lens: Intrinsics,
    camera: PoseTrack,
    /// Ascending by id. A vector, since most scenes have few and are made anew for every frame.
    instances: Vec<(u32, PoseTrack)>,
}

/// Why the motion of a scene is refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum MotionError {
    /// The static world cannot have poses.
    #[error("instance {STATIC_WORLD} has poses, but {STATIC_WORLD} is the static world; expected ids from 1")]
    StaticWorld,
    /// Two tracks for one instance.
    #[error("instance {id} has two tracks, expected one")]
    Twice {
        /// The instance.
        id: u32,
    },
    /// The camera's poses do not span an interval.
    #[error("camera: {0}")]
    Camera(TrackError),
    /// An instance's poses do not span an interval.
    #[error("instance {id}: {error}")]
    Instance {
        /// The instance.
        id: u32,
        /// What its track lacks.
        error: TrackError,
    },
}

/// Why a pixel has no path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum NoPath {
    /// Its depth is NaN, negative, or so small that its inverse is infinite.
    #[error("the depth is NaN, negative or too small to invert")]
    Depth,
    /// The lens shows nothing there.
    #[error("the lens shows nothing there")]
    OutsideLens,
    /// The point has no image at the time asked for.
    #[error("the point is behind the camera")]
    BehindCamera,
    /// The instance has no poses.
    #[error("instance {id} has no poses")]
    NoPoses {
        /// The instance.
        id: u32,
    },
    /// The poses of the camera or the instance do not reach the time.
    #[error("no poses at {t_ns} ns")]
    Time {
        /// The time.
        t_ns: i64,
    },
}

impl SceneMotion {
    /// A camera in a world in which nothing moves yet.
    #[must_use]
    pub fn new(lens: Intrinsics, camera: PoseTrack) -> Self {
        SceneMotion { lens, camera, instances: Vec::new() }
    }

    /// Adds the poses of a moving instance. Many are added fastest in the order of their ids.
    ///
    /// # Errors
    /// If `id` is [`STATIC_WORLD`] or has a track already.
    pub fn insert(&mut self, id: u32, track: PoseTrack) -> Result<(), MotionError> {
        if id == STATIC_WORLD {
            return Err(MotionError::StaticWorld);
        }
        match self.place(id) {
            Ok(_) => Err(MotionError::Twice { id }),
            Err(place) => {
                self.instances.insert(place, (id, track));
                Ok(())
            }
        }
    }

    /// Takes the poses of an instance away.
    pub fn remove(&mut self, id: u32) {
        if let Ok(place) = self.place(id) {
            self.instances.remove(place);
        }
    }

    /// Where an instance is among the others; the error is where it would be.
    fn place(&self, id: u32) -> Result<usize, usize> {
        // Most often it is the last one, or comes after it.
        match self.instances.last() {
            Some((last, _)) if *last < id => Err(self.instances.len()),
            _ => self.instances.binary_search_by_key(&id, |(id, _)| *id),
        }
    }

    /// The tracks of the camera and of all instances.
    pub fn into_tracks(self) -> impl Iterator<Item = PoseTrack> {
        std::iter::once(self.camera).chain(self.instances.into_iter().map(|(_, track)| track))
    }

    /// The lens.
    #[must_use]
    pub fn lens(&self) -> &Intrinsics {
        &self.lens
    }

    /// The camera's poses.
    #[must_use]
    pub fn camera(&self) -> &PoseTrack {
        &self.camera
    }

    /// The poses of a moving instance.
    #[must_use]
    pub fn instance(&self, id: u32) -> Option<&PoseTrack> {
        self.place(id).ok().map(|place| &self.instances[place].1)
    }

    /// Ids of the moving instances, ascending.
    pub fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.instances.iter().map(|(id, _)| *id)
    }

    /// Number of tracks that do not stand still, the camera's included.
    #[must_use]
    pub fn moving_tracks(&self) -> usize {
        let tracks = std::iter::once(&self.camera).chain(self.instances.iter().map(|(_, track)| track));
        tracks.filter(|track| !track.stands()).count()
    }

    /// Whether all poses span an interval.
    ///
    /// # Errors
    /// Names the camera or the first instance whose poses do not.
    pub fn check_span(&self, from_ns: i64, to_ns: i64) -> Result<(), MotionError> {
        self.camera.check_span(from_ns, to_ns).map_err(MotionError::Camera)?;
        self.instances.iter().try_for_each(|(id, track)| {
            track.check_span(from_ns, to_ns).map_err(|error| MotionError::Instance { id: *id, error })
        })
    }

    /// The motion of instance `id` as the camera sees it: takes a point in camera axes at `from_ns` to camera axes at
    /// `to_ns`.
    ///
    /// # Errors
    /// [`NoPath::NoPoses`] or [`NoPath::Time`].
    pub fn relative(&self, id: u32, from_ns: i64, to_ns: i64) -> Result<Pose, NoPath> {
        let at = |track: &PoseTrack, t_ns: i64| track.at(t_ns).map_err(|_| NoPath::Time { t_ns });
        let (camera_from, camera_to) = (at(&self.camera, from_ns)?, at(&self.camera, to_ns)?);
        if id == STATIC_WORLD {
            return Ok(camera_to.inverse() * camera_from);
        }
        let track = self.instance(id).ok_or(NoPath::NoPoses { id })?;
        let (body_from, body_to) = (at(track, from_ns)?, at(track, to_ns)?);
        Ok(camera_to.inverse() * body_to * body_from.inverse() * camera_from)
    }

    /// Where the point that a key frame shows at `from_ns` at `pixel_px` with `depth_m` is at `to_ns`.
    ///
    /// # Errors
    /// Why it has no path.
    pub fn path(
        &self,
        pixel_px: DVec2,
        depth_m: f64,
        id: u32,
        from_ns: i64,
        to_ns: i64,
    ) -> Result<ImagePoint, NoPath> {
        let relative = self.relative(id, from_ns, to_ns)?;
        self.lens.path(pixel_px, depth_m, &relative)
    }
}

impl Intrinsics {
    /// Where the point that a pixel shows is after a rigid motion in camera axes: [`SceneMotion::path`], with the motion
    /// of its instance ([`SceneMotion::relative`]) at hand.
    ///
    /// # Errors
    /// Why it has no path.
    pub fn path(&self, pixel_px: DVec2, depth_m: f64, relative: &Pose) -> Result<ImagePoint, NoPath> {
        if unusable_depth(depth_m) {
            return Err(NoPath::Depth);
        }
        let point = self.unproject(pixel_px, depth_m).ok_or(NoPath::OutsideLens)?;
        self.project(relative.apply(point)).ok_or(NoPath::BehindCamera)
    }
}

/// Whether a depth is NaN, negative, or so small that its inverse is infinite.
fn unusable_depth(depth_m: f64) -> bool {
    depth_m.is_nan() || depth_m < 0.0 || (depth_m > 0.0 && (1.0 / depth_m).is_infinite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    const FRAME_NS: i64 = 33_333_333;

    /// A camera that moves and turns, and a body that flies and spins before it.
    fn scene(lens: Intrinsics) -> SceneMotion {
        let times_ns: Vec<i64> = (0..9).map(|k| FRAME_NS * k / 8).collect();
        let camera = |k: f64| {
            Pose::new(
                DQuat::from_scaled_axis(DVec3::new(0.2, 0.01 * k, 0.02 * k.sin())),
                DVec3::new(0.01 * k, 1.0, 0.0),
            )
            .unwrap()
        };
        let body = |k: f64| {
            Pose::new(
                DQuat::from_scaled_axis(DVec3::new(0.1 * k, 0.3, 0.0)),
                DVec3::new(0.5, 1.5 - 0.02 * k, -4.0),
            )
            .unwrap()
        };
        let track = |pose: &dyn Fn(f64) -> Pose| {
            PoseTrack::new(times_ns.clone(), (0..9).map(|k| pose(f64::from(k))).collect()).unwrap()
        };
        let mut scene = SceneMotion::new(lens, track(&camera));
        scene.insert(3, track(&body)).unwrap();
        scene
    }

    fn pinhole() -> Intrinsics {
        Intrinsics::pinhole(200.0, 200.0, 119.5, 89.5).unwrap()
    }

    #[test]
    fn a_point_fixed_to_a_body_is_followed_to_where_it_is_projected_directly() {
        for lens in [pinhole(), Intrinsics::fisheye(90.0, 90.0, 119.5, 89.5).unwrap()] {
            let scene = scene(lens);
            for (id, own) in [(3, DVec3::new(0.2, -0.1, 0.3)), (STATIC_WORLD, DVec3::new(-0.4, 2.0, -3.0))] {
                let seen = |t_ns: i64| {
                    let body = scene.instance(id).map_or(Pose::IDENTITY, |track| track.at(t_ns).unwrap());
                    let camera = scene.camera().at(t_ns).unwrap();
                    lens.project(camera.inverse().point(body.point(own)).extend(1.0)).unwrap()
                };
                for (from_ns, to_ns) in [(FRAME_NS, 0), (0, FRAME_NS), (FRAME_NS, FRAME_NS / 3)] {
                    let start = seen(from_ns);
                    let end = scene.path(start.pixel_px, start.depth_m, id, from_ns, to_ns).unwrap();
                    assert!((end.pixel_px - seen(to_ns).pixel_px).length() < 1e-9, "{id} {to_ns}");
                    assert!((end.depth_m - seen(to_ns).depth_m).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn a_path_begins_where_it_is_seen() {
        let scene = scene(pinhole());
        let start = scene.path(DVec2::new(12.0, 34.0), 2.5, 3, FRAME_NS, FRAME_NS).unwrap();
        assert!((start.pixel_px - DVec2::new(12.0, 34.0)).length() < 1e-10);
        assert!((start.depth_m - 2.5).abs() < 1e-12);
    }

    #[test]
    fn background_turns_with_the_camera_and_does_not_move_with_it() {
        let shift = Pose::new(DQuat::IDENTITY, DVec3::new(5.0, 0.0, 0.0)).unwrap();
        let turn = Pose::new(DQuat::from_scaled_axis(DVec3::new(0.0, 0.1, 0.0)), DVec3::X).unwrap();
        let pixel_px = DVec2::new(119.5, 89.5);
        for depth_m in [f64::INFINITY, 0.0] {
            let path = |to: Pose| {
                let camera = PoseTrack::new(vec![0, 1], vec![Pose::IDENTITY, to]).unwrap();
                SceneMotion::new(pinhole(), camera).path(pixel_px, depth_m, STATIC_WORLD, 0, 1).unwrap()
            };
            assert_eq!(path(shift).pixel_px, pixel_px);
            // Turning left moves the picture right.
            assert!((path(turn).pixel_px.x - (119.5 + 200.0 * 0.1_f64.tan())).abs() < 1e-9);
            assert_eq!(path(turn).depth_m, f64::INFINITY);
        }
    }

    #[test]
    fn each_reason_for_no_path_has_its_name() {
        let mut scene = scene(pinhole());
        let pixel_px = DVec2::new(100.0, 80.0);
        let path = |scene: &SceneMotion, depth_m, id, to_ns| scene.path(pixel_px, depth_m, id, 0, to_ns);
        for depth_m in [f64::NAN, -1.0, f64::NEG_INFINITY] {
            assert_eq!(path(&scene, depth_m, 0, FRAME_NS), Err(NoPath::Depth));
        }
        assert_eq!(path(&scene, 1.0, 4, FRAME_NS), Err(NoPath::NoPoses { id: 4 }));
        assert_eq!(path(&scene, 1.0, 3, FRAME_NS + 1), Err(NoPath::Time { t_ns: FRAME_NS + 1 }));
        let past = Pose::new(DQuat::IDENTITY, DVec3::new(0.0, 0.0, 9.0)).unwrap();
        scene.insert(5, PoseTrack::new(vec![0, FRAME_NS], vec![Pose::IDENTITY, past]).unwrap()).unwrap();
        assert_eq!(path(&scene, 1.0, 5, FRAME_NS), Err(NoPath::BehindCamera));
        let fisheye = Intrinsics::fisheye(20.0, 20.0, 119.5, 89.5).unwrap();
        assert_eq!(fisheye.path(DVec2::ZERO, 1.0, &Pose::IDENTITY), Err(NoPath::OutsideLens));
    }

    #[test]
    fn poses_that_do_not_span_an_interval_are_named() {
        let mut scene = scene(pinhole());
        scene.check_span(0, FRAME_NS).unwrap();
        assert_eq!(scene.moving_tracks(), 2);
        let short = PoseTrack::new(vec![0, 1000], vec![Pose::IDENTITY; 2]).unwrap();
        scene.insert(7, short).unwrap();
        assert_eq!(scene.moving_tracks(), 2, "one that stands for a while");
        let error = scene.check_span(0, FRAME_NS).unwrap_err().to_string();
        assert_eq!(error, "instance 7: poses from 0 to 1000 ns, expected them to span 0 to 33333333 ns");
        assert!(scene.check_span(-1, 0).unwrap_err().to_string().starts_with("camera: poses from 0 to"));
        assert_eq!(scene.insert(0, PoseTrack::still(Pose::IDENTITY)), Err(MotionError::StaticWorld));
        assert_eq!(scene.insert(7, PoseTrack::still(Pose::IDENTITY)), Err(MotionError::Twice { id: 7 }));
        assert_eq!(scene.ids().collect::<Vec<_>>(), [3, 7]);
        scene.remove(3);
        assert_eq!(scene.ids().collect::<Vec<_>>(), [7]);
    }
}
