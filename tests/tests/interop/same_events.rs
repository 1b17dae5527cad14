//! A rig fed over the link gives the same events as the same frames in one process, bit for bit, with every kind of
//! memory and timeline of the device. The content of a slot is what was sent.

use crate::frames;
use esaac_engine::{FrameInput, Rig, RigOptions, SubmitHooks};
use esaac_interop::wire::{
    MEMORY_BROUGHT, MEMORY_EXPORTED, MEMORY_HOST, MEMORY_IMAGES, TIMELINE_CARRIED, TIMELINE_EXPORTED,
};
use esaac_interop::{CameraTerms, Outcome, ProducerOptions, Server, ServerOptions, Support};
use esaac_model::{SensorModel, Synthesis, Taps};
use esaac_tests::device::{DEVICE, assert_device_silent, assert_silent};
use esaac_tests::frames::{FRAME_NS, Sequence};
use esaac_tests::interop::{
    Checksum, IMAGES, Place, Uploader, flight, other_device, server, service, trusting, until,
};
use esaac_tests::run::{camera, engine_of_many, step};
use std::time::Duration;

const SECOND: Duration = Duration::from_secs(1);

fn sensor() -> SensorModel {
    // The events depend on every input: colour, motion and noise. Bilinear taps compile quickly.
    SensorModel {
        width: 37,
        height: 23,
        taps: Taps::Bilinear,
        substeps: 8,
        contrast_mismatch: 0.03,
        refractory_ns: 200_000,
        shot_noise_rate_hz: 5.0,
        leak_rate_hz: 0.1,
        ..SensorModel::default()
    }
}

fn t_ns(index: usize) -> i64 {
    index as i64 * FRAME_NS
}

/// The frames of a run: the images repeated, at increasing times.
fn long(images: &Sequence) -> Sequence {
    let frames = (0..frames(200))
        .map(|index| {
            let mut frame = images.frames[index % images.frames.len()].clone();
            frame.t_ns = t_ns(index);
            frame
        })
        .collect();
    Sequence { frames, ..images.clone() }
}

#[test]
fn the_driver_shares_memory_by_descriptors_and_by_host_pointers() {
    let support = Support::of(&DEVICE);
    assert!(support.export_buffer && support.import_buffer, "{support:?}");
    let alignment = support.host_alignment.unwrap_or_else(|| panic!("{support:?}"));
    assert!(alignment.is_power_of_two(), "{support:?}");
    if DEVICE.is_software() {
        assert!(!support.share_timeline, "lavapipe shares timelines now: run these tests with both kinds");
    }
}

/// Runs over the link with one camera for each pair of memory and timeline. All have the same sensor and the same
/// noise. Checks the content of every frame where the engine reads it.
fn over_the_link(kinds: &[(u32, u32)]) {
    let (sensor, checked) = (sensor(), &mut Checksum::default());
    let sequence = long(&flight(&sensor));
    let count = sequence.frames.len();
    let config = camera(&sensor, 0, &sequence);
    let mut alone = Rig::new(&DEVICE, std::slice::from_ref(&config)).unwrap();
    let mut fed = Rig::new(&DEVICE, &vec![config.clone(); kinds.len()]).unwrap();

    let place = Place::default();
    // Gathers all cameras into one tick.
    let options = ServerOptions { gather: 30 * SECOND, ..trusting() };
    let server =
        Server::open(&DEVICE, &place.path(), &vec![CameraTerms::from(&config); kinds.len()], options)
            .unwrap();
    let mut events = 0;
    std::thread::scope(|scope| {
        for (number, &(memory, timeline)) in (0..).zip(kinds) {
            let (path, sequence) = (place.path(), &sequence);
            scope.spawn(move || {
                let device = other_device();
                let options = ProducerOptions {
                    camera: number,
                    memories: memory,
                    timelines: timeline,
                    // The first tick compiles kernels, which takes long under the validation layer.
                    timeout: 300 * SECOND,
                    ..ProducerOptions::default()
                };
                let mut uploader = Uploader::connect(&device, &path, &options).unwrap();
                let offer = *uploader.producer.client().offer();
                assert_eq!((offer.memory, offer.timeline), (memory, timeline));
                for frame in &sequence.frames {
                    uploader.send(frame, frame.t_ns).unwrap();
                }
                assert_eq!(uploader.producer.finish().unwrap(), (count as u64, 0));
                assert_device_silent(&device);
            });
        }
        until("all producers", || server.connected() == kinds.len());
        for (index, frame) in sequence.frames.iter().enumerate() {
            let expected = step(&mut alone, &sequence, index).packet;
            let sums = [
                (alone.inputs(0).unwrap().hdr, frame.hdr.len()),
                (alone.inputs(0).unwrap().motion.unwrap(), frame.motion.as_ref().unwrap().len()),
            ]
            .map(|(buffer, bytes)| checked.of(buffer, bytes));
            let ready = server.wait(60 * SECOND).unwrap();
            assert_eq!(ready.len(), kinds.len(), "frame {index}: {:?}", server.notices());
            let mut frames = vec![None; kinds.len()];
            for ready in &ready {
                assert_eq!((ready.t_ns, ready.first, ready.copies()), (frame.t_ns, index == 0, (1, 1)));
                DEVICE.run_with_hooks(ready.slot().acquire(), &SubmitHooks::default()).unwrap();
                let inputs = ready.slot().inputs();
                let got = [
                    checked.of(inputs.hdr, frame.hdr.len()),
                    checked.of(inputs.motion.unwrap(), frame.motion.as_ref().unwrap().len()),
                ];
                assert_eq!(got, sums, "frame {index}, camera {}: colour, motion", ready.camera);
                frames[ready.camera] = Some(FrameInput { t_ns: ready.t_ns, inputs: Some(inputs) });
            }
            let after: Vec<_> = ready.iter().map(|r| r.slot().release()).collect();
            let waits: Vec<_> = ready.iter().map(|r| (r.slot().timeline().timeline(), r.value())).collect();
            let hooks = SubmitHooks { before: &[], after: &after, waits: &waits, signals: &[] };
            let tick = fed.step_frames(&frames, &hooks).unwrap();
            for (camera, packet) in tick.packets.iter().enumerate() {
                assert!(*packet == expected, "frame {index}, camera {camera}: other events");
            }
            events += expected.len();
            for ready in &ready {
                server.release(ready, Outcome::Stepped);
            }
        }
    });
    assert!(events > 10 * count, "{events} events");
    until("all goodbyes", || server.counts().iter().all(|counts| counts.finished == 1));
    for (counts, (memory, _)) in server.counts().iter().zip(kinds) {
        let frames = count as u64;
        assert_eq!((counts.lost, counts.stepped, counts.dropped), (0, frames, 0));
        // The uploader makes one copy. With shared images the engine makes one more of each of the two images.
        let copies = if *memory == MEMORY_IMAGES { 3 } else { 1 };
        assert_eq!((counts.device_copies, counts.host_copies), (copies * frames, frames));
    }
    drop((server, fed, alone));
    assert_silent();
}

#[test]
fn every_memory_and_every_timeline_gives_the_events_of_one_process() {
    let mut kinds: Vec<(u32, u32)> = [MEMORY_EXPORTED, MEMORY_BROUGHT, MEMORY_IMAGES, MEMORY_HOST]
        .map(|memory| (memory, TIMELINE_CARRIED))
        .to_vec();
    if Support::of(&DEVICE).share_timeline {
        let shared = [MEMORY_EXPORTED, MEMORY_BROUGHT, MEMORY_IMAGES];
        kinds.extend(shared.map(|memory| (memory, TIMELINE_EXPORTED)));
    }
    over_the_link(&kinds);
}

#[test]
fn timelines_that_cannot_be_exported_are_named() {
    if Support::of(&DEVICE).share_timeline {
        // The run over the link covers this.
        return;
    }
    let sensor = sensor();
    let place = Place::default();
    let options = ServerOptions { timelines: TIMELINE_EXPORTED, ..ServerOptions::default() };
    let server = server(&place.path(), &camera(&sensor, 0, &flight(&sensor)), options).unwrap();
    let Err(error) = Uploader::connect(&other_device(), &place.path(), &ProducerOptions::default()) else {
        panic!("a ring without a timeline");
    };
    assert!(error.to_string().contains("timelines"), "{error}");
    assert_eq!(server.counts()[0].connections, 0);
}

#[test]
fn several_cameras_each_with_its_producer() {
    let large = SensorModel { synthesis: Synthesis::None, ..sensor() };
    let small = SensorModel { width: 12, height: 9, ..large.clone() };
    let sensors = [large, small.clone(), SensorModel { seed: 5, ..small }];
    let sequences: Vec<Sequence> = sensors.iter().map(flight).collect();
    let cameras: Vec<_> = sensors.iter().cloned().zip(sequences.iter().cloned()).collect();
    let expected: Vec<Vec<_>> = engine_of_many(&cameras, RigOptions::default())
        .into_iter()
        .map(|steps| steps.into_iter().map(|step| step.packet).collect())
        .collect();
    let place = Place::default();
    let cameras: Vec<_> = sensors.iter().cloned().zip(&sequences).collect();
    let mut service = service(&place.path(), &cameras, false, ServerOptions::default());
    let mut got = vec![Vec::new(); sensors.len()];
    std::thread::scope(|scope| {
        for (number, sequence) in (0..).zip(&sequences) {
            let path = place.path();
            scope.spawn(move || {
                let device = other_device();
                let options =
                    ProducerOptions { camera: number, timeout: 300 * SECOND, ..ProducerOptions::default() };
                let mut uploader = Uploader::connect(&device, &path, &options).unwrap();
                for frame in &sequence.frames {
                    uploader.send(frame, frame.t_ns).unwrap();
                }
                uploader.producer.finish().unwrap();
                assert_device_silent(&device);
            });
        }
        while got.iter().map(Vec::len).sum::<usize>() < sensors.len() * IMAGES {
            let tick = service.tick(30 * SECOND).unwrap().expect("frames come");
            for (number, packets) in got.iter_mut().enumerate() {
                if tick.t_ns[number].is_some() {
                    packets.push(tick.tick.packets[number].clone());
                }
            }
        }
    });
    assert!(got == expected, "events differ");
    until("all goodbyes", || service.counts().iter().all(|counts| counts.finished == 1));
    assert!(service.counts().iter().all(|counts| counts.lost == 0));
    drop(service);
    assert_silent();
}

#[test]
fn latest_drops_old_frames_and_counts_them() {
    let sensor = SensorModel { synthesis: Synthesis::None, ..sensor() };
    let sequence = flight(&sensor);
    let place = Place::default();
    let mut service = service(&place.path(), &[(sensor.clone(), &sequence)], true, ServerOptions::default());
    let device = other_device();
    let mut uploader = Uploader::connect(&device, &place.path(), &ProducerOptions::default()).unwrap();
    // The engine does not step. A producer that had to wait for free slots would block after three frames.
    for frame in &sequence.frames {
        uploader.send(frame, frame.t_ns).unwrap();
    }
    until("all frames", || service.counts()[0].frames == IMAGES as u64);
    let tick = service.tick(5 * SECOND).unwrap().expect("the newest frame");
    assert_eq!((tick.t_ns[0], tick.first[0]), (Some(t_ns(IMAGES - 1)), true));
    assert_eq!(uploader.producer.finish().unwrap(), (1, IMAGES as u64 - 1));
    let counts = service.counts()[0];
    assert_eq!((counts.frames, counts.stepped, counts.dropped), (12, 1, 11));
    drop(service);
    assert_silent();
}
