//! Unoccluded pixels of synthesis `rigid`: what they show.

use super::levels::{LEVEL_TOLERANCE_LOG, SIZE, sensor};
use esaac_model::Taps;
use esaac_oracle::synthesize::rigid::{Rigid, Sample};
use esaac_scene::SceneKind;
use esaac_tests::geometry::Rendered;

const SCENES: [SceneKind; 4] = [SceneKind::Flight, SceneKind::Shake, SceneKind::Propeller, SceneKind::Bounce];

/// Share of unoccluded pixels below which a scene says nothing about them: images this small are full of silhouettes.
const LEAST_UNOCCLUDED: f64 = 0.1;

/// Share of the samples of unoccluded pixels that all candidates would change.
const DIFFERING_SHARE: f64 = 1e-3;

/// The interval between the last two of these frames, as the oracle sees it.
fn oracle(rendered: &Rendered) -> Rigid<'_> {
    let [.., before, last] = &rendered.frames[..] else { panic!("two frames at least") };
    let planes = [before, last].map(|frame| frame.planes(&sensor()));
    let inputs = [before.input(SIZE, &planes[0]), last.input(SIZE, &planes[1])];
    Rigid::new(&rendered.scene, inputs, sensor().log_offset, (Taps::Cubic, 1), None)
}

/// Unoccluded pixels skip the looks at their candidates, but that changes next to nothing: all that they read lies inside
/// one surface.
#[test]
fn unoccluded_pixels_show_what_all_their_candidates_would() {
    let sensor = sensor();
    let size = (SIZE.0 as usize, SIZE.1 as usize);
    for kind in SCENES {
        let rendered = Rendered::of(kind, SIZE, 3);
        let rigid = oracle(&rendered);
        let unoccluded: Vec<usize> =
            (0..size.0 * size.1).filter(|&pixel| rigid.unoccluded_pixels()[pixel].is_some()).collect();
        let share = unoccluded.len() as f64 / (size.0 * size.1) as f64;
        assert!(share > LEAST_UNOCCLUDED && share < 1.0, "{kind:?}: {share}");
        let (mut samples, mut far) = (0, 0);
        for fraction in [0.1, 0.25, 0.4, 0.55, 0.7, 0.85] {
            let instant = rigid.instant(fraction);
            for pixel in &unoccluded {
                let (x, y) = (pixel % size.0, pixel / size.0);
                let log = |sample: Sample| (sample.intensity().expect("a path") + sensor.log_offset).ln();
                let [own, all] =
                    [rigid.sample(&instant, 0, x, y), rigid.composite(&instant, 0, x, y)].map(log);
                samples += 1;
                far += usize::from((own - all).abs() > LEVEL_TOLERANCE_LOG);
            }
        }
        println!("{kind:?}: {share:.2} of the pixels, {far} of {samples} samples differ");
        assert!(far as f64 <= DIFFERING_SHARE * samples as f64, "{kind:?}: {far} of {samples} samples");
    }
}
