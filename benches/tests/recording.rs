//! The real recording is read as it is known to be, and broken copies of it are errors.

use esaac_benches::recording::{Recording, RecordingError, aedat4};
use std::path::{Path, PathBuf};

fn path() -> PathBuf {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/recordings/davis346_emlb_demo01.aedat4");
    assert!(path.is_file(), "the recording is missing: expected {}", path.display());
    path
}

fn read() -> Recording {
    aedat4::read(&path()).unwrap()
}

#[test]
fn the_recording_holds_what_is_known_of_it() {
    let recording = read();
    assert_eq!((recording.width_px, recording.height_px), (346, 260));
    assert_eq!((recording.events.len(), recording.frames.len()), (319_512, 13));
    assert!(recording.name.starts_with("DAVIS346"), "{}", recording.name);
    assert!(recording.events.is_sorted());
    let span_ns = recording.events[319_511].t_ns - recording.events[0].t_ns;
    assert!((505_000_000..515_000_000).contains(&span_ns), "{span_ns}");
    for frame in &recording.frames {
        let exposure_ms = (frame.end_ns - frame.start_ns) as f64 * 1e-6;
        assert!((exposure_ms - 20.0).abs() < 0.5, "{exposure_ms} ms");
        let mean = frame.pixels.iter().sum::<f32>() / frame.pixels.len() as f32;
        assert!((0.02..0.98).contains(&mean), "{mean}");
    }
    // Frames and events are on one clock.
    assert!(recording.events_between_frames().len() > 200_000);
}

#[test]
fn broken_files_are_errors_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("broken.aedat4");
    let good = std::fs::read(path()).unwrap();
    let error_of = |bytes: &[u8]| {
        std::fs::write(&file, bytes).unwrap();
        aedat4::read(&file).expect_err("a broken file")
    };
    assert!(error_of(b"#!AER-DAT2.0\r\n").to_string().contains("not an AEDAT 4 file"));
    assert!(matches!(error_of(&good[..20]), RecordingError::Format { .. }));
    assert!(matches!(error_of(&good[..1000]), RecordingError::Format { .. }));
    assert!(error_of(&good[..200_000]).to_string().contains("beyond the file"));
    let mut scrambled = good.clone();
    scrambled[3158..3300].fill(0x5a);
    assert!(error_of(&scrambled).to_string().contains("packet at byte 3150"));
    let missing = aedat4::read(Path::new("/nonesuch.aedat4")).unwrap_err();
    assert!(missing.to_string().contains("/nonesuch.aedat4"), "{missing}");
}
