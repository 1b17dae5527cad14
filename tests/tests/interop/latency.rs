//! Cost of the link: the time from the end of a frame's write to its packet, compared with the tick alone. Prints its
//! figures (`--nocapture`). `ESAAC_LINK_FRAMES` sets the number of frames, `ESAAC_LINK_SENSOR` a preset, which gets the
//! noisy profile.

use crate::frames;
use esaac_interop::wire::{TIMELINE_CARRIED, TIMELINE_EXPORTED};
use esaac_interop::{Copies, ProducerOptions, ServerOptions, Support};
use esaac_model::presets::preset;
use esaac_model::{HdrFormat, MotionFormat, Profile, SensorModel, Synthesis};
use esaac_scene::renderer::{Renderer, Targets};
use esaac_scene::{RenderError, SceneKind};
use esaac_tests::device::{DEVICE, assert_device_silent, assert_silent};
use esaac_tests::figures::Figures;
use esaac_tests::frames::{FRAME_NS, Frame, Sequence};
use esaac_tests::interop::{Place, other_device, service, until};
use std::sync::mpsc;
use std::time::{Duration, Instant};

const MINUTES: Duration = Duration::from_secs(300);

fn sensor() -> SensorModel {
    let Ok(name) = std::env::var("ESAAC_LINK_SENSOR") else {
        return SensorModel { width: 37, height: 23, synthesis: Synthesis::None, ..SensorModel::default() };
    };
    let mut sensor = preset(&name).expect("ESAAC_LINK_SENSOR is a preset");
    Profile::Noisy.apply(&mut sensor);
    sensor
}

/// Runs a producer that renders each frame once the packet of the last one has arrived.
fn producer(path: &std::path::Path, timeline: u32, wait: &mpsc::Receiver<()>, tell: &mpsc::Sender<Instant>) {
    let device = other_device();
    let options = ProducerOptions { timelines: timeline, timeout: MINUTES, ..ProducerOptions::default() };
    let mut producer = esaac_interop::Producer::connect(&device, path, &options).unwrap();
    let images = *producer.client().images();
    let scene = SceneKind::Flight.scene(images.width_px, images.height_px);
    let mut renderer = Renderer::new(&device, scene, images.hdr, images.motion.unwrap()).unwrap();
    let mut t_ns = 0;
    while wait.recv().is_ok() {
        let slot = producer.slot().unwrap();
        producer
            .write(slot, |place, hooks| {
                let inputs = place.inputs();
                let targets = Targets { hdr: inputs.hdr, motion: inputs.motion, depth: None, ids: None };
                renderer.render_with_hooks(t_ns, Some(t_ns - FRAME_NS), targets, hooks)?;
                Ok::<(), RenderError>(())
            })
            .unwrap();
        tell.send(Instant::now()).unwrap();
        producer.publish(slot, t_ns, Copies::default()).unwrap();
        t_ns += FRAME_NS;
    }
    producer.finish().unwrap();
    assert_device_silent(&device);
}

#[test]
fn from_the_write_to_the_packet() {
    let frames = frames(100);
    let sensor = sensor();
    let formats =
        Sequence { hdr: HdrFormat::F16x4, motion: Some(MotionFormat::F32x2), frames: Vec::<Frame>::new() };
    let mut timelines = vec![TIMELINE_CARRIED];
    if Support::of(&DEVICE).share_timeline {
        timelines.push(TIMELINE_EXPORTED);
    }
    for timeline in timelines {
        let place = Place::default();
        let options = ServerOptions { gather: Duration::ZERO, ..ServerOptions::default() };
        let mut fed = service(&place.path(), &[(sensor.clone(), &formats)], false, options);
        let ((go, wait), (tell, told)) = (mpsc::channel(), mpsc::channel());
        let [mut whole, mut inside, mut link] = [const { Figures::new() }; 3];
        std::thread::scope(|scope| {
            let path = place.path();
            scope.spawn(move || producer(&path, timeline, &wait, &tell));
            for index in 0..frames {
                go.send(()).unwrap();
                let tick = fed.tick(MINUTES).unwrap().expect("the next frame");
                let (done, submit_ns) = (Instant::now(), tick.tick.submit_to_packet_ns);
                let written = told.recv().unwrap();
                // Skips the first frames, which compile kernels and grow buffers.
                if index >= frames.min(40) / 2 {
                    let span_ns = (done - written).as_nanos() as u64;
                    whole.add_ns(span_ns);
                    inside.add_ns(submit_ns);
                    link.add_ns(span_ns - submit_ns);
                }
            }
            drop(go);
        });
        until("its goodbye", || fed.counts()[0].finished == 1);
        println!(
            "timelines {timeline}: write done to packet {whole}; of it submit to packet {inside}, the link {link}"
        );
        // Far above what any machine needs: it finds a sleep that is too long and a lost wake-up.
        assert!(link.quantile_us(0.5) < 50_000.0, "{link}");
    }
    assert_silent();
}
