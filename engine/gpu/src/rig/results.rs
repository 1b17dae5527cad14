//! Results of the last tick: packets, APS frames and diagnostics, from the counters and buffers that the device wrote.

use super::arena::Arena;
use super::{CameraConfig, CameraState, PacketPlace};
use crate::threads;
use esaac_layout::{self as layout, Counters};
use esaac_model::substeps::quantise_ns;
use esaac_model::{Packet, PacketView};

/// Counters of a camera in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Diagnostics {
    /// Pixels whose colour is NaN, infinite or negative; they keep their last value.
    pub invalid_pixels: u64,
    /// Pixels whose motion is not finite; they are blended instead of warped.
    pub invalid_motion: u64,
    /// Pixels that have never had a valid colour and therefore emit nothing.
    pub unarmed_pixels: u64,
    /// Blocks of 8x8 pixels that were skipped because nothing in or around their tile moves or changes.
    pub skipped_blocks: u64,
    /// Sub-steps, summed over blocks.
    pub substeps: u64,
    /// Physical pixels that would have sent more events than a pixel may in an interval
    /// ([`MOST_EVENTS`](esaac_model::physical::MOST_EVENTS)). They send no more in it, and are armed anew at its end.
    pub overrun_pixels: u64,
    /// Events that are deferred to a later packet.
    pub deferred_events: u64,
    /// Events dropped because of the sensor's limit per interval.
    pub dropped_events: u64,
    /// Events that the sensor lost because their pixel had one waiting for the bus.
    pub lost_events: u64,
    /// Events that the sensor's rate controller dropped.
    pub capped_events: u64,
    /// Pixels of the frame without a path because their depth is NaN, negative or too small to invert (synthesis `rigid`).
    pub without_depth: u64,
    /// Pixels without a path because their instance has no poses.
    pub without_poses: u64,
    /// Pixels without a path because the lens shows nothing there.
    pub without_lens: u64,
    /// Sub-steps of pixels at which neither frame shows what is there (synthesis `rigid`).
    pub unseen_samples: u64,
    /// Blocks of 8x8 pixels that things pass whose motions meet (synthesis `motion`, unless `layers` is 1).
    pub meeting_blocks: u64,
    /// Intervals in which a pixel could show several surfaces: 1 or 0.
    pub layered_intervals: u64,
    /// How often the event buffers had to grow.
    pub regrown: u64,
}

/// An APS frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ApsFrame {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Significant bits of a pixel.
    pub bits: u32,
    /// End of the exposure, nanoseconds.
    pub t_ns: i64,
    /// Row-major pixels; a mosaic if the sensor's intensity is one.
    pub pixels: Vec<u16>,
}

/// Results of the last tick.
pub(super) struct Results {
    pub packets: Vec<Packet>,
    /// Number of events in each packet, wherever they lie.
    pub events: Vec<u32>,
    pub aps: Vec<Option<ApsFrame>>,
    pub diagnostics: Vec<Diagnostics>,
    pub stage_ns: Vec<(&'static str, u64)>,
    pub submit_to_packet_ns: u64,
}

impl Results {
    pub(super) fn new(configs: &[CameraConfig]) -> Self {
        let cameras = configs.len();
        let empty = |config: &CameraConfig| Packet {
            width_px: config.sensor.width,
            height_px: config.sensor.height,
            ..Packet::default()
        };
        Results {
            packets: configs.iter().map(empty).collect(),
            events: vec![0; cameras],
            aps: vec![None; cameras],
            diagnostics: vec![Diagnostics::default(); cameras],
            stage_ns: Vec::new(),
            submit_to_packet_ns: 0,
        }
    }

    /// Forgets the last tick.
    pub(super) fn clear(&mut self) {
        for packet in &mut self.packets {
            packet.clear();
        }
        self.events.fill(0);
        self.aps.fill(None);
        self.diagnostics.fill(Diagnostics::default());
        self.stage_ns.clear();
        self.submit_to_packet_ns = 0;
    }

    /// Takes the packets out; their headers stay.
    pub(super) fn take_packets(&mut self) -> Vec<Packet> {
        let take = |packet: &mut Packet| Packet {
            x: std::mem::take(&mut packet.x),
            y: std::mem::take(&mut packet.y),
            t_offset_ns: std::mem::take(&mut packet.t_offset_ns),
            polarity: std::mem::take(&mut packet.polarity),
            ..*packet
        };
        self.packets.iter_mut().map(take).collect()
    }

    /// Stores the results of a camera in a tick to time `t_ns`, all but the events. `camera` has the state before the
    /// tick.
    pub(super) fn take(
        &mut self,
        number: usize,
        camera: &CameraState,
        t_ns: i64,
        counters: &Counters,
        regrown: u64,
    ) {
        let sensor = &camera.config.sensor;
        let start_ns = camera.last_ns.unwrap_or(t_ns);
        let packet = &mut self.packets[number];
        packet.watermark_ns = camera.watermark_ns(t_ns);
        packet.base_ns = quantise_ns(start_ns, i64::from(sensor.timestamp_quantum_ns));
        packet.sequence = camera.sequence;
        let is_interval = camera.last_ns.is_some();
        let found = if is_interval { counters.packet } else { 0 };
        let cap = if sensor.max_events_per_interval == 0 { u32::MAX } else { sensor.max_events_per_interval };
        self.events[number] = found.min(cap);
        packet.dropped = u64::from(found - found.min(cap));
        self.diagnostics[number] = Diagnostics {
            invalid_pixels: counters.invalid_pixels.into(),
            invalid_motion: counters.invalid_motion.into(),
            unarmed_pixels: counters.unarmed_pixels.into(),
            skipped_blocks: counters.skipped_blocks.into(),
            substeps: counters.substeps.into(),
            overrun_pixels: counters.overrun_pixels.into(),
            deferred_events: counters.deferred.into(),
            dropped_events: packet.dropped,
            lost_events: counters.lost.into(),
            capped_events: counters.capped.into(),
            without_depth: counters.without_depth.into(),
            without_poses: counters.without_poses.into(),
            without_lens: counters.without_lens.into(),
            unseen_samples: counters.unseen_samples.into(),
            meeting_blocks: counters.meeting_blocks.into(),
            layered_intervals: (is_interval && camera.layers() > 1).into(),
            regrown,
        };
        // The interval's end cuts the exposure off; nothing may be left of it.
        let interval_ns = t_ns - start_ns;
        if is_interval && sensor.aps_exposure_ns > 0 && i64::from(sensor.aps_start_ns) < interval_ns {
            let end_ns = start_ns + i64::from(sensor.aps_start_ns) + i64::from(sensor.aps_exposure_ns);
            self.aps[number] = Some(ApsFrame {
                width_px: sensor.width,
                height_px: sensor.height,
                bits: sensor.aps_bits,
                t_ns: end_ns.min(t_ns),
                pixels: Vec::new(),
            });
        }
    }

    /// Copies events and APS pixels out of the memory that the device wrote, as far as the host is to own them.
    pub(super) fn copy_out(&mut self, place: PacketPlace, cameras: &[CameraState], arena: &Arena) {
        let mut copies = Vec::new();
        if place == PacketPlace::Owned {
            for (number, packet) in self.packets.iter_mut().enumerate() {
                let base = cameras[number].packet_base() as usize;
                let events = self.events[number] as usize;
                let Packet { t_offset_ns, x, y, polarity, .. } = packet;
                copies.push(ColumnCopy::Times(arena.buffer(layout::EVENT_T).read(base, events), t_offset_ns));
                copies.push(ColumnCopy::Words(arena.buffer(layout::EVENT_X).read(base, events), x));
                copies.push(ColumnCopy::Words(arena.buffer(layout::EVENT_Y).read(base, events), y));
                copies.push(ColumnCopy::Bytes(arena.buffer(layout::EVENT_P).read(base, events), polarity));
            }
        }
        if place != PacketPlace::InPlace {
            for (frame, camera) in self.aps.iter_mut().zip(cameras) {
                if let Some(frame) = frame {
                    let (base, pixels) = (camera.place.aps_base as usize, camera.place.pixels as usize);
                    copies.push(ColumnCopy::Words(
                        arena.buffer(layout::APS).read(base, pixels),
                        &mut frame.pixels,
                    ));
                }
            }
        }
        run(copies);
    }

    /// A view of a camera's packet, with the events that the host owns.
    pub(super) fn view(&self, number: usize) -> PacketView<'_> {
        self.packets[number].view()
    }
}

/// A column to copy, and the vector that it is appended to.
enum ColumnCopy<'a> {
    Times(&'a [u32], &'a mut Vec<u32>),
    Words(&'a [u16], &'a mut Vec<u16>),
    Bytes(&'a [u8], &'a mut Vec<u8>),
}

impl ColumnCopy<'_> {
    fn bytes(&self) -> usize {
        match self {
            ColumnCopy::Times(from, _) => size_of_val(*from),
            ColumnCopy::Words(from, _) => size_of_val(*from),
            ColumnCopy::Bytes(from, _) => from.len(),
        }
    }

    fn run(self) {
        match self {
            ColumnCopy::Times(from, to) => to.extend_from_slice(from),
            ColumnCopy::Words(from, to) => to.extend_from_slice(from),
            ColumnCopy::Bytes(from, to) => to.extend_from_slice(from),
        }
    }
}

/// Bytes per copying thread: copying them takes several times as long as waking the thread.
const THREAD_BYTES: usize = 2 << 20;

/// Most threads that copy: a few saturate the memory.
const MOST_THREADS: usize = 8;

/// Runs the copies, on several threads if they are large.
fn run(copies: Vec<ColumnCopy<'_>>) {
    let bytes: usize = copies.iter().map(ColumnCopy::bytes).sum();
    let threads = match bytes / THREAD_BYTES {
        0 | 1 => 1,
        worth => worth.min(MOST_THREADS).min(threads::most()),
    };
    threads::share(share_out(copies, threads), |share| share.into_iter().for_each(ColumnCopy::run));
}

/// Divides copies into shares of about equal bytes: the largest copies first, each to the smallest share so far.
fn share_out(mut copies: Vec<ColumnCopy<'_>>, shares: usize) -> Vec<Vec<ColumnCopy<'_>>> {
    if shares == 1 {
        return vec![copies];
    }
    copies.sort_by_key(|copy| std::cmp::Reverse(copy.bytes()));
    let mut shared: Vec<(usize, Vec<ColumnCopy<'_>>)> = (0..shares).map(|_| (0, Vec::new())).collect();
    for copy in copies {
        let least = shared.iter_mut().min_by_key(|(bytes, _)| *bytes).expect("at least one share");
        least.0 += copy.bytes();
        least.1.push(copy);
    }
    shared.into_iter().map(|(_, copies)| copies).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_is_copied_whole_whether_by_one_thread_or_by_many() {
        for events in [0, 1, 1000, 3 << 20] {
            let times: Vec<u32> = (0..events).collect();
            let columns: Vec<u16> = (0..events).map(|e| e as u16).collect();
            let signs: Vec<u8> = (0..events).map(|e| (e % 2) as u8).collect();
            let mut copied = (Vec::new(), Vec::new(), Vec::new());
            run(vec![
                ColumnCopy::Times(&times, &mut copied.0),
                ColumnCopy::Words(&columns, &mut copied.1),
                ColumnCopy::Bytes(&signs, &mut copied.2),
            ]);
            assert!(copied == (times, columns, signs), "{events} events");
        }
    }

    #[test]
    fn shares_are_even() {
        let columns: Vec<Vec<u16>> = (1..40).map(|n| vec![0; n]).collect();
        let mut targets: Vec<Vec<u16>> = vec![Vec::new(); columns.len()];
        let copies: Vec<ColumnCopy<'_>> =
            columns.iter().zip(&mut targets).map(|(from, to)| ColumnCopy::Words(from, to)).collect();
        let bytes: Vec<usize> =
            share_out(copies, 4).iter().map(|share| share.iter().map(ColumnCopy::bytes).sum()).collect();
        let all: usize = (1..40).map(|n| 2 * n).sum();
        assert_eq!((bytes.len(), bytes.iter().sum::<usize>()), (4, all));
        assert!(bytes.iter().all(|&b| b.abs_diff(all / 4) <= 20), "{bytes:?}");
    }
}
