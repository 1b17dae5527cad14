//! The hard cases and the faults of others in `tests/corpus`: one body runs each through the oracle and
//! through the engine.

use esaac_engine::RigOptions;
use esaac_model::Polarity;
use esaac_model::packet::Event;
use esaac_tests::corpus::{Case, cases};
use esaac_tests::device::assert_silent;
use esaac_tests::run::{Step, engine_of_many, events, oracle, oracle_events};

/// What a run gives, whoever ran it.
struct Outcome {
    events: Vec<Event>,
    invalid_pixels: Vec<u64>,
    unarmed_pixels: Vec<u64>,
}

fn by_oracle(cases: &[Case]) -> Vec<Outcome> {
    let run = |case: &Case| {
        let intervals = oracle(&case.sensor(), 0, &case.sequence());
        Outcome {
            events: oracle_events(&intervals),
            invalid_pixels: intervals.iter().map(|i| i.diagnostics.invalid_pixels).collect(),
            unarmed_pixels: intervals.iter().map(|i| i.diagnostics.unarmed_pixels).collect(),
        }
    };
    cases.iter().map(run).collect()
}

/// All cases are cameras of one rig, each with times of its own.
fn by_engine(cases: &[Case]) -> Vec<Outcome> {
    let cameras: Vec<_> = cases.iter().map(|case| (case.sensor(), case.sequence())).collect();
    let outcome = |steps: &Vec<Step>| Outcome {
        events: events(steps),
        invalid_pixels: steps.iter().map(|s| s.diagnostics.invalid_pixels).collect(),
        unarmed_pixels: steps.iter().map(|s| s.diagnostics.unarmed_pixels).collect(),
    };
    engine_of_many(&cameras, RigOptions::default()).iter().map(outcome).collect()
}

fn check_all(who: &str, run: impl Fn(&[Case]) -> Vec<Outcome>) {
    let cases = cases();
    let outcomes = run(&cases);
    let fails = |(case, outcome): &(&Case, &Outcome)| {
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| check(who, case, outcome))).is_err()
    };
    let failures: Vec<&str> =
        cases.iter().zip(&outcomes).filter(fails).map(|(case, _)| case.name.as_str()).collect();
    assert!(failures.is_empty(), "{} of {} cases fail: {}", failures.len(), cases.len(), failures.join(", "));
    assert_silent();
}

fn check(who: &str, case: &Case, outcome: &Outcome) {
    for expected in &case.expect {
        let of_pixel: Vec<(i64, Polarity)> = outcome
            .events
            .iter()
            .filter(|e| expected.pixel.is_none_or(|pixel| usize::from(e.x) == pixel))
            .map(|e| (e.t_ns, e.polarity))
            .collect();
        case.check(who, expected, &of_pixel);
    }
    for (what, actual, expected) in [
        ("invalid", &outcome.invalid_pixels, &case.invalid_pixels),
        ("unarmed", &outcome.unarmed_pixels, &case.unarmed_pixels),
    ] {
        if let Some(expected) = expected {
            assert_eq!(actual, expected, "{} by the {who}: {what} pixels", case.name);
        }
    }
}

#[test]
fn the_oracle_holds_every_case() {
    check_all("oracle", by_oracle);
}

#[test]
fn the_engine_holds_every_case() {
    check_all("engine", by_engine);
}

#[test]
fn a_wrong_expectation_is_found() {
    let case = &cases()[0];
    let mut expected = case.expect[0].clone();
    expected.polarities = Some("--------".to_owned());
    let held = std::panic::catch_unwind(|| case.check("nobody", &expected, &[(5, Polarity::On)]));
    assert!(held.is_err());
}
