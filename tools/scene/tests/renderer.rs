//! Compares the shader with the f64 implementation, and its memory layout with the Rust structs.

use esaac_engine::ash::vk;
use esaac_engine::{Buffer, Device, DeviceChoice, MemoryLocation, Validation};
use esaac_model::{HdrFormat, MotionFormat};
use esaac_scene::layout::{MAX_LAYERS, MAX_OBJECTS, ViewData};
use esaac_scene::renderer::{BINDINGS, RENDER_SPIRV, RenderError, Renderer, Targets, WORKGROUP_PX};
use esaac_scene::{Frame, Scene, SceneKind, render_cpu};
use std::sync::{Arc, LazyLock};

/// Largest relative difference of f32 radiance. A ray is exact to about 3e-5 px in f32, and log radiance changes by a
/// few nepers per pixel at most, at the borders of the brightest objects.
const RADIANCE_TOLERANCE: f64 = 2e-4;

/// Largest relative difference where the radiance is smooth: at all but one pixel in a hundred, except of `poles`, where
/// borders are everywhere.
const SMOOTH_RADIANCE_TOLERANCE: f64 = 1e-5;

/// Largest relative difference of f16 radiance: half a unit in the last place, or a whole one on devices that truncate.
const F16_TOLERANCE: f64 = 1.0 / 1024.0;

/// Tolerance of motion. Rounding of the motion is proportional to its size; that of the ray adds an absolute error.
const MOTION_TOLERANCE_PX: f64 = 5e-5;

/// Largest relative difference of depth.
const DEPTH_TOLERANCE: f64 = 1e-5;

/// Largest share of pixels that two surfaces cover half each, up to rounding, so that either may count as the nearest.
const TIES: f64 = 1e-3;

/// The device of all tests here. The validation layer may crash while one device is used and another is opened.
static DEVICE: LazyLock<Arc<Device>> = LazyLock::new(|| {
    Device::open(DeviceChoice::Best, Validation::from_env()).expect("a Vulkan device is needed for this test")
});

fn buffer(device: &Arc<Device>, name: &str, bytes: usize) -> Buffer {
    let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
    device.allocate(name, bytes as u64, usage, MemoryLocation::GpuToCpu).expect("a small buffer")
}

fn renderer(device: &Arc<Device>, scene: &Scene, hdr: HdrFormat, motion: MotionFormat) -> Renderer {
    Renderer::new(device, scene.clone(), hdr, motion).expect("a renderer")
}

fn render_gpu(
    device: &Arc<Device>,
    renderer: &mut Renderer,
    times_ns: (i64, Option<i64>),
    hdr: HdrFormat,
    motion: MotionFormat,
) -> Frame {
    let scene = renderer.scene();
    let pixels = (scene.width_px * scene.height_px) as usize;
    let sizes = [pixels * hdr.texel_bytes(), pixels * motion.texel_bytes(), pixels * 4, pixels * 4];
    let [colour, moved, depth, ids] = [("colour", 0), ("motion", 1), ("depth", 2), ("ids", 3)]
        .map(|(name, index)| buffer(device, name, sizes[index]));
    let targets = Targets { hdr: &colour, motion: Some(&moved), depth: Some(&depth), ids: Some(&ids) };
    renderer.render(times_ns.0, times_ns.1, targets).expect("a frame");
    assert_eq!(device.validation_messages(), Vec::<String>::new());
    Frame {
        hdr: colour.read::<u8>(0, sizes[0]).to_vec(),
        motion: moved.read::<u8>(0, sizes[1]).to_vec(),
        depth: depth.read::<u8>(0, sizes[2]).to_vec(),
        ids: ids.read::<u8>(0, sizes[3]).to_vec(),
    }
}

/// Share of values beyond the tolerance and the largest difference.
struct Differences {
    beyond: f64,
    largest: f64,
    quantile99: f64,
}

fn differences(pairs: impl Iterator<Item = (f64, f64)>, tolerance: f64, relative: bool) -> Differences {
    let mut all: Vec<f64> = pairs
        .map(|(a, b)| if a == b { 0.0 } else { (a - b).abs() / if relative { b.abs() } else { 1.0 } })
        .map(|d| if d.is_nan() { f64::INFINITY } else { d })
        .collect();
    all.sort_by(f64::total_cmp);
    let beyond = all.iter().filter(|d| **d > tolerance).count() as f64 / all.len() as f64;
    Differences { beyond, largest: all[all.len() - 1], quantile99: all[(all.len() - 1) * 99 / 100] }
}

fn colours(frame: &Frame, format: HdrFormat, pixels: usize) -> impl Iterator<Item = f64> {
    (0..pixels).flat_map(move |i| format.decode(&frame.hdr, i))
}

fn motions(frame: &Frame, format: MotionFormat, pixels: usize) -> impl Iterator<Item = f64> {
    (0..pixels).flat_map(move |i| format.decode(&frame.motion, i))
}

fn depths(frame: &Frame) -> impl Iterator<Item = f64> {
    bytemuck::pod_collect_to_vec::<u8, f32>(&frame.depth).into_iter().map(f64::from)
}

fn ids(frame: &Frame) -> impl Iterator<Item = u32> {
    bytemuck::pod_collect_to_vec::<u8, u32>(&frame.ids).into_iter()
}

#[test]
fn every_scene_is_the_f64_face() {
    let device = &*DEVICE;
    let mut renderer = renderer(device, &SceneKind::Edge.scene(1, 1), HdrFormat::F32x4, MotionFormat::F32x2);
    for kind in SceneKind::ALL {
        for (width_px, height_px) in [(1, 1), (7, 9), (131, 97), (346, 260)] {
            for t_ns in [1_234_567_891, 7_033_333_333] {
                let scene = kind.scene(width_px, height_px);
                let pixels = (width_px * height_px) as usize;
                let times_ns = (t_ns, Some(t_ns - 33_333_333));
                let (hdr, motion) = (HdrFormat::F32x4, MotionFormat::F32x2);
                renderer.set_scene(scene.clone()).expect("a scene that fits");
                let gpu = render_gpu(device, &mut renderer, times_ns, hdr, motion);
                let cpu = render_cpu(&scene, times_ns.0, times_ns.1, hdr, motion);
                let label = format!("{kind:?} {width_px}x{height_px} at {t_ns}");
                let colour = colours(&gpu, hdr, pixels).zip(colours(&cpu, hdr, pixels));
                let colour = differences(colour, RADIANCE_TOLERANCE, true);
                let moved = motions(&gpu, motion, pixels).zip(motions(&cpu, motion, pixels));
                let moved = differences(moved, MOTION_TOLERANCE_PX, false);
                let depth = differences(depths(&gpu).zip(depths(&cpu)), DEPTH_TOLERANCE, true);
                let other_ids = ids(&gpu).zip(ids(&cpu)).filter(|(a, b)| a != b).count();
                println!(
                    "{label}: radiance {:.1e} (99% {:.1e}), motion {:.1e} ({:.1e}), depth {:.1e} ({:.1e}), ids {other_ids}",
                    colour.largest,
                    colour.quantile99,
                    moved.largest,
                    moved.beyond,
                    depth.largest,
                    depth.beyond
                );
                assert!(colour.largest <= RADIANCE_TOLERANCE, "{label}: radiance {}", colour.largest);
                let smooth =
                    if kind == SceneKind::Poles { RADIANCE_TOLERANCE } else { SMOOTH_RADIANCE_TOLERANCE };
                assert!(colour.quantile99 <= smooth, "{label}: {}", colour.quantile99);
                assert!(moved.beyond <= TIES, "{label}: motion {} {}", moved.beyond, moved.largest);
                assert!(depth.beyond <= TIES, "{label}: depth {} {}", depth.beyond, depth.largest);
                assert!(other_ids as f64 <= TIES * pixels as f64, "{label}: {other_ids} ids");
            }
        }
    }
}

#[test]
fn every_format_holds_the_same_frame() {
    let device = &*DEVICE;
    for kind in [SceneKind::Flight, SceneKind::Hdr] {
        let scene = kind.scene(65, 33);
        let pixels = 65 * 33;
        let times_ns = (500_000_000, Some(480_000_000));
        let cpu = render_cpu(&scene, times_ns.0, times_ns.1, HdrFormat::F16x4, MotionFormat::F32x2);
        for motion in [MotionFormat::F16x2, MotionFormat::F32x2, MotionFormat::F32x4] {
            let mut renderer = renderer(device, &scene, HdrFormat::F16x4, motion);
            let gpu = render_gpu(device, &mut renderer, times_ns, HdrFormat::F16x4, motion);
            let colour = colours(&gpu, HdrFormat::F16x4, pixels).zip(colours(&cpu, HdrFormat::F16x4, pixels));
            let colour = differences(colour, F16_TOLERANCE, true);
            assert!(colour.largest <= F16_TOLERANCE, "{kind:?}: {}", colour.largest);
            let moved = motions(&gpu, motion, pixels).zip(motions(&cpu, MotionFormat::F32x2, pixels));
            let tolerance =
                if motion == MotionFormat::F16x2 { 8.0 * F16_TOLERANCE } else { MOTION_TOLERANCE_PX };
            let moved = differences(moved, tolerance, false);
            assert!(moved.beyond <= TIES, "{kind:?} {motion:?}: {}", moved.largest);
        }
    }
}

#[test]
fn without_a_previous_frame_nothing_moves() {
    let device = &*DEVICE;
    let (hdr, motion) = (HdrFormat::F16x4, MotionFormat::F32x2);
    let mut renderer = renderer(device, &SceneKind::Flight.scene(21, 13), hdr, motion);
    let frame = render_gpu(device, &mut renderer, (0, None), hdr, motion);
    assert!(motions(&frame, motion, 21 * 13).all(|m| m == 0.0));
    renderer.set_scene(SceneKind::Still.scene(21, 13)).expect("a scene that fits");
    let frame = render_gpu(device, &mut renderer, (9, Some(1)), hdr, motion);
    assert!(motions(&frame, motion, 21 * 13).all(|m| m == 0.0));
    let later = render_gpu(device, &mut renderer, (3_600_000_000_000, Some(5)), hdr, motion);
    assert_eq!(frame, later);
}

#[test]
fn a_short_buffer_and_a_wrong_format_are_refused() {
    let device = &*DEVICE;
    let scene = SceneKind::Edge.scene(16, 16);
    let error = Renderer::new(device, scene.clone(), HdrFormat::Srgb8x4, MotionFormat::F32x2).err();
    assert!(matches!(error, Some(RenderError::Format { .. })));
    let mut renderer =
        Renderer::new(device, scene, HdrFormat::F16x4, MotionFormat::F32x2).expect("a renderer");
    let small = buffer(device, "small", 16);
    let targets = Targets { hdr: &small, motion: None, depth: None, ids: None };
    let error = renderer.render(0, None, targets).expect_err("too small").to_string();
    assert!(error.contains("2048") && error.contains("16") && error.contains("colour"), "{error}");
}

#[test]
fn the_shader_reads_the_structs_that_rust_writes() {
    // The embedded module is optimised, which removes names. Compiled without optimisation it keeps them.
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/glsl/render.comp");
    let compiled = std::process::Command::new("glslc")
        .args(["--target-env=vulkan1.2", source, "-o", "-"])
        .output()
        .expect("glslc runs: apt-get install glslc");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let reflection = esaac_kernels::reflect(&esaac_kernels::words(&compiled.stdout)).expect("SPIR-V");
    let embedded = esaac_kernels::reflect(&esaac_kernels::words(RENDER_SPIRV)).expect("SPIR-V");
    assert_eq!(embedded.workgroup, reflection.workgroup);
    assert_eq!(reflection.workgroup, [WORKGROUP_PX, WORKGROUP_PX, 1]);
    assert_eq!(reflection.bindings.len() as u32, BINDINGS);
    let offsets = |name: &str| -> Vec<u32> { reflection.structs[name].iter().map(|m| m.offset).collect() };
    assert_eq!(offsets("Layer"), [0, 16, 32]);
    assert_eq!(offsets("Object"), [0, 16, 32, 48, 64, 80, 144, 160, 176, 192, 208, 224]);
    let view = offsets("ViewBuffer");
    let header: Vec<u32> = (0..15).map(|i| 16 * i).collect();
    assert_eq!(view[..15], header);
    assert_eq!(view[15..], [240, 240 + 272 * MAX_OBJECTS as u32]);
    assert_eq!(size_of::<ViewData>(), 240 + 272 * MAX_OBJECTS + 48 * MAX_LAYERS);
}
