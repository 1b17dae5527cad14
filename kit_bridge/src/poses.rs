//! Poses that a caller gives for a step, and the engine's scenes made of them. `esaac/poses.py` has brought them to the
//! engine's axes and order; what is no pose is refused here.

use crate::error::Fault;
use crate::threads::Threads;
use esaac_model::paths::{
    Intrinsics, MotionError, Pose, PoseTimes, PoseTrack, Projection, STATIC_WORLD, SceneMotion, TrackError,
    TrackMemory,
};
use numpy::{PyReadonlyArray1, PyReadonlyArray3, PyReadonlyArray4, PyUntypedArrayMethods as _};
use pyo3::prelude::*;
use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};

/// Position, metres, and a unit quaternion with its scalar last.
type Numbers = [f64; NUMBERS];

/// Numbers of a pose.
const NUMBERS: usize = 7;

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

/// The same, usable without the interpreter's lock. The numbers are where Python has them. If somebody writes to them
/// during a step, some poses are torn, as images are.
pub struct Poses<'a> {
    times_ns: Vec<i64>,
    camera: &'a [f64],
    cameras: usize,
    bodies: &'a [f64],
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
    /// Whether its poses are followed. If not, they are only checked.
    pub follows: bool,
}

/// The poses of a step: one for all cameras, else one for each.
pub struct Moving<'a> {
    /// The poses.
    pub poses: Vec<Option<Poses<'a>>>,
    /// Whether the one entry is for all cameras.
    pub together: bool,
}

impl<'a> Moving<'a> {
    /// Where a camera's poses are: the number of the entry, the poses, and the camera's index in them.
    pub fn of(&self, camera: usize) -> Option<(usize, &Poses<'a>, usize)> {
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
    /// Bodies whose poses are right from a step on.
    checked: HashSet<(usize, usize)>,
    spare: Vec<TrackMemory>,
}

/// Whose poses are meant.
#[derive(Clone, Copy)]
enum Whose {
    Camera(usize),
    Body { environment: usize, body: usize },
}

impl GivenPoses<'_> {
    /// Checks their shapes, which may have changed since they were made, and their numbers of cameras and environments.
    pub fn read(&self, cameras: usize) -> Result<Poses<'_>, Fault> {
        let steps = self.times_ns.len();
        for (what, shape) in [("camera", self.camera.shape()), ("bodies", self.bodies.shape())] {
            if shape.first() != Some(&steps) || shape.last() != Some(&NUMBERS) {
                let expected = format!("{steps} steps as times_ns and {NUMBERS} numbers a pose");
                return Err(Fault::Frame(format!("poses: {what} has shape {shape:?}, expected {expected}")));
            }
        }
        for (ids, bodies) in &self.tables {
            if ids.len() != bodies.len() {
                let (actual, expected) = (bodies.len(), ids.len());
                let message = format!("poses: a table has bodies for {actual} ids, expected {expected}");
                return Err(Fault::Frame(message));
            }
        }
        let gaps = |_| Fault::Frame("poses have gaps".to_owned());
        let table = |(ids, bodies): &Table<'_>| -> Vec<(u32, i64)> {
            let mut table: Vec<_> =
                ids.as_array().iter().copied().zip(bodies.as_array().iter().copied()).collect();
            // Scenes are made fastest in this order.
            table.sort_by_key(|(id, _)| *id);
            table
        };
        let poses = Poses {
            times_ns: self.times_ns.as_array().to_vec(),
            camera: self.camera.as_slice().map_err(gaps)?,
            cameras: self.camera.shape()[1],
            bodies: self.bodies.as_slice().map_err(gaps)?,
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

impl Poses<'_> {
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

    /// The scenes of cameras, made by several `threads` if there are many; `None` where poses are not followed. Tracks are
    /// made in the memory of `spare` ones.
    pub fn scenes(
        &self,
        wanted: &[Wanted],
        spare: &mut Vec<TrackMemory>,
        threads: &Threads,
    ) -> Result<Vec<Option<SceneMotion>>, Fault> {
        let shares = threads.shares(wanted.len());
        let (each, spare_each) = (wanted.len().div_ceil(shares).max(1), spare.len().div_ceil(shares));
        let shares = wanted.chunks(each).map(|share| {
            let own = spare.len().saturating_sub(spare_each);
            (share, spare.split_off(own))
        });
        let made = threads.each(shares.collect(), |_, (share, spare): (&[Wanted], Vec<TrackMemory>)| {
            let mut known = Known { spare, ..Known::default() };
            share.iter().map(|wanted| self.scene(wanted, &mut known)).collect::<Result<Vec<_>, _>>()
        })?;
        Ok(made.into_iter().flatten().collect())
    }

    /// A camera's scene; `None` if its poses are not followed.
    fn scene(&self, wanted: &Wanted, known: &mut Known) -> Result<Option<SceneMotion>, Fault> {
        let Wanted { index, lens, first_ns, follows } = *wanted;
        // What was before a reset counts for nothing, so it may be anything.
        let first = self.times_ns.partition_point(|&t_ns| t_ns <= first_ns).saturating_sub(1);
        if !follows {
            return self.check(index, first, known).map(|()| None);
        }
        let times = match known.times.entry(first) {
            Entry::Occupied(times) => times.get().clone(),
            Entry::Vacant(missing) => {
                let times = PoseTimes::new(self.times_ns[first..].to_vec()).map_err(|error| wrong(&error))?;
                missing.insert(times).clone()
            }
        };
        let mut scene = SceneMotion::new(lens, self.track(Whose::Camera(index), &times, &mut known.spare)?);
        for instance in self.instances(index) {
            let (id, body) = instance?;
            let track = match body.map(|body| (body, known.tracks.get(&(body, first)))) {
                None => PoseTrack::still(Pose::IDENTITY),
                Some((_, Some(track))) if self.shares_bodies() => track.clone(),
                Some((body, _)) => {
                    let track = self.track(self.body(index, body), &times, &mut known.spare)?;
                    if self.shares_bodies() {
                        known.tracks.insert((body, first), track.clone());
                    }
                    track
                }
            };
            scene.insert(id, track).map_err(|error| wrong(&error))?;
        }
        Ok(Some(scene))
    }

    /// Fails where [`Poses::scene`] would, from a step on.
    fn check(&self, index: usize, first: usize, known: &mut Known) -> Result<(), Fault> {
        let check =
            |whose| (first..self.times_ns.len()).try_for_each(|step| self.pose(whose, step).map(drop));
        check(Whose::Camera(index))?;
        for instance in self.instances(index) {
            let Some(body) = instance?.1 else { continue };
            if !self.shares_bodies() || known.checked.insert((body, first)) {
                check(self.body(index, body))?;
            }
        }
        Ok(())
    }

    /// Bodies of each environment.
    pub fn bodies_each(&self) -> usize {
        self.bodies_each
    }

    /// Whether environments share their bodies.
    fn shares_bodies(&self) -> bool {
        self.environments == 1 && self.cameras > 1
    }

    fn body(&self, index: usize, body: usize) -> Whose {
        Whose::Body { environment: if self.environments == 1 { 0 } else { index }, body }
    }

    /// The instances that a camera sees: ids, and the body that each is, `None` for the static world under another id.
    fn instances(&self, index: usize) -> impl Iterator<Item = Result<(u32, Option<usize>), Fault>> + '_ {
        let table = &self.tables[if self.tables.len() == 1 { 0 } else { index }];
        table.iter().filter_map(|&(id, body)| match usize::try_from(body) {
            // The static world needs no track under its own id.
            Err(_) => (id != STATIC_WORLD).then_some(Ok((id, None))),
            Ok(body) if self.bodies_each == 0 => Some(Err(Fault::Frame(format!(
                "id {id} is body {body}, but the poses have no bodies: expected some, or -1 for the static world"
            )))),
            Ok(body) if body >= self.bodies_each => {
                let message = format!(
                    "id {id} is body {body}, expected less than {}, or -1 for the static world",
                    self.bodies_each
                );
                Some(Err(Fault::Frame(message)))
            }
            Ok(_) if id == STATIC_WORLD => Some(Err(wrong(&MotionError::StaticWorld))),
            Ok(body) => Some(Ok((id, Some(body)))),
        })
    }

    /// The track at `times`, which are the last steps.
    fn track(
        &self,
        whose: Whose,
        times: &PoseTimes,
        spare: &mut Vec<TrackMemory>,
    ) -> Result<PoseTrack, Fault> {
        let first = self.times_ns.len() - times.times_ns().len();
        let mut memory = spare.pop().unwrap_or_default();
        memory.fill((first..self.times_ns.len()).map(|step| self.pose(whose, step)))?;
        PoseTrack::in_memory(times, memory).map_err(|error| wrong(&error))
    }

    fn pose(&self, whose: Whose, step: usize) -> Result<Pose, Fault> {
        let (numbers, place) = match whose {
            Whose::Camera(index) => (self.camera, step * self.cameras + index),
            Whose::Body { environment, body } => {
                (self.bodies, (step * self.environments + environment) * self.bodies_each + body)
            }
        };
        let numbers: &Numbers = numbers[place * NUMBERS..].first_chunk().expect("a pose of each step");
        Pose::from_xyz_qxyzw(numbers).map_err(|error| {
            let name = match whose {
                Whose::Camera(_) if self.cameras == 1 => "camera".to_owned(),
                Whose::Camera(index) => format!("camera {index}"),
                Whose::Body { body, .. } if self.environments == 1 => format!("body {body}"),
                Whose::Body { environment, body } => format!("body {body} of environment {environment}"),
            };
            Fault::Frame(format!("poses: {name}, step {step}: {error}"))
        })
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
