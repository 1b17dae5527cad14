//! The link gives the same events as the frames in one process, with each way into a slot and each timeline.

#![expect(unsafe_code, reason = "pointers of CUDA are given by hand")]

use crate::present::{cuda_or_a_clear_error, frames};
use esaac_engine::{FrameBytes, Rig, SubmitHooks};
use esaac_interop::cuda::{CudaDevice, CudaOptions, CudaProducer, Strided};
use esaac_interop::wire::{TIMELINE_CARRIED, TIMELINE_EXPORTED};
use esaac_interop::{Copies, Planes, ServerOptions, Support};
use esaac_model::{SensorModel, Taps};
use esaac_tests::cuda::{CudaImage, use_device};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::FRAME_NS;
use esaac_tests::interop::{Checksum, IMAGES, Place, flight, service};
use esaac_tests::run::camera;
use std::time::Duration;

const MINUTE: Duration = Duration::from_secs(60);

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
            assert_eq!(producer.client().offer().timeline, timeline);
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
                    unsafe { producer.copy(slot, Planes::of(hdr.strided(), Some(motion.strided()))) }.unwrap()
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
            let bytes =
                FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref(), ..FrameBytes::default() };
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
                    let written = SubmitHooks { waits: &waits, ..SubmitHooks::default() };
                    DEVICE.run_with_hooks(slot.acquire(), &written).unwrap();
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
    let image = CudaImage::new(&images.frames[0].hdr, sensor.height as usize, 0);
    let hdr = image.strided();
    for (stride_bytes, words) in [(8, "hdr row"), (1 << 30, "hdr"), (usize::MAX, "hdr")] {
        // SAFETY: no image is as long as these strides say, which is refused before anything is copied.
        let result = unsafe { producer.copy(slot, Planes::of(Strided { stride_bytes, ..hdr }, None)) };
        let error = result.unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("expected"), "{error}");
    }
}
