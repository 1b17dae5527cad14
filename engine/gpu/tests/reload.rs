//! Kernels that are edited while a rig runs.

use esaac_engine::{
    CameraConfig, Device, DeviceChoice, EngineError, FrameBytes, KernelFolder, Rig, Validation,
};
use esaac_model::{HdrFormat, MotionFormat, Packet, SensorModel, Synthesis};
use std::path::Path;
use std::sync::{Arc, LazyLock};
use tempfile::TempDir;

const ALL: [&str; 14] = [
    "poses",
    "ingest",
    "detail_transfer",
    "paths",
    "deferred",
    "synthesize",
    "cross",
    "sort",
    "readout",
    "merge",
    "gather",
    "event_frame",
    "voxel_grid",
    "event_ids",
];

/// The device of all tests here. The validation layer may crash while one device is used and another is opened.
static DEVICE: LazyLock<Arc<Device>> =
    LazyLock::new(|| Device::open(DeviceChoice::Best, Validation::from_env()).expect("a Vulkan device"));

/// A rig of one camera and the frames that it is given.
struct Run {
    rig: Rig,
    frame: u64,
}

impl Run {
    const SIZE: (u32, u32) = (37, 23);

    fn new(device: &Arc<Device>, synthesis: Synthesis) -> Self {
        let (width, height) = Self::SIZE;
        let sensor = SensorModel { width, height, synthesis, ..SensorModel::default() };
        let motion = Some(MotionFormat::F32x2);
        let camera = CameraConfig { sensor, camera: 0, hdr: HdrFormat::F32x4, motion, geometry: None };
        Run { rig: Rig::new(device, &[camera]).expect("a rig"), frame: 0 }
    }

    /// A pattern that moves by a pixel a frame.
    fn tick(&mut self) -> Packet {
        let (width, height) = Self::SIZE;
        let colour = (0..width * height).flat_map(|i| {
            let x = f64::from(i % width) - self.frame as f64;
            let value = 1.0 + 0.8 * (0.7 * x + 0.3 * f64::from(i / width)).sin();
            [value as f32, value as f32, value as f32, 1.0]
        });
        let hdr: Vec<u8> = colour.flat_map(f32::to_le_bytes).collect();
        let motion: Vec<u8> =
            (0..width * height).flat_map(|_| [-1.0_f32, 0.0]).flat_map(f32::to_le_bytes).collect();
        self.rig
            .upload(0, &FrameBytes { hdr: &hdr, motion: Some(&motion), ..FrameBytes::default() })
            .expect("the frame fits");
        let tick = self.rig.step(&[self.frame as i64 * 33_333_333]).expect("a tick");
        self.frame += 1;
        tick.packets[0].clone()
    }

    fn problem(&mut self, folder: &mut KernelFolder) -> String {
        match self.rig.reload_kernels(folder) {
            Err(EngineError::Kernels(message)) => message,
            other => panic!("expected an error of the kernels, not {other:?}"),
        }
    }
}

/// A copy of the engine's kernels.
struct Copy(TempDir);

impl Copy {
    fn new() -> Self {
        let copy = tempfile::tempdir().expect("a temporary folder");
        let kernels = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../glsl");
        for entry in std::fs::read_dir(kernels).expect("the folder of kernels") {
            let entry = entry.expect("an entry");
            std::fs::copy(entry.path(), copy.path().join(entry.file_name())).expect("copied");
        }
        Copy(copy)
    }

    fn open(&self) -> KernelFolder {
        KernelFolder::open(self.0.path()).expect("a folder")
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.0.path().join(name)).expect("a kernel")
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.0.path().join(name), text).expect("written");
    }

    /// Makes `cross` find nothing.
    fn silence(&self) {
        let head = "void stamp_and_scatter(Camera cam, uint at_ns, uint tag) {\n";
        let text = self.read("event_sink.glsl");
        assert_eq!(
            text.matches(head).count(),
            1,
            "event_sink.glsl defines `stamp_and_scatter` in another way"
        );
        self.write("event_sink.glsl", &text.replace(head, &format!("{head}    return;\n")));
    }
}

/// Every kernel includes `common.glsl`, so all of them are compiled again.
#[test]
fn a_copy_with_another_comment_gives_the_events_of_the_embedded_kernels() {
    let device = &*DEVICE;
    let copy = Copy::new();
    let (mut embedded, mut copied) =
        (Run::new(device, Synthesis::Motion), Run::new(device, Synthesis::Motion));
    let mut folder = copy.open();
    assert!(copied.rig.reload_kernels(&mut folder).expect("nothing to do").is_empty());
    copy.write("common.glsl", &(copy.read("common.glsl") + "// Edited.\n"));
    assert_eq!(copied.rig.reload_kernels(&mut folder).expect("they compile"), ALL);
    for frame in 0..4 {
        let packet = copied.tick();
        assert_eq!(packet, embedded.tick(), "frame {frame}");
        assert_eq!(packet.is_empty(), frame == 0);
        assert!(copied.rig.reload_kernels(&mut folder).expect("nothing to do").is_empty());
    }
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

#[test]
fn an_edit_counts_from_the_next_tick_on_and_leaves_the_state() {
    let device = &*DEVICE;
    let copy = Copy::new();
    let original = copy.read("event_sink.glsl");
    let mut run = Run::new(device, Synthesis::Linear);
    let mut folder = copy.open();
    run.tick();
    copy.write("random.glsl", &(copy.read("random.glsl") + "// Edited.\n"));
    // An include belongs to the kernels that include it.
    let reloaded = run.rig.reload_kernels(&mut folder).expect("they compile");
    assert!(reloaded.contains(&"cross") && !reloaded.contains(&"sort"), "{reloaded:?}");
    assert!(!run.tick().is_empty(), "the rig forgot its frames");

    copy.silence();
    assert_eq!(run.rig.reload_kernels(&mut folder).expect("it compiles"), ["cross"]);
    assert!(run.tick().is_empty());

    copy.write("event_sink.glsl", &original);
    assert_eq!(run.rig.reload_kernels(&mut folder).expect("it compiles"), ["cross"]);
    assert!(!run.tick().is_empty());
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

#[test]
fn a_broken_edit_is_reported_with_its_line_and_the_old_kernels_run_on() {
    let device = &*DEVICE;
    let copy = Copy::new();
    let mut run = Run::new(device, Synthesis::Linear);
    let mut folder = copy.open();
    run.tick();

    let original = copy.read("event_sink.glsl");
    let broken = original.clone() + "\nuint f() { return nonesuch; }\n";
    copy.write("event_sink.glsl", &broken);
    let message = run.problem(&mut folder);
    let line = format!("event_sink.glsl:{}: error: 'nonesuch'", broken.lines().count());
    assert!(message.contains(&line), "no `{line}` in: {message}");
    assert!(!run.tick().is_empty());
    assert!(run.rig.reload_kernels(&mut folder).expect("said once").is_empty());

    // A good edit elsewhere waits for the bad one.
    copy.write("sort.comp", &(copy.read("sort.comp") + "// Edited.\n"));
    assert_eq!(run.problem(&mut folder), message);
    copy.write("event_sink.glsl", &original);
    assert_eq!(run.rig.reload_kernels(&mut folder).expect("mended"), ["sort"]);
    assert!(!run.tick().is_empty());

    // An include that is wrong is reported once, though every kernel includes it.
    let common = copy.read("common.glsl");
    copy.write("common.glsl", &format!("{common}uint f() {{ return nonesuch; }}\n"));
    let message = run.problem(&mut folder);
    assert_eq!(message.matches("'nonesuch'").count(), 1, "{message}");
    std::fs::remove_file(copy.0.path().join("common.glsl")).expect("removed");
    let message = run.problem(&mut folder);
    assert!(message.contains("common.glsl: No such file"), "{message}");
    copy.write("common.glsl", &common);
    assert!(run.rig.reload_kernels(&mut folder).expect("mended, and as it ran").is_empty());
    assert!(!run.tick().is_empty());
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

#[test]
fn a_kernel_of_another_layout_is_refused() {
    let copy = Copy::new();
    let mut run = Run::new(&DEVICE, Synthesis::Linear);
    let mut folder = copy.open();
    copy.write("sort.comp", &(copy.read("sort.comp") + "BUFFER(readonly, SLOT_SAMPLES, uvec2, wrong);\n"));
    let message = run.problem(&mut folder);
    assert!(message.contains("sort.comp: `samples` has stride 8, expected 4"), "{message}");
    run.tick();
    assert!(!run.tick().is_empty());
}

#[test]
fn a_folder_must_be_one() {
    for (path, problem) in [("/nonesuch", "does not exist"), ("/etc/hostname", "is no folder")] {
        let Err(error) = KernelFolder::open(Path::new(path)) else { panic!("{path} was accepted") };
        let message = error.to_string();
        assert!(message.contains(path) && message.contains(problem), "{message}");
    }
    let empty = tempfile::tempdir().expect("a temporary folder");
    let mut folder = KernelFolder::open(empty.path()).expect("a folder");
    let message = Run::new(&DEVICE, Synthesis::Linear).problem(&mut folder);
    assert_eq!(message.lines().count(), esaac_layout::KERNELS.len(), "{message}");
    assert!(message.contains("ingest_gpu.comp: No such file"), "{message}");
}
