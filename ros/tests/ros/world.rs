//! A rig of random packets and images, and subscribers in other processes.

use esaac_model::packet::Event;
use esaac_model::{Packet, Polarity, SensorModel, random};
use esaac_ros::{ApsImage, BagWriter, CameraPlan, Imu, Intrinsics, Payload, RigOptions, RigPublisher, Sinks};
#[cfg(feature = "embedded")]
use esaac_ros::{CycloneTransport, NetworkOptions};
use std::cell::Cell;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// How long anything may take that should take less than a second.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// A domain that no other test has, and with some luck no other program.
pub fn domain() -> u32 {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    1 + (std::process::id() % 5) * 20 + NEXT.fetch_add(1, Ordering::Relaxed) % 20
}

/// Loopback on `domain`.
#[cfg(feature = "embedded")]
pub fn network(domain: u32) -> NetworkOptions {
    let options = NetworkOptions::from_environment(|_| None).expect("an empty environment");
    NetworkOptions { domain, localhost_only: true, ..options }
}

/// The embedded transport on loopback.
#[cfg(feature = "embedded")]
pub fn transport(domain: u32) -> CycloneTransport {
    CycloneTransport::open(network(domain)).expect("loopback is there")
}

/// A camera with all outputs.
pub fn camera(name: &str, width: u32, height: u32) -> CameraPlan {
    let sensor = SensorModel { width, height, aps_exposure_ns: 1, aps_bits: 8, ..SensorModel::default() };
    let intrinsics = Some(Intrinsics { focal_px: [300.0, 301.0], centre_px: [172.5, 129.5] });
    let (name, split) = (name.to_owned(), esaac_ros::Split::default());
    CameraPlan { name, sensor, intrinsics, image: true, depth: true, imu: true, split, frame_id: None }
}

/// Publishes `cameras` to `sinks`.
pub fn rig(cameras: &[CameraPlan], options: &RigOptions, sinks: Sinks) -> RigPublisher {
    RigPublisher::start(cameras.to_vec(), options.clone(), sinks).expect("a good plan")
}

/// A recording at `path`.
pub fn bag(path: &Path) -> BagWriter {
    BagWriter::create(path).expect("a file in a temporary folder")
}

fn number(seed: u32, index: u32, stream: u32) -> u32 {
    random::philox4x32_10([index, stream, 0, 0], [seed, 0])[0]
}

/// A packet of `events` random events in (`start_ns`, `end_ns`], in order.
pub fn packet(plan: &CameraPlan, start_ns: i64, end_ns: i64, events: u32, seed: u32) -> Packet {
    let sensor = &plan.sensor;
    let span = (end_ns - start_ns) as u32;
    let mut list: Vec<Event> = (0..events)
        .map(|i| Event {
            t_ns: start_ns + 1 + i64::from(number(seed, i, 0) % span),
            y: (number(seed, i, 1) % sensor.height) as u16,
            x: (number(seed, i, 2) % sensor.width) as u16,
            polarity: if number(seed, i, 3) & 1 == 1 { Polarity::On } else { Polarity::Off },
        })
        .collect();
    list.sort_unstable();
    let (width_px, height_px) = (sensor.width, sensor.height);
    let mut packet = Packet {
        width_px,
        height_px,
        base_ns: start_ns,
        watermark_ns: end_ns,
        dropped: u64::from(seed % 3),
        ..Packet::default()
    };
    list.into_iter().for_each(|event| packet.push(event));
    packet
}

/// One tick of every camera with everything that it has: events of `packets`, random images, IMU samples.
pub fn publish(rig: &mut RigPublisher, cameras: &[CameraPlan], packets: &[Packet], imu_samples: i64) {
    let (start_ns, end_ns) = (packets[0].base_ns, packets[0].watermark_ns);
    let mut tick = rig.tick(end_ns);
    for (number, (plan, packet)) in cameras.iter().zip(packets).enumerate() {
        let pixels = plan.sensor.pixels();
        let levels: Vec<u16> = (0..pixels).map(|i| (i as u16).wrapping_mul(31) & 0xff).collect();
        let depth: Vec<f32> =
            (0..pixels).map(|i| if i % 7 == 0 { f32::INFINITY } else { i as f32 }).collect();
        let samples: Vec<Imu> = (1..=imu_samples)
            .map(|i| Imu {
                t_ns: start_ns + (end_ns - start_ns) * i / imu_samples,
                angular_rate_rad_s: [0.1, -0.2, i as f64],
                specific_force_m_s2: [0.0, 0.5, 9.81],
            })
            .collect();
        tick.events(number, &packet.view());
        let bits = plan.sensor.aps_bits;
        tick.aps(number, &ApsImage { pixels: &levels, bits, bayer: number % 2 == 1, t_ns: end_ns });
        tick.rgb(number, |out| out.extend((0..pixels * 3).map(|i| (i * 7) as u8)));
        tick.depth(number, &depth).imu(number, &samples);
    }
    tick.send();
}

/// FNV-1a, as the receiver computes it.
pub fn hash(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

/// Hash of a message as it is on the wire: with its padding.
pub fn wire_hash(message: &Payload) -> u64 {
    hash(message.padded())
}

/// A process that speaks in lines and ends when its standard input does.
pub struct Peer {
    name: String,
    child: Child,
    input: Option<ChildStdin>,
    lines: Receiver<String>,
    matched: Cell<usize>,
}

impl Peer {
    fn spawn(command: &mut Command) -> Self {
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let (input, output) = (child.stdin.take(), child.stdout.take().expect("piped"));
        let (tell, lines) = channel();
        std::thread::spawn(move || {
            BufReader::new(output).lines().map_while(Result::ok).for_each(|line| drop(tell.send(line)));
        });
        let name = command.get_program().to_string_lossy().into_owned();
        Peer { name, child, input, lines, matched: Cell::new(0) }
    }

    /// Process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Waits for a line that starts so.
    pub fn wait_for(&self, start: &str) -> String {
        loop {
            let line = self.lines.recv_timeout(PATIENCE);
            let line = line.unwrap_or_else(|_| panic!("no line `{start}` from {}", self.name));
            if line.starts_with("matched") {
                self.matched.set(self.matched.get() + 1);
            }
            if line.starts_with(start) {
                return line;
            }
        }
    }

    /// Waits until publishers of so many topics have been found, now or earlier.
    pub fn wait_until_matched(&self, topics: usize) {
        while self.matched.get() < topics {
            self.wait_for("matched");
        }
    }

    /// Ends its input and returns the rest of what it said.
    pub fn finish(mut self) -> Vec<String> {
        drop(self.input.take());
        let lines: Vec<String> = std::iter::from_fn(|| self.lines.recv_timeout(PATIENCE).ok()).collect();
        let status = self.child.wait().expect("it ends");
        assert!(status.success(), "{status}: {lines:?}");
        lines
    }

    /// Kills it without a word.
    pub fn kill(&mut self) {
        self.child.kill().expect("it runs");
        self.child.wait().expect("it ends");
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// How a Fast DDS subscriber is set up.
pub struct Subscriber {
    pub domain: u32,
    pub receive_buffer: usize,
    pub history: usize,
    /// Whether it looks at every byte.
    pub hashes: bool,
}

impl Subscriber {
    /// With the recommended receive buffer.
    pub fn on(domain: u32) -> Self {
        Subscriber { domain, receive_buffer: 4 << 20, history: 5000, hashes: true }
    }

    /// Starts it: (topic, type, quality) each.
    pub fn start(&self, topics: &[(String, String, &str)]) -> Peer {
        let mut command = Command::new(fastdds_receiver());
        for number in [self.domain as usize, self.receive_buffer, self.history, self.hashes.into()] {
            command.arg(number.to_string());
        }
        for (topic, kind, qos) in topics {
            let [package, _, name] = kind.split('/').collect::<Vec<_>>()[..] else { panic!("{kind}") };
            command.arg(format!("rt{topic}={package}::msg::dds_::{name}_={qos}"));
        }
        let peer = Peer::spawn(&mut command);
        peer.wait_for("ready");
        peer
    }
}

/// A message that the Fast DDS subscriber took.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Taken {
    pub topic: usize,
    pub bytes: usize,
    pub hash: u64,
    pub at_ns: i64,
    /// Seconds and nanoseconds of a header's stamp, where the message begins with one.
    pub stamp_ns: i64,
}

/// What the Fast DDS subscriber said.
pub fn taken(lines: &[String]) -> Vec<Taken> {
    let parse = |line: &String| {
        let words: Vec<&str> = line.split(' ').collect();
        let [topic, bytes, hash, at_ns, seconds, nanoseconds] = words[..] else { return None };
        Some(Taken {
            topic: topic.parse().ok()?,
            bytes: bytes.parse().ok()?,
            hash: u64::from_str_radix(hash, 16).ok()?,
            at_ns: at_ns.parse().ok()?,
            stamp_ns: seconds.parse::<i64>().ok()? * 1_000_000_000 + nanoseconds.parse::<i64>().ok()?,
        })
    };
    lines.iter().filter_map(parse).collect()
}

/// The receiver in C++, compiled once.
fn fastdds_receiver() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ros/receiver.cpp");
        let program = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("receiver-{}", std::process::id()));
        let mut compile = Command::new("c++");
        compile.args(["-O2", "-std=c++17", "-o"]).arg(&program).arg(source).args(["-lfastrtps", "-lfastcdr"]);
        let output = compile.output().expect("a C++ compiler; tools/test.sh installs it");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "Fast DDS (libfastrtps-dev; tools/test.sh installs it): {text}");
        program
    })
}

/// A script in Python with cyclonedds and rosbags.
fn python(script: &str, arguments: &[&str]) -> Command {
    let fallback = || Path::new(env!("CARGO_TARGET_TMPDIR")).join("../ros-python/bin/python");
    let python = std::env::var_os("ESAAC_ROS_PYTHON").map_or_else(fallback, PathBuf::from);
    assert!(python.exists(), "{} is not there; tools/test.sh makes it", python.display());
    let mut command = Command::new(python);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ros").join(script)).args(arguments);
    command.env("ESAAC_ROS_SOURCES", env!("CARGO_MANIFEST_DIR")).env_remove("CYCLONEDDS_URI");
    command
}

/// The answer of a script that ends by itself.
fn answer(mut script: Command) -> serde_json::Value {
    let output = script.output().expect("Python runs");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// What rosbags says about a recording.
pub fn check_bag(path: &Path) -> serde_json::Value {
    answer(python("subscriber.py", &["check", path.to_str().expect("UTF-8")]))
}

/// The ROS graph once a node has so many writers, where identities have `gid_bytes`.
pub fn graph(domain: u32, gid_bytes: usize, writers: usize) -> serde_json::Value {
    answer(python(
        "graph.py",
        &[domain as usize, gid_bytes, writers].map(|n| n.to_string()).each_ref().map(|s| &**s),
    ))
}

/// A subscriber on PyPI's cyclonedds; its last line is what it makes of what came, beside `bag`.
pub fn cyclone_subscriber(domain: u32, bag: &Path, topics: &[(String, String, &str)]) -> Peer {
    let mut command = python("subscriber.py", &["listen", &domain.to_string(), bag.to_str().expect("UTF-8")]);
    for (topic, kind, qos) in topics {
        let latched = if qos.contains("transient_local") { "=transient_local" } else { "" };
        command.arg(format!("{topic}={kind}{latched}"));
    }
    let peer = Peer::spawn(&mut command);
    peer.wait_for("ready");
    peer
}

/// A subscriber on PyPI's eclipse-zenoh and a router at `port`; it declares `tokens`.
#[cfg(feature = "zenoh")]
pub fn zenoh_subscriber(port: u16, domain: u32, tokens: &[String]) -> Peer {
    let mut command = python("zenoh_subscriber.py", &[&port.to_string(), &domain.to_string()]);
    let peer = Peer::spawn(command.args(tokens));
    peer.wait_for("ready");
    peer
}

/// Topics of a plan as subscribers name them, in its order.
pub fn topics(rig: &RigPublisher) -> Vec<(String, String, &'static str)> {
    let kind = |topic: &esaac_ros::Topic| match topic.qos.durability {
        esaac_ros::qos::Durability::TransientLocal => "reliable,transient_local",
        esaac_ros::qos::Durability::Volatile => "reliable",
    };
    rig.plan().topics.iter().map(|topic| (topic.name.clone(), topic.type_name.clone(), kind(topic))).collect()
}
