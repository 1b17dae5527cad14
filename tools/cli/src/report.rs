//! The report of a run: a struct that serialises for programs and prints for people.

use crate::link_report::LinkReport;
use crate::outcome::{Ending, Outcome};
use crate::run_record::{RunRecord, quantile};
use crate::table;
use anyhow::Result;
use esaac_engine::{MemoryUse, PacketPlace, Rig, RigOptions};
use esaac_model::SensorModel;
use esaac_ros::Summary;
use serde::Serialize;
use std::collections::BTreeMap;

/// The whole report.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// What was simulated.
    pub input: String,
    /// Device.
    pub device: DeviceReport,
    /// How frames came to the engine.
    pub link: LinkReport,
    /// What became of ROS 2 messages, if any were published or recorded.
    pub ros: Option<Summary>,
    /// Intervals simulated.
    pub intervals: usize,
    /// Simulated time, nanoseconds.
    pub simulated_ns: i64,
    /// By camera.
    pub cameras: Vec<CameraReport>,
    /// GPU time of an interval by stage, all cameras together, in order of the stages.
    pub stages: Vec<StageReport>,
    /// GPU time of an interval, all stages.
    pub gpu: StageReport,
    /// Time from submission to the packet in host memory.
    pub submit_to_packet: StageReport,
    /// Device memory of all cameras, bytes; what lies in host memory is not counted.
    pub memory_bytes: u64,
    /// Memory by purpose.
    pub memory: Vec<MemoryReport>,
    /// Files written.
    pub files: Vec<String>,
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
    /// What the engine counted, by name.
    pub diagnostics: BTreeMap<String, u64>,
    /// Error against the scene's exact events, where the scene is known.
    pub accuracy: Option<AccuracyReport>,
}

/// Median and 99th percentile of a duration over the intervals.
#[derive(Clone, Debug, Default, Serialize)]
pub struct StageReport {
    /// What took the time.
    pub name: String,
    /// Median, nanoseconds.
    pub median_ns: u64,
    /// 99th percentile, nanoseconds.
    pub p99_ns: u64,
}

/// Memory of one purpose.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MemoryReport {
    /// Camera, or none where all share it.
    pub camera: Option<usize>,
    /// Purpose.
    pub purpose: String,
    /// Bytes.
    pub bytes: u64,
    /// Whether it lies in host memory.
    pub on_host: bool,
}

/// Distance between the events produced and the scene's exact ones, on a subset of the pixels.
#[derive(Clone, Debug, Default, Serialize)]
pub struct AccuracyReport {
    /// Pixels compared.
    pub pixels: usize,
    /// Events produced by them.
    pub events: u64,
    /// Exact events of them.
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
    /// Report of `record`; files, memory and accuracy are the caller's to add.
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
                diagnostics: camera.diagnostics.clone(),
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

    /// The report as a command's outcome: text or JSON, and whether events were dropped.
    pub fn outcome(&self, json: bool) -> Result<Outcome> {
        let dropped = self.cameras.iter().any(|c| c.dropped > 0);
        let ending = if dropped { Ending::EventsDropped } else { Ending::Complete };
        Ok(Outcome { text: if json { self.to_json()? } else { self.to_text() }, ending })
    }

    /// JSON, indented.
    pub fn to_json(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    /// Text for people.
    #[must_use]
    pub fn to_text(&self) -> String {
        let device = &self.device;
        let mut text = format!(
            "input     {}\ndevice    {} ({}), {}, Vulkan {}\nlink      {}\nspan      {} intervals, {:.3} s simulated\n",
            self.input,
            device.name,
            device.kind,
            device.driver,
            device.vulkan,
            self.link.to_text(),
            self.intervals,
            self.simulated_ns as f64 * 1e-9
        );
        if let Some(ros) = &self.ros {
            text.push_str(&format!("ROS 2     {}\n", ros.to_text()));
        }
        for (index, camera) in self.cameras.iter().enumerate() {
            text.push_str(&camera.to_text(index));
        }
        let of_all = match self.cameras.len() {
            0 | 1 => "time per interval".to_owned(),
            cameras => format!("time per interval, {cameras} cameras"),
        };
        let mut times = vec![vec![of_all, "median us".to_owned(), "p99 us".to_owned()]];
        times.extend(self.stages.iter().chain([&self.gpu, &self.submit_to_packet]).map(StageReport::row));
        text.push_str(&format!("\n{}", table::render(&times)));
        text.push_str(&format!("\n{}", table::render(&self.memory_rows())));
        text.push_str(&format!("{:.1} MiB on the device\n", self.memory_bytes as f64 / f64::from(1 << 20)));
        if !self.files.is_empty() {
            text.push_str(&format!("\nwrote {}\n", self.files.join(", ")));
        }
        text
    }

    /// A row for each purpose, a column for each camera and one for what all share.
    fn memory_rows(&self) -> Vec<Vec<String>> {
        let cameras = self.cameras.len();
        let mut rows = vec![vec!["memory, KiB".to_owned()]];
        rows[0].extend((0..cameras).map(|camera| format!("camera {camera}")));
        rows[0].push("shared".to_owned());
        let mut purposes: Vec<(&str, bool)> = Vec::new();
        for memory in self.memory.iter().filter(|m| m.bytes >= NEGLIGIBLE_BYTES) {
            if !purposes.contains(&(&memory.purpose, memory.on_host)) {
                purposes.push((&memory.purpose, memory.on_host));
            }
        }
        for (purpose, on_host) in purposes {
            let of = |camera: Option<usize>| {
                let of_camera = |m: &&MemoryReport| m.camera == camera && m.purpose == purpose;
                self.memory.iter().filter(of_camera).map(|m| m.bytes).sum::<u64>()
            };
            let mut row = vec![format!("{purpose}{}", if on_host { " (host)" } else { "" })];
            row.extend((0..cameras).map(|camera| kibibytes(of(Some(camera)))));
            row.push(kibibytes(of(None)));
            rows.push(row);
        }
        rows
    }
}

/// What a rig is asked for so that the report can name the stages.
#[must_use]
pub fn rig_options() -> RigOptions {
    RigOptions { stage_times: true, packets: PacketPlace::InPlace, ..RigOptions::default() }
}

/// Less than this is left out of the table.
const NEGLIGIBLE_BYTES: u64 = 512;

impl CameraReport {
    fn to_text(&self, index: usize) -> String {
        let sensor = &self.sensor;
        let mut text = format!(
            "\ncamera {index}  {} {}x{}, N <= {}, {}, {}\n",
            sensor.name,
            sensor.width,
            sensor.height,
            sensor.substeps,
            choice(&sensor.intensity),
            choice(&sensor.synthesis),
        );
        let mut line = |label: &str, value: String| text.push_str(&format!("  {label:<15}{value}\n"));
        line("events", format!("{} ({} ON, {} OFF)", self.events, self.on, self.off));
        line("dropped", self.dropped.to_string());
        let counted: Vec<String> =
            self.diagnostics.iter().filter(|(_, n)| **n > 0).map(|(name, n)| format!("{name} {n}")).collect();
        if !counted.is_empty() {
            line("diagnostics", counted.join(", "));
        }
        if let Some(a) = &self.accuracy {
            line(
                "against exact",
                format!("{} events of {} pixels, exact {}", a.events, a.pixels, a.exact_events),
            );
            line("", format!("F1 {:.3} (within {:.0} us)", a.f1, a.match_window_us));
            line("", format!("Victor-Purpura {:.3} per event", a.victor_purpura));
            let (median, p99) = (a.time_error_median_us, a.time_error_p99_us);
            line("", format!("time error median {median:.1} us, p99 {p99:.1} us"));
            line("", format!("exact sequences {:.1} %", 100.0 * a.exact_sequences));
        }
        text
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

    fn row(&self) -> Vec<String> {
        let us = |ns: u64| format!("{:9.1}", ns as f64 * 1e-3);
        vec![self.name.clone(), us(self.median_ns), us(self.p99_ns)]
    }
}

impl MemoryReport {
    /// What a rig uses.
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

fn kibibytes(bytes: u64) -> String {
    if bytes < NEGLIGIBLE_BYTES { String::new() } else { format!("{:8.1}", bytes as f64 / 1024.0) }
}

/// A choice by its name on the command line.
pub fn choice(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => name,
        other => panic!("a choice serialises as text, not {other:?}"),
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
    fn text_and_json_hold_the_same_figures() {
        let text = example().to_text();
        for part in ["12 (7 ON, 5 OFF)", "warp", "submit to packet", "staging", "F1 0.500", "luminance"] {
            assert!(text.contains(part), "{part} in\n{text}");
        }
        let json: serde_json::Value = serde_json::from_str(&example().to_json().unwrap()).unwrap();
        assert_eq!(json["cameras"][0]["events"], 12);
        assert_eq!(json["cameras"][0]["sensor"]["substeps"], 32);
    }
}
