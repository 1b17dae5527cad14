//! A rig's state as bytes: a run that is stopped, saved, restored and continued gives the same events
//! as one that went on.

use super::Rig;
use crate::error::EngineError;
use esaac_model::layout::{self, BINDINGS, Counters};
use serde::{Deserialize, Serialize};

/// Buffers that outlive a tick.
const KEPT: [usize; 5] = [layout::PLANES, layout::MOTION, layout::STATE, layout::BLOCKS, layout::COUNTERS];

const MAGIC: &[u8; 8] = b"ESAACRIG";

#[derive(Serialize, Deserialize)]
struct Header {
    version: u32,
    cameras: Vec<CameraHeader>,
    buffer_bytes: Vec<u64>,
}

#[derive(Serialize, Deserialize)]
struct CameraHeader {
    sensor: String,
    camera: u32,
    last_ns: Option<i64>,
    last_interval_ns: u32,
    epoch_ns: i64,
    parity: u32,
    frames: u64,
    sequence: u64,
    holds_until_ns: Option<i64>,
    late_events: u32,
}

const VERSION: u32 = 3;

impl Rig {
    /// Everything that the next tick depends on.
    pub fn save(&self) -> Result<Vec<u8>, EngineError> {
        let mut late = Vec::new();
        let mut cameras = Vec::new();
        let counters = self.arena.download(
            &self.device,
            layout::COUNTERS,
            0,
            (2 * self.cameras.len() * size_of::<Counters>()) as u64,
        )?;
        let counters: Vec<Counters> = bytemuck::pod_collect_to_vec(&counters);
        for c in &self.cameras {
            // The last tick's counters are the other set now.
            let last = &counters[(2 * c.place.slot + 1 - c.parity) as usize];
            let first = u64::from(c.place.event_base + last.packet) * 8;
            late.extend(self.arena.download(
                &self.device,
                layout::GATHERED,
                first,
                u64::from(last.late) * 8,
            )?);
            cameras.push(CameraHeader {
                sensor: c.config.sensor.to_toml(),
                camera: c.config.camera,
                last_ns: c.last_ns,
                last_interval_ns: c.last_interval_ns,
                epoch_ns: c.epoch_ns,
                parity: c.parity,
                frames: c.frames,
                sequence: c.sequence,
                holds_until_ns: c.holds_until_ns,
                late_events: last.late,
            });
        }
        let header = Header {
            version: VERSION,
            cameras,
            buffer_bytes: KEPT.iter().map(|&slot| self.arena.buffers[slot].bytes()).collect(),
        };
        let header = serde_json::to_vec(&header).map_err(|e| EngineError::Snapshot(e.to_string()))?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend((header.len() as u64).to_le_bytes());
        bytes.extend(header);
        for slot in KEPT {
            bytes.extend(self.arena.download(&self.device, slot, 0, self.arena.buffers[slot].bytes())?);
        }
        bytes.extend(late);
        Ok(bytes)
    }

    /// Takes up a saved state; the rig has the same cameras and sensors as the one saved.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), EngineError> {
        let bad = |what: String| EngineError::Snapshot(what);
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| bad("not a saved rig".to_owned()))?;
        let (length, rest) =
            rest.split_at_checked(8).ok_or_else(|| bad("truncated before its header".to_owned()))?;
        let length = u64::from_le_bytes(length.try_into().expect("eight bytes")) as usize;
        let (header, mut rest) =
            rest.split_at_checked(length).ok_or_else(|| bad("truncated in its header".to_owned()))?;
        let header: Header = serde_json::from_slice(header).map_err(|e| bad(e.to_string()))?;
        if header.version != VERSION {
            return Err(bad(format!("version {}, expected {VERSION}", header.version)));
        }
        if header.cameras.len() != self.cameras.len() {
            return Err(bad(format!("{} cameras, expected {}", header.cameras.len(), self.cameras.len())));
        }
        for (number, (saved, c)) in header.cameras.iter().zip(&self.cameras).enumerate() {
            if saved.sensor != c.config.sensor.to_toml() || saved.camera != c.config.camera {
                return Err(bad(format!("camera {number} has another sensor than the one saved")));
            }
        }
        let late: u64 = header.cameras.iter().map(|c| u64::from(c.late_events) * 8).sum();
        let expected: u64 = late + KEPT.iter().map(|&slot| self.arena.buffers[slot].bytes()).sum::<u64>();
        if rest.len() as u64 != expected {
            return Err(bad(format!("{} bytes of buffers, expected {expected}", rest.len())));
        }
        for (slot, &saved) in KEPT.iter().zip(&header.buffer_bytes) {
            let own = self.arena.buffers[*slot].bytes();
            if saved != own {
                return Err(bad(format!("{saved} bytes of {}, expected {own}", BINDINGS[*slot].name)));
            }
        }
        for slot in KEPT {
            let (part, after) = rest.split_at(self.arena.buffers[slot].bytes() as usize);
            self.arena.upload(&self.device, slot, 0, part)?;
            rest = after;
        }
        self.arena.clear_bins(&self.device)?;
        let wanted: Vec<u32> = header.cameras.iter().map(|c| c.late_events).collect();
        if wanted.iter().zip(&self.cameras).any(|(&w, c)| w > c.place.event_capacity) {
            self.arena.grow_events(&self.device, &mut self.cameras, &wanted)?;
            self.record_again()?;
        }
        for (number, saved) in header.cameras.into_iter().enumerate() {
            let (part, after) = rest.split_at(saved.late_events as usize * 8);
            rest = after;
            let c = &mut self.cameras[number];
            c.last_ns = saved.last_ns;
            c.last_interval_ns = saved.last_interval_ns;
            c.epoch_ns = saved.epoch_ns;
            c.parity = saved.parity;
            c.frames = saved.frames;
            c.sequence = saved.sequence;
            c.holds_until_ns = saved.holds_until_ns;
            c.changed = true;
            c.may_be_unarmed = true;
            if saved.late_events > 0 {
                // Late events lie behind the last packet, wherever that ended.
                let counters =
                    Counters { late: saved.late_events, staged_fit: u32::MAX, ..Counters::default() };
                let (place, set) = (c.place, 2 * c.place.slot + 1 - c.parity);
                let offset = u64::from(set) * size_of::<Counters>() as u64;
                self.arena.upload(&self.device, layout::COUNTERS, offset, bytemuck::bytes_of(&counters))?;
                self.arena.upload(&self.device, layout::GATHERED, u64::from(place.event_base) * 8, part)?;
            }
        }
        Ok(())
    }
}
