//! Simulated events against a real sensor's. The part simulates a recording's frames and compares the two streams.
//! Beside each figure stands its floor: the difference between two halves of the recording itself.

use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::laboratory::Laboratory;
use crate::statistics::{kolmogorov_smirnov, mean, wasserstein};
use anyhow::Result;
use esaac_calibrate::physical::fit_scene;
use esaac_calibrate::{Fit, estimate, fit, simulate};
use esaac_formats::recording::{Recording, aedat4};
use esaac_model::packet::Event;
use esaac_model::presets::{LOG_OFFSET_HDR, preset_with_physical_pixel};
use esaac_model::{Polarity, SensorModel};
use serde::Serialize;

/// Focal-plane light of the frames' full scale, lux: not known, so that of a bright day.
const WHITE_LUX: f64 = 100.0;

/// Statistics of one stream.
struct Stream {
    events: usize,
    on_off_ratio: f64,
    rates_hz: Vec<f64>,
    gaps_log: Vec<f64>,
    stamps_per_ms: f64,
}

/// A stream compared with the recording.
#[derive(Serialize)]
struct Row {
    stream: String,
    events: usize,
    on_off_ratio: f64,
    /// Number of events over the recording's.
    count_ratio: f64,
    /// Kolmogorov-Smirnov distance of the pixels' event rates.
    rate_ks: f64,
    /// Mean of ln(rate + 1 Hz) minus the recording's mean.
    rate_log_ratio: f64,
    /// First Wasserstein distance of ln(time between two events of a pixel).
    gap_w1_log: f64,
    /// Mean number of different time stamps in a millisecond, over milliseconds that have events.
    stamps_per_ms: f64,
    /// Correlation of the change of log APS with `C_on n_on - C_off n_off`.
    aps_correlation: f64,
    fitted_on: f64,
    fitted_off: f64,
}

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let mut document = Document::new("Against a real sensor");
    let Some(path) = &laboratory.options().recording else {
        document.say("**Left out:** `--recording FILE.aedat4` names a recording.");
        return Ok(Outcome { figures: serde_json::Value::Null, document });
    };
    let recording = aedat4::read(path)?;
    let fit = fit(laboratory.device(), &recording, LOG_OFFSET_HDR)?;
    let mut rows = Vec::new();
    let real = recording.events_between_frames();
    let (even, odd) = checkerboard(real);
    rows.push(row("the recording", &recording, real, real)?);
    rows.push(row("half of its pixels against the other half", &half_of(&recording), &even, &odd)?);
    let plain = SensorModel { name: "default".into(), ..uncalibrated(&fit) };
    let without_noise = SensorModel {
        contrast_mismatch: 0.0,
        leak_rate_hz: 0.0,
        shot_noise_rate_hz: 0.0,
        ..fit.sensor.clone()
    };
    let guess = preset_with_physical_pixel("davis346").expect("a preset");
    let guess = SensorModel { lux_per_unit: WHITE_LUX, ..guess };
    let physical = fit_scene(laboratory.device(), &recording, LOG_OFFSET_HDR, &guess)?;
    let runs = vec![
        ("simulated, default sensor", plain),
        ("simulated, calibrated thresholds alone", without_noise),
        ("simulated, calibrated", fit.sensor.clone()),
        ("simulated, calibrated physical pixel", physical.clone()),
    ];
    rows.extend(laboratory.rows("real sensor", runs, |(name, sensor)| {
        let events = simulate(laboratory.device(), &recording, &sensor)?;
        row(name, &recording, &events, real)
    })?);
    show(&mut document, &recording, &fit, &rows);
    document.say(&format!(
        "The physical pixel, if full scale is {WHITE_LUX} lux: C_on {:.3}, C_off {:.3}, mismatch {:.3}, leak {:.2} Hz, \
         refractory period {} us, charge {:.0} e; the rest is that of `davis346`.",
        physical.contrast_on,
        physical.contrast_off,
        physical.contrast_mismatch,
        physical.leak_rate_hz,
        short(f64::from(physical.refractory_ns) * 1e-3),
        physical.photoreceptor_charge_e
    ));
    let figures = serde_json::json!({ "fit": fit, "physical": physical, "rows": rows });
    Ok(Outcome { figures, document })
}

/// The default sensor with the recording's size.
fn uncalibrated(fit: &Fit) -> SensorModel {
    let fitted = &fit.sensor;
    SensorModel {
        width: fitted.width,
        height: fitted.height,
        intensity: fitted.intensity,
        log_offset: fitted.log_offset,
        timestamp_quantum_ns: fitted.timestamp_quantum_ns,
        ..SensorModel::default()
    }
}

/// Splits events by pixel, like the white and the black fields of a chessboard. Both halves see the same scene.
fn checkerboard(events: &[Event]) -> (Vec<Event>, Vec<Event>) {
    events.iter().partition(|e| (e.x + e.y) % 2 == 0)
}

/// The recording's frames with only the white fields valid. NaN marks the others.
fn half_of(recording: &Recording) -> Recording {
    let width = recording.width_px as usize;
    let mut half = recording.clone();
    for frame in &mut half.frames {
        for (i, value) in frame.pixels.iter_mut().enumerate() {
            if (i % width + i / width) % 2 == 1 {
                *value = f32::NAN;
            }
        }
    }
    half
}

fn stream(recording: &Recording, events: &[Event]) -> Stream {
    let width = recording.width_px as usize;
    let pixels = width * recording.height_px as usize;
    let frames = &recording.frames;
    let seconds = (frames[frames.len() - 1].middle_ns() - frames[0].middle_ns()) as f64 * 1e-9;
    let mut counts = vec![0_u32; pixels];
    let mut last_ns = vec![None; pixels];
    let mut gaps_log = Vec::new();
    let mut stamps = 0_u64;
    let mut milliseconds = 0_u64;
    let mut previous: Option<i64> = None;
    let on = events.iter().filter(|e| e.polarity == Polarity::On).count();
    for event in events {
        let pixel = usize::from(event.y) * width + usize::from(event.x);
        counts[pixel] += 1;
        if let Some(last) = last_ns[pixel].replace(event.t_ns) {
            // The recording's clock ticks in microseconds, so shorter gaps count as one microsecond.
            gaps_log.push(((event.t_ns - last).max(1_000) as f64).ln());
        }
        let ms = |t_ns: i64| t_ns.div_euclid(1_000_000);
        stamps += u64::from(previous != Some(event.t_ns));
        milliseconds += u64::from(previous.is_none_or(|p| ms(p) != ms(event.t_ns)));
        previous = Some(event.t_ns);
    }
    Stream {
        events: events.len(),
        on_off_ratio: on as f64 / (events.len() - on).max(1) as f64,
        rates_hz: counts.iter().map(|&n| f64::from(n) / seconds).collect(),
        gaps_log,
        stamps_per_ms: stamps as f64 / milliseconds.max(1) as f64,
    }
}

/// Compares `events` with `against`. If the two are the halves of a chessboard, each half's rates include its own
/// pixels only.
fn row(name: &str, recording: &Recording, events: &[Event], against: &[Event]) -> Result<Row> {
    let (tested, real) = (stream(recording, events), stream(recording, against));
    let is_half = tested.events + real.events == recording.events_between_frames().len();
    let width = recording.width_px as usize;
    let own = |rates: &[f64], parity: usize| -> Vec<f64> {
        let field = |i: usize| (i % width + i / width) % 2 == parity;
        rates.iter().enumerate().filter(|(i, _)| !is_half || field(*i)).map(|(_, r)| *r).collect()
    };
    let (rates, real_rates) = (own(&tested.rates_hz, 0), own(&real.rates_hz, 1));
    let log_mean = |rates: &[f64]| mean(&rates.iter().map(|r| (r + 1.0).ln()).collect::<Vec<_>>());
    let fitted = estimate(recording, events, LOG_OFFSET_HDR)?;
    Ok(Row {
        stream: name.to_owned(),
        events: tested.events,
        on_off_ratio: tested.on_off_ratio,
        count_ratio: tested.events as f64 / real.events.max(1) as f64,
        rate_ks: kolmogorov_smirnov(&rates, &real_rates),
        rate_log_ratio: log_mean(&rates) - log_mean(&real_rates),
        gap_w1_log: wasserstein(&tested.gaps_log, &real.gaps_log),
        stamps_per_ms: tested.stamps_per_ms,
        aps_correlation: fitted.correlation,
        fitted_on: fitted.contrast_on,
        fitted_off: fitted.contrast_off,
    })
}

fn show(document: &mut Document, recording: &Recording, fit: &Fit, rows: &[Row]) {
    let sensor = &fit.sensor;
    document.say(&format!(
        "{} {}x{}, {} events, {} APS frames. Simulated from its APS frames, each at the middle of its exposure, \
         blended in between: frames 40 ms apart with an exposure of 20 ms show neither what moves on between them \
         nor what the exposure smears, and no motion vectors mend that. The second row is the floor: the \
         recording's pixels like the white fields of a chessboard against the black ones.",
        recording.name,
        recording.width_px,
        recording.height_px,
        recording.events.len(),
        recording.frames.len()
    ));
    let mut table = vec![cells![
        "stream",
        "events",
        "/ real",
        "ON / OFF",
        "rate KS",
        "rate log-ratio",
        "gap W1, log",
        "stamps a ms",
        "corr. with d log APS",
        "sums' C_on, C_off"
    ]];
    for r in rows {
        table.push(cells![
            r.stream,
            r.events,
            short(r.count_ratio),
            short(r.on_off_ratio),
            short(r.rate_ks),
            short(r.rate_log_ratio),
            short(r.gap_w1_log),
            short(r.stamps_per_ms),
            short(r.aps_correlation),
            format!("{}, {}", short(r.fitted_on), short(r.fitted_off))
        ]);
    }
    document.table(&table);
    document.say(&format!(
        "Calibrated: C_on {:.3}, C_off {:.3}, mismatch {:.3}, leak {:.2} Hz, shot noise {:.2} Hz ({:.0} \
         pixel-seconds stand still). {}",
        sensor.contrast_on,
        sensor.contrast_off,
        sensor.contrast_mismatch,
        sensor.leak_rate_hz,
        sensor.shot_noise_rate_hz,
        fit.still.pixel_s,
        fit.remarks.join(". ")
    ));
}
