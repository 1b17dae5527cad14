//! Cost of the link compared with the same frames in one process: the time from the end of a frame's write to its
//! packet in host memory. Prints its figures.

#![expect(unsafe_code, reason = "pointers of CUDA are given by hand")]

use crate::present::{cuda_or_a_clear_error, frames};
use esaac_engine::{FrameBytes, Rig, Tick};
use esaac_interop::cuda::{CudaDevice, CudaOptions, CudaProducer};
use esaac_interop::wire::{TIMELINE_CARRIED, TIMELINE_EXPORTED};
use esaac_interop::{Planes, ServerOptions, Support};
use esaac_model::presets::preset;
use esaac_model::{Profile, SensorModel};
use esaac_tests::cuda::{CudaImage, finish, use_device};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::figures::Figures;
use esaac_tests::frames::{FRAME_NS, Frame, Sequence};
use esaac_tests::interop::{Place, service, there_and_back, until};
use esaac_tests::run::camera;
use std::sync::mpsc;
use std::time::{Duration, Instant};

const MINUTE: Duration = Duration::from_secs(60);

/// How long the engine spins for messages before it sleeps: practically always, or not at all.
const LONG: Duration = Duration::from_secs(1);
const SHORT: Duration = Duration::ZERO;

/// Whether a frame counts. The first ones do not: they compile kernels and grow buffers.
fn counts(index: usize, frames: usize) -> bool {
    index >= frames.min(100) / 2
}

fn noisy(name: &str) -> SensorModel {
    let mut sensor = SensorModel { substeps: 32, ..preset(name).expect("a preset") };
    Profile::Noisy.apply(&mut sensor);
    sensor
}

/// Measured times of one way of feeding a rig.
#[derive(Default)]
struct Times {
    whole: Figures,
    inside: Figures,
    gpu: Figures,
}

impl Times {
    fn add(&mut self, whole: Duration, tick: &Tick<'_>) {
        self.whole.add(whole);
        self.inside.add_ns(tick.submit_to_packet_ns);
        self.gpu.add_ns(tick.stage_ns.iter().map(|stage| stage.1).sum());
    }

    fn print(&self, what: &str) {
        println!(
            "{what}: frame there to packet {}; of it submit to packet {}; of that on the GPU {}",
            self.whole, self.inside, self.gpu
        );
    }
}

/// The engine without a link. If a CUDA device is given, CUDA writes a frame on it before each step, so that CUDA and
/// the engine share the device as they do over the link.
fn in_process(
    sensor: &SensorModel,
    images: &Sequence,
    cameras: usize,
    count: usize,
    cuda: Option<CudaDevice>,
) -> Times {
    let configs: Vec<_> = (0..cameras).map(|number| camera(sensor, number as u32, images)).collect();
    let mut rig = Rig::new(&DEVICE, &configs).unwrap();
    let mut times = Times::default();
    let written: Vec<[CudaImage; 2]> =
        cuda.iter().flat_map(|_| (0..cameras).map(|_| on_cuda(&images.frames[0], sensor))).collect();
    for index in 0..count {
        let frame = &images.frames[index % images.frames.len()];
        let bytes = FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref(), ..FrameBytes::default() };
        (0..cameras).for_each(|camera| rig.upload(camera, &bytes).unwrap());
        for image in written.iter().flatten() {
            image.render_to(image.strided().pointer, 0);
        }
        if cuda.is_some() {
            finish(0);
        }
        let there = Instant::now();
        let tick = rig.step(&vec![index as i64 * FRAME_NS; cameras]).unwrap();
        if counts(index, count) {
            times.add(there.elapsed(), &tick);
        }
    }
    times
}

fn on_cuda(frame: &Frame, sensor: &SensorModel) -> [CudaImage; 2] {
    let rows = sensor.height as usize;
    [&frame.hdr, frame.motion.as_ref().unwrap()].map(|bytes| CudaImage::new(bytes, rows, 0))
}

/// Copies frames for all cameras whenever it is asked to, and reports when the copies are done.
fn produce(
    device: CudaDevice,
    path: &std::path::Path,
    (sensor, images): (&SensorModel, &Sequence),
    (cameras, timeline): (usize, u32),
    wait: &mpsc::Receiver<()>,
    tell: &mpsc::Sender<Instant>,
) {
    use_device(device.ordinal);
    let mut producers: Vec<CudaProducer> = (0..cameras as u32)
        .map(|camera| {
            let options =
                CudaOptions { camera, timelines: timeline, timeout: MINUTE, ..CudaOptions::default() };
            CudaProducer::connect(path, &options).unwrap()
        })
        .collect();
    let uploaded: Vec<_> = images.frames.iter().map(|frame| on_cuda(frame, sensor)).collect();
    let mut index = 0;
    while wait.recv().is_ok() {
        let [hdr, motion] = &uploaded[index % uploaded.len()];
        let written: Vec<_> = producers
            .iter_mut()
            .map(|producer| {
                let slot = producer.slot().unwrap();
                // SAFETY: both images have the camera's formats and live until the producer is gone.
                (
                    slot,
                    unsafe { producer.copy(slot, Planes::of(hdr.strided(), Some(motion.strided()))) }
                        .unwrap(),
                )
            })
            .collect();
        let done = |producers: &[CudaProducer]| {
            producers.iter().for_each(|producer| finish(producer.stream()));
            tell.send(Instant::now()).unwrap();
        };
        // A shared timeline signals the end of the write. Without one the producer waits for it.
        if timeline == TIMELINE_CARRIED {
            done(&producers);
        }
        for (producer, (slot, copies)) in producers.iter_mut().zip(written) {
            producer.publish(slot, index as i64 * FRAME_NS, copies).unwrap();
        }
        if timeline == TIMELINE_EXPORTED {
            done(&producers);
        }
        index += 1;
    }
    for producer in producers {
        producer.finish().unwrap();
    }
}

fn over_the_link(
    device: CudaDevice,
    sensor: &SensorModel,
    images: &Sequence,
    (cameras, timeline): (usize, u32),
    spin: Duration,
    count: usize,
) -> Times {
    let place = Place::default();
    // Gathers all cameras into one tick.
    let options = ServerOptions { gather: MINUTE, spin, ..ServerOptions::default() };
    let each = vec![(sensor.clone(), images); cameras];
    let mut fed = service(&place.path(), &each, false, options);
    let ((go, wait), (tell, told)) = (mpsc::channel(), mpsc::channel());
    let mut times = Times::default();
    std::thread::scope(|scope| {
        let path = place.path();
        scope.spawn(move || produce(device, &path, (sensor, images), (cameras, timeline), &wait, &tell));
        until("all cameras", || fed.server().connected() == cameras);
        for index in 0..count {
            go.send(()).unwrap();
            let tick = fed.tick(MINUTE).unwrap().expect("the next frame");
            let done = Instant::now();
            assert!(tick.t_ns.iter().all(Option::is_some), "frame {index}: a tick without all cameras");
            let written = told.recv().unwrap();
            if counts(index, count) {
                times.add(done.saturating_duration_since(written), &tick.tick);
            }
        }
        drop(go);
    });
    until("all goodbyes", || fed.counts().iter().all(|counts| counts.finished == 1));
    times
}

fn compare(name: &str, cameras: usize, count: usize) {
    let Some(device) = cuda_or_a_clear_error() else { return };
    use_device(device.ordinal);
    let sensor = noisy(name);
    let images = there_and_back(&sensor, 12);
    in_process(&sensor, &images, cameras, count, None).print(&format!("{cameras} x {name}, in process"));
    let beside = in_process(&sensor, &images, cameras, count, Some(device));
    beside.print(&format!("{cameras} x {name}, in process, CUDA writes before each step"));
    let mut ways =
        vec![("carried", TIMELINE_CARRIED, LONG), ("carried, engine asleep", TIMELINE_CARRIED, SHORT)];
    if Support::of(&DEVICE).share_timeline {
        ways.push(("exported", TIMELINE_EXPORTED, LONG));
        ways.push(("exported, engine asleep", TIMELINE_EXPORTED, SHORT));
    }
    for (word, timeline, spin) in ways {
        let fed = over_the_link(device, &sensor, &images, (cameras, timeline), spin, count);
        let name = format!("{cameras} x {name}, over the link, {word}");
        fed.print(&name);
        let more_us = fed.whole.quantile_us(0.5) - beside.whole.quantile_us(0.5);
        println!("{name}: {more_us:.1} us more than without a link (p50)");
        // Far above what any machine needs: it finds a sleep that is too long and a lost wake-up.
        assert!(more_us < 1000.0, "{more_us} us");
    }
    assert_silent();
}

#[test]
fn of_one_camera() {
    compare("genx320", 1, frames());
}

#[test]
fn of_eight_cameras() {
    compare("vga", 8, frames().min(500));
}
