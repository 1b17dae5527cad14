//! Runs `esaac` and makes folders of frames for it.

use esaac_model::paths::Intrinsics;
use esaac_ros::BagReader;
use esaac_ros::encode::{self, Header};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, Vec2, WritableImage,
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

/// `esaac`, to be completed, which ignores a signal from the start.
pub fn ignoring(signal: &str) -> Command {
    let script = format!("trap '' {signal}; exec \"$@\"");
    by(&["bash", "-c", &script, "bash"])
}

/// `esaac`, to be completed, which ignores no hangup, although the tests themselves may run under `nohup`.
pub fn heeding_hangups() -> Command {
    by(&["env", "--default-signal=HUP"])
}

/// `esaac`, to be completed, as another program starts it in its own place.
fn by(starter: &[&str]) -> Command {
    let mut command = Command::new(starter[0]);
    command.args(&starter[1..]).arg(env!("CARGO_BIN_EXE_esaac"));
    command.env_remove("ESAAC_DEVICE").env("ROS_LOCALHOST_ONLY", "1");
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

/// How files name their channels and convey motion, depth and ids.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Writer {
    /// As `esaac` does.
    #[default]
    Esaac,
    /// As Blender 4: all passes in one part.
    Blender4,
    /// As Blender 5: a part for each pass.
    Blender5,
}

/// A folder of frames in which a bright bar moves by two pixels per frame.
pub struct Frames {
    folder: TempDir,
    writer: Writer,
}

impl Frames {
    /// An empty folder.
    pub fn empty() -> Self {
        Frames::by(Writer::Esaac)
    }

    /// An empty folder whose files look like those of `writer`.
    pub fn by(writer: Writer) -> Self {
        Frames { folder: tempfile::tempdir().expect("a temporary folder"), writer }
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
        let parts = match self.writer {
            Writer::Esaac => vec![list],
            Writer::Blender4 => vec![list.into_iter().map(|c| blender(c, "IndexOB.X")).collect()],
            Writer::Blender5 => list.into_iter().map(|c| vec![blender(c, "Object Index.X")]).collect(),
        };
        self.write_parts(name, size, parts);
    }

    /// One frame of parts with these channels.
    pub fn write_parts(&self, name: &str, size: (usize, usize), parts: Vec<Vec<AnyChannel<FlatSamples>>>) {
        let layer = |(number, list): (usize, Vec<AnyChannel<FlatSamples>>)| {
            let attributes = LayerAttributes::named(&*format!("part {number}"));
            let channels = AnyChannels::sort(list.into_iter().collect());
            Layer::new(size, attributes, Encoding::FAST_LOSSLESS, channels)
        };
        let layers: Vec<_> = parts.into_iter().enumerate().map(layer).collect();
        let window = IntegerBounds::from_dimensions(Vec2(size.0, size.1));
        let image = Image::from_layers(ImageAttributes::new(window), layers);
        image.write().to_file(self.file(name)).expect("the frame is written");
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

/// A channel as Blender has it: y up, ids as floats.
fn blender(channel: AnyChannel<FlatSamples>, index_pass: &str) -> AnyChannel<FlatSamples> {
    let samples = || channel.sample_data.values_as_f32();
    let (pass, samples) = match channel.name.to_string().as_str() {
        "motion.X" => ("Vector.X".to_owned(), FlatSamples::F32(samples().collect())),
        "motion.Y" => ("Vector.Y".to_owned(), FlatSamples::F32(samples().map(|y| -y).collect())),
        "depth.Z" => ("Depth.Z".to_owned(), FlatSamples::F32(samples().collect())),
        "id" => (index_pass.to_owned(), FlatSamples::F32(samples().collect())),
        colour => (format!("Combined.{colour}"), channel.sample_data.clone()),
    };
    AnyChannel::new(&*format!("ViewLayer.{pass}"), samples)
}
