//! Steps that fail in some of several rigs.

#[path = "../src/half_done.rs"]
mod half_done;

use half_done::HalfDone;

const FIRST_NS: [Option<i64>; 3] = [Some(0), None, Some(0)];
const SECOND_NS: [Option<i64>; 3] = [Some(10), None, Some(10)];

/// Steps three rigs that fail where `fails` says so. Returns which of them were called.
fn step(half_done: &mut HalfDone, t_ns: &[Option<i64>], fails: [bool; 3]) -> ([bool; 3], Result<(), usize>) {
    assert!(half_done.allows(t_ns));
    let called = [0, 1, 2].map(|rig| !half_done.has_taken(rig));
    let end = |rig: usize| if called[rig] && fails[rig] { Err(rig) } else { Ok(()) };
    (called, half_done.note(t_ns, vec![end(0), end(1), end(2)]))
}

#[test]
fn a_step_that_fails_in_some_rigs_is_repeated_in_those_alone() {
    let mut half_done = HalfDone::default();
    assert_eq!(step(&mut half_done, &FIRST_NS, [false, true, true]), ([true; 3], Err(1)));
    assert!(!half_done.is_none() && half_done.allows(&FIRST_NS) && !half_done.allows(&SECOND_NS));
    assert_eq!(step(&mut half_done, &FIRST_NS, [true, false, true]), ([false, true, true], Err(2)));
    assert_eq!(step(&mut half_done, &FIRST_NS, [true, true, false]), ([false, false, true], Ok(())));
    assert!(half_done.is_none());
    assert_eq!(step(&mut half_done, &SECOND_NS, [false; 3]), ([true; 3], Ok(())));
}

#[test]
fn a_step_that_no_rig_has_taken_leaves_nothing_behind() {
    let mut half_done = HalfDone::default();
    assert_eq!(step(&mut half_done, &FIRST_NS, [true; 3]), ([true; 3], Err(0)));
    assert!(half_done.is_none() && half_done.allows(&SECOND_NS));
    assert_eq!(step(&mut half_done, &FIRST_NS, [true, false, true]).1, Err(0));
    half_done.clear();
    assert!(half_done.allows(&SECOND_NS) && !half_done.has_taken(1));
}
