//! Depth, instance ids and poses from CUDA give the events that they give in one process.

#![expect(unsafe_code, reason = "pointers of CUDA are given by hand")]

use crate::present::cuda_or_a_clear_error;
use esaac_engine::Rig;
use esaac_interop::cuda::{CudaOptions, CudaProducer};
use esaac_interop::{Copies, Gives, Planes, ServerOptions, Service};
use esaac_model::IdFormat;
use esaac_tests::cuda::{CudaImage, use_device};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::exact::{Run, SIZE};
use esaac_tests::interop::Place;
use std::time::Duration;

const MINUTE: Duration = Duration::from_secs(60);

#[test]
fn depth_ids_and_poses_come_by_every_way_into_a_slot() {
    let Some(device) = cuda_or_a_clear_error() else { return };
    let run = &Run::default();
    let expected = run.alone(&[0, 1, 2, 3]);
    assert!(expected.iter().any(|packet| !packet.is_empty()));
    for (brings_memory, copies) in [(false, true), (false, false), (true, false)] {
        let config = run.config(IdFormat::U16);
        let place = Place::default();
        let rig = Rig::new(&DEVICE, std::slice::from_ref(&config)).unwrap();
        let terms = [(&config).into()];
        let mut service = Service::open(rig, &place.path(), &terms, ServerOptions::default()).unwrap();
        std::thread::scope(|scope| {
            let path = place.path();
            scope.spawn(move || {
                use_device(device.ordinal);
                let options = CudaOptions {
                    device: Some(device.uuid),
                    brings_memory,
                    geometry: Gives::Geometry,
                    timeout: MINUTE,
                    ..CudaOptions::default()
                };
                let mut producer = CudaProducer::connect(&path, &options).unwrap();
                for (index, (t_ns, frame)) in run.frames.iter().enumerate() {
                    let ids = run.ids(index, IdFormat::U16);
                    let image = |bytes: &[u8]| CudaImage::new(bytes, SIZE.1 as usize, 64);
                    let images = Planes {
                        hdr: image(&frame.hdr),
                        motion: Some(image(&frame.motion)),
                        depth: Some(image(&frame.depth)),
                        ids: Some(image(&ids)),
                    };
                    let slot = producer.slot().unwrap();
                    let made = if copies {
                        // SAFETY: the images have the camera's formats and live until the slot is published.
                        unsafe { producer.copy(slot, images.map(CudaImage::strided)) }.unwrap()
                    } else {
                        let pointers = producer.pointers(slot);
                        for (image, pointer) in images.iter().zip(pointers.iter()) {
                            image.render_to(*pointer, producer.stream());
                        }
                        Copies::default()
                    };
                    assert_eq!(made.device, if copies { 4 } else { 0 });
                    producer.publish_scene(slot, *t_ns, made, &run.motion).unwrap();
                }
                assert_eq!(producer.finish().unwrap(), (run.frames.len() as u64, 0));
            });
            for (index, expected) in expected.iter().enumerate() {
                let tick = service.tick(MINUTE).unwrap().expect("the next frame");
                assert!(
                    tick.tick.packets[0] == *expected,
                    "{brings_memory} {copies}, frame {index}: other events"
                );
            }
        });
        drop(service);
    }
    assert_silent();
}
