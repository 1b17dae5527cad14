//! The frontier on a small case: the part's statement on the default agrees with its own figures.

use esaac_benches::{Laboratory, Options, Part, run};
use esaac_tests::device::{DEVICE, assert_silent};
use serde_json::Value;
use std::sync::Arc;

/// Bands of the part: differences below them are noise.
const TIME_BAND: f64 = 0.03;
const ERROR_BAND: f64 = 0.005;

#[test]
fn the_default_is_reported_as_its_figures_are() {
    let options = Options {
        quick: true,
        parts: vec![Part::Frontier],
        only: "adaptive 32".to_owned(),
        ..Options::default()
    };
    let laboratory = Laboratory::new(Arc::clone(&DEVICE), options).unwrap();
    let report = run(&laboratory, |_| Ok(())).unwrap();
    let text = report.documents[0].1.markdown();
    assert!(text.contains("**A rendered sequence is left out:**"), "{text}");
    let scenes = report.parts["frontier"].as_array().unwrap();
    assert_eq!(scenes.len(), 1);
    let mut on_frontier = 0;
    for scene in scenes {
        assert!(scene["true_events"].as_u64().unwrap() > 100, "{scene}");
        let points = scene["points"].as_array().unwrap();
        let of = |point: &Value| {
            [&point["gpu_us"], &point["victor_purpura"]].map(|figure| figure.as_f64().unwrap())
        };
        let beats = |a: [f64; 2], b: [f64; 2]| {
            let (cheaper, as_cheap) = (a[0] < b[0] * (1.0 - TIME_BAND), a[0] * (1.0 - TIME_BAND) <= b[0]);
            let (better, as_good) = (a[1] < b[1] - ERROR_BAND, a[1] <= b[1] + ERROR_BAND);
            cheaper && as_good || better && as_cheap
        };
        for point in points {
            let beaten = points.iter().any(|other| beats(of(other), of(point)));
            assert_eq!(point["on_frontier"], !beaten, "{point} among {points:?}");
        }
        let defaults: Vec<&Value> = points.iter().filter(|p| p["is_default"] == true).collect();
        let [default] = defaults[..] else { panic!("{} defaults in {points:?}", defaults.len()) };
        assert_eq!(scene["default_on_frontier"], default["on_frontier"]);
        let better = scene["better_than_default"].as_array().unwrap();
        assert_eq!(better.is_empty(), default["on_frontier"] == true, "{scene}");
        on_frontier += usize::from(default["on_frontier"] == true);
        // This holds on every machine: the default is nearer to the truth than blending.
        let linear = points.iter().find(|p| p["family"] == "linear").unwrap();
        assert!(of(default)[1] < of(linear)[1], "{default} {linear}");
    }
    assert_eq!(text.matches("The default lies on the frontier.").count(), on_frontier);
    assert_eq!(text.matches("The default does not lie on the frontier.").count(), 1 - on_frontier);
    assert_silent();
}
