//! `rigid` against frames rendered at every sub-step: sheets before a camera, cast ray by ray.

use super::*;
use crate::metrics::{Comparison, compare};
use crate::truth;
use esaac_model::paths::{Intrinsics, Pose, PoseTrack};
use esaac_model::synthesis::rigid::HALF_THICK;
use esaac_model::{Intensity, SensorModel, Taps};
use glam::{DQuat, DVec3};

const SIZE: (usize, usize) = (48, 32);
const INTERVAL_NS: i64 = 33_333_312;
const SUBSTEPS: i64 = 32;
const LOG_OFFSET: f64 = 0.01;

/// A rectangle in the plane z = 0 of its instance.
struct Sheet {
    id: u32,
    half_size_m: [f64; 2],
    centre_m: DVec3,
    light: fn(f64, f64) -> f64,
}

struct Stage {
    scene: SceneMotion,
    sheets: Vec<Sheet>,
}

struct Frame {
    t_ns: i64,
    planes: Vec<Vec<f64>>,
    depth_m: Vec<f64>,
    ids: Vec<u32>,
}

impl Stage {
    fn new(camera: &dyn Fn(f64) -> Pose, moving: &dyn Fn(f64) -> Pose, sheets: Vec<Sheet>) -> Self {
        let times_ns: Vec<i64> = (0..=2 * SUBSTEPS).map(|i| i * INTERVAL_NS / SUBSTEPS).collect();
        let track = |pose: &dyn Fn(f64) -> Pose| {
            let poses = times_ns.iter().map(|&t_ns| pose(t_ns as f64 / INTERVAL_NS as f64)).collect();
            PoseTrack::new(times_ns.clone(), poses).unwrap()
        };
        let lens = Intrinsics::pinhole(40.0, 40.0, 23.5, 15.5).unwrap();
        let mut scene = SceneMotion::new(lens, track(camera));
        scene.insert(1, track(moving)).unwrap();
        Stage { scene, sheets }
    }

    /// The sheet that a ray from the camera meets first: its light, depth and id.
    fn cast(&self, t_ns: i64, at: glam::DVec2) -> (f64, f64, u32) {
        let camera = self.scene.camera().at(t_ns).unwrap();
        let ray = camera.direction(self.scene.lens().ray(at).unwrap());
        let mut nearest = (0.2, f64::INFINITY, 0);
        for sheet in &self.sheets {
            let pose = self.scene.instance(sheet.id).map_or(Pose::IDENTITY, |track| track.at(t_ns).unwrap());
            let inverse = pose.inverse();
            let from = inverse.point(camera.translation_m()) - sheet.centre_m;
            let along = inverse.direction(ray);
            let depth_m = -from.z / along.z;
            let hit = from + along * depth_m;
            let inside = hit.x.abs() < sheet.half_size_m[0] && hit.y.abs() < sheet.half_size_m[1];
            if depth_m > 0.0 && depth_m < nearest.1 && inside {
                nearest = ((sheet.light)(hit.x, hit.y), depth_m, sheet.id);
            }
        }
        nearest
    }

    /// A frame of 6x6 rays a pixel; depth and id are those of the pixel's centre.
    fn frame(&self, t_ns: i64) -> Frame {
        const RAYS: usize = 6;
        let mut frame = Frame { t_ns, planes: vec![Vec::new()], depth_m: Vec::new(), ids: Vec::new() };
        for pixel in 0..SIZE.0 * SIZE.1 {
            let at = surface::position(SIZE, pixel);
            let offset = |i: usize| (i as f64 + 0.5) / RAYS as f64 - 0.5;
            let sum: f64 = (0..RAYS * RAYS)
                .map(|i| self.cast(t_ns, at + glam::DVec2::new(offset(i % RAYS), offset(i / RAYS))).0)
                .sum();
            let (_, depth_m, id) = self.cast(t_ns, at);
            frame.planes[0].push(sum / (RAYS * RAYS) as f64);
            frame.depth_m.push(depth_m);
            frame.ids.push(id);
        }
        frame
    }

    /// Frames at every sub-step of two intervals: rendered, and by `rigid` from the three key frames.
    fn frames(&self) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let rendered: Vec<Frame> =
            (0..=2 * SUBSTEPS).map(|i| self.frame(i * INTERVAL_NS / SUBSTEPS)).collect();
        let mut synthesized = vec![rendered[0].planes[0].clone()];
        let mut history = None;
        for interval in 0..2 {
            let keys = [0, 1].map(|key| &rendered[(interval + key) * SUBSTEPS as usize]);
            let rigid =
                Rigid::new(&self.scene, keys.map(input), LOG_OFFSET, (Taps::Cubic, 1), history.take());
            for step in 1..SUBSTEPS {
                let instant = rigid.instant(step as f64 / SUBSTEPS as f64);
                let pixels = 0..SIZE.0 * SIZE.1;
                synthesized.push(
                    pixels
                        .map(|i| {
                            rigid.sample(&instant, 0, i % SIZE.0, i / SIZE.0).intensity().expect("a path")
                        })
                        .collect(),
                );
            }
            synthesized.push(keys[1].planes[0].clone());
            history = Some(rigid.into_history());
        }
        (rendered.into_iter().map(|mut frame| frame.planes.remove(0)).collect(), synthesized)
    }

    /// Events of `rigid`, and of `linear`, against those of the rendered frames.
    fn compare(&self) -> [Comparison; 2] {
        let (rendered, synthesized) = self.frames();
        let blended: Vec<Vec<f64>> = (0..rendered.len())
            .map(|i| {
                let start = i / SUBSTEPS as usize * SUBSTEPS as usize;
                let end = (start + SUBSTEPS as usize).min(rendered.len() - 1);
                let fraction = (i - start) as f64 / SUBSTEPS as f64;
                let ends = rendered[start].iter().zip(&rendered[end]);
                ends.map(|(&from, &to)| super::super::linear(from, to, fraction)).collect()
            })
            .collect();
        [synthesized, blended].map(|frames| against(&rendered, &frames))
    }
}

fn against(rendered: &[Vec<f64>], frames: &[Vec<f64>]) -> Comparison {
    compare((SIZE.0 as u32, SIZE.1 as u32), events(rendered), events(frames))
}

/// What twelve taps leave on a texture whose shortest period is five pixels.
fn assert_near_rendered([rigid, linear]: [Comparison; 2]) {
    assert!(rigid.truth_on_off.0 > 1000, "{rigid:?}");
    assert!(rigid.f1 > 0.88 && rigid.victor_purpura < 0.44, "{rigid:?}");
    assert!((rigid.count_ratio - 1.0).abs() < 0.07, "{rigid:?}");
    assert!(rigid.victor_purpura < 0.5 * linear.victor_purpura, "{rigid:?}, linear {linear:?}");
}

fn input(frame: &Frame) -> Input<'_> {
    Input {
        t_ns: frame.t_ns,
        planes: &frame.planes,
        geometry: Geometry { size: SIZE, depth_m: &frame.depth_m, ids: &frame.ids },
    }
}

fn events(frames: &[Vec<f64>]) -> Vec<esaac_model::packet::Event> {
    let sensor = SensorModel {
        width: SIZE.0 as u32,
        height: SIZE.1 as u32,
        log_offset: LOG_OFFSET,
        intensity: Intensity::Gray,
        ..SensorModel::default()
    };
    let frames = frames.iter().enumerate().map(|(i, frame)| (i as i64 * INTERVAL_NS / SUBSTEPS, &frame[..]));
    truth::events(&sensor, 0, frames).unwrap()
}

fn pose(turn: DVec3, place_m: DVec3) -> Pose {
    Pose::new(DQuat::from_scaled_axis(turn), place_m).unwrap()
}

fn still(_: f64) -> Pose {
    Pose::IDENTITY
}

fn texture(x: f64, y: f64) -> f64 {
    (0.7 * (13.0 * x).sin() + 0.5 * (11.0 * y + 5.0 * x).cos()).exp()
}

fn wall() -> Sheet {
    Sheet { id: 0, half_size_m: [9.0, 9.0], centre_m: DVec3::new(0.0, 0.0, -4.0), light: texture }
}

/// An upright bar 2 m away, of a width in pixels.
fn bar(width_px: f64, light: fn(f64, f64) -> f64) -> Sheet {
    let half_size_m = [0.5 * width_px * 2.0 / 40.0, 9.0];
    Sheet { id: 1, half_size_m, centre_m: DVec3::new(0.0, 0.0, -2.0), light }
}

#[test]
fn a_moving_plane_gives_the_events_of_rendered_frames() {
    let moving = |t: f64| pose(DVec3::new(0.1, 0.25 * t, 0.05 * t), DVec3::new(0.3 * t, -0.2 * t, -3.0));
    let sheet = Sheet { id: 1, half_size_m: [9.0, 9.0], centre_m: DVec3::ZERO, light: texture };
    assert_near_rendered(Stage::new(&still, &moving, vec![sheet]).compare());
}

/// 25 Hz: almost a whole period in an interval.
fn shake(t: f64) -> Pose {
    let angle = std::f64::consts::TAU * 25.0 / 30.0 * t;
    pose(
        DVec3::new(0.05 * angle.cos(), 0.08 * angle.sin(), 0.02 * angle.sin()),
        DVec3::new(0.1 * angle.sin(), 0.0, 0.0),
    )
}

#[test]
fn a_shaking_camera_gives_the_events_of_rendered_frames() {
    assert_near_rendered(Stage::new(&shake, &still, vec![wall()]).compare());
}

#[test]
fn an_occluding_edge_sends_no_events_of_its_own() {
    let moving = |t: f64| pose(DVec3::ZERO, DVec3::new(-0.6 + 0.5 * t, 0.0, 0.0));
    let wall = Sheet { light: |_, _| 0.3, ..wall() };
    let stage = Stage::new(&still, &moving, vec![wall, bar(12.0, |_, _| 2.0)]);
    let (rendered, synthesized) = stage.frames();
    let got = against(&rendered, &synthesized);
    assert!(got.truth_on_off.0 > 1000, "{got:?}");
    assert_eq!(got.tested_on_off, got.truth_on_off);
    assert_eq!(got.same_sequence, 1.0, "{got:?}");
    // No pixel is ever outside the range of the two surfaces.
    assert!(synthesized.iter().flatten().all(|s| (0.3 - 1e-9..=2.0 + 1e-9).contains(s)));
}

#[test]
fn an_occluding_edge_before_texture_keeps_to_the_number_of_events() {
    let moving = |t: f64| pose(DVec3::ZERO, DVec3::new(-0.6 + 0.4 * t, 0.0, 0.0));
    let [got, _] =
        Stage::new(&shake, &moving, vec![wall(), bar(8.0, |_, y| 0.6 + 0.3 * (9.0 * y).sin())]).compare();
    assert!(got.f1 > 0.89 && got.victor_purpura < 0.33, "{got:?}");
    assert!((0.9..1.1).contains(&got.count_ratio), "{got:?}");
}

#[test]
fn a_pole_narrower_than_its_motion_does_not_vanish() {
    // 1.3 px wide; 8 px an interval.
    let moving = |t: f64| pose(DVec3::new(0.0, 0.0, 0.1), DVec3::new(-0.5 + 0.4 * t, 0.0, 0.0));
    let wall = Sheet { light: |_, _| 0.3, ..wall() };
    let stage = Stage::new(&still, &moving, vec![wall, bar(1.3, |_, _| 2.0)]);
    let (rendered, synthesized) = stage.frames();
    let light_above_wall = |frame: &[f64]| frame.iter().map(|s| s - 0.3).sum::<f64>();
    for (i, (expected, got)) in rendered.iter().zip(&synthesized).enumerate() {
        let ratio = light_above_wall(got) / light_above_wall(expected);
        assert!((0.9..1.1).contains(&ratio), "frame {i}: {ratio}");
    }
    let got = against(&rendered, &synthesized);
    assert!(got.f1 > 0.87 && (0.85..1.15).contains(&got.count_ratio), "{got:?}");
}

#[test]
fn at_the_ends_of_the_interval_it_is_the_key_frames() {
    let moving = |t: f64| pose(DVec3::ZERO, DVec3::new(-0.6 + 0.4 * t, 0.0, 0.0));
    let stage = Stage::new(&shake, &moving, vec![wall(), bar(5.0, texture)]);
    let frames = [0, INTERVAL_NS].map(|t_ns| stage.frame(t_ns));
    let rigid =
        Rigid::new(&stage.scene, [input(&frames[0]), input(&frames[1])], LOG_OFFSET, (Taps::Cubic, 1), None);
    for (fraction, frame) in [(0.0, &frames[0]), (1.0, &frames[1])] {
        let instant = rigid.instant(fraction);
        for (pixel, intensity) in frame.planes[0].iter().enumerate() {
            let got = rigid.sample(&instant, 0, pixel % SIZE.0, pixel / SIZE.0).intensity().expect("a path");
            assert!(
                (got / intensity - 1.0).abs() < 1e-6,
                "{pixel} at {fraction}: {got}, expected {intensity}"
            );
        }
    }
}

#[test]
fn a_pixel_without_a_path_is_blended_and_counted_by_its_reason() {
    let mut frames = [0, INTERVAL_NS].map(|t_ns| Stage::new(&shake, &still, vec![wall()]).frame(t_ns));
    for frame in &mut frames {
        frame.depth_m[5] = f64::NAN;
        frame.depth_m[6] = -1.0;
        frame.ids[7] = 9;
    }
    let stage = Stage::new(&shake, &still, vec![]);
    let rigid =
        Rigid::new(&stage.scene, [input(&frames[0]), input(&frames[1])], LOG_OFFSET, (Taps::Cubic, 1), None);
    for key in 0..2 {
        assert_eq!(rigid.without_path(key), WithoutPath { depth: 2, poses: 1, lens: 0 });
    }
    let instant = rigid.instant(0.25);
    for x in 5..8 {
        assert_eq!(rigid.sample(&instant, 0, x, 0), Sample::NoPath);
    }
    assert!(matches!(rigid.sample(&instant, 0, 8, 5), Sample::Seen(_)));
}

#[test]
fn what_neither_key_frame_shows_is_counted_as_unseen() {
    // A bar stands before the wall in both frames, at the same place. Between them it is elsewhere.
    let moving = |t: f64| {
        let angle = std::f64::consts::TAU * t;
        pose(DVec3::ZERO, DVec3::new(0.5 - 0.5 * angle.cos(), 0.0, 0.0))
    };
    let wall = Sheet { light: |_, _| 0.3, ..wall() };
    let stage = Stage::new(&still, &moving, vec![wall, bar(4.0, |_, _| 2.0)]);
    let frames = [0, INTERVAL_NS].map(|t_ns| stage.frame(t_ns));
    let rigid =
        Rigid::new(&stage.scene, [input(&frames[0]), input(&frames[1])], LOG_OFFSET, (Taps::Cubic, 1), None);
    let Sample::Unseen(Some(behind)) = rigid.sample(&rigid.instant(0.5), 0, 24, 16) else {
        panic!("not unseen")
    };
    assert!((behind - 0.3).abs() < 1e-6, "the wall beside it, not the bar: {behind}");
    assert!(matches!(rigid.sample(&rigid.instant(0.5), 0, 10, 16), Sample::Seen(_)));
    // The bar itself is where it is.
    let Sample::Seen(bar) = rigid.sample(&rigid.instant(0.5), 0, 44, 16) else { panic!("not seen") };
    assert!((bar - 2.0).abs() < 1e-6, "{bar}");
}

#[test]
fn pixels_beside_what_is_nearer_have_it_as_their_front() {
    for width in [1, 2, 3, 5] {
        // Half a pixel to the right, so that `width` columns from the middle one to the left show it.
        let moving = |_: f64| pose(DVec3::ZERO, DVec3::new(-0.025 * (width % 2) as f64, 0.0, 0.0));
        let stage = Stage::new(&still, &moving, vec![wall(), bar(width as f64 - 0.1, texture)]);
        let frame = stage.frame(0);
        let surfaces = Surfaces::new(&stage.scene, &input(&frame).geometry);
        let row = 16 * SIZE.0;
        let columns: Vec<usize> = (0..SIZE.0).filter(|x| frame.ids[row + x] == 1).collect();
        assert_eq!(columns.len(), width);
        let (first, last) = (columns[0], columns[width - 1]);
        for x in 1..SIZE.0 - 1 {
            let front = surfaces.front(row + x);
            // Of three pixels of the same depth the upper one counts.
            let expected = if x + 1 == first {
                Some(row - SIZE.0 + first)
            } else if x == last + 1 {
                Some(row - SIZE.0 + last)
            } else {
                None
            };
            assert_eq!(front, expected, "{width} px: column {x}");
            let on_bar = columns.contains(&x);
            let thickness = match width {
                1 if on_bar => 0.0,
                2 if on_bar => HALF_THICK,
                _ => 1.0,
            };
            assert_eq!(surfaces.thickness(row + x), thickness, "{width} px: column {x}");
        }
    }
}
