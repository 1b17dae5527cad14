//! A CUDA producer against the same frames in process, by each way into a slot and each timeline. Where
//! there is no CUDA, or not on the engine's device, every test asserts that this is said clearly instead.
//!
//! `ESAAC_CUDA_FRAMES` is the number of frames (2000); the figures are printed with `--nocapture`.

#![expect(unsafe_code, reason = "pointers of CUDA are given by hand")]

use esaac_engine::{Around, FrameBytes, Rig};
use esaac_interop::cuda::{CudaDevice, CudaOptions, CudaProducer, Strided, cuda_devices};
use esaac_interop::wire::{ErrorCode, TIMELINE_CARRIED, TIMELINE_EXPORTED};
use esaac_interop::{Copies, InteropError, ServerOptions, Support};
use esaac_model::presets::preset;
use esaac_model::{Profile, SensorModel, Taps};
use esaac_tests::cuda::{CudaImage, finish, use_device};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::FRAME_NS;
use esaac_tests::interop::{Checksum, IMAGES, Place, flight, service};
use esaac_tests::run::camera;
use std::sync::mpsc;
use std::time::{Duration, Instant};

const MINUTE: Duration = Duration::from_secs(60);

fn frames() -> usize {
    std::env::var("ESAAC_CUDA_FRAMES").map_or(2000, |n| n.parse().expect("ESAAC_CUDA_FRAMES is a number"))
}

fn sensor() -> SensorModel {
    SensorModel {
        width: 97,
        height: 61,
        taps: Taps::Bilinear,
        substeps: 8,
        contrast_mismatch: 0.03,
        refractory_ns: 200_000,
        shot_noise_rate_hz: 5.0,
        ..SensorModel::default()
    }
}

/// The CUDA device that is the device under test. Otherwise the producer says why there is none for it,
/// which is asserted here.
fn cuda_or_a_clear_error() -> Option<CudaDevice> {
    let place = Place::default();
    let sensor = SensorModel { width: 9, height: 9, ..sensor() };
    let sequence = flight(&sensor).first(1);
    let _service = service(&place.path(), &[(sensor, &sequence)], false, ServerOptions::default());
    let devices = match cuda_devices() {
        Ok(devices) => devices,
        Err(error) => {
            let text = error.to_string();
            match error {
                InteropError::NoCuda => assert!(text.contains("libcuda.so.1") && text.contains("install")),
                InteropError::NoCudaDevice { .. } => assert!(text.contains("no CUDA device"), "{text}"),
                _ => panic!("CUDA is there and broken: {text}"),
            }
            let Err(error) = CudaProducer::connect(&place.path(), &CudaOptions::default()) else {
                panic!("a CUDA producer without CUDA");
            };
            assert_eq!(error.to_string(), text);
            println!("no CUDA here: {text}");
            return None;
        }
    };
    let own = devices.iter().find(|device| device.uuid == DEVICE.info().uuid).copied();
    if own.is_none() {
        match CudaProducer::connect(&place.path(), &CudaOptions::default()) {
            Err(InteropError::Refused { code: ErrorCode::Device, text }) => {
                assert!(text.contains("start both on one device"), "{text}");
            }
            Err(error) => panic!("{error}"),
            Ok(_) => panic!("a CUDA producer on another device"),
        }
    }
    own
}

/// How frames get into slots.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    Copy,
    Write,
    Bring,
}

fn run(device: CudaDevice, way: Way, timeline: u32) {
    let sensor = sensor();
    let (images, count) = (flight(&sensor), frames());
    let mut alone = Rig::new(&DEVICE, &[camera(&sensor, 0, &images)]).unwrap();
    let place = Place::default();
    let mut fed = service(&place.path(), &[(sensor.clone(), &images)], false, ServerOptions::default());
    let checked = &mut Checksum::default();
    std::thread::scope(|scope| {
        let (path, images) = (place.path(), &images);
        scope.spawn(move || {
            use_device(device.ordinal);
            let options = CudaOptions {
                device: Some(device.uuid),
                brings_memory: way == Way::Bring,
                timelines: timeline,
                timeout: MINUTE,
                ..CudaOptions::default()
            };
            let mut producer = CudaProducer::connect(&path, &options).unwrap();
            assert_eq!(producer.offer().timeline, timeline);
            let rows = sensor.height as usize;
            let uploaded: Vec<[CudaImage; 2]> = images
                .frames
                .iter()
                .map(|f| {
                    [CudaImage::new(&f.hdr, rows, 256), CudaImage::new(f.motion.as_ref().unwrap(), rows, 64)]
                })
                .collect();
            for index in 0..count {
                let [hdr, motion] = &uploaded[index % IMAGES];
                let slot = producer.slot().unwrap();
                let copies = if way == Way::Copy {
                    // SAFETY: both images have the camera's formats and live until the producer is gone.
                    unsafe { producer.copy(slot, hdr.strided(), Some(motion.strided())) }.unwrap()
                } else {
                    let pointers = producer.pointers(slot);
                    hdr.render_to(pointers.hdr, producer.stream());
                    motion.render_to(pointers.motion.unwrap(), producer.stream());
                    Copies::default()
                };
                producer.publish(slot, index as i64 * FRAME_NS, copies).unwrap();
            }
            assert_eq!(producer.finish().unwrap(), (count as u64, 0));
        });
        let mut events = 0;
        for index in 0..count {
            let frame = &images.frames[index % IMAGES];
            let bytes = FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref() };
            alone.upload(0, &bytes).unwrap();
            let own = alone.inputs(0).unwrap();
            let sums = [
                checked.of(own.hdr, frame.hdr.len()),
                checked.of(own.motion.unwrap(), frame.motion.as_ref().unwrap().len()),
            ];
            let mut seen = Vec::new();
            let tick = fed
                .tick_checked(MINUTE, |ready| {
                    let slot = ready.slot();
                    let waits = [(slot.timeline().timeline(), ready.value())];
                    let written = Around { waits: &waits, ..Around::default() };
                    DEVICE.run_around(slot.acquire(), &written).unwrap();
                    let inputs = slot.inputs();
                    seen = vec![
                        checked.of(inputs.hdr, frame.hdr.len()),
                        checked.of(inputs.motion.unwrap(), frame.motion.as_ref().unwrap().len()),
                    ];
                })
                .unwrap()
                .expect("the next frame");
            let expected = &alone.step(&[index as i64 * FRAME_NS]).unwrap().packets[0];
            assert!(tick.tick.packets[0] == *expected, "frame {index}: other events");
            assert_eq!(seen, sums, "frame {index}: other content");
            events += expected.len();
        }
        assert!(events > count, "{events} events");
    });
    let counts = fed.counts()[0];
    assert_eq!((counts.stepped, counts.lost, counts.host_copies), (count as u64, 0, 0));
    assert_eq!(counts.device_copies, if way == Way::Copy { 2 * count as u64 } else { 0 });
    drop((alone, fed));
    assert_silent();
}

fn every_timeline(way: Way) {
    let Some(device) = cuda_or_a_clear_error() else { return };
    run(device, way, TIMELINE_CARRIED);
    if Support::of(&DEVICE).share_timeline {
        run(device, way, TIMELINE_EXPORTED);
    }
}

#[test]
fn frames_copied_from_strided_memory() {
    every_timeline(Way::Copy);
}

#[test]
fn frames_written_straight_into_the_engines_memory() {
    every_timeline(Way::Write);
}

#[test]
fn frames_in_memory_that_cuda_brings() {
    every_timeline(Way::Bring);
}

#[test]
fn strides_that_overrun_are_refused() {
    let Some(device) = cuda_or_a_clear_error() else { return };
    use_device(device.ordinal);
    let sensor = sensor();
    let images = flight(&sensor).first(1);
    let place = Place::default();
    let _service = service(&place.path(), &[(sensor.clone(), &images)], false, ServerOptions::default());
    let mut producer = CudaProducer::connect(&place.path(), &CudaOptions::default()).unwrap();
    let slot = producer.slot().unwrap();
    let hdr = CudaImage::new(&images.frames[0].hdr, sensor.height as usize, 0).strided();
    for (stride_bytes, words) in [(8, "hdr row"), (1 << 30, "hdr"), (usize::MAX, "hdr")] {
        // SAFETY: no image is as long as these strides say, which is refused before anything is copied.
        let result = unsafe { producer.copy(slot, Strided { stride_bytes, ..hdr }, None) };
        let error = result.unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("expected"), "{error}");
    }
}

#[test]
fn from_the_write_to_the_packet() {
    let Some(device) = cuda_or_a_clear_error() else { return };
    let mut sensor = preset("genx320").expect("a preset");
    Profile::Noisy.apply(&mut sensor);
    let images = flight(&sensor);
    for timeline in [TIMELINE_CARRIED, TIMELINE_EXPORTED] {
        let place = Place::default();
        let options = ServerOptions { gather: Duration::ZERO, ..ServerOptions::default() };
        let mut fed = service(&place.path(), &[(sensor.clone(), &images)], false, options);
        let (tell, told) = mpsc::channel();
        let (go, wait) = mpsc::channel();
        let path = place.path();
        let (mut spans, mut inside) = (Vec::new(), Vec::new());
        std::thread::scope(|scope| {
            let images = &images;
            scope.spawn(move || {
                use_device(device.ordinal);
                let options = CudaOptions { timelines: timeline, timeout: MINUTE, ..CudaOptions::default() };
                let mut producer = CudaProducer::connect(&path, &options).unwrap();
                let uploaded: Vec<[CudaImage; 2]> = images
                    .frames
                    .iter()
                    .map(|f| [&f.hdr, f.motion.as_ref().unwrap()].map(|b| CudaImage::new(b, 320, 0)))
                    .collect();
                for index in 0..frames() {
                    wait.recv().unwrap();
                    let slot = producer.slot().unwrap();
                    let [hdr, motion] = &uploaded[index % IMAGES];
                    // SAFETY: as in `run`.
                    let copies = unsafe { producer.copy(slot, hdr.strided(), Some(motion.strided())) };
                    finish(producer.stream());
                    tell.send(Instant::now()).unwrap();
                    producer.publish(slot, index as i64 * FRAME_NS, copies.unwrap()).unwrap();
                }
                producer.finish().unwrap();
            });
            for index in 0..frames() {
                go.send(()).unwrap();
                let tick = fed.tick(MINUTE).unwrap().expect("the next frame");
                let done = Instant::now();
                let submit_ns = tick.tick.submit_to_packet_ns;
                let written = told.recv().unwrap();
                // The first ones build kernels and find sizes.
                if index >= frames().min(100) / 2 {
                    spans.push((done - written).as_nanos() as u64);
                    inside.push(submit_ns);
                }
            }
        });
        let quantile = |values: &mut Vec<u64>, q: f64| {
            values.sort_unstable();
            values[((values.len() - 1) as f64 * q) as usize] as f64 * 1e-3
        };
        println!(
            "{} frames, timelines {timeline}: write done to packet p50 {:.1} us, p99 {:.1} us; of it submit to packet \
             p50 {:.1} us, p99 {:.1} us",
            spans.len(),
            quantile(&mut spans, 0.5),
            quantile(&mut spans, 0.99),
            quantile(&mut inside, 0.5),
            quantile(&mut inside, 0.99),
        );
        assert!(quantile(&mut spans, 0.5) >= quantile(&mut inside, 0.5));
        if !Support::of(&DEVICE).share_timeline {
            return;
        }
    }
}
