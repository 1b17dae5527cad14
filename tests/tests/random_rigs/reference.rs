//! Plays a camera of a case on the oracle, and tells its run apart at each reset.

use crate::case::{Case, Change};
use crate::images::View;
use esaac_model::packet::Event;
use esaac_model::random::PixelKey;
use esaac_model::substeps::substep_end_ns;
use esaac_model::{Pixel, SensorModel, Synthesis};
use esaac_oracle::cross::PixelConstants;
use esaac_oracle::ingest::{Image, ingest, plane_of};
use esaac_oracle::{Interval, Oracle};
use esaac_scene::SceneKind;
use esaac_tests::agreement::Stretch;

/// A frame of a run.
pub struct Taken {
    pub tick: usize,
    pub t_ns: i64,
    /// The sensor that took it.
    pub sensor: SensorModel,
    pub interval: Interval,
}

/// The frames between two resets.
pub type Run = Vec<Taken>;

/// All runs of a camera. `moved` changes the sensors, but not when they reset the camera.
pub fn runs(
    case: &Case,
    view: &View,
    number: usize,
    moved: impl Fn(&SensorModel) -> SensorModel,
) -> Vec<Run> {
    let camera = &case.cameras[number];
    let mut asked = camera.resolved(&camera.sensor);
    let mut oracle = Oracle::new(moved(&asked), camera.number).expect("a valid sensor");
    oracle.keep_samples(true);
    if camera.geometry.is_some() {
        oracle.set_scene(view.poses.clone());
    }
    let mut runs = vec![Run::new()];
    for (index, tick) in case.ticks.iter().enumerate() {
        for change in &tick.changes {
            let resets = match change {
                Change::Reset(of) if *of == number => {
                    oracle.reset();
                    true
                }
                Change::Sensor(of, sensor) if *of == number => {
                    let before = std::mem::replace(&mut asked, camera.resolved(sensor));
                    oracle.set_sensor(moved(&asked)).expect("a valid sensor");
                    let resets = before.change_to(&asked).resets_frames;
                    if resets {
                        // Sensors that are moved may be closer to each other.
                        oracle.reset();
                    }
                    resets
                }
                _ => false,
            };
            if resets {
                runs.push(Run::new());
            }
        }
        if let Some(images) = &view.frames[index] {
            let interval = oracle.step(&view.oracle_frame(images)).expect("a frame in time");
            let run = runs.last_mut().expect("there is a first");
            run.push(Taken { tick: index, t_ns: images.t_ns, sensor: asked.clone(), interval });
        }
    }
    runs.retain(|run| !run.is_empty());
    runs
}

/// Events of a run.
pub fn events(run: &Run) -> Vec<Event> {
    run.iter().flat_map(|taken| taken.interval.packet.iter()).collect()
}

/// The stretches of a log pixel's level plus its leak in a run.
pub fn stretches(view: &View, run: &Run, pixel: usize) -> Vec<Stretch> {
    let mut stretches = Vec::new();
    let mut from = first_log(view, &run[0], pixel);
    for (before, taken) in run.iter().zip(&run[1..]) {
        let sensor = &taken.sensor;
        let key = PixelKey { seed: sensor.seed, camera: view.case.number, pixel: pixel as u32 };
        let leak_per_ns = PixelConstants::draw(sensor, key).leak_log_per_ns;
        let samples = taken.interval.samples.as_ref().expect("runs keep samples").at(pixel);
        let interval_ns = (taken.t_ns - before.t_ns) as u32;
        for (i, sample) in (1..).zip(samples) {
            let end = |i| before.t_ns + i64::from(substep_end_ns(interval_ns, i, samples.len() as u32));
            let (start_ns, end_ns) = (end(i - 1), end(i));
            let to = (sample + sensor.log_offset).ln();
            let slope_per_ns = (to - from) / (end_ns - start_ns) as f64 + leak_per_ns;
            stretches.push(Stretch { start_ns, end_ns, slope_per_ns });
            from = to;
        }
    }
    stretches
}

fn first_log(view: &View, first: &Taken, pixel: usize) -> f64 {
    let sensor = &first.sensor;
    let images = view.frames[first.tick].as_ref().expect("a run's frames are there");
    let image = ingest(sensor, &Image::black(sensor), &view.oracle_frame(images)).image;
    let plane = plane_of(sensor.intensity, pixel % image.width, pixel / image.width);
    let light = sensor.flicker().map_or(1.0, |lamp| lamp.factor(first.t_ns));
    (image.planes(sensor.intensity)[plane][pixel] * light + sensor.log_offset).ln()
}

/// Frames closer together than this show motions that positions in single precision do not tell from none.
const CLOSEST_NS: i64 = 1_000;

/// In longer intervals surfaces move by hundreds of pixels, and positions are exact to so much less.
const LONGEST_NS: i64 = 110_000_000;

/// The same along exact paths, whose bodies turn besides.
const LONGEST_RIGID_NS: i64 = 40_000_000;

/// Whether levels in a run are the oracle's but for roundings. They are not where surfaces are followed over too short an
/// interval, or over a long one. Nor does a ball that bounces follow the paths that the engine draws
/// through the poses of 33 instants: they are smooth.
pub fn foretells_light(view: &View, run: &Run) -> bool {
    let mut intervals_ns = run.windows(2).map(|pair| (pair[1].t_ns - pair[0].t_ns, &pair[1].sensor));
    intervals_ns.all(|(interval_ns, sensor)| match sensor.synthesis {
        Synthesis::Rigid => {
            view.case.scene != SceneKind::Bounce && (CLOSEST_NS..=LONGEST_RIGID_NS).contains(&interval_ns)
        }
        Synthesis::Motion | Synthesis::Paper => (CLOSEST_NS..=LONGEST_NS).contains(&interval_ns),
        _ => true,
    })
}

/// Whether levels in a run are read where motion vectors lead to.
pub fn follows_vectors(view: &View, run: &Run) -> bool {
    let follows = |taken: &Taken| matches!(taken.sensor.synthesis, Synthesis::Motion | Synthesis::Paper);
    view.case.motion.is_some() && run.iter().any(follows)
}

/// Whether pixels have noise whose draws in the oracle are others.
pub fn has_noise(run: &Run) -> bool {
    run.iter().any(|taken| taken.sensor.pixel == Pixel::Physical && taken.sensor.noise_gain > 0.0)
}

/// A sensor without noise of physical pixels, which the oracle needs minutes for, and no event of which is compared.
pub fn without_noise(sensor: &SensorModel) -> SensorModel {
    SensorModel { noise_gain: 0.0, ..sensor.clone() }
}
