//! `--glsl`: kernels of a folder in place of the embedded ones.

use crate::harness::{Frames, assert_error, esaac, run};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

fn copy_kernels(frames: &Frames) -> PathBuf {
    let copy = frames.file("glsl");
    std::fs::create_dir(&copy).expect("a folder");
    for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../glsl")).expect("glsl") {
        let entry = entry.expect("an entry");
        std::fs::copy(entry.path(), copy.join(entry.file_name())).expect("copied");
    }
    copy
}

fn edit(kernel: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(kernel).expect("a kernel");
    assert_eq!(text.matches(from).count(), 1, "`{from}` in {}", kernel.display());
    std::fs::write(kernel, text.replace(from, to)).expect("written");
}

/// A process that does not outlive its test.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        self.0.kill().expect("it can be ended");
        self.0.wait().expect("it ends");
    }
}

const EMIT: &str = "void stamp_and_scatter(Camera cam, uint at_ns, uint tag) {\n";

fn events(json: &str) -> u64 {
    let report: serde_json::Value = serde_json::from_str(json).expect("JSON");
    report["cameras"][0]["events"].as_u64().expect("a count")
}

#[test]
fn the_kernels_of_the_folder_run() {
    let frames = Frames::new(4, true);
    let kernels = copy_kernels(&frames);
    let (out, glsl) = (frames.file_argument("events.npz"), frames.file_argument("glsl"));
    let plain = ["simulate", frames.argument(), "--out", &out, "--json"];
    let edited = [&plain[..], &["--glsl", &glsl]].concat();

    let (_, embedded, _) = run(&plain);
    let (code, json, error) = run(&edited);
    assert_eq!(code, 0, "{error}");
    assert!(events(&json) > 0);
    assert_eq!(events(&json), events(&embedded));
    assert!(error.contains("glsl: those embedded\n"), "{error}");

    edit(&kernels.join("event_sink.glsl"), EMIT, &format!("{EMIT}    return;\n"));
    let (code, json, error) = run(&edited);
    assert_eq!((code, events(&json)), (0, 0), "{error}");
    assert!(error.contains("glsl: cross\n"), "{error}");

    edit(&kernels.join("event_sink.glsl"), EMIT, &format!("{EMIT}    nonesuch;\n"));
    assert_error(&edited, &["event_sink.glsl:", "'nonesuch' : undeclared identifier"]);
    let nowhere = [&plain[..], &["--glsl", "/nonesuch"]].concat();
    assert_error(&nowhere, &["/nonesuch does not exist", "expected a copy of"]);
}

#[test]
fn an_edit_is_picked_up_while_the_demo_runs() {
    let frames = Frames::empty();
    let kernels = copy_kernels(&frames);
    let (out, glsl) = (frames.file_argument("out"), frames.file_argument("glsl"));
    let size = ["--width", "32", "--height", "24"];
    let demo = ["demo", "--frames", "100000", "--ros", "off", "--out", &out, "--glsl", &glsl];
    let arguments = [&demo[..], &size[..]].concat();
    let mut child =
        Ended(esaac(&arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("it runs"));
    let mut lines = BufReader::new(child.0.stderr.take().expect("piped")).lines();
    let mut next = || lines.next().expect("it goes on").expect("UTF-8");

    let mut said = vec![next()];
    edit(&kernels.join("event_sink.glsl"), EMIT, &format!("{EMIT}    nonesuch;\n"));
    said.extend([next(), next()]);
    edit(&kernels.join("event_sink.glsl"), "    nonesuch;\n", "    // Mended.\n");
    while !said.last().expect("not empty").starts_with("reloaded") {
        said.push(next());
    }
    assert!(said[0].ends_with("glsl: those embedded"), "{said:?}");
    assert_eq!(said[1], "warning: kernels not reloaded:");
    assert!(said[2].contains("event_sink.glsl:") && said[2].contains("'nonesuch'"), "{said:?}");
    assert_eq!(said.last().expect("not empty"), "reloaded kernels: cross");
}
