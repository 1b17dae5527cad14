//! From what the device counted and wrote to packets.

use super::{PacketPlace, Rig};
use crate::commands::Around;
use crate::error::EngineError;
use esaac_model::layout::{self, Counters};
use esaac_model::substeps::quantise_ns;

/// What was counted for a camera in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Diagnostics {
    /// Pixels whose colour was NaN, infinite or negative; they kept their last value.
    pub invalid_pixels: u64,
    /// Pixels whose motion was not finite; they were blended instead of warped.
    pub invalid_motion: u64,
    /// Pixels that never had a valid colour and therefore send nothing.
    pub unarmed_pixels: u64,
    /// Blocks of 8x8 pixels in which nothing could happen.
    pub skipped_blocks: u64,
    /// Sub-steps, summed over blocks.
    pub substeps: u64,
    /// Events waiting for a later packet.
    pub late_events: u64,
    /// Events left out because of the sensor's cap.
    pub dropped_events: u64,
    /// How often the event buffers had to grow.
    pub regrown: u64,
}

/// Bins get more room when more of a packet than one in this many events found none, or half of what `sort` searches.
const SPILLED_SHARE: u32 = 8;

/// An APS frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ApsFrame {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Significant bits of a pixel.
    pub bits: u32,
    /// End of the exposure.
    pub t_ns: i64,
    /// Row-major pixels; a mosaic if the sensor's intensity is one.
    pub pixels: Vec<u16>,
}

impl Rig {
    /// Waits are over: makes room and goes on where events did not fit, then takes the packets.
    pub(super) fn collect(&mut self, t_ns: &[Option<i64>]) -> Result<(), EngineError> {
        let _zone = zone!("publish");
        let mut pending: Vec<bool> = t_ns.iter().map(Option::is_some).collect();
        let mut regrown = vec![0_u64; self.cameras.len()];
        let mut largest_bins = vec![0_u32; self.cameras.len()];
        for packet in &mut self.packets {
            packet.clear();
        }
        self.events.fill(0);
        self.aps.fill(None);
        self.diagnostics.fill(Diagnostics::default());
        loop {
            let mut wanted = vec![0_u32; self.cameras.len()];
            let mut done = Vec::new();
            for camera in 0..self.cameras.len() {
                if !pending[camera] {
                    continue;
                }
                let counters = self.counters(camera);
                let fitted = counters.staged_fit == u32::MAX;
                if fitted && counters.crowded_strips == 0 {
                    done.push((camera, counters));
                    pending[camera] = false;
                } else {
                    // What is staged stays; `cross` goes on with the blocks that are not done.
                    let staged = if fitted { counters.staged } else { counters.staged_fit };
                    if !fitted {
                        wanted[camera] = counters.staged;
                        regrown[camera] += 1;
                    }
                    let resumed = Counters { staged, staged_fit: u32::MAX, crowded_strips: 0, ..counters };
                    let set = 2 * self.cameras[camera].place.slot + self.cameras[camera].parity;
                    let offset = u64::from(set) * size_of::<Counters>() as u64;
                    self.arena.upload(
                        &self.device,
                        layout::COUNTERS,
                        offset,
                        bytemuck::bytes_of(&resumed),
                    )?;
                }
            }
            self.merge_heavy(t_ns, &done)?;
            for (camera, counters) in done {
                self.take(camera, t_ns[camera].expect("pending cameras have a time"), &counters);
                self.diagnostics[camera].regrown = regrown[camera];
                let many = (counters.packet / SPILLED_SHARE).min(layout::SEARCHED_EVENTS / 2);
                if counters.spilled - counters.late > many {
                    largest_bins[camera] = counters.largest_bin;
                }
            }
            if !pending.contains(&true) {
                break;
            }
            if wanted.iter().any(|&events| events > 0) {
                self.arena.grow_events(&self.device, &mut self.cameras, &wanted)?;
                self.record_again()?;
            }
            self.prepare_again()?;
            let rest: Vec<Option<i64>> =
                t_ns.iter().zip(&pending).map(|(&t, &waits)| t.filter(|_| waits)).collect();
            self.prepare(&rest)?;
            self.submit(&self.again, &Around::default())?;
            self.count_again()?;
        }
        for (camera, &t) in self.cameras.iter_mut().zip(t_ns) {
            if let Some(t) = t {
                camera.last_interval_ns = camera.last_ns.map_or(0, |last| (t - last) as u32);
                if camera.last_ns.is_none() {
                    camera.epoch_ns = t;
                }
                camera.last_ns = Some(t);
                camera.parity = 1 - camera.parity;
                camera.frames += 1;
                camera.changed = false;
            }
        }
        if largest_bins.iter().any(|&events| events > 0)
            && self.arena.grow_rooms(&self.device, &mut self.cameras, &largest_bins)?
        {
            self.record_again()?;
        }
        Ok(())
    }

    /// Sorts those packets of cameras that are `done` of which `sort` left some bins.
    fn merge_heavy(&mut self, t_ns: &[Option<i64>], done: &[(usize, Counters)]) -> Result<(), EngineError> {
        let mut times_ns = vec![None; t_ns.len()];
        let mut most_events = 0;
        for (camera, counters) in done.iter().filter(|(_, c)| c.heavy != 0) {
            times_ns[*camera] = t_ns[*camera];
            most_events = most_events.max(counters.packet);
        }
        if most_events == 0 { Ok(()) } else { self.merge(&times_ns, most_events) }
    }

    /// Adds the time of a submission that followed the tick's own.
    pub(super) fn count_again(&mut self) -> Result<(), EngineError> {
        let again_ns = self.timer.span_ns(super::record::STAMPS)?;
        if let Some(last) = self.stage_ns.last_mut() {
            last.1 += again_ns;
        }
        Ok(())
    }

    fn counters(&self, camera: usize) -> Counters {
        let c = &self.cameras[camera];
        let slot = c.place.slot as usize;
        self.arena.buffers[layout::REPORT].read::<Counters>(slot, 1)[0]
    }

    /// Takes a camera's packet, and copies it out of the buffers if it is to be owned.
    fn take(&mut self, camera: usize, t_ns: i64, counters: &Counters) {
        let buffers = &self.arena.buffers;
        let c = &mut self.cameras[camera];
        let (sensor, place) = (&c.config.sensor, &c.place);
        let diagnostics = &mut self.diagnostics[camera];
        diagnostics.invalid_pixels = counters.invalid_pixels.into();
        diagnostics.invalid_motion = counters.invalid_motion.into();
        diagnostics.unarmed_pixels = counters.unarmed_pixels.into();
        diagnostics.skipped_blocks = counters.skipped_blocks.into();
        diagnostics.substeps = counters.substeps.into();
        diagnostics.late_events = counters.late.into();
        // Nobody counted those of a block that was skipped.
        if counters.unarmed_pixels == 0 && counters.skipped_blocks == 0 {
            c.may_be_unarmed = false;
        }
        let busy_blocks = place.blocks - counters.skipped_blocks.min(place.blocks);
        c.many_substeps = (counters.substeps + counters.substeps / 4) / busy_blocks.max(1);

        let packet = &mut self.packets[camera];
        let quantum_ns = i64::from(sensor.timestamp_quantum_ns);
        // The next event is stamped after t_ns, and may be floored to the quantum that holds t_ns + 1.
        packet.watermark_ns = quantise_ns(t_ns + 1, quantum_ns) - 1;
        packet.base_ns = quantise_ns(c.last_ns.unwrap_or(t_ns), quantum_ns);
        packet.sequence = c.sequence;
        c.sequence += 1;
        if c.last_ns.is_none() {
            return;
        }
        let found = counters.packet;
        let cap = if sensor.max_events_per_interval == 0 { u32::MAX } else { sensor.max_events_per_interval };
        let events = found.min(cap) as usize;
        packet.dropped = u64::from(found) - events as u64;
        diagnostics.dropped_events = packet.dropped;
        self.events[camera] = events as u32;
        let base = place.event_base as usize;
        if self.options.packets == PacketPlace::Owned {
            packet.t_offset_ns.extend_from_slice(buffers[layout::EVENT_T].read(base, events));
            packet.x.extend_from_slice(buffers[layout::EVENT_X].read(base, events));
            packet.y.extend_from_slice(buffers[layout::EVENT_Y].read(base, events));
            packet.polarity.extend_from_slice(buffers[layout::EVENT_P].read(base, events));
        }
        let interval_ns = t_ns - c.last_ns.unwrap_or(t_ns);
        // The exposure is cut at the interval's end; there may be nothing left of it.
        if sensor.aps_exposure_ns > 0 && i64::from(sensor.aps_start_ns) < interval_ns {
            let pixels = match self.options.packets {
                PacketPlace::InPlace => Vec::new(),
                PacketPlace::Owned | PacketPlace::OnDevice => {
                    buffers[layout::APS].read(place.aps_base as usize, place.pixels as usize).to_vec()
                }
            };
            let start_ns = c.last_ns.unwrap_or(t_ns);
            let end_ns = start_ns + i64::from(sensor.aps_start_ns) + i64::from(sensor.aps_exposure_ns);
            self.aps[camera] = Some(ApsFrame {
                width_px: sensor.width,
                height_px: sensor.height,
                bits: sensor.aps_bits,
                t_ns: end_ns.min(t_ns),
                pixels,
            });
        }
    }
}
