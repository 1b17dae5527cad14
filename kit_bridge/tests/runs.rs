//! Which images are copied where some cameras wait, without a device.

#[path = "../src/runs.rs"]
mod runs;

use runs::runs;

#[test]
fn only_cameras_with_a_time_are_copied_and_small_gaps_between_them() {
    let times = |cameras: &str| cameras.chars().map(|c| (c == 'x').then_some(0)).collect::<Vec<_>>();
    for (cameras, gap, expected) in [
        ("xxxx", 0, vec![(0, 4)]),
        ("....", 9, vec![]),
        (".xx.x.", 0, vec![(1, 3), (4, 5)]),
        (".xx.x.", 1, vec![(1, 5)]),
        ("x..x...x", 2, vec![(0, 4), (7, 8)]),
        ("x", 0, vec![(0, 1)]),
    ] {
        let actual: Vec<(usize, usize)> =
            runs(&times(cameras), gap).iter().map(|run| (run.start, run.end)).collect();
        assert_eq!(actual, expected, "{cameras} with gaps of {gap}");
    }
}
