//! Fills the tables that a tick's kernels read.

use super::parameters::{camera_row, optics_row, outlet_row, physical_row, readout_row};
use super::record::order;
use super::rest::rest_row;
use super::sensor::{has_bus, has_optics, is_physical, is_rigid};
use super::{CameraState, Rig};
use crate::error::EngineError;
use esaac_layout::{self as layout, Counters, ReadoutProgress};

impl Rig {
    /// Fills the table for a tick, and records the commands unless those of an earlier tick will do. The cameras' state
    /// on the device does not change.
    pub(super) fn prepare(&mut self, t_ns: &[Option<i64>]) -> Result<(), EngineError> {
        let _zone = zone!("record");
        let room = self.arena.has_room_for_tracks();
        self.poses_by.choose(&self.cameras, t_ns, self.pipelines.policy, room);
        let needed = self.needed_recording(true);
        self.timing.with_bus = self.outlets() > 0;
        self.timing.passes = needed.passes;
        self.bind_current();
        self.record(needed, true)?;
        self.prepare_rows(t_ns);
        self.prepare_reports(t_ns);
        self.prepare_poses(t_ns);
        Ok(())
    }

    /// As `prepare`, for the part of a tick that runs again when events did not fit.
    pub(super) fn prepare_retry(&mut self, t_ns: &[Option<i64>]) -> Result<(), EngineError> {
        let needed = self.needed_recording(false);
        self.bind_current();
        self.record(needed, false)?;
        self.prepare_rows(t_ns);
        self.prepare_reports(t_ns);
        Ok(())
    }

    /// Fills the tables of instances and of poses, or of tracks, for a tick.
    fn prepare_poses(&mut self, t_ns: &[Option<i64>]) {
        for (camera, t_ns) in self.cameras.iter().zip(t_ns) {
            if t_ns.is_some() && is_rigid(&camera.config.sensor) {
                let known = camera.instances.known();
                self.arena.table(layout::INSTANCES).write(camera.place.instance_base as usize, known);
            }
        }
        let by = self.poses_by;
        if by.device {
            by.write_tracks(&self.cameras, t_ns, self.arena.track_tables());
        } else {
            by.write_poses(&self.cameras, t_ns, self.arena.table(layout::POSES).all_mut());
        }
    }

    /// Fills the table of cameras for the next submission.
    pub(super) fn prepare_rows(&mut self, t_ns: &[Option<i64>]) {
        if self.cameras.iter().any(|camera| is_rigid(&camera.config.sensor)) {
            let geometries: Vec<_> = self.cameras.iter().map(CameraState::geometry_row).collect();
            self.arena.table(layout::GEOMETRIES).write(0, &geometries);
        }
        if self.cameras.iter().any(|camera| is_physical(&camera.config.sensor)) {
            let physicals: Vec<_> = self.cameras.iter().map(|c| physical_row(&c.config.sensor)).collect();
            self.arena.table(layout::PHYSICALS).write(0, &physicals);
        }
        if self.cameras.iter().any(|camera| has_optics(&camera.config.sensor)) {
            let rows: Vec<_> = self.cameras.iter().zip(t_ns).map(|(c, t_ns)| optics_row(c, *t_ns)).collect();
            self.arena.table(layout::OPTICS).write(0, &rows);
        }
        let permutations = self.permutations();
        if permutations.iter().any(|permutation| permutation.cross.pixels_rest) {
            let rows: Vec<_> = self.cameras.iter().zip(t_ns).map(|(c, t_ns)| rest_row(c, *t_ns)).collect();
            self.arena.table(layout::RESTS).write(0, &rows);
        }
        let order = order(&permutations);
        self.parameters.clear();
        self.parameters
            .extend(order.iter().map(|&camera| camera_row(&self.cameras[camera], t_ns[camera], &self.arena)));
        if self.cameras.iter().any(|camera| camera.place.has_bus) {
            self.prepare_readouts(&order, t_ns);
        }
        self.arena.table(layout::CAMERAS).write(0, &self.parameters);
    }

    /// Resets the reports of outlets. Where `sort` serves, it says in them what it has served, and where it could not.
    fn prepare_reports(&mut self, t_ns: &[Option<i64>]) {
        let fresh = Counters { progress: ReadoutProgress::Done as u32, ..Counters::default() };
        for (camera, _) in self.cameras.iter().zip(t_ns).filter(|(_, t_ns)| t_ns.is_some()) {
            if has_bus(&camera.config.sensor) {
                self.arena.table(layout::REPORT).write(camera.outlet.slot as usize, &[fresh]);
            }
        }
    }

    /// Adds the rows of outlets to the table of cameras, in the order of their cameras, and fills the table of readouts.
    fn prepare_readouts(&mut self, order: &[usize], t_ns: &[Option<i64>]) {
        let mut readouts = vec![layout::Readout::default(); self.cameras.len()];
        for (position, &camera) in order.iter().enumerate() {
            let state = &self.cameras[camera];
            let outlet = has_bus(&state.config.sensor).then_some(self.parameters.len() as u32);
            readouts[state.place.slot as usize] = readout_row(state, &self.parameters[position], outlet);
            if outlet.is_some() {
                let row = outlet_row(state, t_ns[camera], &self.parameters[position]);
                self.parameters.push(row);
            }
        }
        self.arena.table(layout::READOUTS).write(0, &readouts);
    }
}
