//! Saving and restoring a rig's state: a run that is saved, restored and continued gives the same events as a run
//! without interruption.

use super::fresh::{counters, only_deferred};
use super::geometry::Place;
use super::rest::PassedIntervals;
use super::scene::Instances;
use super::sensor::has_bus;
use super::transfer::{Part, Write, Writes, read_back};
use super::{CameraState, GeometryConfig, Rig};
use crate::error::EngineError;
use esaac_layout::{self as layout, BINDINGS, Counters, MOST_INSTANCES};
use esaac_model::paths::conventions::{PoseCheck, Trust};
use esaac_model::paths::{Projection, STATIC_WORLD};
use esaac_model::synthesis::layers::MAX_LAYERS;
use serde::{Deserialize, Serialize};
use std::collections::HashSet;

/// Buffers that outlive a tick. A saved state holds the part of each that the sensors need. Of the counters it holds the
/// numbers of events that wait, in its header: kernels index by the others.
const KEPT: [usize; 8] = [
    layout::PLANES,
    layout::MOTION,
    layout::STATE,
    layout::BLOCKS,
    layout::SURFACES,
    layout::SLOPES,
    layout::REPRESENTATIVES,
    layout::BUS,
];

/// Bytes of a deferred event.
const DEFERRED_BYTES: u64 = BINDINGS[layout::GATHERED].stride as u64;

const MAGIC: &[u8; 8] = b"ESAACRIG";

/// Bytes at the end: the CRC-32 of all before them.
const CHECKSUM_BYTES: usize = size_of::<u32>();

#[derive(Serialize, Deserialize)]
struct Header {
    version: u32,
    cameras: Vec<CameraHeader>,
}

#[derive(Serialize, Deserialize)]
struct CameraHeader {
    sensor: String,
    camera: u32,
    last_ns: Option<i64>,
    last_interval_ns: u32,
    complete_ns: Option<i64>,
    epoch_ns: i64,
    frame_slot: u32,
    frames: u64,
    sequence: u64,
    holds_until_ns: Option<i64>,
    rested: Option<PassedIntervals>,
    layers_for_scene: u32,
    deferred_events: u32,
    /// Events that leave the bus after the last packet.
    leaving_events: u32,
    /// Instances that the surfaces of the last frame may name, row by row.
    instances: Vec<u32>,
    /// The poses that are followed.
    trust: Trust,
    /// Whether its poses are compared no more.
    check_is_over: bool,
    /// The lens in which these surfaces were found: whether it is a fisheye, and the bits of its numbers.
    lens: Option<(bool, [u64; 4])>,
}

fn lens_bits(geometry: &GeometryConfig) -> (bool, [u64; 4]) {
    let (focal_px, centre_px) = (geometry.lens.focal_px(), geometry.lens.centre_px());
    let numbers = [focal_px.x, focal_px.y, centre_px.x, centre_px.y];
    (geometry.lens.projection() == Projection::Fisheye, numbers.map(f64::to_bits))
}

const VERSION: u32 = 17;

impl Rig {
    /// Saves everything that the next tick depends on but its input (images and poses), as bytes for `restore`.
    ///
    /// One thing begins anew: a comparison of poses with motion vectors that is under way, in the first intervals of a
    /// camera that has both. Its findings so far are saved; what it finds later may come some intervals later.
    pub fn save(&self) -> Result<Vec<u8>, EngineError> {
        self.check_ready()?;
        let all = self.arena.buffer(layout::COUNTERS);
        let counters = read_back(&self.device, &[Part { buffer: all, offset: 0, bytes: all.bytes() }])?;
        let counted: Vec<Counters> = bytemuck::pod_collect_to_vec(&counters);
        let gathered = self.arena.buffer(layout::GATHERED);
        let mut deferred = Vec::new();
        let mut cameras = Vec::new();
        for c in &self.cameras {
            // After a tick, its counters are the other set.
            let last = |place: &Place| counted[(2 * place.slot + 1 - c.frame_slot) as usize];
            let part = |place: &Place| Part {
                buffer: gathered,
                offset: u64::from(place.event_base + last(place).packet) * DEFERRED_BYTES,
                bytes: u64::from(last(place).deferred) * DEFERRED_BYTES,
            };
            let leaving_events = if has_bus(&c.config.sensor) { last(&c.outlet).deferred } else { 0 };
            deferred.push(part(&c.place));
            if leaving_events > 0 {
                deferred.push(part(&c.outlet));
            }
            cameras.push(CameraHeader {
                sensor: c.config.sensor.to_toml(),
                camera: c.config.camera,
                last_ns: c.last_ns,
                last_interval_ns: c.last_interval_ns,
                complete_ns: c.complete_ns,
                epoch_ns: c.epoch_ns,
                frame_slot: c.frame_slot,
                frames: c.frames,
                sequence: c.sequence,
                holds_until_ns: c.holds_until_ns,
                rested: c.rested,
                layers_for_scene: c.layers_for_scene,
                deferred_events: last(&c.place).deferred,
                leaving_events,
                instances: c.instances.ids(),
                trust: c.check.trust().clone(),
                check_is_over: c.check.is_over(),
                lens: c.config.geometry.as_ref().map(lens_bits),
            });
        }
        let header = serde_json::to_vec(&Header { version: VERSION, cameras })
            .map_err(|e| EngineError::Snapshot(e.to_string()))?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend((header.len() as u64).to_le_bytes());
        bytes.extend(header);
        let parts: Vec<Part<'_>> = KEPT.iter().flat_map(|&slot| self.parts(slot)).chain(deferred).collect();
        bytes.extend(read_back(&self.device, &parts)?);
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        Ok(bytes)
    }

    /// Restores a saved state into a rig with the same cameras and sensors. [`EngineError::Snapshot`] if they differ or
    /// the bytes are damaged; [`EngineError::TooManyInstances`] if the saved instances and those of the present poses are
    /// too many together. On an error the rig's state has not changed.
    ///
    /// A checksum finds damage, not intent: of bytes that somebody has made up, only what the header says is checked.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), EngineError> {
        self.check_ready()?;
        let (header, body) = read_header(bytes)?;
        self.check_cameras(&header)?;
        let waiting = |c: &CameraHeader| u64::from(c.deferred_events) + u64::from(c.leaving_events);
        let deferred: u64 = header.cameras.iter().map(|c| waiting(c) * DEFERRED_BYTES).sum();
        let expected: u64 =
            deferred + KEPT.iter().flat_map(|&slot| self.parts(slot)).map(|part| part.bytes).sum::<u64>();
        if body.len() as u64 != expected {
            return Err(bad(format!("{} bytes of buffers, expected {expected}", body.len())));
        }
        self.make_room(&header)?;
        let writes = self.writes(&header, body);
        self.change(self.places(), writes, &[layout::BINS, layout::PASSING, layout::MEETINGS])?;
        self.results.clear();
        for (c, saved) in self.cameras.iter_mut().zip(header.cameras) {
            c.last_ns = saved.last_ns;
            c.last_interval_ns = saved.last_interval_ns;
            c.complete_ns = saved.complete_ns;
            c.epoch_ns = saved.epoch_ns;
            c.frame_slot = saved.frame_slot;
            c.frames = saved.frames;
            c.sequence = saved.sequence;
            c.holds_until_ns = saved.holds_until_ns;
            c.rested = saved.rested;
            c.deferred_events = saved.deferred_events;
            c.lit = None;
            c.layers_for_scene = saved.layers_for_scene;
            c.changed = true;
            c.may_be_unarmed = true;
            c.check = PoseCheck::resumed(saved.trust, saved.check_is_over);
            c.instances = c.restored_instances(&saved.instances, c.trust(), saved.frames);
        }
        Ok(())
    }

    /// The words of a camera's part of a buffer, or of all of it if cameras share it, by its name in the list of bindings,
    /// for tests. Panics if there is no such buffer; an error if there is no such camera.
    #[doc(hidden)]
    pub fn words(&self, camera: usize, name: &str) -> Result<Vec<u32>, EngineError> {
        self.check_ready()?;
        let place = self.camera(camera)?.place;
        let slot = BINDINGS.iter().position(|b| b.name == name).expect("a name in the list of bindings");
        let stride = u64::from(BINDINGS[slot].stride);
        let buffer = self.arena.buffer(slot);
        let part = match place.elements()[slot] {
            Some(elements) => {
                Part { buffer, offset: place.first_element(slot) * stride, bytes: elements * stride }
            }
            None => Part { buffer, offset: 0, bytes: buffer.bytes() },
        };
        Ok(bytemuck::pod_collect_to_vec(&read_back(&self.device, &[part])?))
    }

    /// Makes a camera's next tick count its events from a number on, for tests.
    #[doc(hidden)]
    pub fn count_events_from(&self, camera: usize, emitted: u32) -> Result<(), EngineError> {
        self.check_ready()?;
        let camera = self.camera(camera)?;
        let set = u64::from(2 * camera.place.slot + camera.frame_slot);
        let bytes = bytemuck::bytes_of(&Counters { emitted, ..only_deferred(0) }).to_vec();
        let write = Write { slot: layout::COUNTERS, offset: set * size_of::<Counters>() as u64, bytes };
        Writes::new(&self.device, vec![write])?.run(&self.device, &self.arena)
    }

    /// Every camera's part of a buffer that outlives a tick.
    fn parts(&self, slot: usize) -> Vec<Part<'_>> {
        let (buffer, stride) = (self.arena.buffer(slot), u64::from(BINDINGS[slot].stride));
        let part = |c: &CameraState| Part {
            buffer,
            offset: c.place.first_element(slot) * stride,
            bytes: c.place.kept_elements(slot, &c.config.sensor) * stride,
        };
        self.cameras.iter().map(part).collect()
    }

    fn check_cameras(&self, header: &Header) -> Result<(), EngineError> {
        let (actual, expected) = (header.cameras.len(), self.cameras.len());
        if actual != expected {
            return Err(bad(format!("{actual} cameras, expected {expected}")));
        }
        for (number, (saved, c)) in header.cameras.iter().zip(&self.cameras).enumerate() {
            if let Some((actual, expected)) = first_difference(&c.config.sensor.to_toml(), &saved.sensor) {
                return Err(bad(format!(
                    "camera {number} has another sensor than the one saved: `{actual}`, expected `{expected}`"
                )));
            }
            if saved.camera != c.config.camera {
                let (actual, expected) = (c.config.camera, saved.camera);
                return Err(bad(format!("camera {number} is camera {actual}, expected {expected} as saved")));
            }
            if saved.lens != c.config.geometry.as_ref().map(lens_bits) {
                return Err(bad(format!("camera {number} has another lens than the one saved")));
            }
            if saved.instances.first() != Some(&STATIC_WORLD) {
                return Err(bad(format!("camera {number} has no static world in its instances")));
            }
            let (rows, distinct) =
                (saved.instances.len(), saved.instances.iter().collect::<HashSet<_>>().len());
            if distinct != rows {
                return Err(bad(format!(
                    "camera {number} has {distinct} different ids in {rows} rows of instances, expected one in each"
                )));
            }
            let rows = c.restored_instances(&saved.instances, &Trust::All, saved.frames).len();
            if rows > MOST_INSTANCES {
                return Err(EngineError::TooManyInstances {
                    camera: number,
                    expected: MOST_INSTANCES,
                    actual: rows,
                });
            }
            let most = c.place.pixels;
            if saved.leaving_events > most {
                let actual = saved.leaving_events;
                return Err(bad(format!(
                    "camera {number} has {actual} events on their way out, expected at most {most}"
                )));
            }
            if saved.layers_for_scene == 0 || saved.layers_for_scene > MAX_LAYERS {
                let actual = saved.layers_for_scene;
                return Err(bad(format!("camera {number} has {actual} layers, expected 1 to {MAX_LAYERS}")));
            }
            if saved.frame_slot > 1 {
                return Err(bad(format!(
                    "camera {number} has frame slot {}, expected 0 or 1",
                    saved.frame_slot
                )));
            }
        }
        Ok(())
    }

    /// Grows event buffers that are too small for the deferred events, and tables for the instances; nothing else
    /// changes.
    fn make_room(&mut self, header: &Header) -> Result<(), EngineError> {
        let mut places = self.places();
        for ((place, c), saved) in places.iter_mut().zip(&self.cameras).zip(&header.cameras) {
            let rows = c.restored_instances(&saved.instances, &Trust::All, saved.frames);
            let instances = rows.len() as u32;
            *place = place.with_events(saved.deferred_events).with_instances(instances);
        }
        self.change(places, Vec::new(), &[])
    }

    /// The writes that put a saved state into the buffers.
    fn writes(&self, header: &Header, body: &[u8]) -> Vec<Write> {
        let mut rest = body;
        let mut writes = Vec::new();
        for slot in KEPT {
            for Part { offset, bytes, .. } in self.parts(slot) {
                let (part, after) = rest.split_at(bytes as usize);
                rest = after;
                writes.push(Write { slot, offset, bytes: part.to_vec() });
            }
        }
        for (c, saved) in self.cameras.iter().zip(&header.cameras) {
            for (place, events) in [(&c.place, saved.deferred_events), (&c.outlet, saved.leaving_events)] {
                let (part, after) = rest.split_at((u64::from(events) * DEFERRED_BYTES) as usize);
                rest = after;
                let offset = place.first_element(layout::GATHERED) * DEFERRED_BYTES;
                writes.push(Write { slot: layout::GATHERED, offset, bytes: part.to_vec() });
            }
        }
        // A running rig has deferred events behind the last packet. A restored one has them first, so the counters must
        // say that the last packet is empty.
        for (c, saved) in self.cameras.iter().zip(&header.cameras) {
            for (place, events) in [(&c.place, saved.deferred_events), (&c.outlet, saved.leaving_events)] {
                let mut sets = [only_deferred(0); 2];
                sets[1 - saved.frame_slot as usize] = only_deferred(events);
                writes.push(counters(sets, place));
            }
        }
        writes
    }
}

impl CameraState {
    /// The rows of a saved camera, and those that its present poses need besides.
    fn restored_instances(&self, saved: &[u32], trust: &Trust, frames: u64) -> Instances {
        let saved = Instances::restored(saved);
        self.scene.as_ref().map_or(saved.clone(), |scene| saved.with(scene, trust, frames))
    }
}

/// The first lines in which two sensors' files differ: a parameter, with its value in each.
fn first_difference<'a>(one: &'a str, other: &'a str) -> Option<(&'a str, &'a str)> {
    let (mut one, mut other) = (one.lines(), other.lines());
    loop {
        match (one.next(), other.next()) {
            (None, None) => return None,
            (a, b) if a == b => {}
            (a, b) => return Some((a.unwrap_or("nothing"), b.unwrap_or("nothing"))),
        }
    }
}

fn bad(what: String) -> EngineError {
    EngineError::Snapshot(what)
}

/// The header of a saved state, and the buffers' bytes after it.
fn read_header(bytes: &[u8]) -> Result<(Header, &[u8]), EngineError> {
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| bad("not a saved rig".to_owned()))?;
    let (length, rest) =
        rest.split_at_checked(8).ok_or_else(|| bad("truncated before its header".to_owned()))?;
    let length = u64::from_le_bytes(length.try_into().expect("eight bytes")) as usize;
    let (header, body) =
        rest.split_at_checked(length).ok_or_else(|| bad("truncated in its header".to_owned()))?;
    let header: Header = serde_json::from_slice(header).map_err(|e| bad(e.to_string()))?;
    if header.version != VERSION {
        return Err(bad(format!("version {}, expected {VERSION}", header.version)));
    }
    let (sealed, checksum) = bytes.split_at(bytes.len() - CHECKSUM_BYTES.min(body.len()));
    let actual = crc32fast::hash(sealed);
    if checksum != actual.to_le_bytes() {
        let expected: String = checksum.iter().rev().map(|byte| format!("{byte:02x}")).collect();
        return Err(bad(format!("damaged: its CRC-32 is {actual:08x}, expected {expected}")));
    }
    Ok((header, &body[..body.len() - CHECKSUM_BYTES]))
}
