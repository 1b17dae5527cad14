//! Collects the results of a run, interval by interval.

use anyhow::Result;
use esaac_engine::{Diagnostics, Rig, Tick};
use esaac_formats::event_file::EventColumns;
use esaac_model::PacketView;
use esaac_model::physical::LightReport;
use std::collections::BTreeMap;

/// The results of one camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraRecord {
    /// Its events.
    pub events: EventColumns,
    /// ON events.
    pub on: u64,
    /// OFF events.
    pub off: u64,
    /// Events left out because of a cap.
    pub dropped: u64,
    /// Sums of the engine's diagnostics, by name. What still waits is no part of them: see
    /// [`CameraRecord::waiting_at_end`].
    pub diagnostics: BTreeMap<String, u64>,
    /// Events that waited for a later packet after the last interval.
    waiting: u64,
    /// The same of streams of frames that ended earlier.
    waiting_before: u64,
    /// Light on its focal plane, for a physical pixel.
    pub light: Option<LightReport>,
    /// What to tell about its light.
    pub light_warnings: Vec<String>,
    /// What to tell about pixels that cannot be used, of the first frame that has many.
    pub frame_warning: Option<String>,
    /// What to tell about pixels without an exact path, of the first frame that has many.
    pub path_warning: Option<String>,
}

impl CameraRecord {
    /// Events that were stamped after the last frame of their stream, so that no packet has them.
    #[must_use]
    pub fn waiting_at_end(&self) -> u64 {
        self.waiting_before + self.waiting
    }

    /// Adds the instances of the events that were added last.
    pub fn add_ids(&mut self, ids: &[i64]) {
        self.events.ids.get_or_insert_default().extend_from_slice(ids);
    }

    fn count(&mut self, packet: &PacketView<'_>) {
        let (on, off) = packet.on_off();
        self.on += on;
        self.off += off;
        self.dropped += packet.dropped;
    }
}

/// The results of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunRecord {
    /// By camera.
    pub cameras: Vec<CameraRecord>,
    /// GPU nanoseconds of every interval by stage.
    pub stages: Vec<(String, Vec<u64>)>,
    /// Nanoseconds from submission to packet of every interval.
    pub submit_to_packet_ns: Vec<u64>,
}

impl RunRecord {
    /// An empty record.
    #[must_use]
    pub fn new(cameras: usize) -> Self {
        RunRecord { cameras: vec![CameraRecord::default(); cameras], ..RunRecord::default() }
    }

    /// Adds an interval.
    pub fn add_tick(&mut self, tick: &Tick<'_>) -> Result<()> {
        self.add_timing(tick.stage_ns, tick.submit_to_packet_ns);
        (0..self.cameras.len()).try_for_each(|camera| self.add_camera(camera, tick, true))
    }

    /// Adds one camera's results of a tick; `keep_events`: with its events, not only their number.
    pub fn add_camera(&mut self, camera: usize, tick: &Tick<'_>, keep_events: bool) -> Result<()> {
        self.add_packet(camera, &tick.view(camera), keep_events);
        self.add_diagnostics(camera, &tick.diagnostics[camera])
    }

    /// Notes that a camera begins with a new stream of frames: what still waits will not come.
    pub fn begin_anew(&mut self, camera: usize) {
        let record = &mut self.cameras[camera];
        record.waiting_before += std::mem::take(&mut record.waiting);
    }

    /// Adds one camera's packet; `keep_events`: with its events, not only their number.
    pub fn add_packet(&mut self, camera: usize, packet: &PacketView<'_>, keep_events: bool) {
        let record = &mut self.cameras[camera];
        record.count(packet);
        if keep_events {
            record.events.extend(packet);
        }
    }

    /// Adds an interval's timings.
    pub fn add_timing(&mut self, stage_ns: &[(&str, u64)], submit_to_packet_ns: u64) {
        for &(stage, ns) in stage_ns {
            match self.stages.iter_mut().find(|(name, _)| name == stage) {
                Some((_, all)) => all.push(ns),
                None => self.stages.push((stage.to_owned(), vec![ns])),
            }
        }
        self.submit_to_packet_ns.push(submit_to_packet_ns);
    }

    /// Forgets all timings but the last `keep` intervals', once there are twice as many. A service runs for
    /// days: at 1000 ticks a second it would else keep some gigabytes of timings a day.
    pub fn forget_old_timings(&mut self, keep: usize) {
        let all = self.stages.iter_mut().map(|(_, all)| all).chain([&mut self.submit_to_packet_ns]);
        for timings_ns in all.filter(|timings_ns| timings_ns.len() >= 2 * keep) {
            timings_ns.drain(..timings_ns.len() - keep);
        }
    }

    /// Adds a camera's diagnostics of an interval.
    pub fn add_diagnostics(&mut self, camera: usize, diagnostics: &Diagnostics) -> Result<()> {
        let record = &mut self.cameras[camera];
        for (name, count) in counters(diagnostics)? {
            *record.diagnostics.entry(name).or_default() += count;
        }
        record.waiting = diagnostics.deferred_events;
        Ok(())
    }

    /// Takes what a rig has seen of the cameras' light, at the end of a run.
    pub fn take_light(&mut self, rig: &Rig) -> Result<()> {
        for (number, camera) in self.cameras.iter_mut().enumerate() {
            camera.light = rig.light(number)?;
            camera.light_warnings = rig.light_warnings(number)?;
        }
        Ok(())
    }

    /// Events dropped by all cameras.
    #[must_use]
    pub fn dropped(&self) -> u64 {
        self.cameras.iter().map(|c| c.dropped).sum()
    }
}

/// The engine's counters that add up over intervals, by name.
fn counters(diagnostics: &Diagnostics) -> Result<BTreeMap<String, u64>> {
    let mut counters: BTreeMap<String, u64> = serde_json::from_value(serde_json::to_value(diagnostics)?)?;
    // An event that waits for several intervals is in the figure of each.
    counters.remove("deferred_events");
    Ok(counters)
}

/// The `quantile` (0 to 1) of `values` by nearest rank; 0 for none.
#[must_use]
pub fn quantile(values: &[u64], quantile: f64) -> u64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable();
    let rank = (quantile * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Packet;

    #[test]
    fn quantiles_are_values_of_the_run() {
        let values: Vec<u64> = (1..=100).rev().collect();
        assert_eq!((quantile(&values, 0.5), quantile(&values, 0.99)), (50, 99));
        assert_eq!((quantile(&[7], 0.5), quantile(&[7], 0.99), quantile(&[], 0.5)), (7, 7, 0));
    }

    #[test]
    fn a_service_keeps_its_last_timings_alone() {
        let mut record = RunRecord::new(1);
        for interval in 0..1000 {
            record.add_timing(&[("ingest", interval), ("cross", 2 * interval)], 3 * interval);
            record.forget_old_timings(10);
            assert!(record.submit_to_packet_ns.len() < 20);
        }
        assert_eq!(record.submit_to_packet_ns.last(), Some(&2997));
        for (scale, (_, timings_ns)) in (1..).zip(&record.stages) {
            let last: Vec<u64> = (990..1000).map(|interval| scale * interval).collect();
            assert!(timings_ns.len() < 20 && timings_ns.ends_with(&last), "{timings_ns:?}");
        }
    }

    #[test]
    fn intervals_add_up() {
        let packet = Packet {
            x: vec![0; 3],
            y: vec![0; 3],
            t_offset_ns: vec![1, 2, 3],
            polarity: vec![1, 0, 1],
            dropped: 2,
            ..Packet::default()
        };
        let mut record = RunRecord::new(1);
        for _ in 0..2 {
            record.add_packet(0, &packet.view(), true);
            record.add_timing(&[("warp", 5)], 9);
            let counted = Diagnostics { invalid_pixels: 4, ..Diagnostics::default() };
            record.add_diagnostics(0, &counted).unwrap();
        }
        let camera = &record.cameras[0];
        assert_eq!((camera.on, camera.off, record.dropped(), camera.events.len()), (4, 2, 4, 6));
        assert_eq!(record.stages, [("warp".to_owned(), vec![5, 5])]);
        assert_eq!((camera.diagnostics["invalid_pixels"], camera.diagnostics["regrown"]), (8, 0));
    }

    #[test]
    fn what_waits_after_the_last_interval_of_each_stream_is_told() {
        let mut record = RunRecord::new(1);
        let mut intervals = |waiting: &[u64]| {
            for &deferred_events in waiting {
                let counted = Diagnostics { deferred_events, ..Diagnostics::default() };
                record.add_diagnostics(0, &counted).unwrap();
            }
            let told = record.cameras[0].waiting_at_end();
            record.begin_anew(0);
            told
        };
        assert_eq!((intervals(&[5, 7, 3]), intervals(&[9, 4])), (3, 3 + 4));
        assert!(!record.cameras[0].diagnostics.contains_key("deferred_events"));
    }
}
