//! Poses that a caller gives for a step, and the engine's scenes made of them. `esaac/poses.py` has brought them to the
//! engine's axes and order; what is no pose is refused here.

use crate::error::Fault;
use esaac_model::paths::{
    Intrinsics, Pose, PoseError, PoseTimes, PoseTrack, Projection, SceneMotion, TrackError,
};
use numpy::{PyReadonlyArray1, PyReadonlyArray3, PyReadonlyArray4, PyUntypedArrayMethods as _};
use pyo3::prelude::*;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::num::NonZero;

/// Cameras for which a thread is worth starting: starting one takes as long as some twenty of them.
const CAMERAS_A_THREAD: usize = 128;

/// Position, metres, and a unit quaternion with its scalar last.
type Numbers = [f64; 7];

/// Ids, and the body that each is; a negative number is the static world.
type Table<'py> = (PyReadonlyArray1<'py, u32>, PyReadonlyArray1<'py, i64>);

/// Projection, `fx`, `fy`, `cx`, `cy`.
pub type GivenLens = (String, f64, f64, f64, f64);

/// The arrays of an `esaac.Poses`: camera `[steps, cameras, 7]`, bodies `[steps, environments, bodies, 7]`.
#[derive(FromPyObject)]
pub struct GivenPoses<'py> {
    times_ns: PyReadonlyArray1<'py, i64>,
    camera: PyReadonlyArray3<'py, f64>,
    bodies: PyReadonlyArray4<'py, f64>,
    tables: Vec<Table<'py>>,
}

/// The same, usable without the interpreter's lock.
pub struct Poses {
    times_ns: Vec<i64>,
    camera: Vec<f64>,
    cameras: usize,
    bodies: Vec<f64>,
    environments: usize,
    bodies_each: usize,
    tables: Vec<Vec<(u32, i64)>>,
}

/// A camera for which a scene is wanted.
#[derive(Clone, Copy)]
pub struct Wanted {
    /// Its number among the cameras of the poses.
    pub index: usize,
    /// Its lens.
    pub lens: Intrinsics,
    /// Time of its first frame since its reset, which may have moved what was before it.
    pub first_ns: i64,
}

/// The poses of a step: one for all cameras, else one for each.
pub struct Moving {
    /// The poses.
    pub poses: Vec<Option<Poses>>,
    /// Whether the one entry is for all cameras.
    pub together: bool,
}

impl Moving {
    /// Where a camera's poses are: the number of the entry, the poses, and the camera's index in them.
    pub fn of(&self, camera: usize) -> Option<(usize, &Poses, usize)> {
        let (at, index) = if self.together { (0, camera) } else { (camera, 0) };
        self.poses[at].as_ref().map(|poses| (at, poses, index))
    }
}

/// What several scenes of a step have in common.
#[derive(Default)]
struct Known {
    /// Times from a step on.
    times: HashMap<usize, PoseTimes>,
    /// Tracks of bodies from a step on.
    tracks: HashMap<(usize, usize), PoseTrack>,
}

impl GivenPoses<'_> {
    /// Copies the numbers.
    pub fn read(&self, cameras: usize) -> Result<Poses, Fault> {
        let flat = |slice: Result<&[f64], numpy::AsSliceError>| {
            slice.map(<[f64]>::to_vec).map_err(|_| Fault::Frame("poses have gaps".to_owned()))
        };
        let table = |(ids, bodies): &Table<'_>| -> Vec<(u32, i64)> {
            ids.as_array().iter().copied().zip(bodies.as_array().iter().copied()).collect()
        };
        let poses = Poses {
            times_ns: self.times_ns.as_array().to_vec(),
            camera: flat(self.camera.as_slice())?,
            cameras: self.camera.shape()[1],
            bodies: flat(self.bodies.as_slice())?,
            environments: self.bodies.shape()[1],
            bodies_each: self.bodies.shape()[2],
            tables: self.tables.iter().map(table).collect(),
        };
        for (what, actual, may_be_one) in [
            ("cameras", poses.cameras, false),
            ("environments", poses.environments, true),
            ("tables of ids", poses.tables.len(), true),
        ] {
            if actual != cameras && !(may_be_one && actual == 1) {
                let one = if may_be_one && cameras != 1 { "1 or " } else { "" };
                return Err(Fault::Frame(format!("poses have {actual} {what}, expected {one}{cameras}")));
            }
        }
        Ok(poses)
    }
}

impl Poses {
    /// Fails if times do not ascend or do not span an interval. One pose alone stands still at all times.
    pub fn check_span(&self, from_ns: i64, to_ns: i64) -> Result<(), Fault> {
        let (Some(&first_ns), Some(&last_ns)) = (self.times_ns.first(), self.times_ns.last()) else {
            return Err(wrong(&TrackError::Empty));
        };
        if let Some(i) = self.times_ns.windows(2).position(|pair| pair[1] <= pair[0]) {
            let (previous_ns, actual_ns) = (self.times_ns[i], self.times_ns[i + 1]);
            return Err(wrong(&TrackError::Order { index: i + 1, previous_ns, actual_ns }));
        }
        if self.times_ns.len() == 1 || (first_ns <= from_ns && to_ns <= last_ns) {
            return Ok(());
        }
        Err(wrong(&TrackError::Span { first_ns, last_ns, from_ns, to_ns }))
    }

    /// The scenes of cameras, made by several threads if there are many.
    pub fn scenes(&self, wanted: &[Wanted]) -> Result<Vec<SceneMotion>, Fault> {
        let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
        let threads = (wanted.len() / CAMERAS_A_THREAD).clamp(1, cores);
        let some = |wanted: &[Wanted]| {
            let mut known = Known::default();
            wanted.iter().map(|wanted| self.scene(wanted, &mut known)).collect::<Result<Vec<_>, _>>()
        };
        if threads == 1 {
            return some(wanted);
        }
        std::thread::scope(|scope| {
            let shares = wanted.chunks(wanted.len().div_ceil(threads));
            let threads: Vec<_> = shares.map(|share| scope.spawn(|| some(share))).collect();
            let mut scenes = Vec::with_capacity(wanted.len());
            for thread in threads {
                scenes.append(&mut thread.join().expect("a thread of poses does not panic")?);
            }
            Ok(scenes)
        })
    }

    fn scene(&self, wanted: &Wanted, known: &mut Known) -> Result<SceneMotion, Fault> {
        let index = wanted.index;
        let after = self.times_ns.partition_point(|&t_ns| t_ns <= wanted.first_ns);
        let first = after.saturating_sub(1);
        let times = match known.times.entry(first) {
            Entry::Occupied(times) => times.get().clone(),
            Entry::Vacant(missing) => {
                let times = PoseTimes::new(self.times_ns[first..].to_vec()).map_err(|error| wrong(&error))?;
                missing.insert(times).clone()
            }
        };
        let camera = self.track(&times, &self.camera, self.cameras, index, || match self.cameras {
            1 => "camera".to_owned(),
            _ => format!("camera {index}"),
        })?;
        let mut scene = SceneMotion::new(wanted.lens, camera);
        let environment = if self.environments == 1 { 0 } else { index };
        for &(id, body) in &self.tables[if self.tables.len() == 1 { 0 } else { index }] {
            let Ok(body) = usize::try_from(body) else {
                // The static world needs no track under its own id, and one that stands still under others.
                if id != esaac_model::paths::STATIC_WORLD {
                    scene.insert(id, PoseTrack::still(Pose::IDENTITY)).map_err(|error| wrong(&error))?;
                }
                continue;
            };
            if body >= self.bodies_each {
                let message = format!(
                    "id {id} is body {body}, expected less than {}, or -1 for the static world",
                    self.bodies_each
                );
                return Err(Fault::Frame(message));
            }
            // Environments may share their bodies.
            let shared = self.environments == 1 && self.cameras > 1;
            let track = match known.tracks.get(&(body, first)).filter(|_| shared) {
                Some(track) => PoseTrack::clone(track),
                None => {
                    let (width, at) =
                        (self.environments * self.bodies_each, environment * self.bodies_each + body);
                    let track = self.track(&times, &self.bodies, width, at, || match self.environments {
                        1 => format!("body {body}"),
                        _ => format!("body {body} of environment {environment}"),
                    })?;
                    if shared {
                        known.tracks.insert((body, first), track.clone());
                    }
                    track
                }
            };
            scene.insert(id, track).map_err(|error| wrong(&error))?;
        }
        Ok(scene)
    }

    /// The track of entry `at` of `width` a step, over the last steps, at `times`. Those before must be poses too.
    fn track(
        &self,
        times: &PoseTimes,
        numbers: &[f64],
        width: usize,
        at: usize,
        whose: impl Fn() -> String,
    ) -> Result<PoseTrack, Fault> {
        let first = self.times_ns.len() - times.times_ns().len();
        let mut poses = Vec::with_capacity(times.times_ns().len());
        for step in 0..self.times_ns.len() {
            let start = (step * width + at) * size_of::<Numbers>() / size_of::<f64>();
            let numbers = numbers[start..].first_chunk().expect("a pose of each step");
            let pose = Pose::from_xyz_qxyzw(numbers).map_err(|error: PoseError| {
                Fault::Frame(format!("poses: {}, step {step}: {error}", whose()))
            })?;
            if step >= first {
                poses.push(pose);
            }
        }
        PoseTrack::at_times(times, poses).map_err(|error| wrong(&error))
    }
}

fn wrong(error: &impl std::fmt::Display) -> Fault {
    Fault::Frame(format!("poses: {error}"))
}

/// A lens, as `esaac.Intrinsics` tells it.
pub fn lens((projection, fx, fy, cx, cy): &GivenLens) -> Result<Intrinsics, Fault> {
    let projection = match projection.as_str() {
        "pinhole" => Projection::Pinhole,
        "fisheye" => Projection::Fisheye,
        other => {
            let message = format!("projection is `{other}`, expected `pinhole` or `fisheye`");
            return Err(Fault::Argument(message));
        }
    };
    Intrinsics::new(projection, *fx, *fy, *cx, *cy)
        .map_err(|error| Fault::Argument(format!("intrinsics: {error}")))
}
