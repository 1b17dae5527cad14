//! The report as text.

use super::{CameraReport, MemoryReport, Report, StageReport};
use crate::table;
use serde::Serialize;

impl Report {
    /// The report as text.
    #[must_use]
    pub fn to_text(&self) -> String {
        let device = &self.device;
        let rate = self
            .key_rate
            .as_ref()
            .map_or_else(String::new, |rate| format!(" at {} Hz ({})", rate.hz, rate.from));
        let intervals = match (self.interrupted, self.intervals_expected) {
            (true, Some(expected)) => format!("{} of {expected} intervals, interrupted", self.intervals),
            _ => format!("{} intervals", self.intervals),
        };
        let mut text = format!(
            "input     {}\ndevice    {} ({}), {}, Vulkan {}\nlink      {}\nspan      {intervals}{rate}, {:.3} s simulated\n",
            self.input,
            device.name,
            device.kind,
            device.driver,
            device.vulkan,
            self.link.to_text(),
            self.simulated_ns as f64 * 1e-9
        );
        if let Some(ros) = &self.ros {
            text.push_str(&format!("ROS 2     {}\n", ros.to_text()));
        }
        if let Some(synthesis) = &self.synthesis {
            text.push_str(&format!("synthesis {}\n", synthesis.to_text()));
        }
        if let Some(poses) = &self.poses {
            text.push_str(&format!("poses     {}\n", poses.to_text()));
        }
        if let Some(warning) = self.input_check.as_ref().and_then(|check| check.warning.as_ref()) {
            text.push_str(&format!("warning   {warning}\n"));
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

    /// A row for each purpose. A column for each camera, and one for memory that all cameras share.
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

/// The table leaves out less memory than this.
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
            sensor.synthesis.name(),
        );
        let mut line = |label: &str, value: String| text.push_str(&format!("  {label:<15}{value}\n"));
        line("events", format!("{} ({} ON, {} OFF)", self.events, self.on, self.off));
        line("dropped", self.dropped.to_string());
        if let Some(warning) = self.waiting_warning() {
            line("warning", warning);
        }
        let counted: Vec<String> =
            self.diagnostics.iter().filter(|(_, n)| **n > 0).map(|(name, n)| format!("{name} {n}")).collect();
        if !counted.is_empty() {
            line("diagnostics", counted.join(", "));
        }
        if let Some(light) = &self.light {
            line("light", light.to_string());
        }
        for warning in self.frame_warning.iter().chain(&self.path_warning).chain(&self.light_warnings) {
            line("warning", warning.clone());
        }
        for note in &self.notes {
            line("note", note.clone());
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
    fn row(&self) -> Vec<String> {
        let us = |ns: u64| format!("{:9.1}", ns as f64 * 1e-3);
        vec![self.name.clone(), us(self.median_ns), us(self.p99_ns)]
    }
}

fn kibibytes(bytes: u64) -> String {
    if bytes < NEGLIGIBLE_BYTES { String::new() } else { format!("{:8.1}", bytes as f64 / 1024.0) }
}

/// The name of a choice, as on the command line.
fn choice(value: &impl Serialize) -> String {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => name,
        other => panic!("a choice serialises as text, not {other:?}"),
    }
}
