//! Checks what a step is given: formats, devices, poses.

use super::State;
use super::warnings::Kind;
use crate::bank::{Bank, Format, Frames, Images};
use crate::cuda::CudaSide;
use crate::error::Fault;
use crate::image::{Place, elsewhere};
use crate::poses::{Moving, Wanted};
use esaac_model::Synthesis;
use esaac_model::input::{auto_reason, missing_paths};
use esaac_model::paths::SceneMotion;
use std::sync::Arc;

impl State {
    /// Leaves depth, ids and poses out where synthesis is `auto` and something is missing for exact paths. The first frames
    /// tell; the cameras are told of.
    pub(super) fn leave_out(&mut self, frames: &mut Frames, moving: &Moving<'_>) {
        if self.banks.is_empty() {
            self.warnings.forget();
            let why: Vec<_> = (0..self.sensors.len()).map(|c| self.why_left_out(c, frames, moving)).collect();
            self.left_out = match why.iter().any(Option::is_some) {
                // Cameras of a tiled renderer share their arrays.
                any if frames.tiled => vec![any; why.len()],
                _ => why.iter().map(Option::is_some).collect(),
            };
            for (camera, why) in why.into_iter().enumerate() {
                let why = why.or_else(|| lack_of_ids(camera, frames, moving));
                why.into_iter().for_each(|why| self.warnings.add(Kind::Synthesis, camera, why));
            }
        }
        for (images, left_out) in frames.images.iter_mut().zip(&self.left_out) {
            images.iter_mut().for_each(|images| images.left_out = *left_out);
        }
    }

    /// What to tell, if a camera's synthesis is `auto` and cannot be `rigid` though some is given for it.
    fn why_left_out(&self, camera: usize, frames: &Frames, moving: &Moving<'_>) -> Option<String> {
        let (images, _) = frames.of(camera)?;
        let has_poses = moving.of(camera).is_some();
        let given = [("depth", images.depth.is_some()), ("ids", images.ids.is_some()), ("poses", has_poses)];
        let given: Vec<&str> = given.into_iter().filter_map(|(name, given)| given.then_some(name)).collect();
        let what = match given[..] {
            [] => return None,
            ["depth"] => "depth is".to_owned(),
            [one] => format!("{one} are"),
            [one, other] => format!("{one} and {other} are"),
            _ => "depth, ids and poses are".to_owned(),
        };
        let asked = self.sensors[camera].synthesis;
        let missing = missing_paths(images.depth.is_some(), self.lenses[camera].is_some(), has_poses)?;
        let reason = auto_reason(Some(missing), images.motion.is_none().then_some("no motion vectors"));
        let used = asked.resolve(false, images.motion.is_some()).name();
        (asked == Synthesis::Auto).then(|| format!("synthesis `{used}` (auto: {reason}); {what} left out"))
    }

    /// The scene of each camera that follows its poses. Synthesis `rigid` needs them at every step; with others they are
    /// only checked.
    pub(super) fn scenes(
        &mut self,
        frames: &Frames,
        t_ns: &[Option<i64>],
        moving: &Moving<'_>,
    ) -> Result<Vec<(usize, SceneMotion)>, Fault> {
        let mut wanted: Vec<Vec<(usize, Wanted)>> = moving.poses.iter().map(|_| Vec::new()).collect();
        for (camera, t_ns) in t_ns.iter().enumerate() {
            let (Some((images, _)), Some(t_ns)) = (frames.of(camera), *t_ns) else { continue };
            let Format { depth, ids, .. } = images.format();
            if images.left_out && self.sensors[camera].synthesis != Synthesis::Rigid {
                continue;
            }
            let lens = self.lenses[camera];
            let without = match moving.of(camera) {
                _ if ids.is_some() && depth.is_none() => Some("ids without depth, expected both"),
                _ if depth.is_some() && lens.is_none() => {
                    Some("depth without a lens, expected a camera made with intrinsics=")
                }
                Some(_) if depth.is_none() => Some("poses without depth, expected both"),
                None if depth.is_some() && self.synthesis(camera, images) == Synthesis::Rigid => {
                    Some("no poses, expected poses= at every step with synthesis `rigid`")
                }
                _ => None,
            };
            if let Some(message) = without {
                return Err(Fault::Frame(format!("camera {camera}: {message}")));
            }
            if let (Some((entry, poses, index)), Some(lens)) = (moving.of(camera), lens) {
                poses.check_span(self.last_ns[camera].unwrap_or(t_ns), t_ns)?;
                let first_ns = self.first_ns[camera].unwrap_or(t_ns);
                let follows = self.synthesis(camera, images) == Synthesis::Rigid;
                wanted[entry].push((camera, Wanted { index, lens, first_ns, follows }));
            }
        }
        let mut scenes = Vec::new();
        for (poses, wanted) in moving.poses.iter().zip(wanted) {
            let Some(poses) = poses else { continue };
            let (cameras, wanted): (Vec<_>, Vec<_>) = wanted.into_iter().unzip();
            let made = cameras.into_iter().zip(poses.scenes(&wanted, &mut self.spare, &self.threads)?);
            scenes.extend(made.filter_map(|(camera, scene)| Some((camera, scene?))));
        }
        Ok(scenes)
    }

    fn synthesis(&self, camera: usize, images: &Images) -> Synthesis {
        self.sensors[camera].synthesis.resolve(images.depth.is_some(), images.motion.is_some())
    }

    /// Banks of new cameras. Of those of a tiled renderer, which are alike, the first has its input looked at.
    pub(super) fn new_banks(&self, formats: &[Format]) -> Result<Vec<Bank>, Fault> {
        let checked = if self.together { 1 } else { self.sensors.len() };
        Bank::all(&self.device, &self.sensors, formats, &self.lenses, self.rig_options(), checked)
    }

    /// The first frames set each camera's formats; later ones must have the same.
    pub(super) fn check_formats(&mut self, frames: &Frames) -> Result<(), Fault> {
        let given = |camera: usize| frames.of(camera).map(|(images, _)| images.format());
        if self.banks.is_empty() {
            let formats: Option<Vec<Format>> = (0..self.sensors.len()).map(given).collect();
            let formats = formats.ok_or_else(|| {
                Fault::Frame("the first step needs a frame of every camera: they tell the formats".to_owned())
            })?;
            let read = read_formats(&formats, &self.left_out);
            self.banks = self.new_banks(&read)?;
            (self.formats, self.first_step) = (formats, true);
            return Ok(());
        }
        for (camera, expected) in self.formats.iter().enumerate() {
            let Some(actual) = given(camera) else { continue };
            if actual != *expected {
                return Err(Fault::Frame(format!(
                    "camera {camera}: {}, expected {} as in its first frame",
                    describe(actual),
                    describe(*expected)
                )));
            }
        }
        Ok(())
    }

    /// Frames on a CUDA device must be on the engine's.
    pub(super) fn check_devices(&self, frames: &Frames, side: Option<&Arc<CudaSide>>) -> Result<(), Fault> {
        for images in frames.images.iter().flatten() {
            for tiles in images.planes().into_iter().flatten() {
                // A texture has no address. Its context is checked when it is copied.
                let addressed = tiles.texture().is_none();
                if let (Place::Cuda { .. }, Some(side), true) = (tiles.place(), side, addressed) {
                    let actual = side.link().device_of(tiles.pointer())?;
                    if actual != side.ordinal {
                        let device = &self.device.info().name;
                        return Err(elsewhere(tiles.plane(), actual, side.ordinal, device));
                    }
                }
                let places = [images.hdr.place(), tiles.place()].map(|place| match place {
                    Place::Host => "the host",
                    Place::Cuda { .. } => "a CUDA device",
                });
                if places[0] != places[1] {
                    return Err(Fault::Frame(format!(
                        "hdr lies on {} and {} on {}, expected both on one",
                        places[0],
                        tiles.plane().name(),
                        places[1]
                    )));
                }
            }
        }
        Ok(())
    }
}

/// What to tell, if a camera has poses of bodies, and no ids that tell which pixels show them.
fn lack_of_ids(camera: usize, frames: &Frames, moving: &Moving<'_>) -> Option<String> {
    let (images, _) = frames.of(camera)?;
    let (_, poses, _) = moving.of(camera)?;
    let bodies = poses.bodies_each();
    (bodies > 0 && images.depth.is_some() && images.ids.is_none()).then(|| {
        let noun = if bodies == 1 { "body" } else { "bodies" };
        format!(
            "the poses have {bodies} {noun}, but the frames no ids: all pixels are taken for the static world"
        )
    })
}

/// The formats that rigs are told of: without what is left out.
pub(super) fn read_formats(formats: &[Format], left_out: &[bool]) -> Vec<Format> {
    let read = |(format, left_out): (&Format, &bool)| {
        if *left_out { format.without_geometry() } else { *format }
    };
    formats.iter().zip(left_out).map(read).collect()
}

fn describe(format: Format) -> String {
    let hdr = format!("{:?} colour", format.hdr.element).to_lowercase();
    let motion = match format.motion {
        Some(motion) => format!(" with {} channels of {:?} motion", motion.channels, motion.element),
        None => " without motion".to_owned(),
    };
    let geometry = match (format.depth, format.ids) {
        (Some(_), Some(ids)) => format!(", with depth and {:?} ids", ids.element),
        (Some(_), None) => ", with depth".to_owned(),
        (None, Some(ids)) => format!(", with {:?} ids and without depth", ids.element),
        (None, None) => String::new(),
    };
    hdr + &motion + &geometry
}
