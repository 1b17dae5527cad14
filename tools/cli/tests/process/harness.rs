//! Runs `esaac` and makes folders of frames for it.

use esaac_model::paths::Intrinsics;
use esaac_ros::BagReader;
use esaac_ros::encode::{self, Header};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// Width of the frames that [`Frames`] writes.
pub const WIDTH: usize = 37;
/// Height of them.
pub const HEIGHT: usize = 23;

/// `esaac` with these arguments, without environment variables that would change the result.
pub fn esaac(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_esaac"));
    // The demo publishes by default; its messages must stay on this machine.
    command.args(arguments).env_remove("ESAAC_DEVICE").env("ROS_LOCALHOST_ONLY", "1");
    command
}

/// Runs `esaac` and returns exit code, standard output and standard error.
pub fn run(arguments: &[&str]) -> (i32, String, String) {
    finish(esaac(arguments).output().expect("the binary runs"))
}

/// Exit code, standard output and standard error.
pub fn finish(output: Output) -> (i32, String, String) {
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    (output.status.code().expect("not killed"), text(output.stdout), text(output.stderr))
}

/// Asserts exit code 1 and one error line that contains every part.
pub fn assert_error(arguments: &[&str], parts: &[&str]) {
    let (code, out, error) = run(arguments);
    assert_eq!(code, 1, "{arguments:?}\n{out}{error}");
    assert!(out.is_empty(), "{arguments:?} wrote {out}");
    assert_eq!(error.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{error}");
    for part in parts {
        assert!(error.contains(part), "{arguments:?}: no `{part}` in: {error}");
    }
}

/// The messages of a recording's topic, in order.
pub fn recorded_messages(path: &Path, topic: &str) -> Vec<Vec<u8>> {
    let mut bag = BagReader::open(path).expect("a recording");
    let mut messages = Vec::new();
    while let Some(message) = bag.next_message().expect("readable") {
        if bag.topics()[message.topic].name == topic {
            messages.push(message.bytes);
        }
    }
    messages
}

/// Asserts that all `camera_info` on a topic of `camera_0` tell `lens`, and that there are `count`.
#[track_caller]
pub fn assert_lens(path: &Path, topic: &str, count: usize, size_px: (u32, u32), lens: Option<Intrinsics>) {
    // The encoding and the stamp.
    const BEFORE_BYTES: usize = 12;
    let header = Header { stamp_ns: 0, frame_id: "esaac_camera_0_optical_frame" };
    let mut expected = Vec::new();
    encode::camera_info(&mut expected, header, size_px, lens);
    let messages = recorded_messages(path, &format!("/esaac/camera_0/{topic}"));
    assert_eq!(messages.len(), count, "{topic}");
    for message in messages {
        assert_eq!(message[BEFORE_BYTES..], expected[BEFORE_BYTES..], "{topic}");
    }
}

/// A folder of frames in which a bright bar moves by two pixels per frame.
pub struct Frames {
    folder: TempDir,
}

impl Frames {
    /// An empty folder.
    pub fn empty() -> Self {
        Frames { folder: tempfile::tempdir().expect("a temporary folder") }
    }

    /// `count` frames with colour, and with motion and depth if `motion`.
    pub fn new(count: usize, motion: bool) -> Self {
        Frames::with_motion_x(count, motion.then_some(-2.0))
    }

    /// `count` frames whose motion channels, if any, have this x.
    pub fn with_motion_x(count: usize, motion_x: Option<f32>) -> Self {
        let frames = Frames::empty();
        for index in 0..count {
            frames.write(&format!("key_{index:04}.exr"), index, (WIDTH, HEIGHT), motion_x);
        }
        frames
    }

    /// One frame.
    pub fn write(&self, name: &str, index: usize, size: (usize, usize), motion_x: Option<f32>) {
        let mut list = colour(index, size);
        if let Some(motion_x) = motion_x {
            let pixels = size.0 * size.1;
            list.push(AnyChannel::new("motion.X", FlatSamples::F32(vec![motion_x; pixels])));
            list.push(AnyChannel::new("motion.Y", FlatSamples::F32(vec![0.0; pixels])));
            list.push(AnyChannel::new("depth.Z", FlatSamples::F32(vec![5.0; pixels])));
        }
        self.write_channels(name, size, list);
    }

    /// One frame of these channels.
    pub fn write_channels(&self, name: &str, size: (usize, usize), list: Vec<AnyChannel<FlatSamples>>) {
        let channels = AnyChannels::sort(list.into_iter().collect());
        let layer = Layer::new(size, LayerAttributes::default(), Encoding::FAST_LOSSLESS, channels);
        Image::from_layer(layer).write().to_file(self.file(name)).expect("the frame is written");
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// The folder as an argument.
    pub fn argument(&self) -> &str {
        self.path().to_str().expect("UTF-8")
    }

    /// A file in it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    /// A file in it as an argument.
    pub fn file_argument(&self, name: &str) -> String {
        self.file(name).to_str().expect("UTF-8").to_owned()
    }
}

/// Colour channels of frame `index`: a bright bar, two pixels further in each frame.
pub fn colour(index: usize, (width, height): (usize, usize)) -> Vec<AnyChannel<FlatSamples>> {
    let bar = |i: usize| {
        let distance = (i % width) as f32 - (6.0 + 2.0 * index as f32);
        half::f16::from_f32(0.1 + (-0.1 * distance * distance).exp())
    };
    let colour: Vec<half::f16> = (0..width * height).map(bar).collect();
    ["R", "G", "B"].map(|name| AnyChannel::new(name, FlatSamples::F16(colour.clone()))).to_vec()
}
