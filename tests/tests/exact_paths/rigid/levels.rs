//! Compares synthesis `rigid` of the engine with the oracle: sub-steps, levels and events of whole runs.

use super::input::changed;
use super::stages::run_by;
use esaac_engine::{CameraConfig, FrameBytes, KernelPolicy, LevelsFirst, Rig, RigOptions};
use esaac_layout::{PASSING_ENTRIES, PASSING_HEAD_WORDS};
use esaac_model::packet::Event;
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, Projection, SceneMotion};
use esaac_model::substeps::BLOCK_PX;
use esaac_model::{
    DepthFormat, HdrFormat, IdFormat, Intensity, MotionFormat, Pixel, Polarity, SensorModel, SubstepPolicy,
    Synthesis, Taps, q24_to_log,
};
use esaac_oracle::metrics::compare;
use esaac_oracle::{Frame, Interval, Oracle};
use esaac_scene::SceneKind;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::geometry::{KeyFrame, Rendered};
use glam::DVec2;

/// Odd: the image cuts blocks off at the right and at the bottom.
pub(super) const SIZE: (u32, u32) = (75, 53);

const FRAMES: usize = 4;

/// Ids of the bodies of a scene [`in_pieces`].
const PIECES: std::ops::Range<u32> = 100..105;

/// Least share of pixels with the oracle's sequence of polarities, over all cases of a test (a requirement).
const SAME_SHARE: f64 = 0.9999;

/// How far a log intensity may be from the oracle's, nepers, but for a share of the samples: at a silhouette, tests of
/// depth fall the other way by rounding.
pub(super) const LEVEL_TOLERANCE_LOG: f64 = 1e-4;

/// The same through a fisheye: a device's sines and arc tangents are less exact than its other arithmetic.
const FISHEYE_TOLERANCE_LOG: f64 = 1e-3;

/// That share.
const DIFFERING_SAMPLES: f64 = 1e-4;

/// The same behind a lens that blurs, where such a sample reaches its neighbours.
const BLURRED_DIFFERING_SAMPLES: f64 = 2e-4;

/// Share of samples, and of pixels, that may differ where bodies lie in one plane: rounding says which is nearer.
const IN_PLANE_DIFFERING: f64 = 2e-3;

const SCENES: [SceneKind; 5] =
    [SceneKind::Shake, SceneKind::Poles, SceneKind::Foliage, SceneKind::Propeller, SceneKind::Bounce];

pub(super) fn sensor() -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis: Synthesis::Rigid,
        intensity: Intensity::Luminance,
        contrast_on: 0.17,
        contrast_off: 0.23,
        log_offset: 0.01,
        substeps: 16,
        ..SensorModel::default()
    }
}

fn keep() -> RigOptions {
    RigOptions { keep_substeps: true, ..RigOptions::default() }
}

/// A tick of the engine.
pub(super) struct Step {
    pub events: Vec<Event>,
    pub substeps: u64,
    pub unseen: u64,
    levels_q24: Option<Vec<Vec<i32>>>,
}

/// Runs the engine over frames, with their motion vectors if `vectors`.
pub(super) fn run(
    sensor: &SensorModel,
    rendered: &Rendered,
    options: RigOptions,
    vectors: bool,
) -> Vec<Step> {
    let motion = vectors.then_some(MotionFormat::F32x2);
    let camera = CameraConfig { motion, ..rendered.camera(sensor) };
    let mut rig = Rig::with_options(&DEVICE, &[camera], options).expect("a rig");
    rig.set_scene(0, rendered.scene.clone()).expect("poses of its lens");
    let steps = rendered
        .frames
        .iter()
        .map(|frame| {
            let motion = vectors.then_some(&frame.motion[..]);
            rig.upload(0, &FrameBytes { motion, ..frame.bytes() }).expect("a frame that fits");
            let tick = rig.step(&[frame.t_ns]).expect("a frame in time");
            let (events, diagnostics) = (tick.packets[0].iter().collect(), tick.diagnostics[0]);
            Step {
                events,
                substeps: diagnostics.substeps,
                unseen: diagnostics.unseen_samples,
                levels_q24: rig.substeps_q24(0),
            }
        })
        .collect();
    drop(rig);
    assert_silent();
    steps
}

fn oracle_frame(frame: &KeyFrame, vectors: bool) -> Frame<'_> {
    Frame {
        t_ns: frame.t_ns,
        hdr: (HdrFormat::F32x4, &frame.hdr),
        motion: vectors.then_some((MotionFormat::F32x2, &frame.motion[..])),
        depth: Some((DepthFormat::F32, &frame.depth)),
        ids: Some((IdFormat::U32, &frame.ids)),
    }
}

fn oracle(sensor: &SensorModel, rendered: &Rendered, vectors: bool) -> Vec<Interval> {
    let mut oracle = Oracle::new(sensor.clone(), 0).expect("a valid sensor");
    oracle.keep_samples(true);
    oracle.set_scene(rendered.scene.clone());
    let step = |frame| oracle.step(&oracle_frame(frame, vectors)).expect("a frame in time");
    rendered.frames.iter().map(step).collect()
}

#[test]
fn the_oracle_takes_auto_for_rigid_where_there_are_poses_and_depth() {
    let rendered = Rendered::of(SceneKind::Propeller, (16, 8), 2);
    let auto = SensorModel { width: 16, height: 8, synthesis: Synthesis::Auto, ..SensorModel::default() };
    let resolved = |poses: bool, depth: bool| {
        let mut oracle = Oracle::new(auto.clone(), 0).expect("a valid sensor");
        if poses {
            oracle.set_scene(rendered.scene.clone());
        }
        let frame = oracle_frame(&rendered.frames[0], true);
        let frame = if depth { frame } else { Frame { depth: None, ids: None, ..frame } };
        oracle.step(&frame).expect("a frame");
        let first = oracle.sensor().synthesis;
        oracle.set_sensor(auto.clone()).expect("the same sensor");
        assert_eq!(oracle.sensor().synthesis, first);
        first
    };
    assert_eq!(resolved(true, true), Synthesis::Rigid);
    assert_eq!([resolved(true, false), resolved(false, true)], [Synthesis::Motion; 2]);
}

fn polarities(sensor: &SensorModel, events: impl Iterator<Item = Event>) -> Vec<Vec<Polarity>> {
    let mut pixels = vec![Vec::new(); sensor.pixels()];
    for e in events {
        pixels[usize::from(e.y) * sensor.width as usize + usize::from(e.x)].push(e.polarity);
    }
    pixels
}

/// Samples, and how many of them are further from the oracle's than a tolerance; the largest difference.
fn compare_levels(
    sensor: &SensorModel,
    intervals: &[Interval],
    steps: &[Step],
    tolerance_log: f64,
) -> (usize, usize, f64) {
    let (mut samples, mut far, mut worst) = (0, 0, 0.0_f64);
    for (interval, step) in intervals.iter().zip(steps).skip(1) {
        let expected = interval.samples.as_ref().expect("the oracle keeps samples");
        let levels_q24 = step.levels_q24.as_ref().expect("the rig keeps them");
        for pixel in 0..sensor.pixels() {
            for (sample, levels) in expected.at(pixel).iter().zip(&levels_q24[1..]) {
                let error = (q24_to_log(levels[pixel]) - (sample + sensor.log_offset).ln()).abs();
                samples += 1;
                far += usize::from(error > tolerance_log);
                worst = worst.max(error);
            }
        }
    }
    (samples, far, worst)
}

/// Runs scenes by both, and compares sub-steps, levels and events.
fn check(sensor: &SensorModel, scenes: &[SceneKind], policy: Option<KernelPolicy>) {
    let rendered = scenes.iter().map(|&kind| (kind, Rendered::of(kind, SIZE, FRAMES)));
    check_frames(sensor, &rendered.collect::<Vec<_>>(), policy, false);
}

/// The same for rendered frames, with their motion vectors if `vectors`.
pub(super) fn check_frames(
    sensor: &SensorModel,
    scenes: &[(SceneKind, Rendered)],
    policy: Option<KernelPolicy>,
    vectors: bool,
) {
    let all = differences(sensor, scenes, policy, vectors);
    let allowed = if sensor.psf_sigma_px > 0.0 { BLURRED_DIFFERING_SAMPLES } else { DIFFERING_SAMPLES };
    all.check(allowed, 1.0 - SAME_SHARE);
}

/// Pixels, and those whose sequence of polarities is not the oracle's; samples, and those whose level is far from its.
#[derive(Default)]
struct Differences {
    pixels: usize,
    differing: usize,
    samples: usize,
    far: usize,
}

impl Differences {
    fn check(&self, far_share: f64, differing_share: f64) {
        let Differences { pixels, differing, samples, far } = *self;
        assert!(far as f64 <= far_share * samples as f64, "{far} of {samples} samples are far");
        let allowed = (differing_share * pixels as f64).ceil();
        assert!(differing as f64 <= allowed, "{differing} of {pixels} pixels differ");
    }
}

fn differences(
    sensor: &SensorModel,
    scenes: &[(SceneKind, Rendered)],
    policy: Option<KernelPolicy>,
    vectors: bool,
) -> Differences {
    let mut all = Differences::default();
    for (kind, rendered) in scenes {
        let options = RigOptions { policy, ..keep() };
        let steps = run(sensor, rendered, options, vectors);
        let intervals = oracle(sensor, rendered, vectors);
        for (index, (interval, step)) in intervals.iter().zip(&steps).enumerate() {
            let expected: u64 = interval.substeps_per_block.iter().map(|&n| u64::from(n)).sum();
            println!(
                "{kind:?} {index}: {} sub-steps of {expected}, {} unseen of {}",
                step.substeps, step.unseen, interval.diagnostics.unseen_samples
            );
            assert_eq!(step.substeps, expected, "{kind:?}, frame {index}: sub-steps of all blocks");
            // A pixel at the limit may fall the other way by rounding.
            let unseen = interval.diagnostics.unseen_samples;
            assert!(
                step.unseen.abs_diff(unseen) <= unseen / 50 + 1,
                "{kind:?}, frame {index}: unseen samples"
            );
        }
        let expected = polarities(sensor, intervals.iter().flat_map(|i| i.packet.iter()));
        let got = polarities(sensor, steps.iter().flat_map(|s| s.events.iter().copied()));
        let here = expected.iter().zip(&got).filter(|(a, b)| a != b).count();
        let events: usize = expected.iter().map(Vec::len).sum();
        let fisheye = rendered.scene.lens().projection() == Projection::Fisheye;
        let tolerance_log = if fisheye { FISHEYE_TOLERANCE_LOG } else { LEVEL_TOLERANCE_LOG };
        let levels = compare_levels(sensor, &intervals, &steps, tolerance_log);
        println!(
            "{kind:?}: {here} of {} pixels differ, {events} events; levels: {} of {} far, at most {:.1e}",
            sensor.pixels(),
            levels.1,
            levels.0,
            levels.2
        );
        assert!(events > 1000, "{kind:?} sends few events");
        all.pixels += sensor.pixels();
        all.differing += here;
        all.samples += levels.0;
        all.far += levels.1;
    }
    all
}

#[test]
fn levels_and_events_are_the_oracles() {
    check(&sensor(), &SCENES, None);
}

#[test]
fn the_gpus_kernels_are_the_oracles_too() {
    check(&sensor(), &[SceneKind::Shake, SceneKind::Foliage], Some(KernelPolicy::gpu()));
    let dense = KernelPolicy { levels_first: LevelsFirst::Always, ..KernelPolicy::gpu() };
    check(&sensor(), &[SceneKind::Foliage], Some(dense));
}

/// In every interval, the sub-tiles of a rig with many events have several times more than a queue holds.
#[test]
fn crowded_sub_tiles_send_on_a_gpu_what_the_devices_own_kernels_send() {
    let sensor = SensorModel { contrast_on: 0.01, contrast_off: 0.01, ..sensor() };
    let rendered = Rendered::of(SceneKind::Foliage, SIZE, 3);
    let of = |policy| run(&sensor, &rendered, RigOptions { policy, ..RigOptions::default() }, false);
    let own = of(None);
    for levels_first in [LevelsFirst::Never, LevelsFirst::Always] {
        let crowded = of(Some(KernelPolicy { levels_first, ..KernelPolicy::gpu() }));
        for (frame, (step, own)) in crowded.iter().zip(&own).enumerate() {
            assert!(step.events == own.events, "{levels_first:?}, frame {frame}");
            assert!(frame == 0 || own.events.len() > 24 * sensor.pixels(), "{} events", own.events.len());
        }
    }
}

/// Queues have grown to their longest by then. The validation layer knows what a device has.
#[test]
fn long_queues_beside_lists_of_candidates_fit_the_shared_memory_of_any_device() {
    const SMALL: (u32, u32) = (35, 19);
    let (width, height) = SMALL;
    let dense = SensorModel { width, height, contrast_on: 0.01, contrast_off: 0.01, substeps: 4, ..sensor() };
    let layered = SensorModel { synthesis: Synthesis::Motion, layers: 3, ..dense.clone() };
    let physical = SensorModel { pixel: Pixel::Physical, noise_gain: 0.0, ..dense.clone() };
    let rendered = Rendered::of(SceneKind::Shake, SMALL, 7);
    for (sensor, vectors) in [(dense, false), (physical, false), (layered, true)] {
        let steps = run(&sensor, &rendered, RigOptions::default(), vectors);
        assert!(steps[6].events.len() > 16 * sensor.pixels(), "{} events", steps[6].events.len());
    }
}

#[test]
fn behind_a_lens_and_in_the_light_of_a_lamp_they_are_the_oracles() {
    let lens = SensorModel { psf_sigma_px: 0.6, vignetting_fov_deg: 60.0, ..sensor() };
    let lamp = SensorModel { flicker_depth: 0.5, flicker_hz: 60.0, ..lens.clone() };
    check(&lens, &[SceneKind::Poles], None);
    check(&SensorModel { intensity: Intensity::BayerRggb, ..lamp.clone() }, &[SceneKind::Bounce], None);
    check(&lamp, &[SceneKind::Shake], Some(KernelPolicy::gpu()));
}

#[test]
fn several_transfers_and_fixed_substeps_are_the_oracles() {
    for transfers in [2, 3] {
        let sensor = SensorModel { transfers, substep_policy: SubstepPolicy::Fixed, substeps: 8, ..sensor() };
        check(&sensor, &[SceneKind::Bounce, SceneKind::Poles], None);
    }
}

#[test]
fn bilinear_taps_are_the_oracles() {
    let sensor = SensorModel { taps: Taps::Bilinear, ..sensor() };
    for policy in [None, Some(KernelPolicy::gpu())] {
        check(&sensor, &[SceneKind::Shake, SceneKind::Bounce], policy);
    }
}

/// Sub-steps of all intervals.
fn total(substeps: impl Iterator<Item = u64>) -> u64 {
    substeps.skip(1).sum()
}

/// Large enough for blocks that no silhouette passes.
const LARGE: (u32, u32) = (139, 101);

fn by_error(substep_error_ns: u32) -> SensorModel {
    SensorModel { width: LARGE.0, height: LARGE.1, substeps: 32, substep_error_ns, ..sensor() }
}

#[test]
fn substeps_by_error_are_the_oracles_and_fewer_than_by_speed() {
    for (kind, policy) in [(SceneKind::Flight, None), (SceneKind::Shake, Some(KernelPolicy::gpu()))] {
        let rendered = Rendered::of(kind, LARGE, 3);
        check_frames(&by_error(300_000), &[(kind, rendered.clone())], policy, false);
        let of = |error_ns| run(&by_error(error_ns), &rendered, RigOptions { policy, ..keep() }, false);
        let [some, most] = [of(300_000), of(0)];
        let events = |steps: &[Step]| steps.iter().flat_map(|step| step.events.clone()).collect::<Vec<_>>();
        let apart = compare(LARGE, events(&most), events(&some));
        let [some, most] = [some, most].map(|steps| total(steps.iter().map(|step| step.substeps)));
        println!("{kind:?}: {some} sub-steps, {most} by speed, {apart:?}");
        assert!(50 * some < 49 * most, "{kind:?}: {some} sub-steps, {most} by speed");
        assert!(apart.f1 > 0.99, "{kind:?}: events are {apart:?}");
    }
}

/// A frame keeps its texture only where sub-steps are by error at its time, also for the interval after it.
#[test]
fn the_bound_of_substeps_may_change_between_ticks() {
    const BOUNDS_NS: [u32; 6] = [0, 300_000, 300_000, 100_000, 0, 300_000];
    let rendered = Rendered::of(SceneKind::Flight, LARGE, BOUNDS_NS.len());
    let mut rig = rendered.rig(&by_error(0), RigOptions::default());
    let mut oracle = Oracle::new(by_error(0), 0).expect("a valid sensor");
    oracle.set_scene(rendered.scene.clone());
    let by_speed = self::oracle(&by_error(0), &rendered, false);
    let mut spared = Vec::new();
    for (index, (&bound_ns, frame)) in BOUNDS_NS.iter().zip(&rendered.frames).enumerate() {
        rig.set_sensor(0, by_error(bound_ns)).expect("of the same size");
        oracle.set_sensor(by_error(bound_ns)).expect("of the same size");
        rig.upload(0, &frame.bytes()).expect("a frame that fits");
        let got = rig.step(&[frame.t_ns]).expect("a frame in time").diagnostics[0].substeps;
        let interval = oracle.step(&oracle_frame(frame, false)).expect("a frame in time");
        let sum =
            |interval: &Interval| interval.substeps_per_block.iter().map(|&n| u64::from(n)).sum::<u64>();
        assert_eq!(got, sum(&interval), "frame {index}");
        if got < sum(&by_speed[index]) {
            spared.push(index);
        }
    }
    assert_eq!(spared, [2, 3], "intervals between two frames with textures");
    assert_silent();
}

/// The frames of a scene, with no depth in the right half of the image.
fn without_depth_at_the_right(kind: SceneKind) -> Rendered {
    let mut rendered = Rendered::of(kind, SIZE, FRAMES);
    let width = SIZE.0 as usize;
    for frame in &mut rendered.frames {
        *frame = changed(frame, |pixel, depth, _| {
            if pixel % width >= width / 2 {
                *depth = f32::NAN;
            }
        });
    }
    rendered
}

/// The frames of a scene, taken for those of a fisheye that sees more than 180 degrees from corner to corner.
fn through_a_fisheye(kind: SceneKind) -> Rendered {
    let mut rendered = Rendered::of(kind, SIZE, FRAMES);
    let lens = Intrinsics::fisheye(28.0, 27.0, 36.2, 25.7).expect("a lens");
    let mut scene = SceneMotion::new(lens, rendered.scene.camera().clone());
    for id in rendered.scene.ids() {
        scene.insert(id, rendered.scene.instance(id).expect("its poses").clone()).expect("one id");
    }
    rendered.scene = scene;
    rendered
}

/// A scene before a camera that shakes, in which the ground is cut into bodies that stand, 3 by 4 pixels each in the first
/// frame: so many surfaces pass some blocks that `passing` has no room for all.
fn in_pieces() -> Rendered {
    let rendered = Rendered::of(SceneKind::Shake, SIZE, FRAMES);
    let mut scene = SceneMotion::new(*rendered.scene.lens(), rendered.scene.camera().clone());
    for id in PIECES {
        scene.insert(id, PoseTrack::still(Pose::IDENTITY)).expect("one id");
    }
    let frames = rendered.frames.iter().map(|frame| {
        changed(frame, |pixel, depth, id| {
            let at = DVec2::new((pixel % SIZE.0 as usize) as f64, (pixel / SIZE.0 as usize) as f64);
            let first =
                scene.path(at, f64::from(*depth), 0, frame.t_ns, rendered.frames[0].t_ns).expect("a path");
            let piece = (first.pixel_px.x / 3.0).floor() + 2.0 * (first.pixel_px.y / 4.0).floor();
            if *id == 0 && depth.is_finite() {
                *id = PIECES.start + piece.rem_euclid(PIECES.len() as f64) as u32;
            }
        })
    });
    Rendered { frames: frames.collect(), scene: scene.clone(), ..rendered }
}

#[test]
fn blocks_that_more_surfaces_pass_than_there_is_room_for_look_for_them() {
    let rendered = in_pieces();
    for policy in [None, Some(KernelPolicy::gpu())] {
        let all = differences(&sensor(), &[(SceneKind::Shake, rendered.clone())], policy, false);
        all.check(IN_PLANE_DIFFERING, IN_PLANE_DIFFERING);
        let words = run_by(&rendered, &sensor(), policy).words(0, "passing").expect("a rig that is well");
        let blocks = (SIZE.0.div_ceil(BLOCK_PX) * SIZE.1.div_ceil(BLOCK_PX)) as usize;
        let heads = words.chunks(PASSING_HEAD_WORDS as usize);
        // The heads of both slots, of which one is empty.
        let without_room = heads.take(2 * blocks).filter(|head| head[0] > PASSING_ENTRIES).count();
        assert!((1..blocks).contains(&without_room), "{without_room} of {blocks} blocks");
    }
    assert_silent();
}

#[test]
fn levels_through_a_fisheye_are_the_oracles() {
    let scenes = [SceneKind::Shake, SceneKind::Bounce].map(|kind| (kind, through_a_fisheye(kind)));
    check_frames(&sensor(), &scenes, None, false);
    let three_transfers = SensorModel { transfers: 3, ..sensor() };
    check_frames(&three_transfers, &scenes[1..], Some(KernelPolicy::gpu()), false);
}

#[test]
fn pixels_without_a_path_follow_their_vectors() {
    let scenes = [SceneKind::Flight, SceneKind::Bounce].map(|kind| (kind, without_depth_at_the_right(kind)));
    for (policy, taps, transfers) in
        [(None, Taps::Cubic, 3), (Some(KernelPolicy::gpu()), Taps::Cubic, 1), (None, Taps::Bilinear, 1)]
    {
        check_frames(&SensorModel { taps, transfers, ..sensor() }, &scenes, policy, true);
    }
    let (_, flight) = &scenes[0];
    let [with, without] = [true, false].map(|vectors| run(&sensor(), flight, keep(), vectors));
    let at_the_right = |steps: &[Step]| -> Vec<Event> {
        steps.iter().flat_map(|s| s.events.clone()).filter(|e| u32::from(e.x) > SIZE.0 / 2 + 2).collect()
    };
    assert_ne!(at_the_right(&with), at_the_right(&without), "they are blended only without vectors");
}

#[test]
fn a_run_is_the_same_bits_each_time() {
    let rendered = Rendered::of(SceneKind::Foliage, SIZE, FRAMES);
    let [first, second] = [0, 1].map(|_| run(&sensor(), &rendered, keep(), false));
    assert!(first.iter().any(|step| !step.events.is_empty()));
    for (first, second) in first.iter().zip(&second) {
        assert_eq!(first.events, second.events);
        assert_eq!((first.substeps, first.unseen), (second.substeps, second.unseen));
    }
}
