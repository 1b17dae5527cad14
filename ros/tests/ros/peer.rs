//! Subscribers in other processes, and what they say.

use super::PATIENCE;
use std::cell::RefCell;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, channel};
use std::time::Instant;

/// A process that speaks in lines and ends when its standard input does.
pub struct Peer {
    name: String,
    child: Child,
    input: Option<ChildStdin>,
    lines: Receiver<String>,
    /// Lines that have been waited for already.
    heard: RefCell<Vec<String>>,
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
        Peer { name, child, input, lines, heard: RefCell::default() }
    }

    /// Process id.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Waits for another line.
    fn hear(&self, until: Instant) -> Option<String> {
        let line = self.lines.recv_timeout(until.saturating_duration_since(Instant::now())).ok()?;
        self.heard.borrow_mut().push(line.clone());
        Some(line)
    }

    /// Waits for a new line that starts so.
    pub fn wait_for(&self, start: &str) -> String {
        let until = Instant::now() + PATIENCE;
        loop {
            let line = self.hear(until).unwrap_or_else(|| panic!("no line `{start}` from {}", self.name));
            if line.starts_with(start) {
                return line;
            }
        }
    }

    /// Waits until `count` of all its lines start so.
    #[cfg(feature = "zenoh")]
    pub fn wait_for_lines(&self, count: usize, start: &str) {
        self.wait_until_heard(count, |line| line.starts_with(start));
    }

    /// Waits until `count` of all its lines are so.
    fn wait_until_heard(&self, count: usize, is_so: impl Fn(&str) -> bool) {
        let until = Instant::now() + PATIENCE;
        let heard = || self.heard.borrow().iter().filter(|line| is_so(line)).count();
        while heard() < count {
            assert!(self.hear(until).is_some(), "{} of {count} lines from {}", heard(), self.name);
        }
    }

    /// Waits until publishers of so many topics have been found, now or earlier.
    pub fn wait_until_matched(&self, topics: usize) {
        self.wait_until_heard(topics, |line| line.starts_with("matched"));
    }

    /// Waits until a Fast DDS subscriber with hashes has taken so many messages, now or earlier.
    pub fn wait_until_taken(&self, messages: usize) {
        self.wait_until_heard(messages, |line| Taken::parse(line).is_some());
    }

    /// Ends its input and returns all that it said.
    pub fn finish(mut self) -> Vec<String> {
        drop(self.input.take());
        let mut lines = self.heard.take();
        lines.extend(std::iter::from_fn(|| self.lines.recv_timeout(PATIENCE).ok()));
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

impl Taken {
    /// What a line says; `None` if it is about something else.
    fn parse(line: &str) -> Option<Self> {
        let words: Vec<&str> = line.split(' ').collect();
        let [topic, bytes, hash, at_ns, seconds, nanoseconds] = words[..] else { return None };
        Some(Taken {
            topic: topic.parse().ok()?,
            bytes: bytes.parse().ok()?,
            hash: u64::from_str_radix(hash, 16).ok()?,
            at_ns: at_ns.parse().ok()?,
            stamp_ns: seconds.parse::<i64>().ok()? * 1_000_000_000 + nanoseconds.parse::<i64>().ok()?,
        })
    }
}

/// The messages that the Fast DDS subscriber took.
pub fn taken(lines: &[String]) -> Vec<Taken> {
    lines.iter().filter_map(|line| Taken::parse(line)).collect()
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

/// Fails if the golden messages are not what rosbags writes.
pub fn check_golden_messages() {
    let output = python("../golden/generate.py", &["--check"]).output().expect("Python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
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
