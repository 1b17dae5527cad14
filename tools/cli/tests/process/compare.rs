//! `compare`.

use crate::harness::{assert_error, run};
use esaac_formats::event_file::{EventColumns, write_npz};
use esaac_formats::truth_file::{self, TruthFile};
use esaac_model::packet::Event;
use esaac_model::{Polarity, SensorModel, evt3};
use std::fs::File;
use std::path::Path;
use zip::{ZipArchive, ZipWriter};

const MS: i64 = 1_000_000;

fn sensor() -> SensorModel {
    SensorModel { width: 4, height: 2, ..SensorModel::default() }
}

/// Every 10 ms an event of another pixel, ON and OFF in turn.
fn truth() -> Vec<Event> {
    (0..8)
        .map(|k| {
            let polarity = if k % 2 == 0 { Polarity::On } else { Polarity::Off };
            Event { t_ns: (i64::from(k) + 1) * 10 * MS, y: k / 4, x: k % 4, polarity }
        })
        .collect()
}

fn columns(events: &[Event]) -> EventColumns {
    EventColumns {
        x: events.iter().map(|e| e.x).collect(),
        y: events.iter().map(|e| e.y).collect(),
        t_ns: events.iter().map(|e| e.t_ns).collect(),
        sign: events.iter().map(|e| if e.polarity == Polarity::On { 1 } else { -1 }).collect(),
        ids: None,
    }
}

fn write_events(path: &Path, events: &[Event], sensor: &SensorModel) {
    write_npz(File::create(path).unwrap(), &columns(events), &sensor.to_toml()).unwrap();
}

#[test]
fn events_are_compared_with_those_of_a_truth() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let file = TruthFile { sensor: sensor(), end_ns: 85 * MS, events: truth() };
    truth_file::write(File::create(at("truth.npz")).unwrap(), &file).unwrap();
    // Of eight events one is missing, one is half a millisecond late, one is of the other polarity. What comes after the
    // truth's end does not count.
    let mut events = truth();
    events[1].t_ns += MS / 2;
    events[2].polarity = Polarity::Off;
    events.remove(7);
    events.push(Event { t_ns: 90 * MS, y: 0, x: 0, polarity: Polarity::On });
    evt3::write_file(&mut File::create(at("events.raw")).unwrap(), [4, 2], events.iter().copied()).unwrap();
    let (code, text, error) = run(&["compare", &at("truth.npz"), &at("events.raw"), "--json"]);
    assert_eq!((code, error.as_str()), (0, ""), "{text}");
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(report["truth_on_off"], serde_json::json!([4, 4]));
    assert_eq!(report["on_off"], serde_json::json!([3, 4]));
    assert_eq!((&report["count_ratio"], &report["f1"]), (&(7.0 / 8.0).into(), &(12.0 / 15.0).into()));
    // One event too few, one of each polarity for the wrong one, half a shift.
    assert_eq!(report["victor_purpura"], (3.5 / 8.0));
    assert_eq!((&report["same_sequence"], &report["time_error_us"][2]), (&(6.0 / 8.0).into(), &500.0.into()));

    let (code, text, error) = run(&["compare", &at("truth.npz"), &at("events.raw")]);
    assert_eq!(code, 0, "{error}");
    assert!(text.contains("F1                     0.800 within 1000 us"), "{text}");
    assert!(text.contains("true events            8 (4 ON, 4 OFF)"), "{text}");

    let within =
        ["compare", &at("truth.npz"), &at("events.raw"), "--from", "0.035", "--to", "0.065", "--json"];
    let report: serde_json::Value = serde_json::from_str(&run(&within).1).unwrap();
    assert_eq!((&report["truth_on_off"], &report["f1"]), (&serde_json::json!([1, 2]), &1.0.into()));
}

#[test]
fn files_that_cannot_be_compared_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    write_events(Path::new(&at("a.npz")), &truth(), &sensor());
    write_events(Path::new(&at("wide.npz")), &truth(), &SensorModel { width: 5, ..sensor() });
    let later: Vec<Event> = truth().into_iter().map(|e| Event { t_ns: e.t_ns + 1000 * MS, ..e }).collect();
    write_events(Path::new(&at("later.npz")), &later, &sensor());

    assert_error(
        &["compare", &at("a.npz"), &at("wide.npz")],
        &["wide.npz is of a sensor of 5x2 px, expected 4x2"],
    );
    assert_error(&["compare", &at("a.npz"), &at("a.csv")], &["a.csv: expected a recording .npz"]);
    assert_error(&["compare", &at("a.npz"), &at("nonesuch.npz")], &["cannot read", "nonesuch.npz"]);
    std::fs::write(at("broken.npz"), "no archive").unwrap();
    assert_error(&["compare", &at("a.npz"), &at("broken.npz")], &["broken.npz holds no events"]);
    let same = [&at("a.npz"), &at("a.npz")].map(String::clone);
    assert_error(&["compare", &same[0], &same[1], "--from", "1", "--to", "1"], &["--from before --to"]);
    assert_error(&["compare", &same[0], &same[1], "--to", "nan"], &["--to is no number"]);

    let (code, text, error) = run(&["compare", &at("a.npz"), &at("later.npz")]);
    assert_eq!(code, 0);
    assert!(text.contains("0.000 within 1000 us"), "{text}");
    assert!(
        error.contains("warning: the times of the files do not overlap") && error.contains("1.010000"),
        "{error}"
    );

    let report: serde_json::Value =
        serde_json::from_str(&run(&["compare", &at("a.npz"), &at("later.npz"), "--json"]).1).unwrap();
    assert_eq!((&report["f1"], &report["time_error_us"]), (&0.0.into(), &serde_json::Value::Null));
    assert!(text.contains("time error             -\n"), "{text}");
}

#[test]
fn nothing_is_no_truth() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    write_events(Path::new(&at("a.npz")), &truth(), &sensor());
    write_events(Path::new(&at("one.npz")), &truth()[..1], &sensor());
    write_events(Path::new(&at("none.npz")), &[], &sensor());
    let of_a = "a.npz from 0.010000 to 0.080000 s";
    assert_error(
        &["compare", &at("a.npz"), &at("one.npz"), "--from", "5"],
        &["no true event", of_a, "one.npz at 0.010000 s", "--from and --to"],
    );
    for events in ["a.npz", "none.npz"] {
        assert_error(
            &["compare", &at("none.npz"), &at(events)],
            &["no true event", "none.npz has no events"],
        );
    }
    let (code, text, error) = run(&["compare", &at("a.npz"), &at("none.npz")]);
    assert_eq!((code, error.as_str()), (0, ""));
    assert!(
        text.contains("F1                     0.000") && text.contains("time error             -"),
        "{text}"
    );
}

/// Copies an archive without one of its arrays.
fn without(array: &str, from: &str, to: &str) {
    let mut from = ZipArchive::new(File::open(from).unwrap()).unwrap();
    let mut to = ZipWriter::new(File::create(to).unwrap());
    for index in 0..from.len() {
        let member = from.by_index(index).unwrap();
        if member.name().unwrap() != format!("{array}.npy") {
            to.raw_copy_file(member).unwrap();
        }
    }
    to.finish().unwrap();
}

#[test]
fn a_truth_may_leave_its_sensor_to_the_events() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    write_events(Path::new(&at("a.npz")), &truth(), &sensor());
    without("sensor", &at("a.npz"), &at("bare.npz"));
    let (code, text, error) = run(&["compare", &at("bare.npz"), &at("a.npz"), "--json"]);
    assert_eq!((code, error.as_str()), (0, ""));
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&report["f1"], &report["truth_on_off"]), (&1.0.into(), &serde_json::json!([4, 4])));
    // Of events nobody else tells the size.
    let (code, _, error) = run(&["compare", &at("a.npz"), &at("bare.npz")]);
    assert_eq!(code, 1);
    assert!(error.ends_with("bare.npz holds no events: no array `sensor`\n"), "{error}");
    // Events of a smaller sensor do not hold all of the truth's.
    write_events(Path::new(&at("small.npz")), &truth()[..3], &SensorModel { width: 3, ..sensor() });
    assert_error(
        &["compare", &at("bare.npz"), &at("small.npz")],
        &["bare.npz", "an event at (3, 0) on a sensor of 3x2 px"],
    );
}
