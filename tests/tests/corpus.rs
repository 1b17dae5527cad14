//! The hard cases in `tests/corpus`, many of them faults of other simulators. Each runs through the oracle and through
//! the engine.

use esaac_engine::RigOptions;
use esaac_model::Polarity;
use esaac_model::packet::Event;
use esaac_tests::corpus::{Case, FILES, Outcome, by_engine, by_oracle, cases};
use esaac_tests::device::{DEVICE, assert_silent};
use std::path::Path;

fn check_all(who: &str, run: impl Fn(&[Case]) -> Vec<Outcome>) {
    let cases = cases();
    let outcomes = run(&cases);
    let failures: Vec<String> = cases
        .iter()
        .zip(&outcomes)
        .filter_map(|(case, outcome)| {
            let error = case.judge(outcome).err()?;
            Some(format!("{} ({}): {error}", case.name, case.about))
        })
        .collect();
    let count = failures.len();
    assert!(
        failures.is_empty(),
        "{count} of {} cases fail by the {who}:\n{}",
        cases.len(),
        failures.join("\n")
    );
    assert_silent();
}

#[test]
fn the_oracle_holds_every_case() {
    check_all("oracle", by_oracle);
}

#[test]
fn the_engine_holds_every_case() {
    check_all("engine", |cases| by_engine(&DEVICE, cases, RigOptions::default()));
}

#[test]
fn a_wrong_expectation_is_found() {
    let case = &cases()[0];
    let event = Event { t_ns: 5, y: 0, x: 0, polarity: Polarity::On };
    let (invalid_pixels, unarmed_pixels) = (vec![0, 2, 1, 0], vec![0; 4]);
    let wrong = case.judge(&Outcome { events: vec![event], invalid_pixels, unarmed_pixels });
    assert!(wrong.is_err_and(|error| error.contains("pixel 0: `+`")));
    let [mut right] = <[Outcome; 1]>::try_from(by_oracle(std::slice::from_ref(case))).ok().unwrap();
    assert_eq!(case.judge(&right), Ok(()));
    right.invalid_pixels[1] = 0;
    assert!(case.judge(&right).is_err_and(|error| error.contains("invalid pixels")));
}

#[test]
fn every_file_of_the_corpus_is_run() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let mut there: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    there.sort();
    assert_eq!(there, FILES.map(|(name, _)| name));
}
