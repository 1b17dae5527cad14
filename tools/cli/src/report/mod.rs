//! The report of a run: a struct that is printed as JSON or as text.

mod text;

use crate::counted::counted;
use crate::link_report::LinkReport;
use crate::outcome::{Ending, Outcome};
use crate::pose_report::PoseReport;
use crate::run_record::{RunRecord, quantile};
use crate::synthesis_choice::SynthesisChoice;
use crate::warnings::Warnings;
use anyhow::Result;
use esaac_engine::{MemoryUse, PacketPlace, Rig, RigOptions};
use esaac_model::SensorModel;
use esaac_model::input::InputReport;
use esaac_model::physical::LightReport;
use esaac_ros::{Summary, TopicSummary};
use serde::Serialize;
use std::collections::BTreeMap;

/// The whole report.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Source of the frames.
    pub input: String,
    /// Device.
    pub device: DeviceReport,
    /// How frames reached the engine.
    pub link: LinkReport,
    /// Counts of ROS 2 messages, if any were published or recorded.
    pub ros: Option<Summary>,
    /// Which synthesis the frames got and why, if it depended on them.
    pub synthesis: Option<SynthesisChoice>,
    /// Poses that came with the frames, if any did.
    pub poses: Option<PoseReport>,
    /// Whether events must be false because of what the frames lack, if that was looked at.
    pub input_check: Option<InputReport>,
    /// Intervals simulated.
    pub intervals: usize,
    /// Intervals of a whole run, if their number is known before.
    pub intervals_expected: Option<usize>,
    /// Whether a signal ended the run before its end.
    pub interrupted: bool,
    /// Simulated time, nanoseconds.
    pub simulated_ns: i64,
    /// Rate of the key frames, if they came from a folder.
    pub key_rate: Option<KeyRate>,
    /// By camera.
    pub cameras: Vec<CameraReport>,
    /// GPU time of an interval for each stage, all cameras together.
    pub stages: Vec<StageReport>,
    /// GPU time of an interval, all stages.
    pub gpu: StageReport,
    /// Time from the submission until the packet is in host memory.
    pub submit_to_packet: StageReport,
    /// Device memory of all cameras, bytes, without host memory.
    pub memory_bytes: u64,
    /// Memory by purpose.
    pub memory: Vec<MemoryReport>,
    /// Files written.
    pub files: Vec<String>,
    /// The warnings that standard error has.
    pub warnings: Warnings,
}

/// Rate of a folder's key frames.
#[derive(Clone, Debug, Serialize)]
pub struct KeyRate {
    /// Frames a second.
    pub hz: f64,
    /// Who says so.
    pub from: &'static str,
}

/// The device that ran it.
#[derive(Clone, Debug, Default, Serialize)]
pub struct DeviceReport {
    /// Name.
    pub name: String,
    /// Kind.
    pub kind: String,
    /// UUID.
    pub uuid: String,
    /// Driver and its version.
    pub driver: String,
    /// Vulkan version.
    pub vulkan: String,
}

/// One camera.
#[derive(Clone, Debug, Default, Serialize)]
pub struct CameraReport {
    /// Its sensor.
    pub sensor: SensorModel,
    /// Events.
    pub events: u64,
    /// ON events.
    pub on: u64,
    /// OFF events.
    pub off: u64,
    /// Events dropped because of `max_events_per_interval`.
    pub dropped: u64,
    /// Events that the run does not have, because they were stamped after its last frame.
    pub waiting_at_end: u64,
    /// The engine's counters, by name.
    pub diagnostics: BTreeMap<String, u64>,
    /// Light on the focal plane, for a physical pixel.
    pub light: Option<LightReport>,
    /// What to tell about the light.
    pub light_warnings: Vec<String>,
    /// What to tell about pixels that cannot be used.
    pub frame_warning: Option<String>,
    /// What to tell about pixels without an exact path.
    pub path_warning: Option<String>,
    /// What is assumed of a physical pixel and its light.
    pub notes: Vec<String>,
    /// Comparison with the scene's exact events, if the scene is known.
    pub accuracy: Option<AccuracyReport>,
}

/// Median and 99th percentile of a duration over the intervals.
#[derive(Clone, Debug, Default, Serialize)]
pub struct StageReport {
    /// What is timed.
    pub name: String,
    /// Median, nanoseconds.
    pub median_ns: u64,
    /// 99th percentile, nanoseconds.
    pub p99_ns: u64,
}

/// Memory that is used for one purpose.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MemoryReport {
    /// Camera. `None`: all cameras share it.
    pub camera: Option<usize>,
    /// Purpose.
    pub purpose: String,
    /// Bytes.
    pub bytes: u64,
    /// Whether it lies in host memory.
    pub on_host: bool,
}

/// Comparison of simulated events with the scene's exact ones, on a subset of the pixels.
#[derive(Clone, Debug, Default, Serialize)]
pub struct AccuracyReport {
    /// Pixels compared.
    pub pixels: usize,
    /// Simulated events of these pixels.
    pub events: u64,
    /// Exact events of these pixels.
    pub exact_events: u64,
    /// Share of pixels with the exact sequence of polarities.
    pub exact_sequences: f64,
    /// Harmonic mean of precision and recall of matches within `match_window_us`.
    pub f1: f64,
    /// Largest time between two events that match, microseconds.
    pub match_window_us: f64,
    /// Median time between matched events, microseconds.
    pub time_error_median_us: f64,
    /// 99th percentile of it.
    pub time_error_p99_us: f64,
    /// Victor-Purpura distance per exact event.
    pub victor_purpura: f64,
}

impl Report {
    /// The report of `record`. The caller adds files, memory, notes and accuracy.
    #[must_use]
    pub fn new(input: String, device: DeviceReport, sensors: &[SensorModel], record: &RunRecord) -> Self {
        let cameras = sensors
            .iter()
            .zip(&record.cameras)
            .map(|(sensor, camera)| CameraReport {
                sensor: sensor.clone(),
                events: camera.on + camera.off,
                on: camera.on,
                off: camera.off,
                dropped: camera.dropped,
                waiting_at_end: camera.waiting_at_end(),
                diagnostics: camera.diagnostics.clone(),
                light: camera.light,
                light_warnings: camera.light_warnings.clone(),
                frame_warning: camera.frame_warning.clone(),
                path_warning: camera.path_warning.clone(),
                notes: Vec::new(),
                accuracy: None,
            })
            .collect();
        let intervals = record.submit_to_packet_ns.len();
        let totals: Vec<u64> =
            (0..intervals).map(|i| record.stages.iter().filter_map(|(_, all)| all.get(i)).sum()).collect();
        Report {
            input,
            device,
            intervals,
            cameras,
            stages: record.stages.iter().map(|(name, all)| StageReport::new(name, all)).collect(),
            gpu: StageReport::new("all stages", &totals),
            submit_to_packet: StageReport::new("submit to packet", &record.submit_to_packet_ns),
            ..Report::default()
        }
    }

    /// Adds the memory.
    pub fn set_memory(&mut self, memory: Vec<MemoryReport>) {
        self.memory_bytes = memory.iter().filter(|m| !m.on_host).map(|m| m.bytes).sum();
        self.memory = memory;
    }

    /// The report as a command's outcome: text or JSON, and whether it was interrupted or events were dropped. Of a run
    /// without an interval there is JSON alone.
    pub fn outcome(&self, json: bool) -> Result<Outcome> {
        let dropped = self.cameras.iter().any(|c| c.dropped > 0);
        let ending = match (self.interrupted, dropped) {
            (true, _) => Ending::Interrupted,
            (false, true) => Ending::EventsDropped,
            (false, false) => Ending::Complete,
        };
        let text = match json {
            true => self.to_json()?,
            false if self.interrupted && self.intervals == 0 => String::new(),
            false => self.to_text(),
        };
        Ok(Outcome { text, ending })
    }

    /// Warns of events that the run does not have, and of messages that were neither published nor recorded.
    pub fn warn_of_losses(&mut self) {
        for (camera, report) in self.cameras.iter().enumerate() {
            if let Some(warning) = report.waiting_warning() {
                self.warnings.tell(format_args!("camera {camera}: {warning}"));
            }
        }
        let topics = self.ros.iter().flat_map(|ros| &ros.topics);
        for TopicSummary { topic, failed, .. } in topics.filter(|topic| topic.failed > 0) {
            let messages = counted(*failed, "message");
            self.warnings.tell(format_args!("{topic}: {messages} failed; lines on standard error say why"));
        }
    }

    /// JSON, indented.
    pub fn to_json(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}

/// Options of a rig whose times the report shows.
#[must_use]
pub fn rig_options() -> RigOptions {
    RigOptions { stage_times: true, packets: PacketPlace::InPlace, ..RigOptions::default() }
}

impl CameraReport {
    /// Why events are missing at the end, and what to do.
    fn waiting_warning(&self) -> Option<String> {
        (self.waiting_at_end > 0).then(|| {
            let missing = if self.waiting_at_end == 1 { "event is" } else { "events are" };
            format!(
                "{} {missing} missing: the sensor delays them (latency, jitter, readout) beyond the last frame; more \
                 frames at the end bring them",
                self.waiting_at_end
            )
        })
    }
}

impl StageReport {
    /// Statistics of one duration.
    #[must_use]
    pub fn new(name: &str, values_ns: &[u64]) -> Self {
        StageReport {
            name: name.to_owned(),
            median_ns: quantile(values_ns, 0.5),
            p99_ns: quantile(values_ns, 0.99),
        }
    }
}

impl MemoryReport {
    /// The memory of a rig.
    #[must_use]
    pub fn of(rig: &Rig) -> Vec<Self> {
        let report = |m: MemoryUse| MemoryReport {
            camera: m.camera,
            purpose: m.purpose,
            bytes: m.bytes,
            on_host: m.on_host,
        };
        rig.memory().into_iter().map(report).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Report {
        let mut record = RunRecord::new(1);
        record.cameras[0].on = 7;
        record.cameras[0].off = 5;
        record.add_timing(&[("warp", 1_000), ("sort", 2_500)], 9_000);
        record.add_timing(&[("warp", 3_000), ("sort", 2_500)], 8_000);
        let sensor = SensorModel::default();
        let mut report = Report::new("flight".to_owned(), DeviceReport::default(), &[sensor], &record);
        report.set_memory(vec![
            MemoryReport { camera: Some(0), purpose: "state".to_owned(), bytes: 2048, on_host: false },
            MemoryReport { camera: None, purpose: "staging".to_owned(), bytes: 1024, on_host: true },
        ]);
        let topic =
            |topic: &str, failed| TopicSummary { topic: topic.to_owned(), failed, ..TopicSummary::default() };
        let topics = vec![topic("/left/events", 3), topic("/clock", 0)];
        report.ros = Some(Summary { topics, ..Summary::default() });
        report.cameras[0].waiting_at_end = 5808;
        report.warn_of_losses();
        report.cameras[0].accuracy = Some(AccuracyReport { pixels: 3, f1: 0.5, ..AccuracyReport::default() });
        report
    }

    #[test]
    fn times_of_an_interval_add_up_over_stages() {
        let report = example();
        assert_eq!((report.gpu.median_ns, report.gpu.p99_ns), (3_500, 5_500));
        assert_eq!(report.memory_bytes, 2048);
    }

    #[test]
    fn a_run_that_was_interrupted_says_how_much_of_it_there_is() {
        let mut report = example();
        (report.intervals_expected, report.interrupted) = (Some(20), true);
        let outcome = report.outcome(false).unwrap();
        assert_eq!(outcome.ending, Ending::Interrupted);
        assert!(outcome.text.contains("2 of 20 intervals, interrupted, "), "{}", outcome.text);
        report.intervals = 0;
        assert_eq!(report.outcome(false).unwrap().text, "");
        let json: serde_json::Value = serde_json::from_str(&report.outcome(true).unwrap().text).unwrap();
        assert_eq!((&json["intervals"], &json["intervals_expected"]), (&0.into(), &20.into()));
        assert_eq!(json["interrupted"], true);
    }

    #[test]
    fn text_and_json_hold_the_same_figures() {
        let text = example().to_text();
        for part in [
            "12 (7 ON, 5 OFF)",
            "warp",
            "submit to packet",
            "staging",
            "F1 0.500",
            "luminance",
            "5808 events are missing",
        ] {
            assert!(text.contains(part), "{part} in\n{text}");
        }
        let json: serde_json::Value = serde_json::from_str(&example().to_json().unwrap()).unwrap();
        assert_eq!(
            (&json["cameras"][0]["events"], &json["cameras"][0]["waiting_at_end"]),
            (&12.into(), &5808.into())
        );
        assert_eq!(json["cameras"][0]["sensor"]["substeps"], 32);
        let warnings = json["warnings"].as_array().unwrap();
        assert!(warnings[0].as_str().unwrap().starts_with("camera 0: 5808 events are missing"));
        assert!(
            warnings.len() == 2
                && warnings[1].as_str().unwrap().starts_with("/left/events: 3 messages failed")
        );
    }
}
