//! A sensor of known parameters is recovered from its own recording. The engine makes the recording and does the fit.

use esaac_calibrate::{fit, simulate};
use esaac_formats::recording::{Recording, aedat4};
use esaac_model::SensorModel;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::recording::{FRAME_NS, record, save, sensor};

/// APS frames of a recording.
const FRAMES: usize = 41;

/// Largest error of a fit. Event counts bound how well mismatch and rates can be known.
const THRESHOLD_SHARE: f64 = 0.05;
const MISMATCH_LOG: f64 = 0.015;
const RATE_SHARE: f64 = 0.25;

#[test]
fn a_known_sensor_is_recovered_from_its_recording() {
    let known = sensor();
    let recorded = record(&known, FRAMES);
    // A user has the recording as a file, so the test reads one too.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("recording.aedat4");
    save(&file, &recorded);
    let recording = aedat4::read(&file).unwrap();
    assert_eq!(recording, recorded);
    let fit = fit(&DEVICE, &recording, 0.01).unwrap();
    let found = &fit.sensor;
    println!("{fit:?}");
    let share = |what: &str, actual: f64, expected: f64, bound: f64| {
        assert!(
            (actual / expected - 1.0).abs() <= bound,
            "{what}: {actual:.4}, expected {expected} +- {bound}"
        );
    };
    share("contrast_on", found.contrast_on, known.contrast_on, THRESHOLD_SHARE);
    share("contrast_off", found.contrast_off, known.contrast_off, THRESHOLD_SHARE);
    share("leak_rate_hz", found.leak_rate_hz, known.leak_rate_hz, RATE_SHARE);
    share("shot_noise_rate_hz", found.shot_noise_rate_hz, known.shot_noise_rate_hz, RATE_SHARE);
    let mismatch = (found.contrast_mismatch - known.contrast_mismatch).abs();
    assert!(mismatch <= MISMATCH_LOG, "contrast_mismatch: {:.4}", found.contrast_mismatch);
    // The fit can be written as a sensor file and read again.
    assert_eq!(SensorModel::from_toml(&found.to_toml()).as_ref(), Ok(found));
    assert_silent();
}

#[test]
fn a_clean_sensor_has_no_noise_found_in_it() {
    let known = SensorModel {
        contrast_mismatch: 0.0,
        leak_rate_hz: 0.0,
        shot_noise_rate_hz: 0.0,
        contrast_on: 0.35,
        contrast_off: 0.25,
        ..sensor()
    };
    let found = fit(&DEVICE, &record(&known, FRAMES), 0.01).unwrap().sensor;
    println!("{found:?}");
    assert!((found.contrast_on / 0.35 - 1.0).abs() <= THRESHOLD_SHARE, "{}", found.contrast_on);
    assert!((found.contrast_off / 0.25 - 1.0).abs() <= THRESHOLD_SHARE, "{}", found.contrast_off);
    assert!(found.contrast_mismatch <= MISMATCH_LOG, "{}", found.contrast_mismatch);
    assert_eq!((found.leak_rate_hz, found.shot_noise_rate_hz), (0.0, 0.0));
    assert_silent();
}

#[test]
fn recordings_that_say_nothing_are_errors() {
    let mut recording = record(&sensor(), FRAMES);
    let error = |recording: &Recording| format!("{:#}", fit(&DEVICE, recording, 0.01).unwrap_err());
    let frames = std::mem::take(&mut recording.frames);
    recording.frames = frames[..4].to_vec();
    assert!(error(&recording).contains("4 APS frames, expected at least 5"));
    recording.frames = vec![frames[0].clone(); 6];
    for (k, frame) in recording.frames.iter_mut().enumerate() {
        (frame.start_ns, frame.end_ns) = (k as i64 * FRAME_NS, k as i64 * FRAME_NS + 2_000);
    }
    assert!(error(&recording).contains("no thresholds follow"));
    recording.events.clear();
    assert!(error(&recording).contains("no events"));
    // Two frames are further apart than the longest interval.
    recording.frames[5].start_ns += 2_000_000_000;
    recording.frames[5].end_ns += 2_000_000_000;
    let late = simulate(&DEVICE, &recording, &sensor()).unwrap_err();
    assert!(format!("{late:#}").contains("frame 5"), "{late:#}");
}
