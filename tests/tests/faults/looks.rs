//! A step that is refused and tried again looks at its frame once.

use esaac_engine::ash::vk;
use esaac_engine::{FaultPoint, FrameBytes, Rig};
use esaac_model::paths::conventions::ConventionReport;
use esaac_model::physical::LightReport;
use esaac_model::{IdFormat, Pixel, Synthesis};
use esaac_tests::device::{DEVICE, alone, assert_silent};
use esaac_tests::exact::{Run, config};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// What a camera with a physical pixel tells of its poses and its light. If `refuses`, each step is tried again and again: at
/// first the queue refuses its first submission, then its second, until the step is done.
fn reports(refuses: bool) -> (ConventionReport, LightReport) {
    let run = Run::default();
    let mut config = config(Synthesis::Auto, IdFormat::U32, run.scene.intrinsics());
    (config.sensor.pixel, config.sensor.lux_per_unit) = (Pixel::Physical, 100.0);
    let mut rig = Rig::new(&DEVICE, &[config]).expect("a rig");
    rig.set_scene(0, run.motion.clone()).expect("poses of its lens");
    let mut refused = 0;
    for (t_ns, frame) in &run.frames {
        let (motion, depth, ids) = (Some(&*frame.motion), Some(&*frame.depth), Some(&*frame.ids));
        rig.upload(0, &FrameBytes { hdr: &frame.hdr, motion, depth, ids }).expect("a frame that fits");
        for number in 0.. {
            let submissions = AtomicU32::new(0);
            let hook = move |point| {
                let strikes = point == FaultPoint::Submit
                    && submissions.fetch_add(1, Ordering::Relaxed) == number
                    && refuses;
                strikes.then_some(vk::Result::ERROR_OUT_OF_HOST_MEMORY)
            };
            DEVICE.set_faults(Some(Arc::new(hook)));
            let stepped = rig.step(&[*t_ns]).is_ok();
            DEVICE.set_faults(None);
            if stepped {
                break;
            }
            refused += 1;
        }
    }
    assert!(!refuses || refused > run.frames.len(), "{refused} submissions were refused");
    let report = rig.convention_report(0).expect("a camera").expect("vectors and poses").clone();
    let light = rig.light(0).expect("a camera").expect("a physical pixel");
    drop(rig);
    assert_silent();
    (report, light)
}

#[test]
fn a_refused_step_looks_at_its_frame_once() {
    let _alone = alone();
    let expected = reports(false);
    assert_eq!(reports(true), expected);
}
