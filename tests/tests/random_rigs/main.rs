//! Rigs at random: everything that a user may combine, combined by a seed. The engine is compared with the oracle where
//! that foretells its events, and else with itself.
//!
//! A few seeds run with all other tests. `ESAAC_SEEDS=100..400` runs others, `ESAAC_SEEDS=17` one.

mod behind;
mod case;
mod dice;
mod drawn;
mod faults;
mod findings;
mod images;
mod judge;
mod levels;
mod play;
mod reference;
mod sensors;

use case::Case;
use esaac_tests::device::assert_silent;
use findings::Findings;
use judge::{Kind, Tallies, judge};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// Seeds of the ordinary run, with kernels that do not take long to compile.
const SEEDS: &str = "0,12,16,21,24,1004,1006,1010,1014,4421";

/// Seeds as `3`, `3..9` (3 to 8), or several of these with commas.
fn seeds(text: &str) -> Vec<u64> {
    let number = |text: &str| -> u64 {
        text.trim().parse().unwrap_or_else(|e| panic!("ESAAC_SEEDS: `{text}` is no seed: {e}"))
    };
    let part = |part: &str| match part.split_once("..") {
        Some((first, end)) => number(first)..number(end),
        None => number(part)..number(part) + 1,
    };
    let seeds: Vec<u64> = text.split(',').flat_map(part).collect();
    assert!(!seeds.is_empty(), "ESAAC_SEEDS: no seeds in `{text}`");
    seeds
}

/// What is wrong with the case of a seed, if anything is.
fn run(seed: u64, total: &mut Tallies) -> Option<String> {
    let case = Case::draw(seed);
    let mut findings = Findings::default();
    let outcome = catch_unwind(AssertUnwindSafe(|| judge(&case, &|_, _| (), &mut findings)));
    match outcome {
        Ok(tallies) => total.iter_mut().zip(tallies).for_each(|(total, tally)| total.add(tally)),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no text");
            findings.check(false, || format!("it panicked: {text}"));
        }
    }
    let text = findings.text()?;
    Some(format!(
        "seed {seed}:\n{text}\n{case}Again: ESAAC_SEEDS={seed} cargo test --workspace --locked --test random_rigs -- \
         the_engine_and_the_oracle_agree_on_random_rigs"
    ))
}

#[test]
fn the_engine_and_the_oracle_agree_on_random_rigs() {
    let chosen = std::env::var("ESAAC_SEEDS").unwrap_or_else(|_| SEEDS.to_owned());
    let mut total = Tallies::default();
    let mut failed = Vec::new();
    for seed in seeds(&chosen) {
        let started = Instant::now();
        let mut own = Tallies::default();
        let failure = run(seed, &mut own);
        let seconds = started.elapsed().as_secs_f64();
        println!("seed {seed}: {seconds:.1} s, {}", if failure.is_some() { "FAILED" } else { "passed" });
        for (kind, tally) in Kind::ALL.iter().zip(own).filter(|(_, tally)| tally.runs > 0) {
            println!("  {kind:?}: {tally:?}");
        }
        total.iter_mut().zip(own).for_each(|(total, tally)| total.add(tally));
        if let Some(failure) = failure {
            println!("{failure}");
            failed.push(seed);
        }
    }
    for (kind, tally) in Kind::ALL.iter().zip(total) {
        println!("{kind:?}: {tally:?}");
    }
    assert_silent();
    assert!(failed.is_empty(), "{} of the seeds `{chosen}` failed: {failed:?}", failed.len());
    for (kind, tally) in Kind::ALL.iter().zip(total) {
        assert!(kind.allows(tally), "{kind:?}: {tally:?}");
    }
}
