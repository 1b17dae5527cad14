//! Speed against error: every choice is a point.

use super::choices::{Choice, choices};
use crate::amount::Amount;
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::frontier::frontier;
use crate::laboratory::Laboratory;
use crate::measure::{Stand, Timing};
use crate::plot::{Axes, Series, draw};
use crate::scenes::{FRAME_NS, Feed};
use crate::sequence::Sequence;
use crate::truth::Truth;
use anyhow::Result;
use esaac_engine::RigOptions;
use esaac_model::packet::Event;
use esaac_model::synthesis::TRANSFERS_BY_PATHS;
use esaac_model::{HdrFormat, MotionFormat, SensorModel, Synthesis};
use esaac_oracle::metrics::{Comparison, compare};
use esaac_scene::SceneKind;
use serde::Serialize;

#[derive(Serialize)]
struct Point {
    choice: String,
    family: &'static str,
    gpu_us: f64,
    gpu_spread: f64,
    moved_mb: f64,
    substeps_per_block: f64,
    events_per_truth: f64,
    f1: f64,
    victor_purpura: f64,
    time_p99_us: f64,
    exact_sequences: f64,
    on_frontier: bool,
    is_default: bool,
}

#[derive(Serialize)]
struct SceneFigures {
    scene: String,
    width_px: u32,
    height_px: u32,
    pixels_compared: usize,
    true_events: usize,
    default_on_frontier: bool,
    /// Choices that are better than the default; empty if the default is on the frontier.
    better_than_default: Vec<String>,
    points: Vec<Point>,
}

/// Victor-Purpura distances that differ by less count as equal. Another sampling seed of the renderer moves them by
/// twice as much.
const ERROR_BAND: f64 = 0.005;

/// Times that differ by a smaller share count as equal. Part `stability` measures this noise.
const TIME_BAND: f64 = 0.03;

/// Largest distance between quartiles, as a share of the median, of an even run. In an uneven run the intervals differ,
/// or other programs used the device.
const EVEN_SPREAD: f64 = 0.3;

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let mut document = Document::new("Speed against error");
    document.say(
        "Each point is a choice. x: mean GPU time of an interval; the table adds bytes moved (counted). y: \
         Victor-Purpura distance per true event, 1 ms of shift costing as much as an event; the table adds the \
         99th percentile of the time error of events that match within 1 ms. Sensor without noise. A choice \
         is on the frontier if no other is faster and as good, or better and as fast, by more than the noise. The \
         default is that of frames with motion vectors; `rigid` needs depth and poses, 960 a second unless it says \
         otherwise.",
    );
    // What is wrong with the sequence is told before the scenes take their minutes.
    let of_sequence = match &laboratory.options().sequence {
        Some(folder) => Some(rendered(laboratory, &Sequence::open(folder)?)?),
        None => None,
    };
    let mut all = Vec::new();
    let scenes: &[SceneKind] = if laboratory.options().quick {
        &[SceneKind::Flight]
    } else {
        &[
            SceneKind::Edge,
            SceneKind::Sinusoid,
            SceneKind::Lamp,
            SceneKind::Flight,
            SceneKind::Hdr,
            SceneKind::Dark,
            SceneKind::Shake,
            SceneKind::Poles,
            SceneKind::Foliage,
            SceneKind::Propeller,
            SceneKind::Bounce,
        ]
    };
    for &scene in scenes {
        let figures = analytic(laboratory, scene)?;
        show(&mut document, &figures)?;
        all.push(figures);
    }
    match of_sequence {
        Some(figures) => {
            show(&mut document, &figures)?;
            all.push(figures);
        }
        None => document.say("**A rendered sequence is left out:** `--sequence DIR` names one."),
    }
    Ok(Outcome { figures: serde_json::to_value(all)?, document })
}

fn measure(
    laboratory: &Laboratory,
    what: &str,
    base: &SensorModel,
    amount: Amount,
    narrowest: HdrFormat,
    feed: impl Fn(HdrFormat) -> Result<Feed>,
    judge: impl Fn(Vec<Event>) -> Comparison + Sync,
) -> Result<Vec<Point>> {
    let stand = |hdr: HdrFormat, synthesis: Synthesis| {
        let formats: (HdrFormat, MotionFormat) = (hdr, FORMATS.1);
        let sensor = SensorModel { synthesis, ..base.clone() };
        Stand::new(laboratory, &sensor, 1, formats, feed(hdr)?, RigOptions::default())
    };
    let mut narrow = stand(narrowest, base.synthesis)?;
    // Frames of f32 have no narrower form beside which these would be a choice.
    let mut wide = match narrowest {
        HdrFormat::F32x4 => None,
        _ => Some(stand(HdrFormat::F32x4, base.synthesis)?),
    };
    // A rig that takes depth and poses of its own, so that the other choices cost what they cost without.
    let mut posed = match feed(narrowest)?.geometry() {
        Some(_) => Some(stand(narrowest, Synthesis::Rigid)?),
        None => None,
    };
    let choices: Vec<Choice> = choices(base, laboratory.options().quick, posed.is_some())
        .into_iter()
        .filter(|choice| wide.is_some() || !choice.wide)
        .filter(|choice| laboratory.wants(&choice.name) || choice.is_default)
        .collect();
    let measured = laboratory.rows(what, choices, |choice| {
        let stand = match (&mut posed, &mut wide) {
            (Some(posed), _) if choice.sensor.synthesis == Synthesis::Rigid => posed,
            (_, Some(wide)) if choice.wide => wide,
            _ => &mut narrow,
        };
        stand.set_sensor(&choice.sensor)?;
        let run = stand.run(amount)?;
        Ok((run.events, run.timing, choice))
    })?;
    let mut points = judged(measured, judge);
    mark_frontier(&mut points);
    Ok(points)
}

fn mark_frontier(points: &mut [Point]) {
    let costs: Vec<_> = points.iter().map(|p| (p.gpu_us, p.victor_purpura)).collect();
    for (point, on) in points.iter_mut().zip(frontier(&costs, TIME_BAND, ERROR_BAND)) {
        point.on_frontier = on;
    }
}

/// Compares each choice's events with the truth, on all threads of the machine.
fn judged(
    measured: Vec<(Vec<Event>, Timing, Choice)>,
    judge: impl Fn(Vec<Event>) -> Comparison + Sync,
) -> Vec<Point> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let queue = std::sync::Mutex::new(measured.into_iter().enumerate());
    let next = || queue.lock().unwrap_or_else(std::sync::PoisonError::into_inner).next();
    let work = || {
        let mut done = Vec::new();
        while let Some((index, (events, timing, choice))) = next() {
            done.push((index, point(judge(events), timing, choice)));
        }
        done
    };
    let mut points: Vec<(usize, Point)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().flat_map(|w| w.join().expect("comparing is plain arithmetic")).collect()
    });
    points.sort_by_key(|(index, _)| *index);
    points.into_iter().map(|(_, point)| point).collect()
}

fn point(got: Comparison, timing: Timing, choice: Choice) -> Point {
    Point {
        choice: choice.name,
        family: choice.family,
        gpu_us: timing.gpu_mean_us,
        gpu_spread: timing.gpu_us.relative(),
        moved_mb: timing.moved_mb,
        substeps_per_block: timing.substeps_per_block,
        events_per_truth: got.count_ratio,
        f1: got.f1,
        victor_purpura: got.victor_purpura,
        time_p99_us: got.matched.p99_us,
        exact_sequences: got.same_sequence,
        on_frontier: false,
        is_default: choice.is_default,
    }
}

fn analytic(laboratory: &Laboratory, kind: SceneKind) -> Result<SceneFigures> {
    let (quick, software) = (laboratory.options().quick, laboratory.is_software());
    let (width, height) = if software { (120, 90) } else { (320, 320) };
    let base = SensorModel { width, height, ..SensorModel::default() };
    let (pixels, intervals) = if quick { (300, 4) } else { (1200, 6) };
    let amount = amount(laboratory, intervals);
    let span_ns = (0, intervals as i64 * FRAME_NS);
    let truth = Truth::of_scene(&kind.scene(width, height), &base, pixels, span_ns);
    let feed = |hdr| laboratory.feed(kind, (width, height), hdr, FRAME_NS);
    let judge = |events| truth.compare(events);
    let points = measure(laboratory, kind.name(), &base, amount, FORMATS.0, feed, judge)?;
    Ok(figures(kind.name(), (width, height), (truth.pixels(), truth.events()), points))
}

/// Half of the timed intervals of other parts, because there are hundreds of points.
fn amount(laboratory: &Laboratory, intervals: usize) -> Amount {
    let amount = laboratory.amount();
    let timed = (amount.frames - amount.warm_up).div_ceil(2);
    Amount { frames: (amount.warm_up + timed).max(intervals + 1), keep: intervals, ..amount }
}

fn rendered(laboratory: &Laboratory, sequence: &Sequence) -> Result<SceneFigures> {
    let (base, truth) = (&sequence.truth.sensor, &sequence.truth.events);
    let size = (base.width, base.height);
    let timed = laboratory.amount();
    let most = match (laboratory.is_software(), laboratory.options().quick) {
        (true, true) => 1,
        (true, false) => 2,
        (false, _) => 8,
    };
    let passes = timed.frames.div_ceil(sequence.intervals()).min(most);
    let frames = sequence.intervals() + 1;
    let amount = Amount { frames, warm_up: 1, passes, keep: sequence.intervals() };
    let feed = |hdr| Ok(Feed::Stored(sequence.frames(hdr)?, sequence.motion(1)));
    let judge = |events: Vec<Event>| compare(size, truth.iter().copied(), events);
    let mut points = measure(laboratory, &sequence.name, base, amount, sequence.hdr, feed, judge)?;
    points.extend(with_fewer_poses(laboratory, sequence, amount)?);
    mark_frontier(&mut points);
    Ok(figures(&sequence.name, size, (base.pixels(), truth.len()), points))
}

/// Every so many poses of a sequence are left, in turn.
const POSE_STEPS: [usize; 3] = [4, 8, 16];

/// Exact paths from fewer poses than the sequence has.
fn with_fewer_poses(laboratory: &Laboratory, sequence: &Sequence, amount: Amount) -> Result<Vec<Point>> {
    let truth = &sequence.truth;
    let (synthesis, transfers) = (Synthesis::Rigid, TRANSFERS_BY_PATHS);
    let sensor = SensorModel { synthesis, transfers, ..truth.sensor.clone() };
    let size = (sensor.width, sensor.height);
    let rate_hz = sequence.pose_rate_hz().unwrap_or_default();
    let name = |step: usize| {
        format!(
            "rigid cubic, {} transfers, adaptive {}, {:.0} poses a second",
            sensor.detail_transfers(),
            sensor.substeps,
            rate_hz / step as f64
        )
    };
    let rows = POSE_STEPS.into_iter().filter(|&step| laboratory.wants(&name(step)));
    let rows: Vec<_> = rows.filter_map(|step| Some((step, sequence.motion(step)?))).collect();
    let measured = laboratory.rows(&sequence.name, rows, |(step, motion)| {
        let hdr = sequence.hdr;
        let feed = Feed::Stored(sequence.frames(hdr)?, Some(motion));
        let run =
            Stand::new(laboratory, &sensor, 1, (hdr, FORMATS.1), feed, RigOptions::default())?.run(amount)?;
        let choice = Choice {
            name: name(step),
            family: "rigid, fewer poses",
            sensor: sensor.clone(),
            wide: false,
            is_default: false,
        };
        Ok((run.events, run.timing, choice))
    })?;
    Ok(judged(measured, |events| compare(size, truth.events.iter().copied(), events)))
}

fn figures(
    scene: &str,
    (width_px, height_px): (u32, u32),
    (pixels_compared, true_events): (usize, usize),
    points: Vec<Point>,
) -> SceneFigures {
    let default = points.iter().find(|p| p.is_default);
    let default_on_frontier = default.is_some_and(|p| p.on_frontier);
    let better_than_default = default
        .filter(|p| !p.on_frontier)
        .map(|d| {
            let pairs: Vec<_> = points.iter().map(|p| (p.gpu_us, p.victor_purpura)).collect();
            let index = points.iter().position(|p| p.is_default).unwrap_or(0);
            let beats = |i: &usize| {
                let alone = frontier(&[pairs[*i], pairs[index]], TIME_BAND, ERROR_BAND);
                points[*i].choice != d.choice && !alone[1]
            };
            (0..points.len()).filter(beats).map(|i| points[i].choice.clone()).collect()
        })
        .unwrap_or_default();
    let scene = scene.to_owned();
    SceneFigures {
        scene,
        width_px,
        height_px,
        pixels_compared,
        true_events,
        default_on_frontier,
        better_than_default,
        points,
    }
}

fn show(document: &mut Document, figures: &SceneFigures) -> Result<()> {
    let SceneFigures { scene, points, .. } = figures;
    document.heading(&format!("`{scene}`, {}x{}", figures.width_px, figures.height_px));
    let mut series: Vec<Series> = Vec::new();
    for p in points {
        let at = (p.gpu_us, p.victor_purpura);
        match series.iter_mut().find(|s| s.name == p.family) {
            Some(series) => series.points.push(at),
            None => series.push(Series::scatter(p.family, vec![at])),
        }
    }
    let mut on: Vec<(f64, f64)> =
        points.iter().filter(|p| p.on_frontier).map(|p| (p.gpu_us, p.victor_purpura)).collect();
    on.sort_by(|a, b| a.0.total_cmp(&b.0));
    series.push(Series::path("frontier", on));
    let title = format!("{scene}: speed against error");
    let axes = Axes {
        title: &title,
        x: "GPU time per interval, us",
        y: "Victor-Purpura per true event",
        logarithmic: (true, true),
    };
    document.plot(&format!("frontier_{scene}"), &title, draw(axes, &series)?);
    let on_frontier = |name: &&String| points.iter().any(|p| p.on_frontier && p.choice == **name);
    let mut better: Vec<&String> = figures.better_than_default.iter().filter(on_frontier).collect();
    if better.is_empty() {
        // Within the bands, what beats a better choice need not beat the default.
        better.extend(&figures.better_than_default);
    }
    let better: Vec<&str> = better.into_iter().map(String::as_str).collect();
    document.say(&if figures.default_on_frontier {
        "The default lies on the frontier.".to_owned()
    } else {
        format!("**The default does not lie on the frontier.** Better: {}.", better.join("; "))
    });
    let worst = points.iter().map(|p| p.gpu_spread).fold(0.0, f64::max);
    if worst > EVEN_SPREAD {
        document.say(&format!(
            "The quartiles of these times lie up to {:.0}% apart: intervals differ, as where all pixels cross at \
             once, or other work was on the device. The first lines of the report say whether its clock was steady.",
            100.0 * worst
        ));
    }
    let head = cells![
        "choice",
        "GPU us",
        "+-",
        "MB moved",
        "sub-steps",
        "events / truth",
        "F1",
        "VP",
        "p99 us",
        "frontier"
    ];
    let row = |p: &Point| {
        let name = if p.is_default { format!("**{} (default)**", p.choice) } else { p.choice.clone() };
        cells![
            name,
            short(p.gpu_us),
            format!("{:.0}%", 100.0 * p.gpu_spread),
            short(p.moved_mb),
            short(p.substeps_per_block),
            short(p.events_per_truth),
            short(p.f1),
            short(p.victor_purpura),
            short(p.time_p99_us),
            if p.on_frontier { "yes" } else { "" }
        ]
    };
    document.table(&std::iter::once(head).chain(points.iter().map(row)).collect::<Vec<_>>());
    Ok(())
}
