//! Faults drawn at random, several in one run.

use crate::driver::{Driver, undisturbed};
use crate::operations::operations;
use crate::strike::{Faults, Kind};
use esaac_tests::device::{alone, assert_silent};

/// A small generator for the choice of faults: SplitMix64.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % bound as u64) as usize
    }
}

#[test]
fn a_thousand_random_faults() {
    let _alone = alone();
    let seed = std::env::var("ESAAC_FAULT_SEED").map_or(20_261_123, |seed| seed.parse().expect("a number"));
    println!("ESAAC_FAULT_SEED={seed}");
    let mut random = Random(seed);
    let expected = undisturbed();
    let mut struck = 0;
    while struck < 1000 {
        let mut driver = Driver::new();
        let mut actual = Vec::new();
        for operation in &operations() {
            let kind = if random.below(4) == 0 { Kind::Losses } else { Kind::Refusals };
            let faults = Faults::at(kind, random.below(12));
            actual.extend(driver.run_with(operation, &faults));
            struck += usize::from(faults.has_struck());
        }
        assert!(actual == expected, "seed {seed}, {struck} faults");
    }
    assert_silent();
}
