//! Title and subtitle of the overview.

use super::RATE_HZ;
use crate::overview::Caption;
use crate::report::Report;
use esaac_scene::SceneKind;

/// Title and subtitle.
pub(super) fn caption(report: &Report, scene: SceneKind) -> Caption {
    let sensor = &report.cameras[0].sensor;
    let [one, two] = [0, 1].map(|camera| thousands(report.cameras[camera].events));
    Caption {
        title: format!(
            "EsaacSim: {} \u{d7}{}, {}",
            sensor.name.to_uppercase(),
            sensor.substeps,
            scene.name()
        ),
        subtitle: format!(
            "{}\u{d7}{} px, {RATE_HZ} Hz frames, {one} and {two} events in {:.2} s, {:.2} ms GPU time per \
             interval on {}",
            sensor.width,
            sensor.height,
            report.simulated_ns as f64 * 1e-9,
            report.gpu.median_ns as f64 * 1e-6,
            report.device.name
        ),
    }
}

/// Digits in groups of three.
fn thousands(count: u64) -> String {
    let digits = count.to_string();
    let groups: Vec<&str> = digits
        .as_bytes()
        .rchunks(3)
        .rev()
        .map(|group| std::str::from_utf8(group).expect("digits are ASCII"))
        .collect();
    groups.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped_from_the_right() {
        assert_eq!([0, 999, 1000, 1_234_567].map(thousands), ["0", "999", "1 000", "1 234 567"]);
    }
}
