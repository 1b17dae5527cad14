//! Judges a case: the engine against the oracle, against itself, and by what holds of any packet.

use crate::behind;
use crate::case::{Case, Change};
use crate::findings::Findings;
use crate::images::{View, views};
use crate::levels::{POSITION_PX, check_aps, far_levels, level_tolerance_log};
use crate::play::{Played, Steps, play, play_alone, same};
use crate::reference::{
    Run, Taken, events, follows_vectors, foretells_light, has_noise, runs, stretches, without_noise,
};
use esaac_model::packet::Event;
use esaac_model::{Pixel, Polarity, SensorModel, SubstepPolicy, Synthesis};
use esaac_oracle::stamp::{base_ns, complete_before, watermark_ns};
use esaac_tests::agreement::{
    Agreement, Perturbation, Reference, Stamps, by_pixel, moved_vectors, perturbations, polarities,
};
use esaac_tests::run::Step;
use std::cell::LazyCell;

/// How a run is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A log pixel, one surface in each pixel: every difference must be explained.
    Plain,
    /// A log pixel whose surfaces are told apart by tests of depth and of motion, which fall the other way by rounding here
    /// and there.
    Surfaces,
    /// A physical pixel without noise: the engine's photoreceptor is an approximation.
    Physical,
}

impl Kind {
    pub const ALL: [Kind; 3] = [Kind::Plain, Kind::Surfaces, Kind::Physical];

    /// How a run with this sensor is compared.
    pub fn of_sensor(sensor: &SensorModel) -> Kind {
        match (sensor.pixel, sensor.synthesis) {
            (Pixel::Physical, _) => Kind::Physical,
            (_, Synthesis::Rigid | Synthesis::Auto) => Kind::Surfaces,
            (_, Synthesis::Motion) if sensor.layers != 1 => Kind::Surfaces,
            _ => Kind::Plain,
        }
    }

    /// Largest share of pixels, over all cases, with another sequence of polarities.
    fn most_differing(self) -> f64 {
        match self {
            // A requirement.
            Kind::Plain | Kind::Surfaces => 1e-4,
            Kind::Physical => 5e-3,
        }
    }

    /// Largest share of levels, over all cases, that are far from the oracle's.
    fn most_far(self) -> f64 {
        match self {
            Kind::Plain => 0.0,
            Kind::Surfaces | Kind::Physical => 2e-4,
        }
    }

    /// Pixels, events or levels of one run that may differ of so many. What differs in a run lies together, so that the share
    /// over all cases is smaller.
    pub fn most_in_a_run(self, of: usize) -> usize {
        match self {
            Kind::Plain => 0,
            Kind::Surfaces | Kind::Physical => 3 + of / 200,
        }
    }

    /// Pixels that may differ besides: one that sends many events is as often near a threshold. In one that sends hundreds,
    /// there may be two ties, which no moved threshold explains at once.
    fn ties(self, tally: Tally) -> usize {
        tally.events / if self == Kind::Physical { 2_000 } else { 50_000 }
    }

    /// Whether the differences over all cases are few enough. One pixel may differ, however few there are.
    pub fn allows(self, tally: Tally) -> bool {
        let most = |share: f64, of: usize| (share * of as f64).ceil() as usize;
        tally.differing <= most(self.most_differing(), tally.pixels) + self.ties(tally)
            && tally.far <= most(self.most_far(), tally.levels)
    }
}

/// How often engine and oracle differ.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    pub runs: usize,
    pub pixels: usize,
    pub differing: usize,
    pub events: usize,
    /// Log intensities.
    pub levels: usize,
    pub far: usize,
}

impl Tally {
    pub fn add(&mut self, other: Tally) {
        self.runs += other.runs;
        self.pixels += other.pixels;
        self.differing += other.differing;
        self.events += other.events;
        self.levels += other.levels;
        self.far += other.far;
    }
}

/// By kind.
pub type Tallies = [Tally; 3];

/// The runs of a case on the engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunOf {
    /// All of it.
    Whole,
    /// Without what is refused, with other options.
    Again,
    /// Without a bus and a cap, for the oracle.
    Plain,
}

/// Runs a case in every way that it has, and judges the results. `spoil` may change them first: tests of the judge do.
pub fn judge(case: &Case, spoil: &dyn Fn(RunOf, &mut Steps), findings: &mut Findings) -> Tallies {
    let views = views(case);
    let all: Vec<&View> = views.iter().collect();
    let mut whole = play(case, &all, case.options, true, findings);
    spoil(RunOf::Whole, &mut whole.steps);
    let quiet = case.without_refusals();
    let mut again = match case.other_alone {
        true => play_alone(&quiet, &all, case.other_options, findings),
        false => play(&quiet, &all, case.other_options, false, findings),
    };
    spoil(RunOf::Again, &mut again.steps);
    for (tick, (expected, actual)) in whole.steps.iter().zip(&again.steps).enumerate() {
        same(&format!("tick {tick}, another run"), expected, actual, findings);
    }
    let plain = quiet.without_bus_and_cap();
    let plain_steps = if plain == quiet {
        whole.steps.clone()
    } else {
        let Played { mut steps, .. } = play(&plain, &all, case.options, false, findings);
        spoil(RunOf::Plain, &mut steps);
        (0..views.len()).for_each(|camera| behind::check(&quiet, camera, &steps, &whole.steps, findings));
        steps
    };
    let mut tallies = Tallies::default();
    for (camera, view) in views.iter().enumerate() {
        check_packets(case, camera, &whole.steps, findings);
        check_poses(view, camera, &whole, findings);
        let runs = runs(&plain, view, camera, without_noise);
        for run in &runs {
            let kind = kind(run);
            let tally = against_oracle((&plain, camera), view, (run, kind), &plain_steps, findings);
            tallies[kind as usize].add(tally);
        }
    }
    tallies
}

/// Poses of the scenes are right. Nothing must doubt them, as then the engine follows vectors that the oracle does not.
fn check_poses(view: &View, camera: usize, played: &Played, findings: &mut Findings) {
    if view.case.geometry.is_some() {
        let (synthesis, warning) = (played.synthesis[camera], &played.warnings[camera]);
        findings.check(warning.is_none(), || format!("camera {camera}: {synthesis:?}, {warning:?}"));
    }
}

/// What holds of every packet of a camera, whatever it sees.
fn check_packets(case: &Case, camera: usize, steps: &Steps, findings: &mut Findings) {
    let of = &case.cameras[camera];
    let mut sensor = of.resolved(&of.sensor);
    let (mut last_ns, mut sequence, mut last_watermark_ns) = (None, 0, None);
    let mut latest_ns = i64::MIN;
    for (index, tick) in case.ticks.iter().enumerate() {
        for change in &tick.changes {
            match change {
                Change::Reset(number) if *number == camera => last_ns = None,
                Change::Sensor(number, next) if *number == camera => {
                    let next = of.resolved(next);
                    if sensor.change_to(&next).resets_frames {
                        last_ns = None;
                    }
                    sensor = next;
                }
                _ => {}
            }
        }
        let (Some(frame), Some(Step { packet, diagnostics, .. })) =
            (tick.frames[camera], &steps[index][camera])
        else {
            continue;
        };
        let mut check = |holds: bool, what: &str| {
            findings.check(holds, || {
                let times_ns = || packet.iter().map(|event| event.t_ns);
                let span = (times_ns().min(), times_ns().max(), packet.base_ns, packet.watermark_ns);
                format!("tick {index}, camera {camera}, at {} ns: {what}: {span:?}", frame.t_ns)
            });
        };
        let start_ns = last_ns.unwrap_or(frame.t_ns);
        let complete_ns = complete_before(last_watermark_ns, frame.t_ns);
        if complete_ns.is_none() {
            latest_ns = i64::MIN;
        }
        check(packet.is_sorted(), "events are not in order");
        check(packet.sequence == sequence, "packets are not counted");
        check((packet.width_px, packet.height_px) == of.size_px(), "a packet of another size");
        check(packet.base_ns == base_ns(&sensor, start_ns), "another base");
        check(packet.watermark_ns == watermark_ns(&sensor, frame.t_ns, complete_ns), "another watermark");
        check(last_ns.is_some() || packet.is_empty(), "events before a camera is armed");
        let in_image =
            |event: Event| u32::from(event.x) < of.sensor.width && u32::from(event.y) < of.sensor.height;
        check(packet.iter().all(in_image), "events beside the image");
        // A packet may only hold what no packet before it was said to be complete up to.
        let in_time = |event: Event| Some(event.t_ns) > complete_ns && event.t_ns <= frame.t_ns;
        check(packet.iter().all(in_time), "events of another time");
        check(packet.iter().all(|event| event.t_ns >= latest_ns), "events before those of an earlier packet");
        check(packet.dropped == diagnostics.dropped_events, "dropped events are counted twice");
        let cap = sensor.max_events_per_interval as usize;
        check(cap == 0 || packet.len() <= cap, "more events than the cap");
        (last_ns, sequence, last_watermark_ns) = (Some(frame.t_ns), sequence + 1, Some(packet.watermark_ns));
        latest_ns = packet.iter().map(|event| event.t_ns).fold(latest_ns, i64::max);
    }
}

fn kind(run: &Run) -> Kind {
    let kinds = || run.iter().map(|taken| Kind::of_sensor(&taken.sensor));
    if kinds().any(|kind| kind == Kind::Physical) {
        Kind::Physical
    } else if kinds().any(|kind| kind == Kind::Surfaces) {
        Kind::Surfaces
    } else {
        Kind::Plain
    }
}

/// Compares a run of a camera with the oracle's.
fn against_oracle(
    (case, camera): (&Case, usize),
    view: &View,
    (run, kind): (&Run, Kind),
    steps: &Steps,
    findings: &mut Findings,
) -> Tally {
    let what = |taken: &Taken| format!("tick {}, camera {camera}, {kind:?}", taken.tick);
    let step =
        |taken: &Taken| steps[taken.tick][camera].as_ref().expect("a camera with a frame has a result");
    let tolerance_log = level_tolerance_log(kind, run, view);
    let is_foretold = foretells_light(view, run);
    let same_run = |view: &View, moved: Perturbation| {
        let moved = runs(case, view, camera, |sensor| moved.of(sensor));
        moved.into_iter().find(|other| other[0].tick == run[0].tick).expect("the same run")
    };
    let perturbed = |moved: Perturbation| match moved.vectors_px {
        None => same_run(view, moved),
        Some(by_px) => same_run(&view.with_moved_vectors(by_px), moved),
    };
    // A vector moves a position by the part of the interval that has passed, or by the part that is left.
    let vectors: Vec<Perturbation> = match follows_vectors(view, run) {
        true => moved_vectors(2.0 * POSITION_PX).collect(),
        false => Vec::new(),
    };
    let with_moved_vectors: LazyCell<Vec<Run>, _> =
        LazyCell::new(|| vectors.iter().copied().map(perturbed).collect());
    let mut tally = Tally { runs: 1, ..Tally::default() };
    for (place, taken) in run.iter().enumerate() {
        let (step, interval) = (step(taken), &taken.interval);
        let (got, expected) = (step.diagnostics, interval.diagnostics);
        let substeps: u64 = interval.substeps_per_block.iter().map(|&n| u64::from(n)).sum();
        let mut same = |actual: u64, expected: u64, of: &str| {
            findings
                .check(actual == expected, || format!("{}: {actual} {of}, expected {expected}", what(taken)));
        };
        same(got.invalid_pixels, expected.invalid_pixels, "invalid pixels");
        same(got.invalid_motion, expected.invalid_motion, "invalid vectors");
        same(got.unarmed_pixels, expected.unarmed_pixels, "unarmed pixels");
        same(got.substeps + got.skipped_blocks * of_a_still_block(&taken.sensor), substeps, "sub-steps");
        same(got.without_depth, expected.without_path.depth, "pixels without depth");
        same(got.without_poses, expected.without_path.poses, "pixels without poses");
        same(got.without_lens, expected.without_path.lens, "pixels without a ray");
        if !is_foretold {
            continue;
        }
        if !has_noise(run) {
            findings.check(got.overrun_pixels == expected.overrun_pixels, || {
                let [got, expected] = [got.overrun_pixels, expected.overrun_pixels];
                format!("{}: {got} pixels with too many events, expected {expected}", what(taken))
            });
        }
        let unseen = expected.unseen_samples;
        findings.check(got.unseen_samples.abs_diff(unseen) <= unseen / 50 + 40, || {
            format!("{}: {} unseen samples, expected {unseen}", what(taken), got.unseen_samples)
        });
        check_aps(&what(taken), taken, step, kind, findings);
        if let Some(levels_q24) = &step.substeps_q24 {
            let far =
                far_levels((taken, place), levels_q24, tolerance_log, &|| &with_moved_vectors, &mut tally);
            let levels = substeps as usize * 64;
            findings.check(far.0 <= kind.most_in_a_run(levels), || {
                format!("{}: {} of {levels} levels are far: {:?}", what(taken), far.0, far.1)
            });
        }
    }
    if !is_foretold || has_noise(run) {
        return tally;
    }
    let actual: Vec<Event> = run.iter().flat_map(|taken| step(taken).packet.iter()).collect();
    tally.pixels += view.case.sensor.pixels();
    let expected = events(run);
    tally.events += expected.len();
    if kind == Kind::Physical {
        let [actual, expected] = [&actual, &expected].map(|events| by_pixel(view.case.size_px(), events));
        let pairs = || actual.iter().zip(&expected).enumerate();
        let differing = || pairs().filter(|(_, (a, b))| polarities(a).ne(polarities(b)));
        tally.differing += differing().count();
        let most = kind.most_in_a_run(tally.pixels) + kind.ties(tally);
        findings.check(tally.differing <= most, || {
            let first: Vec<String> =
                differing().take(3).map(|(pixel, (a, b))| first_difference(pixel, a, b)).collect();
            let (differing, pixels) = (tally.differing, tally.pixels);
            format!("{}: {differing} of {pixels} pixels differ:\n  {}", what(&run[0]), first.join("\n  "))
        });
        return tally;
    }
    let Agreement { differing, unexplained, late, .. } = Reference {
        size_px: view.case.size_px(),
        stamps: Stamps::of(run.iter().map(|taken| &taken.sensor)),
        level_tolerance_log: tolerance_log,
        events: &expected,
        stretches: &|pixel| stretches(view, run, pixel),
        perturbations: perturbations(tolerance_log).chain(vectors.iter().copied()).collect(),
        perturbed: &|moved| events(&perturbed(moved)),
    }
    .compare(&actual);
    tally.differing += differing;
    let most = kind.most_in_a_run(tally.pixels) + kind.ties(tally);
    findings.check(unexplained.len() <= most, || {
        let (count, first) = (unexplained.len(), unexplained[..unexplained.len().min(3)].join("\n  "));
        format!("{}: {count} pixels differ without a tie:\n  {first}", what(&run[0]))
    });
    findings.check(late.len() <= kind.most_in_a_run(tally.events), || {
        let (count, first) = (late.len(), late[..late.len().min(3)].join("\n  "));
        format!("{}: {count} events at another time:\n  {first}", what(&run[0]))
    });
    tally
}

/// How many events of a pixel come before the first of another polarity, and what follows them.
fn first_difference(pixel: usize, actual: &[(i64, Polarity)], expected: &[(i64, Polarity)]) -> String {
    let alike = polarities(actual).zip(polarities(expected)).take_while(|(a, b)| a == b).count();
    let next = |events: &[(i64, Polarity)]| events[alike..].iter().take(3).copied().collect::<Vec<_>>();
    let (a, b) = (next(actual), next(expected));
    let counts = (actual.len(), expected.len());
    format!("pixel {pixel}: {counts:?} events (expected second), {alike} alike, then {a:?}, expected {b:?}")
}

/// Sub-steps that the oracle has in a block in which nothing moves or changes, and that the engine may skip.
fn of_a_still_block(sensor: &SensorModel) -> u64 {
    let fixed = sensor.substep_policy == SubstepPolicy::Fixed && sensor.synthesis != Synthesis::None;
    if fixed { sensor.substeps.into() } else { 1 }
}
