//! What the service tells of frames that are not stepped, and of cameras that start anew.

use crate::faults::{engine, sensor, sequence};
use esaac_interop::{ProducerOptions, ServerOptions};
use esaac_tests::device::{assert_device_silent, assert_silent};
use esaac_tests::interop::{Place, Uploader, other_device, service, until};
use std::time::Duration;

#[test]
fn every_frame_that_came_is_stepped_or_counted() {
    let place = Place::default();
    let server = engine(&place);
    let device = other_device();
    let send = |count: usize| {
        let mut uploader = Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
        for (frame, t_ns) in sequence().frames.iter().take(count).zip([0, 10, 20]) {
            uploader.send(frame, t_ns).unwrap();
        }
        uploader
    };
    drop(send(3));
    until("its end", || server.counts()[0].lost == 1);
    assert_eq!((server.counts()[0].frames, server.counts()[0].abandoned), (3, 3));
    let stays = send(2);
    server.close();
    assert_eq!((server.counts()[0].frames, server.counts()[0].abandoned), (5, 5));
    assert_eq!((server.counts()[0].lost, server.connected()), (1, 0));
    drop((stays, server));
    assert_device_silent(&device);
    assert_silent();
}

#[test]
fn a_gap_that_dropped_frames_leave_is_told() {
    let (sensor, sequence) = (sensor(), sequence());
    let place = Place::default();
    let mut service = service(&place.path(), &[(sensor, &sequence)], true, ServerOptions::default());
    let device = other_device();
    let mut uploader = Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
    // What comes between two ticks is dropped for the last of it.
    for frames in [0..1, 1..4] {
        for index in frames {
            uploader.send(&sequence.frames[index], index as i64 * 400_000_000).unwrap();
            until("the frame", || service.counts()[0].frames == index as u64 + 1);
        }
        let tick = service.tick(Duration::from_secs(60)).unwrap().expect("a frame");
        assert_eq!(tick.first, [true]);
    }
    let told = "dropped frames left a gap of 1200000000 ns, expected at most 1000000000 ns";
    let notices = service.server().notices().join("\n");
    assert!(notices.contains(&format!("camera 0: warning: {told}")), "{notices}");
    assert!(service.input_warnings()[0].texts().any(|text| text.starts_with(told)));
    assert_eq!((service.resets(), service.counts()[0].dropped), (1, 2));
    assert_eq!(uploader.producer.finish().unwrap(), (2, 2));
    drop(service);
    assert_device_silent(&device);
    assert_silent();
}
