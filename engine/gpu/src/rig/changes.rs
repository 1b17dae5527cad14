//! What changes a rig between two ticks: a sensor, a reset, the places of its cameras. Each change is a transaction; see
//! [`super`].

use super::Rig;
use super::arena::Move;
use super::config::{check_rows, check_sensor};
use super::fresh::{fresh_bus, fresh_counters, pixel_draws};
use super::geometry::{self, Place};
use super::sensor::has_bus;
use super::transfer::{Write, Writes};
use crate::error::EngineError;
use esaac_layout as layout;
use esaac_model::SensorModel;
use esaac_model::physical::Illuminances;
use std::collections::BTreeSet;

impl Rig {
    /// Changes a camera's parameters, all but its size; the change takes effect with the next tick. On an error the
    /// camera keeps its parameters, and nothing has changed.
    pub fn set_sensor(&mut self, camera: usize, sensor: SensorModel) -> Result<(), EngineError> {
        self.check_ready()?;
        let state = self.camera(camera)?;
        let asked = sensor.synthesis;
        let sensor = state.config.resolved(&sensor);
        check_sensor(camera, &sensor, &state.config)?;
        let old = &state.config.sensor;
        let effects = old.change_to(&sensor);
        if effects.resizes {
            return Err(EngineError::SizeChange {
                camera,
                expected_width: old.width,
                expected_height: old.height,
                actual_width: sensor.width,
                actual_height: sensor.height,
            });
        }
        let others = self.cameras.iter().enumerate().filter(|&(number, _)| number != camera);
        check_rows(others.map(|(_, c)| &c.config.sensor).chain([&sensor]))?;
        // Pixels at rest have passed over intervals with the parameters of before.
        self.catch_up()?;
        // First to its new place, alone: a write may name no buffer that moves.
        let mut places = self.places();
        places[camera] = places[camera].with_planes_of(&sensor);
        self.change(places, Vec::new(), &[])?;
        let state = &self.cameras[camera];
        let mut writes = Vec::new();
        let mut zeroed: &[usize] = &[];
        if effects.resets_frames {
            writes.push(fresh_counters(&state.place));
            if has_bus(&sensor) {
                writes.extend(fresh_bus(state));
                zeroed = &[layout::BINS];
            }
        }
        if effects.redraws_pixels {
            writes.push(pixel_draws(&state.place, &sensor, state.config.camera));
        }
        self.change(self.places(), writes, zeroed)?;
        let state = &mut self.cameras[camera];
        let held_ns = state.last_ns.map(|ns| ns + i64::from(state.config.sensor.refractory_ns));
        let other_light = effects.resets_frames || state.config.sensor.lux_per_unit != sensor.lux_per_unit;
        if other_light {
            state.light = Illuminances::default();
            state.lit = None;
        }
        state.config.sensor = sensor;
        state.asked = asked;
        state.changed = true;
        state.has_paths = false;
        state.holds_until_ns = held_ns.max(state.holds_until_ns);
        if effects.resets_frames {
            state.forget();
        }
        state.apply_trust();
        Ok(())
    }

    /// Resets a camera: its next frame counts as its first. Deferred events are discarded, noise begins again, and
    /// packets keep counting.
    pub fn reset(&mut self, camera: usize) -> Result<(), EngineError> {
        self.reset_some(&[camera])
    }

    /// As [`Rig::reset`], for several cameras in one submission. On an error none is reset.
    pub fn reset_some(&mut self, cameras: &[usize]) -> Result<(), EngineError> {
        self.check_ready()?;
        // Two writes to one place would have no order.
        let cameras: BTreeSet<usize> = cameras.iter().copied().collect();
        let mut writes = Vec::new();
        for &camera in &cameras {
            let state = self.camera(camera)?;
            writes.extend(fresh_bus(state));
            writes.push(fresh_counters(&state.place));
        }
        self.change(self.places(), writes, &[])?;
        for camera in cameras {
            self.cameras[camera].forget();
        }
        Ok(())
    }

    /// Initialises the state on the device, as before any frame.
    pub(super) fn clear(&mut self) -> Result<(), EngineError> {
        let mut writes = Vec::new();
        self.arena.table(layout::READOUTS).write(0, &vec![layout::Readout::default(); self.cameras.len()]);
        for c in &self.cameras {
            writes.push(fresh_counters(&c.place));
            writes.extend(fresh_bus(c));
            writes.push(pixel_draws(&c.place, &c.config.sensor, c.config.camera));
        }
        let zeroed = [layout::BINS, layout::STATE, layout::BLOCKS, layout::PASSING, layout::MEETINGS];
        self.device.run_once(|commands| self.arena.record_zero(&self.device, commands, &zeroed))?;
        self.change(self.places(), writes, &[])
    }

    /// The places of all cameras, and after them those of their outlets.
    pub(super) fn places(&self) -> Vec<Place> {
        let outlets = self.cameras.iter().map(|c| c.outlet);
        self.cameras.iter().map(|c| c.place).chain(outlets).collect()
    }

    /// Moves cameras to new places, zeroes buffers and writes into others, in one submission. `writes` and `zeroed` may
    /// name only buffers that do not move. On an error nothing has changed; but if the submission may still run, the
    /// rig is lost.
    pub(super) fn change(
        &mut self,
        mut places: Vec<Place>,
        writes: Vec<Write>,
        zeroed: &[usize],
    ) -> Result<(), EngineError> {
        geometry::follow_cameras(&mut places);
        let before = self.places();
        let planned: Option<Move> =
            if places == before { None } else { Some(self.arena.plan(&self.device, &before, places)?) };
        if planned.is_none() && writes.is_empty() && zeroed.is_empty() {
            return Ok(());
        }
        if planned.is_some() || !zeroed.is_empty() {
            // These are buffers of all cameras. A write is of a camera, which its caller knows.
            self.forget_paths();
        }
        let writes = Writes::new(&self.device, writes)?;
        let device = &self.device;
        let ran = device.run_once(|commands| {
            if let Some(planned) = &planned {
                self.arena.record_move(device, commands, &before, planned);
            }
            self.arena.record_zero(device, commands, zeroed);
            writes.record(device, commands, &self.arena);
        });
        if let Err(error) = ran {
            return Err(if error.leaves_work() { self.lose(error) } else { error });
        }
        if let Some(planned) = planned {
            self.arena.commit(&mut self.cameras, planned);
            self.recordings.unbind();
        }
        Ok(())
    }
}
