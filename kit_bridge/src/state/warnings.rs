//! What users are told of their cameras. `esaac/cameras.py` makes Python's warnings of what is new.

use super::State;
use crate::bank::Bank;
use crate::error::Fault;
use esaac_model::Synthesis;
use esaac_model::physical::LightReport;
use std::collections::HashSet;

/// What a warning is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Depth and poses that do not predict the motion vectors.
    Poses,
    /// What `auto` has left out.
    Synthesis,
    /// Input that must send false events.
    Input,
    /// Light beyond that which a preset was fitted for.
    Light,
    /// A lamp that flickers too fast for the sub-steps.
    Flicker,
}

impl Kind {
    /// Its name in `esaac/cameras.py`.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Poses => "poses",
            Kind::Synthesis => "synthesis",
            Kind::Input => "input",
            Kind::Light => "light",
            Kind::Flicker => "flicker",
        }
    }
}

/// A kind, the number of a camera, and what to tell.
pub type Warning = (Kind, usize, String);

/// What is new, and what was told.
#[derive(Default)]
pub struct Warnings {
    new: Vec<Warning>,
    /// What was last said about each camera's poses.
    of_poses: Vec<Option<String>>,
    /// Whether the last step brought motion vectors with poses.
    pub compares: bool,
    /// Steps after which was looked for something new.
    steps: u64,
    /// Whether light and paths are looked at after the next step, whichever it is.
    look_is_due: bool,
    /// Cameras whose light or paths were told of, and by which kind.
    told: HashSet<(usize, Kind)>,
}

impl Warnings {
    /// Has something told once.
    pub fn add(&mut self, kind: Kind, camera: usize, text: String) {
        self.new.push((kind, camera, text));
    }

    /// Has light and paths looked at after the next step.
    pub fn look_soon(&mut self) {
        self.look_is_due = true;
    }

    /// Counts a step, and says whether light and paths are looked at after it: about as often as rigs look at light.
    fn look_is_due(&mut self) -> bool {
        let step = self.steps;
        self.steps += 1;
        step == 0
            || step.is_power_of_two()
            || step.is_multiple_of(256)
            || std::mem::take(&mut self.look_is_due)
    }

    /// Does not tell what a step was about to tell that was not done.
    pub fn forget(&mut self) {
        self.new.clear();
    }
}

impl State {
    /// What is new since the last call.
    pub fn new_warnings(&mut self) -> Result<Vec<Warning>, Fault> {
        if self.banks.is_empty() || self.first_step {
            return Ok(Vec::new());
        }
        let mut new = std::mem::take(&mut self.warnings.new);
        if self.warnings.compares {
            let found = self.pose_warnings()?;
            let said = std::mem::replace(&mut self.warnings.of_poses, found);
            let all = self.warnings.of_poses.iter().enumerate();
            let other = all.filter(|&(camera, warning)| said.get(camera) != Some(warning));
            new.extend(other.filter_map(|(camera, text)| Some((Kind::Poses, camera, text.clone()?))));
        }
        let of_input = self.banks.iter_mut().flat_map(Bank::input_warnings);
        new.extend(of_input.map(|(camera, text)| (Kind::Input, camera, text)));
        if self.warnings.look_is_due() {
            let found = self.of_each(|rig, own| {
                Ok([
                    (Kind::Light, rig.fit_warning(own)?),
                    (Kind::Flicker, rig.flicker_warning(own)?),
                    (Kind::Input, rig.frame_warning(own)?.or(rig.path_warning(own)?)),
                ])
            })?;
            for (camera, found) in found.into_iter().enumerate() {
                for (kind, text) in found {
                    // Environments are alike: the paths of one are told of.
                    let of = if self.together && kind == Kind::Input { 0 } else { camera };
                    let text = text.filter(|_| self.warnings.told.insert((of, kind)));
                    new.extend(text.map(|text| (kind, camera, text)));
                }
            }
        }
        Ok(new)
    }

    /// What each camera's brightness between two frames is made by; `None` before the first frame, which tells.
    pub fn syntheses(&self) -> Result<Vec<Option<Synthesis>>, Fault> {
        if self.banks.is_empty() {
            return Ok(vec![None; self.sensors.len()]);
        }
        self.of_each(|rig, camera| Ok(Some(rig.synthesis(camera)?)))
    }

    /// For each camera what to tell, if its depth and poses do not predict its motion vectors.
    pub fn pose_warnings(&self) -> Result<Vec<Option<String>>, Fault> {
        self.of_each(|rig, camera| Ok(rig.convention_warning(camera)?))
    }

    /// For each camera the light on its focal plane, if it has physical pixels and had a frame.
    pub fn light(&self) -> Result<Vec<Option<LightReport>>, Fault> {
        self.of_each(|rig, camera| Ok(rig.light(camera)?))
    }

    /// For each camera what to tell about its light.
    pub fn light_warnings(&self) -> Result<Vec<Vec<String>>, Fault> {
        self.of_each(|rig, camera| Ok(rig.light_warnings(camera)?))
    }
}
