//! The judge finds faults that are put into what the engine gave.

use crate::case::Case;
use crate::findings::Findings;
use crate::judge::{Kind, RunOf, judge};
use crate::play::Steps;
use esaac_engine::RigOptions;
use esaac_model::{Packet, ReadoutKind};
use esaac_scene::SceneKind;
use esaac_tests::device::assert_silent;

/// A case of one camera with log pixels, with a bus or without.
fn case(has_bus: bool) -> Case {
    let fits = |case: &Case| {
        let sensors = case.sensors(0);
        let camera = &case.cameras[0];
        let frames_ns = || case.ticks.iter().filter_map(|tick| tick.frames[0]).map(|frame| frame.t_ns);
        let length_ns = frames_ns().next_back().unwrap_or(0) - frames_ns().next().unwrap_or(0);
        case.cameras.len() == 1
            && case.ticks.iter().all(|tick| tick.changes.is_empty())
            // So that it has events.
            && [SceneKind::Sinusoid, SceneKind::Flight, SceneKind::Hdr].contains(&camera.scene)
            && length_ns > 50_000_000
            && camera.sensor.contrast_on.max(camera.sensor.contrast_off) < 0.3
            && sensors.iter().all(|sensor| {
                (sensor.readout != ReadoutKind::None) == has_bus
                    && sensor.max_events_per_interval == 0
                    && Kind::of_sensor(sensor) == Kind::Plain
            })
    };
    (0..).map(Case::draw).find(fits).expect("there are such cases")
}

/// The packet with most events, if it is of a camera's later frames.
fn fullest(steps: &mut Steps) -> &mut Packet {
    let packets = steps.iter_mut().flatten().flatten().map(|step| &mut step.packet);
    packets.max_by_key(|packet| packet.len()).expect("packets")
}

fn remove(packet: &mut Packet, event: usize) {
    packet.x.remove(event);
    packet.y.remove(event);
    packet.t_offset_ns.remove(event);
    packet.polarity.remove(event);
}

/// What the judge says if some runs of a case are spoiled.
fn judged(case: &Case, runs: &[RunOf], spoil: impl Fn(&mut Packet)) -> Option<String> {
    let mut findings = Findings::default();
    let spoil = |run: RunOf, steps: &mut Steps| {
        if runs.contains(&run) {
            let packet = fullest(steps);
            assert!(packet.len() > 2, "a packet with events");
            spoil(packet);
        }
    };
    judge(case, &spoil, &mut findings);
    findings.text()
}

const ALL: [RunOf; 3] = [RunOf::Whole, RunOf::Again, RunOf::Plain];

#[track_caller]
fn assert_found(found: Option<String>, text: &str) {
    let found = found.expect("the fault is found");
    assert!(found.contains(text), "expected `{text}` among:\n{found}");
}

#[test]
fn an_event_that_is_lost_moved_or_flipped_in_every_run_is_found() {
    let case = case(false);
    assert_eq!(judged(&case, &[], |_| ()), None, "{case}");
    assert_found(judged(&case, &ALL, |packet| remove(packet, 1)), "differ without a tie");
    let flip = |packet: &mut Packet| packet.polarity[1] ^= 1;
    assert_found(judged(&case, &ALL, flip), "differ without a tie");
    let swap = |packet: &mut Packet| packet.t_offset_ns.reverse();
    assert_found(judged(&case, &ALL, swap), "events are not in order");
    let late = |packet: &mut Packet| packet.t_offset_ns.iter_mut().for_each(|t_ns| *t_ns += 1_000_000_000);
    assert_found(judged(&case, &ALL, late), "events of another time");
    assert_found(judged(&case, &ALL, |packet| packet.watermark_ns += 1), "another watermark");
    assert_silent();
}

#[test]
fn a_level_that_is_off_in_every_run_is_found() {
    let case = Case { options: RigOptions { keep_substeps: true, ..case(false).options }, ..case(false) };
    let mut findings = Findings::default();
    let spoil = |_, steps: &mut Steps| {
        let step = steps.iter_mut().flatten().flatten().next_back().expect("a frame");
        // At the end of the first sub-step, by a thousandth of a neper.
        step.substeps_q24.as_mut().expect("levels are kept")[1][0] += 16_777;
    };
    judge(&case, &spoil, &mut findings);
    assert_found(findings.text(), "1 of");
    assert_silent();
}

#[test]
fn an_event_that_one_run_lost_is_found() {
    let found = judged(&case(false), &[RunOf::Again], |packet| remove(packet, 1));
    assert_found(found, "another run: camera 0 sends another packet");
    assert_silent();
}

#[test]
fn an_event_that_a_bus_lost_is_found() {
    let found = judged(&case(true), &[RunOf::Whole, RunOf::Again], |packet| remove(packet, 1));
    assert_found(found, "behind the pixels");
    assert_silent();
}
