//! Error against the number of sub-steps.

use crate::amount::Amount;
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::measure::Stand;
use crate::plot::{Axes, Series, draw};
use crate::scenes::FRAME_NS;
use crate::statistics::order;
use crate::truth::Truth;
use anyhow::Result;
use esaac_engine::RigOptions;
use esaac_model::{HdrFormat, SensorModel, SubstepPolicy, Synthesis, Taps};
use esaac_scene::SceneKind;
use serde::Serialize;

/// Numbers of sub-steps. The fit of the order uses those from [`FITTED_FROM`] on.
const COUNTS: [u32; 7] = [1, 2, 4, 8, 16, 32, 64];
const FITTED_FROM: u32 = 8;

/// Smooth scenes, one with solids, and those that are hard to synthesise.
const SCENES: [SceneKind; 8] = [
    SceneKind::Sinusoid,
    SceneKind::Edge,
    SceneKind::Flight,
    SceneKind::Shake,
    SceneKind::Poles,
    SceneKind::Foliage,
    SceneKind::Propeller,
    SceneKind::Bounce,
];

/// With `--quick`, only this many of [`COUNTS`].
const QUICK_COUNTS: usize = 6;

/// Number of compared intervals.
const INTERVALS: usize = 3;

fn size(laboratory: &Laboratory) -> (u32, u32) {
    if laboratory.options().quick { (80, 60) } else { (160, 120) }
}

fn counts(laboratory: &Laboratory) -> &'static [u32] {
    &COUNTS[..if laboratory.options().quick { QUICK_COUNTS } else { COUNTS.len() }]
}

#[derive(Serialize)]
struct Curve {
    scene: &'static str,
    name: &'static str,
    /// `(n, mean time error in us, Victor-Purpura distance per event)`
    points: Vec<(u32, f64, f64)>,
    /// Order of the time error, fitted from 8 sub-steps on.
    order: Option<f64>,
}

/// How the brightness between two key frames is made.
#[derive(Clone, Copy)]
enum Between {
    /// Frames rendered at n times the rate.
    Exact,
    /// A synthesis from key frames.
    Synthesis(Synthesis, Taps, u32),
}

const METHODS: [(&str, Between); 6] = [
    ("exact frames", Between::Exact),
    ("linear", Between::Synthesis(Synthesis::Linear, Taps::Cubic, 1)),
    ("motion bilinear", Between::Synthesis(Synthesis::Motion, Taps::Bilinear, 1)),
    ("motion cubic, 1 transfer", Between::Synthesis(Synthesis::Motion, Taps::Cubic, 1)),
    ("motion cubic, 2 transfers", Between::Synthesis(Synthesis::Motion, Taps::Cubic, 2)),
    ("rigid cubic, 1 transfer", Between::Synthesis(Synthesis::Rigid, Taps::Cubic, 1)),
];

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let mut document = Document::new("Convergence");
    document.say(&format!(
        "Mean error of event times (pixels whose sequence of polarities is exact) and Victor-Purpura distance \
         against N, {}x{} px, {INTERVALS} intervals, f32 input. `exact frames` are rendered at N times 30 Hz \
         and joined in log intensity, which is of second order in theory; the others make N sub-steps from key \
         frames at 30 Hz. Where their curves leave the exact one, warping has taken over and a larger N gains \
         nothing.",
        size(laboratory).0,
        size(laboratory).1
    ));
    let mut curves = Vec::new();
    for scene in SCENES {
        let of_scene = measure(laboratory, scene)?;
        show(&mut document, &of_scene, counts(laboratory))?;
        curves.extend(of_scene);
    }
    Ok(Outcome { figures: serde_json::to_value(curves)?, document })
}

fn measure(laboratory: &Laboratory, kind: SceneKind) -> Result<Vec<Curve>> {
    let size = size(laboratory);
    let base = SensorModel { width: size.0, height: size.1, ..SensorModel::default() };
    let scene = kind.scene(size.0, size.1);
    let pixels = if laboratory.options().quick { 300 } else { 1200 };
    let truth = Truth::of_scene(&scene, &base, pixels, (0, INTERVALS as i64 * FRAME_NS));
    let formats = (HdrFormat::F32x4, FORMATS.1);
    let feed = |step_ns| laboratory.feed(kind, size, formats.0, step_ns);
    let stand = |synthesis| {
        let sensor = SensorModel { synthesis, ..base.clone() };
        Stand::new(laboratory, &sensor, 1, formats, feed(FRAME_NS)?, RigOptions::default())
    };
    let (mut plain, mut posed) = (stand(Synthesis::Motion)?, stand(Synthesis::Rigid)?);
    let rows = METHODS.iter().flat_map(|m| counts(laboratory).iter().map(|n| (*m, *n))).collect();
    let measured = laboratory.rows(kind.name(), rows, |((name, between), n)| {
        let (sensor, steps) = match between {
            Between::Exact => (SensorModel { synthesis: Synthesis::None, ..base.clone() }, n as usize),
            Between::Synthesis(synthesis, taps, transfers) => {
                let substep_policy = SubstepPolicy::Fixed;
                let sensor =
                    SensorModel { synthesis, taps, transfers, substeps: n, substep_policy, ..base.clone() };
                (sensor, 1)
            }
        };
        let stand = if sensor.synthesis == Synthesis::Rigid { &mut posed } else { &mut plain };
        stand.set_sensor(&sensor)?;
        stand.set_feed(feed(FRAME_NS / steps as i64)?);
        let intervals = INTERVALS * steps;
        let run = stand.run(Amount { frames: intervals + 1, warm_up: 0, passes: 1, keep: intervals })?;
        let got = truth.compare(run.events);
        Ok((name, (n, got.ranked.mean_us, got.victor_purpura)))
    })?;
    let curve = |(name, _): &(&'static str, Between)| {
        let points: Vec<_> = measured.iter().filter(|(of, _)| of == name).map(|(_, p)| *p).collect();
        let fitted: Vec<_> =
            points.iter().filter(|p| p.0 >= FITTED_FROM).map(|p| (f64::from(p.0), p.1)).collect();
        Curve { scene: kind.name(), name, points, order: order(&fitted) }
    };
    Ok(METHODS.iter().map(curve).collect())
}

fn show(document: &mut Document, curves: &[Curve], counts: &[u32]) -> Result<()> {
    let scene = curves[0].scene;
    document.heading(&format!("`{scene}`"));
    let series: Vec<Series> = curves
        .iter()
        .map(|c| Series::curve(c.name, c.points.iter().map(|p| (f64::from(p.0), p.1)).collect()))
        .collect();
    let title = format!("{scene}: time error against sub-steps");
    let axes = Axes { title: &title, x: "N", y: "mean time error, us", logarithmic: (true, true) };
    document.plot(&format!("convergence_{scene}"), &title, draw(axes, &series)?);
    let mut head = cells!["mean us (VP)"];
    head.extend(counts.iter().map(|n| format!("N = {n}")));
    head.push("order".to_owned());
    let row = |c: &Curve| {
        let mut row = cells![c.name];
        row.extend(c.points.iter().map(|p| format!("{} ({})", short(p.1), short(p.2))));
        row.push(c.order.map_or_else(String::new, |order| format!("{order:.2}")));
        row
    };
    document.table(&std::iter::once(head).chain(curves.iter().map(row)).collect::<Vec<_>>());
    Ok(())
}
