//! A thing that passes blocks between two of the instants at which it is looked for.

use super::levels::{check_frames, run, sensor};
use super::stages::run_by;
use esaac_engine::{KernelPolicy, RigOptions};
use esaac_layout::{PASSING_ENTRIES, PASSING_HEAD_WORDS};
use esaac_model::paths::{Intrinsics, Pose, PoseTrack, SceneMotion};
use esaac_model::substeps::BLOCK_PX;
use esaac_model::{Polarity, SensorModel};
use esaac_oracle::synthesize::rigid::Rigid;
use esaac_scene::SceneKind;
use esaac_tests::device::assert_silent;
use esaac_tests::frames::FRAME_NS;
use esaac_tests::geometry::{KeyFrame, Rendered};
use glam::{DQuat, DVec2, DVec3};

const POLICIES: [Option<KernelPolicy>; 2] = [None, Some(KernelPolicy::gpu())];

/// Pixels for a metre at a distance of one.
const FOCAL_PX: f64 = 100.0;

/// Depth of an instance, metres.
fn depth_m(id: u32) -> f64 {
    if id == 0 { 4.0 } else { 1.0 + 0.1 * f64::from(id) }
}

/// Two key frames of bright things before a dark wall, which go straight by `way_px`. `id_at` says which is where in the
/// first.
fn going(size: (u32, u32), way_px: DVec2, ids: u32, id_at: impl Fn(DVec2) -> u32) -> Rendered {
    const POSES: i64 = 16;
    let centre_px = DVec2::new(f64::from(size.0 - 1), f64::from(size.1 - 1)) / 2.0;
    let lens = Intrinsics::pinhole(FOCAL_PX, FOCAL_PX, centre_px.x, centre_px.y).expect("a lens");
    let times_ns: Vec<i64> = (0..=POSES).map(|i| i * FRAME_NS / POSES).collect();
    let track = |poses| PoseTrack::new(times_ns.clone(), poses).expect("poses in order");
    let mut scene = SceneMotion::new(lens, track(vec![Pose::IDENTITY; times_ns.len()]));
    for id in 1..=ids {
        let pose = |i: i64| {
            let way_m = way_px * (i as f64 / POSES as f64) * depth_m(id) / FOCAL_PX;
            // The image's rows go down, the camera's axis y goes up.
            Pose::new(DQuat::IDENTITY, DVec3::new(way_m.x, -way_m.y, 0.0)).expect("a pose")
        };
        scene.insert(id, track((0..=POSES).map(pose).collect())).expect("an instance");
    }
    let frames = [DVec2::ZERO, way_px].into_iter().zip(0..).map(|(shift_px, key)| {
        let at = |pixel| DVec2::new(f64::from(pixel % size.0), f64::from(pixel / size.0));
        let ids: Vec<u32> = (0..size.0 * size.1).map(|pixel| id_at(at(pixel) - shift_px)).collect();
        let light = |&id: &u32| if id == 0 { [0.2_f32, 0.2, 0.2, 1.0] } else { [1.0; 4] };
        let hdr: Vec<[f32; 4]> = ids.iter().map(light).collect();
        let depth: Vec<f32> = ids.iter().map(|&id| depth_m(id) as f32).collect();
        let bytes = [bytemuck::cast_slice(&hdr), bytemuck::cast_slice(&depth), bytemuck::cast_slice(&ids)];
        let [hdr, depth, ids] = bytes.map(<[u8]>::to_vec);
        KeyFrame::new(key * FRAME_NS, hdr, Vec::new(), depth, ids)
    });
    Rendered { size, scene, frames: frames.collect() }
}

/// Neither is a multiple of a block.
const SIZE: (u32, u32) = (235, 123);

/// A bar, smaller than its way from knot to knot, in both directions.
const FIRST_PX: DVec2 = DVec2::new(12.0, 8.0);
const BAR_PX: DVec2 = DVec2::new(9.0, 7.0);
const WAY_PX: DVec2 = DVec2::new(200.0, 96.0);

fn bar() -> Rendered {
    going(SIZE, WAY_PX, 1, |at| u32::from(at.cmpge(FIRST_PX).all() && at.cmplt(FIRST_PX + BAR_PX).all()))
}

fn sensor_of(size: (u32, u32), substeps: u32) -> SensorModel {
    SensorModel { width: size.0, height: size.1, substeps, ..sensor() }
}

#[test]
fn blocks_know_what_passes_them_between_two_knots() {
    let (rendered, sensor) = (bar(), sensor_of(SIZE, 32));
    let planes: Vec<_> = rendered.frames.iter().map(|frame| frame.planes(&sensor)).collect();
    let inputs = [0, 1].map(|key| rendered.frames[key].input(SIZE, &planes[key]));
    let oracle = Rigid::new(&rendered.scene, inputs, sensor.log_offset, (sensor.taps, 1), None);
    let side = BLOCK_PX;
    let blocks = (SIZE.0.div_ceil(side) * SIZE.1.div_ceil(side)) as usize;
    for policy in POLICIES {
        let words = run_by(&rendered, &sensor, policy).words(0, "passing").expect("a rig that is well");
        let head_words = PASSING_HEAD_WORDS as usize;
        // The second frame is in slot 1.
        let ways_px: Vec<f64> = words[head_words * blocks..][..head_words * blocks]
            .chunks(head_words)
            .map(|head| f64::from(f32::from_bits(head[1])))
            .collect();
        let passed = ways_px.iter().filter(|&&way_px| way_px > 200.0).count();
        assert!((80..blocks / 4).contains(&passed), "{passed} of {blocks} blocks are passed");
        for (block, way_px) in ways_px.into_iter().enumerate() {
            let expected_px = oracle.way(block).way_px;
            assert!(
                (way_px - expected_px).abs() < 1e-2,
                "block {block}: {way_px} px, expected {expected_px}"
            );
        }
    }
    assert_silent();
}

#[test]
fn every_pixel_on_its_way_sees_it_come_and_go() {
    let (rendered, sensor) = (bar(), sensor_of(SIZE, 32));
    for policy in POLICIES {
        check_frames(&sensor, &[(SceneKind::Bounce, rendered.clone())], policy, false);
        let steps = run(&sensor, &rendered, RigOptions { policy, ..RigOptions::default() }, false);
        let first_of = |at: DVec2, polarity: Polarity| {
            let mut here =
                steps[1].events.iter().filter(|e| f64::from(e.x) == at.x && f64::from(e.y) == at.y);
            here.find(|e| e.polarity == polarity).map(|e| e.t_ns)
        };
        for share in (10..90).map(|i| f64::from(i) / 100.0) {
            let at = (FIRST_PX + share * WAY_PX + (BAR_PX - 1.0) / 2.0).round();
            let [comes, goes] = [Polarity::On, Polarity::Off].map(|polarity| first_of(at, polarity));
            assert!(comes.is_some() && comes < goes, "{at}: comes at {comes:?} ns, goes at {goes:?} ns");
        }
    }
    assert_silent();
}

const COMB_SIZE: (u32, u32) = (517, 21);
/// Four blocks: what a tooth passes at a knot are three of them.
const SPACING_PX: f64 = 32.0;

/// A comb whose teeth are as far apart as they move from knot to knot: blocks between them are passed between knots alone.
/// Each tooth shows six instances, so more surfaces pass a block than there is room for.
fn comb() -> Rendered {
    going(COMB_SIZE, DVec2::new(8.0 * SPACING_PX, 0.0), 6, |at| {
        let in_tooth = at.x.rem_euclid(SPACING_PX);
        if (0.0..8.0 * SPACING_PX).contains(&at.x) && in_tooth < 6.0 { 1 + in_tooth as u32 } else { 0 }
    })
}

#[test]
fn blocks_without_room_for_what_passes_them_find_what_passes_between_two_knots() {
    // Every other sub-step ends between two knots.
    let (rendered, sensor) = (comb(), sensor_of(COMB_SIZE, 16));
    for policy in POLICIES {
        let words = run_by(&rendered, &sensor, policy).words(0, "passing").expect("a rig that is well");
        let blocks = (COMB_SIZE.0.div_ceil(BLOCK_PX) * COMB_SIZE.1.div_ceil(BLOCK_PX)) as usize;
        let heads = words[PASSING_HEAD_WORDS as usize * blocks..].chunks(PASSING_HEAD_WORDS as usize);
        let without_room = heads.take(blocks).filter(|head| head[0] > PASSING_ENTRIES).count();
        assert!(without_room > blocks / 3, "{without_room} of {blocks} blocks");
        check_frames(&sensor, &[(SceneKind::Poles, rendered.clone())], policy, false);
    }
    assert_silent();
}
