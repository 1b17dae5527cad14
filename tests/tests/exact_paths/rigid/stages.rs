//! Compares what `ingest` and `paths` prepare for synthesis `rigid` with the oracle: poses, surfaces, lists of blocks,
//! half-pel frames.

use super::input::changed;
use super::still::behind_a_post;
use esaac_engine::{KernelPolicy, Rig, RigOptions};
use esaac_layout::{PASSING_ENTRIES, PASSING_HEAD_WORDS, REPRESENTATIVE_WORDS};
use esaac_model::paths::{Intrinsics, SceneMotion};
use esaac_model::synthesis::rigid::BLOCK_PX;
use esaac_model::{Intensity, SensorModel, Synthesis};
use esaac_oracle::synthesize::rigid::Rigid;
use esaac_oracle::synthesize::rigid::read::KeyFrame;
use esaac_scene::SceneKind;
use esaac_tests::device::assert_silent;
use esaac_tests::geometry::Rendered;
use glam::{DMat3, DVec3};

/// Size of the frames: neither is a multiple of a block.
const SIZE: (u32, u32) = (75, 53);

const SCENES: [SceneKind; 4] = [SceneKind::Shake, SceneKind::Poles, SceneKind::Propeller, SceneKind::Bounce];

/// Error of a position in an image, pixels, that the interpolation of poses may add.
const PATH_TOLERANCE_PX: f64 = 1e-4;

/// Share of pixels that may differ: a test that falls the other way by rounding.
const DIFFERING_SHARE: f64 = 1e-3;

fn sensor() -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis: Synthesis::Rigid,
        intensity: Intensity::Luminance,
        log_offset: 0.01,
        substeps: 16,
        ..SensorModel::default()
    }
}

/// Runs a rig through all frames.
fn run(rendered: &Rendered, sensor: &SensorModel) -> Rig {
    run_by(rendered, sensor, None)
}

/// As [`run`], with kernels of another policy.
pub(super) fn run_by(rendered: &Rendered, sensor: &SensorModel, policy: Option<KernelPolicy>) -> Rig {
    let mut rig = rendered.rig(sensor, RigOptions { policy, ..RigOptions::default() });
    for frame in &rendered.frames {
        rig.upload(0, &frame.bytes()).expect("a frame that fits");
        rig.step(&[frame.t_ns]).expect("a frame in time");
    }
    rig
}

/// The last interval by the oracle, after all before it.
fn oracle<'a>(rendered: &'a Rendered, planes: &'a [Vec<Vec<f64>>], sensor: &SensorModel) -> Rigid<'a> {
    let input = |frame: usize| rendered.frames[frame].input(rendered.size, &planes[frame]);
    let mut history = None;
    let mut last = None;
    for frame in 1..rendered.frames.len() {
        if let Some(before) = last.take() {
            history = Some(Rigid::into_history(before));
        }
        last = Some(Rigid::new(
            &rendered.scene,
            [input(frame - 1), input(frame)],
            sensor.log_offset,
            (sensor.taps, sensor.detail_transfers()),
            history.take(),
        ));
    }
    last.expect("at least two frames")
}

fn planes(rendered: &Rendered, sensor: &SensorModel) -> Vec<Vec<Vec<f64>>> {
    rendered.frames.iter().map(|frame| frame.planes(sensor)).collect()
}

/// Position in key frame 0 of a point on a ray at an instant, by the twelve numbers of a pose.
fn in_start(lens: &Intrinsics, rows: &[f32], ray: DVec3, inverse_depth: f64) -> glam::DVec2 {
    let row = |axis: usize| {
        DVec3::new(f64::from(rows[4 * axis]), f64::from(rows[4 * axis + 1]), f64::from(rows[4 * axis + 2]))
    };
    let shift = DVec3::new(f64::from(rows[3]), f64::from(rows[7]), f64::from(rows[11]));
    let turn = DMat3::from_cols(row(0), row(1), row(2)).transpose();
    lens.project((turn * ray + shift * inverse_depth).extend(1.0))
        .expect("a point before the camera")
        .pixel_px
}

/// Largest error of a path, pixels, over instances, numbers of sub-steps, and points.
fn worst_path(rig: &Rig, scene: &SceneMotion, [from_ns, to_ns]: [i64; 2], substeps: u32) -> f64 {
    let words = rig.words(0, "paths").expect("a rig that is well");
    let paths: Vec<f32> = words.into_iter().map(f32::from_bits).collect();
    let instants = esaac_layout::path_instants(substeps) as usize;
    let lens = scene.lens();
    let mut worst_px = 0.0_f64;
    let ids = std::iter::once(0).chain(scene.ids());
    for (row, id) in ids.enumerate() {
        let mut instant = 0;
        for n in 2..=substeps {
            for i in 1..n {
                let t_ns = from_ns + (f64::from(i) / f64::from(n) * (to_ns - from_ns) as f64).round() as i64;
                let exact = scene.relative(id, t_ns, from_ns).expect("poses");
                let rows = &paths[12 * (row * instants + instant)..][..12];
                for (x, y, inverse_depth) in [(3.0, 5.0, 0.0), (60.0, 11.0, 0.2), (33.0, 47.0, 1.0)] {
                    let ray = lens.ray(glam::DVec2::new(x, y)).expect("a ray");
                    let Some(expected) = lens.project(exact.apply(ray.extend(inverse_depth))) else {
                        continue;
                    };
                    let found = in_start(lens, rows, ray, inverse_depth);
                    worst_px = worst_px.max((found - expected.pixel_px).length());
                }
                instant += 1;
            }
        }
        assert_eq!(instant, instants);
    }
    worst_px
}

#[test]
fn poses_at_sub_steps_are_those_of_the_tracks() {
    for kind in SCENES {
        let rendered = Rendered::of(kind, SIZE, 2);
        let sensor = sensor();
        let rig = run(&rendered, &sensor);
        let times_ns = [rendered.frames[0].t_ns, rendered.frames[1].t_ns];
        let worst_px = worst_path(&rig, &rendered.scene, times_ns, sensor.substeps);
        println!("{kind:?}: {worst_px:.1e} px");
        assert!(worst_px < PATH_TOLERANCE_PX, "{kind:?}: {worst_px:.2e} px");
    }
    assert_silent();
}

/// In a block's first word of `representatives`: it has a silhouette.
const HAS_SILHOUETTE: u32 = 1 << 31;

/// What `surfaces` says of a pixel: inverse depth; and row, eight bits for the pixels around that continue its surface,
/// and eight for those that are pure as far as it can tell, or its front.
fn surface_words(rig: &Rig, frame: usize) -> Vec<[u32; 2]> {
    let words = rig.words(0, "surfaces").expect("a rig that is well");
    let pixels = (SIZE.0 * SIZE.1) as usize;
    // A rig's first frame is in slot 0.
    let slot = frame % 2;
    words[2 * pixels * slot..][..2 * pixels].chunks(2).map(|pair| [pair[0], pair[1]]).collect()
}

/// The bits that `surfaces` has of a pixel, and which of them count: those of pixels in the image.
fn expected_bits(key: &KeyFrame, pixel: usize) -> [u32; 2] {
    let (width, height) = key.surfaces.size;
    let (x, y) = ((pixel % width) as isize, (pixel / width) as isize);
    let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|&step| step != (0, 0));
    let (mut bits, mut known) = (0, 0);
    for (i, (dx, dy)) in around.enumerate() {
        let (column, row) = ((x + dx) as usize, (y + dy) as usize);
        if column < width && row < height {
            let other = row * width + column;
            bits |= u32::from(key.surfaces.continues(pixel, other)) << i;
            let is_pure = key.surfaces.all_continue(pixel, other, 1);
            bits |= u32::from(is_pure || key.front[pixel] == Some(other)) << (8 + i);
            known |= 0x101 << i;
        }
    }
    [bits, known]
}

fn is_inner(key: &KeyFrame, pixel: usize) -> bool {
    key.surfaces.all_continue(pixel, pixel, 2)
}

fn has_silhouette(key: &KeyFrame, block: (usize, usize)) -> bool {
    let size = key.surfaces.size;
    let side = |first: usize, size: usize| first * BLOCK_PX..((first + 1) * BLOCK_PX).min(size);
    side(block.1, size.1).any(|y| side(block.0, size.0).any(|x| !is_inner(key, y * size.0 + x)))
}

#[test]
fn surfaces_and_their_bits_are_the_oracles() {
    for kind in SCENES {
        let rendered = Rendered::of(kind, SIZE, 3);
        let sensor = sensor();
        let rig = run(&rendered, &sensor);
        let planes = planes(&rendered, &sensor);
        let oracle = oracle(&rendered, &planes, &sensor);
        let ids: Vec<u32> = std::iter::once(0).chain(rendered.scene.ids()).collect();
        let found = surface_words(&rig, 2);
        let key = oracle.key(1);
        let mut differing = 0;
        for (pixel, [inverse_depth, word]) in found.iter().enumerate() {
            let row = (word & 0xffff) as usize;
            match key.surfaces.element(pixel) {
                Err(_) => assert_eq!(row, 0xffff, "{kind:?}: pixel {pixel}"),
                Ok(element) => {
                    assert_eq!(ids[row], element.id, "{kind:?}: pixel {pixel}");
                    let error = f64::from(f32::from_bits(*inverse_depth)) - element.inverse_depth;
                    assert!(error.abs() <= 1e-6 * element.inverse_depth, "{kind:?}: pixel {pixel}");
                }
            }
            let [expected, known] = expected_bits(key, pixel);
            differing += (((word >> 16) & known) ^ expected).count_ones();
        }
        let inner = (0..found.len()).filter(|&pixel| is_inner(key, pixel)).count();
        // A front that only a kernel sees, or another, is two bits at most.
        let fronts = key.front.iter().flatten().count();
        assert!(fronts > 100, "{kind:?}: {fronts} fronts");
        let bits = 16 * found.len();
        println!("{kind:?}: {differing} of {bits} bits differ, {inner} pixels are inner");
        assert!(f64::from(differing) <= DIFFERING_SHARE * bits as f64, "{kind:?}: {differing}");
        assert!(inner > 0 && inner < found.len(), "{kind:?}: both kinds of pixels");
    }
    assert_silent();
}

/// Two frames before a shaking camera in which nothing but the static world is, some of its pixels at another depth.
fn still_world(depths_m: impl Fn(usize) -> Option<f32>) -> Rendered {
    let rendered = Rendered::of(SceneKind::Shake, SIZE, 2);
    let frames = rendered.frames.iter().map(|frame| {
        changed(frame, |pixel, depth, id| (*depth, *id) = (depths_m(pixel).unwrap_or(*depth), 0))
    });
    Rendered { frames: frames.collect(), ..rendered.clone() }
}

/// With both sets of kernels, all bits that `surfaces` has of the second frame are the oracle's, and `more` holds of its key
/// frame and of the words.
fn assert_bits_are_the_oracles(rendered: &Rendered, more: impl Fn(&KeyFrame, &[[u32; 2]])) {
    let planes = planes(rendered, &sensor());
    let oracle = oracle(rendered, &planes, &sensor());
    let key = oracle.key(1);
    for policy in [None, Some(KernelPolicy::gpu())] {
        let found = surface_words(&run_by(rendered, &sensor(), policy), 1);
        for (pixel, [_, word]) in found.iter().enumerate() {
            let [expected, known] = expected_bits(key, pixel);
            assert_eq!((word >> 16) & known, expected, "pixel {pixel}");
        }
        more(key, &found);
    }
    assert_silent();
}

/// A wall that is slanted in both directions fills the image: every pixel continues every other, also at the border.
#[test]
fn a_slanted_wall_is_one_surface_up_to_the_border() {
    let rendered = still_world(|pixel| {
        let (x, y) = (pixel % SIZE.0 as usize, pixel / SIZE.0 as usize);
        Some(1.0 / (0.05 + 0.02 * x as f32 + 0.03 * y as f32))
    });
    assert_bits_are_the_oracles(&rendered, |key, found| {
        (0..found.len()).for_each(|pixel| assert!(is_inner(key, pixel), "pixel {pixel}"));
    });
}

/// A plane that falls to an inverse depth of 0 just where a pixel at infinity is ends before that.
#[test]
fn what_is_at_infinity_continues_no_nearer_surface() {
    let rendered = still_world(|pixel| match pixel % SIZE.0 as usize % 9 {
        // The slope of the inverse depth at the second is all of it.
        0 => Some(2.55),
        1 => Some(12.0),
        2 => Some(f32::INFINITY),
        // At infinity, either way.
        3 => Some(0.0),
        // Half of it.
        5 => Some(4.0),
        6 => Some(8.0),
        7 | 8 => Some(f32::INFINITY),
        _ => None,
    });
    assert_bits_are_the_oracles(&rendered, |_, found| {
        let is_right = |word: u32| word & (1 << (16 + 4)) != 0;
        let row = &found[10 * SIZE.0 as usize..][..9];
        assert_eq!([1, 2, 6, 7].map(|x: usize| is_right(row[x][1])), [false, true, false, true]);
    });
}

/// The representatives of a block by their definition: nearest and farthest pixel of each instance, near to far.
fn representatives(key: &KeyFrame, block: (usize, usize)) -> Vec<f64> {
    let size = key.surfaces.size;
    let mut extremes = std::collections::BTreeMap::<u32, Vec<f64>>::new();
    for y in block.1 * BLOCK_PX..((block.1 + 1) * BLOCK_PX).min(size.1) {
        for x in block.0 * BLOCK_PX..((block.0 + 1) * BLOCK_PX).min(size.0) {
            if let Ok(element) = key.surfaces.element(y * size.0 + x) {
                extremes.entry(element.id).or_default().push(element.inverse_depth);
            }
        }
    }
    let mut depths: Vec<f64> = extremes
        .into_values()
        .flat_map(|mut depths| {
            depths.sort_by(|a, b| b.total_cmp(a));
            let (nearest, farthest) = (depths[0], depths[depths.len() - 1]);
            // One pixel alone, or pixels of one depth, are one representative.
            if nearest == farthest { vec![nearest] } else { vec![nearest, farthest] }
        })
        .collect();
    depths.sort_by(|a, b| b.total_cmp(a));
    depths.truncate(esaac_model::synthesis::rigid::BLOCK_SURFACES);
    depths
}

#[test]
fn blocks_have_the_oracles_representatives() {
    for kind in SCENES {
        let rendered = Rendered::of(kind, SIZE, 3);
        let sensor = sensor();
        let rig = run(&rendered, &sensor);
        let planes = planes(&rendered, &sensor);
        let oracle = oracle(&rendered, &planes, &sensor);
        let words = rig.words(0, "representatives").expect("a rig that is well");
        let (columns, rows) = ((SIZE.0 as usize).div_ceil(BLOCK_PX), (SIZE.1 as usize).div_ceil(BLOCK_PX));
        let (mut most, mut with_silhouette) = (0, 0);
        for block in 0..columns * rows {
            // The third frame is in slot 0.
            let list = &words[block * REPRESENTATIVE_WORDS as usize..];
            let pixels = &list[1..=(list[0] & !HAS_SILHOUETTE) as usize];
            let at = (block % columns, block / columns);
            let expected = representatives(oracle.key(1), at);
            most = most.max(expected.len());
            let found = list[0] & HAS_SILHOUETTE != 0;
            with_silhouette += usize::from(found);
            assert_eq!(found, has_silhouette(oracle.key(1), at), "{kind:?}: block {at:?}");
            assert_eq!(pixels.len(), expected.len(), "{kind:?}: block {at:?}");
            for (&pixel, expected) in pixels.iter().zip(expected) {
                let found = oracle.key(1).surfaces.element(pixel as usize).expect("a surface").inverse_depth;
                // In f32, two pixels may be as near.
                assert!((found - expected).abs() <= 1e-6 * expected, "{kind:?}: block {at:?}");
            }
        }
        assert!(most > 2, "{kind:?}: some block shows two instances");
        assert!(
            (1..columns * rows).contains(&with_silhouette),
            "{kind:?}: {with_silhouette} with a silhouette"
        );
    }
    assert_silent();
}

#[test]
fn a_block_with_a_silhouette_lists_what_it_shows_itself_and_none_lists_a_surface_twice() {
    for rendered in [Rendered::of(SceneKind::Bounce, SIZE, 3), behind_a_post()] {
        for policy in [None, Some(KernelPolicy::gpu())] {
            check_own_lists(&rendered, policy);
        }
    }
}

fn check_own_lists(rendered: &Rendered, policy: Option<KernelPolicy>) {
    let rendered = Rendered { frames: rendered.frames[..3].to_vec(), ..rendered.clone() };
    let rig = run_by(&rendered, &sensor(), policy);
    let (columns, rows) = ((SIZE.0 as usize).div_ceil(BLOCK_PX), (SIZE.1 as usize).div_ceil(BLOCK_PX));
    let blocks = columns * rows;
    let words = rig.words(0, "passing").expect("a rig that is well");
    let representatives = rig.words(0, "representatives").expect("a rig that is well");
    let heads = (PASSING_HEAD_WORDS as usize) * blocks;
    for block in 0..blocks {
        // The third frame is in slot 0; the heads of the next tick are empty.
        let [count, next] = [0, heads].map(|first| words[first + block * PASSING_HEAD_WORDS as usize]);
        assert_eq!(next, 0);
        assert!(count <= PASSING_ENTRIES, "block {block}: {count}");
        let entries = &words[2 * heads + block * PASSING_ENTRIES as usize..][..count as usize];
        let mut sorted = entries.to_vec();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), entries.len(), "block {block} lists a surface twice");
        let list = &representatives[block * REPRESENTATIVE_WORDS as usize..];
        if list[0] & HAS_SILHOUETTE != 0 {
            for place in 0..list[0] & !HAS_SILHOUETTE {
                let entry = (block as u32 * REPRESENTATIVE_WORDS + 1 + place) | 1 << 31;
                assert!(sorted.contains(&entry), "block {block} shows its place {place} at the end");
            }
        }
    }
    assert_silent();
}

/// A half-pel frame as a rig has it.
struct HalfPelWords {
    samples: Vec<f64>,
    /// Keys' parameter of each block.
    parameters: Vec<f64>,
}

/// The half-pel frames of the last two frames: by frame (0 the earlier), then plane.
fn half_pel_words(rig: &Rig, frames: usize, planes: usize) -> [Vec<HalfPelWords>; 2] {
    let words = rig.words(0, "planes").expect("a rig that is well");
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let stride = 2 * width + 4;
    let blocks = width.div_ceil(BLOCK_PX) * height.div_ceil(BLOCK_PX);
    let frame_words = stride * (2 * height + 3) + blocks.next_multiple_of(2);
    // A rig's first frame is in slot 0.
    [frames % 2, 1 - frames % 2].map(|slot| {
        (0..planes)
            .map(|plane| {
                let first = (slot * planes + plane) * frame_words;
                let word = |i: usize| f64::from(f32::from_bits(words[first + i]));
                let sample = |i: usize| word((i / (2 * width) + 1) * stride + i % (2 * width) + 2);
                HalfPelWords {
                    samples: (0..4 * width * height).map(sample).collect(),
                    parameters: (frame_words - blocks..frame_words).map(word).collect(),
                }
            })
            .collect()
    })
}

fn check_half_pels(kind: SceneKind, sensor: &SensorModel, policy: Option<KernelPolicy>) {
    let rendered = Rendered::of(kind, SIZE, 4);
    let rig = run_by(&rendered, sensor, policy);
    let planes = planes(&rendered, sensor);
    let oracle = oracle(&rendered, &planes, sensor);
    let found = half_pel_words(&rig, rendered.frames.len(), planes[0].len());
    for (plane, expected) in oracle.half_pels().iter().enumerate() {
        for key in 0..2 {
            let (mut differing, mut worst) = (0, 0.0_f64);
            let (found, expected) = (&found[key][plane], &expected[key]);
            for (found, expected) in found.samples.iter().zip(expected.samples()) {
                let error = (found - expected).abs();
                worst = worst.max(error);
                differing += usize::from(error > 1e-4);
            }
            let what = format!("{kind:?}, plane {plane}, key frame {key}");
            println!("{what}: {differing} of {} differ, by up to {worst:.1e}", expected.samples().len());
            assert!(
                differing as f64 <= DIFFERING_SHARE * expected.samples().len() as f64,
                "{what}: {differing}"
            );
            assert_eq!(found.parameters.len(), expected.parameters().len(), "{what}");
            for (block, (found, expected)) in found.parameters.iter().zip(expected.parameters()).enumerate() {
                assert!(
                    (found - expected).abs() < 1e-4,
                    "{what}, block {block}: {found}, expected {expected}"
                );
            }
        }
    }
}

#[test]
fn half_pel_frames_take_detail_along_exact_paths() {
    for kind in SCENES {
        check_half_pels(kind, &sensor(), None);
    }
    assert_silent();
}

#[test]
fn half_pel_frames_of_mosaics_and_of_any_number_of_transfers_are_the_oracles_too() {
    let mosaic = SensorModel { intensity: Intensity::BayerRggb, ..sensor() };
    let [one, two, three] = [1, 2, 3].map(|transfers| SensorModel { transfers, ..sensor() });
    for sensor in [mosaic, one, two, three] {
        check_half_pels(SceneKind::Propeller, &sensor, None);
    }
    assert_silent();
}

/// The lists of blocks in `representatives`, for each key frame. What lies behind their ends means nothing.
pub(super) fn lists_of(rig: &Rig) -> Vec<Vec<u32>> {
    let lists = rig.words(0, "representatives").expect("a rig that is well");
    let to_its_end = |list: &[u32]| list[..=(list[0] & !HAS_SILHOUETTE) as usize].to_vec();
    lists.chunks(REPRESENTATIVE_WORDS as usize).map(to_its_end).collect()
}

#[test]
fn kernels_for_gpus_find_the_same() {
    let rendered = Rendered::of(SceneKind::Poles, SIZE, 3);
    let names = ["surfaces", "slopes", "paths"];
    // There is room for more instances than have paths.
    let instances = 1 + rendered.scene.ids().count();
    let path_words = 12 * instances * esaac_layout::path_instants(sensor().substeps) as usize;
    let words = |policy| {
        let rig = run_by(&rendered, &sensor(), policy);
        let lists = lists_of(&rig);
        let tables = names.map(|name| {
            let mut words = rig.words(0, name).expect("a rig that is well");
            if name == "paths" {
                assert!(words.len() >= path_words);
                words.truncate(path_words);
            }
            words
        });
        (tables, lists)
    };
    let (own, for_gpus) = (words(None), words(Some(KernelPolicy::gpu())));
    for (name, (own, for_gpus)) in names.iter().zip(own.0.iter().zip(&for_gpus.0)) {
        assert!(own == for_gpus, "{name}");
    }
    assert!(own.1 == for_gpus.1, "representatives");
    check_half_pels(SceneKind::Poles, &sensor(), Some(KernelPolicy::gpu()));
    let mosaic = SensorModel { intensity: Intensity::BayerRggb, transfers: 3, ..sensor() };
    check_half_pels(SceneKind::Bounce, &mosaic, Some(KernelPolicy::gpu()));
    assert_silent();
}
