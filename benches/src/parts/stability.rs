//! The bench itself: how much two runs of the same version differ, and whether the comparators see known faults.

use super::sensors::noisy;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::measure::Stand;
use crate::scenes::FRAME_NS;
#[cfg(feature = "tracy")]
use crate::statistics::median;
use crate::streams::FAULTS;
use crate::{cells, measure};
use anyhow::{Result, ensure};
use esaac_engine::RigOptions;
use esaac_model::SensorModel;
use esaac_model::packet::Event;
use esaac_oracle::metrics::{Comparison, compare};
use esaac_scene::{SceneKind, all_pixels, exact_events};
use serde::Serialize;

/// Rounds of the same measurement.
const ROUNDS: usize = 7;
const QUICK_ROUNDS: usize = 3;

#[derive(Serialize)]
struct Band {
    sensor: String,
    /// Median GPU time of each round, microseconds.
    rounds_us: Vec<f64>,
    /// Largest difference of two rounds as a share of the least time. Smaller differences mean nothing.
    noise_band: f64,
    /// The same for the host's median time from submit to packet.
    packet_noise_band: f64,
}

#[derive(Serialize)]
struct Seen {
    fault: &'static str,
    count_ratio: f64,
    f1: f64,
    victor_purpura: f64,
    time_mean_us: f64,
    same_sequence: f64,
    exact_channels: f64,
    /// Measures that show the fault by more than a hundredth of their range.
    seen_by: Vec<&'static str>,
}

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let mut document = Document::new("Stability of the bench");
    let rounds = if laboratory.options().quick { QUICK_ROUNDS } else { ROUNDS };
    let sensors = if laboratory.is_software() { vec!["dvs128"] } else { vec!["dvs128", "genx320", "vga"] };
    let bands: Vec<Band> =
        sensors.into_iter().map(|name| band(laboratory, name, rounds)).collect::<Result<_>>()?;
    document.say(&format!(
        "The same version, {rounds} times, each with a rig of its own. The band is the largest difference of two \
         rounds: a difference between rows that is smaller means nothing."
    ));
    let mut table = vec![cells!["sensor", "rounds, GPU us", "noise band", "submit to packet"]];
    for band in &bands {
        let rounds: Vec<String> = band.rounds_us.iter().map(|us| short(*us)).collect();
        let percent = |share: f64| format!("{:.1}%", 100.0 * share);
        table.push(cells![
            band.sensor,
            rounds.join(" "),
            percent(band.noise_band),
            percent(band.packet_noise_band)
        ]);
    }
    document.table(&table);

    let seen = faults()?;
    document
        .say("Comparators on the exact events of `sinusoid`, 64x48, with known faults. Each must be seen.");
    let mut table = vec![cells!["fault", "count", "F1", "VP", "mean us", "sequences", "channels", "seen by"]];
    for s in &seen {
        table.push(cells![
            s.fault,
            short(s.count_ratio),
            short(s.f1),
            short(s.victor_purpura),
            short(s.time_mean_us),
            short(s.same_sequence),
            short(s.exact_channels),
            s.seen_by.join(", ")
        ]);
    }
    document.table(&table);
    let figures =
        serde_json::json!({ "bands": bands, "faults": seen, "tracy": tracy(laboratory, &mut document)? });
    Ok(Outcome { figures, document })
}

fn band(laboratory: &Laboratory, name: &str, rounds: usize) -> Result<Band> {
    let sensor = noisy(name);
    let rounds = laboratory.rows("stability", vec![(); rounds], |()| flight(laboratory, &sensor))?;
    let spread = |of: &dyn Fn(&measure::Timing) -> f64| {
        let (least, most) =
            rounds.iter().map(of).fold((f64::INFINITY, 0.0_f64), |(l, m), v| (l.min(v), m.max(v)));
        most / least - 1.0
    };
    Ok(Band {
        sensor: name.to_owned(),
        noise_band: spread(&|t| t.gpu_us.median),
        packet_noise_band: spread(&|t| t.packet_us.median),
        rounds_us: rounds.iter().map(|t| t.gpu_us.median).collect(),
    })
}

fn flight(laboratory: &Laboratory, sensor: &SensorModel) -> Result<measure::Timing> {
    let feed = laboratory.scene(SceneKind::Flight, (sensor.width, sensor.height))?;
    let mut stand = Stand::new(laboratory, sensor, 1, FORMATS, feed, RigOptions::default())?;
    Ok(stand.run(laboratory.amount())?.timing)
}

/// Runs the comparators on each known fault. Fails if no measure sees a fault.
fn faults() -> Result<Vec<Seen>> {
    let sensor = SensorModel { width: 64, height: 48, ..SensorModel::default() };
    let size = (sensor.width, sensor.height);
    let scene = SceneKind::Sinusoid.scene(size.0, size.1);
    let pixels: Vec<_> = all_pixels(&scene).collect();
    let exact = exact_events(&scene, &sensor, &pixels, 0, 3 * FRAME_NS);
    let mut exact: Vec<Event> = exact.into_iter().flatten().collect();
    exact.sort_unstable();
    let itself = judge("nothing", compare(size, exact.iter().copied(), exact.iter().copied()));
    ensure!(itself.seen_by.is_empty(), "a stream differs from itself by {}", itself.seen_by.join(", "));
    FAULTS
        .iter()
        .map(|fault| {
            let bad = (fault.apply)(&exact, size.0);
            let seen = judge(fault.name, compare(size, exact.iter().copied(), bad));
            ensure!(!seen.seen_by.is_empty(), "no comparator sees `{}`", fault.name);
            Ok(seen)
        })
        .collect()
}

fn judge(fault: &'static str, got: Comparison) -> Seen {
    const TELLING: f64 = 0.01;
    let measures = [
        ("count", (got.count_ratio - 1.0).abs()),
        ("F1", 1.0 - got.f1),
        ("VP", got.victor_purpura),
        ("mean us", got.matched.mean_us / 1e3),
        ("sequences", 1.0 - got.same_sequence),
        ("channels", 1.0 - got.exact_channels),
    ];
    Seen {
        fault,
        count_ratio: got.count_ratio,
        f1: got.f1,
        victor_purpura: got.victor_purpura,
        time_mean_us: got.matched.mean_us,
        same_sequence: got.same_sequence,
        exact_channels: got.exact_channels,
        seen_by: measures.iter().filter(|m| m.1 > TELLING).map(|m| m.0).collect(),
    }
}

/// The cost of the profiler's zones. Without the feature there are none.
#[cfg(not(feature = "tracy"))]
fn tracy(_: &Laboratory, document: &mut Document) -> Result<Option<()>> {
    document.say("Built without the feature `tracy`: there is no zone, plot or message in the program.");
    Ok(None)
}

/// The cost of the profiler's zones: medians without and with a connected profiler, of rounds by turns in one rig.
#[cfg(feature = "tracy")]
#[derive(Serialize)]
struct Profiled {
    gpu_us: [f64; 2],
    packet_us: [f64; 2],
    read_bytes: usize,
}

#[cfg(feature = "tracy")]
fn tracy(laboratory: &Laboratory, document: &mut Document) -> Result<Option<Profiled>> {
    let sensor = noisy(if laboratory.is_software() { "dvs128" } else { "genx320" });
    let feed = laboratory.scene(SceneKind::Flight, (sensor.width, sensor.height))?;
    let mut stand = Stand::new(laboratory, &sensor, 1, FORMATS, feed, RigOptions::default())?;
    let rounds = if laboratory.options().quick { QUICK_ROUNDS } else { ROUNDS };
    let mut seen: [Vec<measure::Timing>; 2] = Default::default();
    let mut read_bytes = 0;
    for _ in 0..rounds {
        seen[0].push(stand.run(laboratory.amount())?.timing);
        let peer = crate::tracy_peer::Peer::connect()?;
        seen[1].push(stand.run(laboratory.amount())?.timing);
        read_bytes += peer.finish()?;
    }
    let middle = |of: fn(&measure::Timing) -> f64| {
        seen.each_ref().map(|rounds| median(&rounds.iter().map(of).collect::<Vec<_>>()))
    };
    let (gpu_us, packet_us) = (middle(|t| t.gpu_us.median), middle(|t| t.packet_us.median));
    document.say(&format!(
        "Built with the feature `tracy`, {}, medians of {rounds} rounds by turns; the profiler that was connected \
         took {} kB a round.",
        sensor.name,
        read_bytes / rounds / 1000
    ));
    document.table(&[
        cells!["profiler", "GPU us", "submit to packet p50 us"],
        cells!["not connected", short(gpu_us[0]), short(packet_us[0])],
        cells!["connected", short(gpu_us[1]), short(packet_us[1])],
        cells!["ratio", short(gpu_us[1] / gpu_us[0]), short(packet_us[1] / packet_us[0])],
    ]);
    Ok(Some(Profiled { gpu_us, packet_us, read_bytes }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_known_fault_is_seen_and_by_the_measures_that_should() {
        let seen = faults().unwrap();
        let by = |fault: &str| &seen.iter().find(|s| s.fault == fault).unwrap().seen_by;
        assert_eq!(seen.len(), FAULTS.len());
        assert!(by("polarities swapped").contains(&"F1") && !by("polarities swapped").contains(&"count"));
        assert!(by("a tenth missing").contains(&"count") && by("a tenth doubled").contains(&"count"));
        assert!(by("300 us late").contains(&"VP") && !by("300 us late").contains(&"channels"));
        assert!(by("times on a grid of 1 ms").contains(&"mean us"));
        assert!(by("one pixel to the right").contains(&"F1"));
        assert!(by("one event in a hundred noise").contains(&"channels"));
    }
}
