//! The camera: its state, and the stages run for one interval after the other.

use crate::cross::{PixelConstants, PixelState, Span, aps, walk};
use crate::ingest::{self, Frame, Image, Ingested};
use crate::physical::readout::Queue;
use crate::physical::{self, PhysicalState};
use crate::plan::{Needs, Plan, needs, plan};
use crate::sort::sort;
use crate::stamp;
use crate::synthesize::layers::candidates::pairs_of;
use crate::synthesize::layers::layer::Vectors;
use crate::synthesize::motion::Motion;
use crate::synthesize::rigid::WithoutPath;
use crate::synthesize::rigid::surface::{Geometry, Surfaces};
use crate::synthesize::sampling::Sampling;
use crate::synthesize::{Gap, History, Motions};
use esaac_model::frame::check_time;
use esaac_model::packet::Event;
use esaac_model::paths::SceneMotion;
use esaac_model::physical::{PhysicalDraws, PhysicalPixel};
use esaac_model::random::PixelKey;
use esaac_model::substeps::substep_end_ns;
use esaac_model::synthesis::is_usable;
use esaac_model::synthesis::layers::layers_for_scene;
use esaac_model::{FrameError, Packet, Pixel, SensorError, SensorModel, Synthesis};

/// Counts of what went wrong or was put off in an interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Diagnostics {
    /// Pixels of this frame with a NaN, infinite or negative component.
    pub invalid_pixels: u64,
    /// Motion vectors of this frame that cannot be followed ([`is_usable`]).
    pub invalid_motion: u64,
    /// Pixels without a valid value so far.
    pub unarmed_pixels: u64,
    /// Physical pixels that would have sent more events than a pixel may.
    pub overrun_pixels: u64,
    /// Events deferred to a later packet.
    pub deferred_events: u64,
    /// Events that the sensor lost because their pixel had one waiting for the bus.
    pub lost_events: u64,
    /// Events that the sensor's rate controller dropped.
    pub capped_events: u64,
    /// Pixels of this frame without an exact path, by reason.
    pub without_path: WithoutPath,
    /// Pixel sub-steps that show what neither key frame shows.
    pub unseen_samples: u64,
}

/// Intensities at the ends of sub-steps, for comparing stage `synthesize` alone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    starts: Vec<usize>,
    values: Vec<f64>,
}

impl Samples {
    /// Intensity of a pixel (`y * width + x`) at the end of each of its sub-steps, scene units.
    #[must_use]
    pub fn at(&self, pixel: usize) -> &[f64] {
        let end = self.starts.get(pixel + 1).copied().unwrap_or(self.values.len());
        &self.values[self.starts[pixel]..end]
    }

    fn push(&mut self, samples: &[f64]) {
        self.starts.push(self.values.len());
        self.values.extend_from_slice(samples);
    }
}

/// The result of one interval.
#[derive(Clone, Debug, PartialEq)]
pub struct Interval {
    /// Events.
    pub packet: Packet,
    /// APS frame, row-major.
    pub aps: Option<Vec<u16>>,
    /// Counts of what went wrong or was put off.
    pub diagnostics: Diagnostics,
    /// Sub-steps per 8x8 block, row-major. Empty for the first frame, which arms the camera.
    pub substeps_per_block: Vec<u32>,
    /// Intensities, if asked for with [`Oracle::keep_samples`].
    pub samples: Option<Samples>,
}

/// One camera.
#[derive(Clone, Debug)]
pub struct Oracle {
    sensor: SensorModel,
    camera: u32,
    sampling: Sampling,
    constants: Vec<PixelConstants>,
    keep_samples: bool,
    scene: Option<SceneMotion>,
    physical: Option<Physical>,
    run: Run,
}

/// What a camera with physical pixels has in place of the log-intensity pixel's constants and states.
#[derive(Clone, Debug)]
struct Physical {
    pixel: PhysicalPixel,
    draws: Vec<PhysicalDraws>,
    /// `None` while a pixel is unarmed.
    states: Vec<Option<PhysicalState>>,
}

impl Physical {
    fn new(sensor: &SensorModel, camera: u32, pixel: PhysicalPixel) -> Self {
        let key = |index| PixelKey { seed: sensor.seed, camera, pixel: index };
        let draws = (0..sensor.pixels() as u32).map(|index| PhysicalDraws::draw(sensor, &pixel, key(index)));
        Physical { draws: draws.collect(), pixel, states: vec![None; sensor.pixels()] }
    }
}

/// State of a camera since its first frame.
#[derive(Clone, Debug)]
struct Run {
    /// Times of the first frame and of the latest, nanoseconds.
    times_ns: Option<(i64, i64)>,
    image: Image,
    /// What [`needs`] says of it.
    needs: Option<Needs>,
    /// Length of the previous interval, nanoseconds.
    last_interval_ns: Option<u32>,
    /// Half-pel frames of the last frame, one per plane, which the next interval improves.
    history: Option<History>,
    /// Surfaces that a pixel may show, if that is left to the scene.
    layers_for_scene: u32,
    /// `None` while a pixel is unarmed.
    pixels: Vec<Option<PixelState>>,
    /// Events on their way to the bus, at the time that they reach it.
    requests: Vec<Event>,
    queue: Queue,
    /// Events that leave the bus after the interval, at the time that they do.
    deferred: Vec<Event>,
    sequence: u64,
    /// Watermark of the last packet.
    watermark_ns: Option<i64>,
}

impl Run {
    fn new(sensor: &SensorModel) -> Self {
        Run {
            times_ns: None,
            image: Image::black(sensor),
            needs: None,
            last_interval_ns: None,
            history: None,
            layers_for_scene: 1,
            pixels: vec![None; sensor.pixels()],
            requests: Vec::new(),
            queue: Queue::new(sensor.readout_model()),
            deferred: Vec::new(),
            sequence: 0,
            watermark_ns: None,
        }
    }
}

/// Where the intensities between two frames come from.
enum Between<'a> {
    Synthesis,
    /// Intensity of a pixel at a time from the interval's start, nanoseconds.
    Exact(&'a dyn Fn(usize, f64) -> f64),
}

impl Oracle {
    /// A camera before its first frame. It reads frames with the engine's approximations. `camera` is its number in
    /// random draws.
    pub fn new(sensor: SensorModel, camera: u32) -> Result<Self, SensorError> {
        Oracle::with_sampling(sensor, camera, Sampling::ENGINE)
    }

    /// A camera as from [`Oracle::new`], with a choice of how frames are read.
    pub fn with_sampling(sensor: SensorModel, camera: u32, sampling: Sampling) -> Result<Self, SensorError> {
        sensor.validate()?;
        let sensor = with_dark_level(sensor);
        let constants = draw_constants(&sensor, camera);
        let run = Run::new(&sensor);
        let physical = (sensor.pixel == Pixel::Physical)
            .then(|| Physical::new(&sensor, camera, sensor.physical_pixel()));
        Ok(Oracle { sensor, camera, sampling, constants, keep_samples: false, scene: None, physical, run })
    }

    /// The sensor.
    #[must_use]
    pub fn sensor(&self) -> &SensorModel {
        &self.sensor
    }

    /// Sets whether later steps fill [`Interval::samples`].
    pub fn keep_samples(&mut self, keep: bool) {
        self.keep_samples = keep;
    }

    /// Sets the poses of the camera and of the instances that it sees, from the next step on. Synthesis `rigid` needs
    /// them, and `auto` is `rigid` if they are there before the first frame, which has depth.
    pub fn set_scene(&mut self, scene: SceneMotion) {
        self.scene = Some(scene);
    }

    /// The random draws of each pixel (`y * width + x`).
    #[must_use]
    pub fn constants(&self) -> &[PixelConstants] {
        &self.constants
    }

    /// State of a pixel (`y * width + x`); `None` while it is unarmed.
    #[must_use]
    pub fn pixel(&self, pixel: usize) -> Option<&PixelState> {
        self.run.pixels[pixel].as_ref()
    }

    /// State of a physical pixel (`y * width + x`); `None` while it is unarmed, and of a camera without them.
    #[must_use]
    pub fn physical_pixel(&self, pixel: usize) -> Option<&PhysicalState> {
        self.physical.as_ref()?.states[pixel].as_ref()
    }

    /// Steps to the next frame. The first frame arms the camera and yields an empty packet, and tells what synthesis
    /// `auto` is.
    pub fn step(&mut self, frame: &Frame<'_>) -> Result<Interval, FrameError> {
        let has_geometry = self.scene.is_some() && frame.depth.is_some();
        self.sensor.synthesis = self.sensor.synthesis.resolve(has_geometry, frame.motion.is_some());
        ingest::check(&self.sensor, self.camera, self.run.times_ns.map(|(_, latest)| latest), frame)?;
        let ingested = ingest::ingest(&self.sensor, &self.run.image, frame);
        Ok(self.advance(frame.t_ns, ingested, &Between::Synthesis))
    }

    /// Steps to the next instant with exact intensities in place of a synthesis. `samples` returns the intensity of a
    /// pixel (`y * width + x`) at a time from the interval's start, nanoseconds. Every pixel gets the sensor's
    /// `substeps`. The first call arms the camera with the intensities at time 0.
    pub fn step_samples(
        &mut self,
        t_ns: i64,
        samples: &dyn Fn(usize, f64) -> f64,
    ) -> Result<Interval, FrameError> {
        let previous_ns = self.run.times_ns.map(|(_, latest)| latest);
        check_time(self.camera, previous_ns, t_ns)?;
        let length_ns = previous_ns.map_or(0, |previous_ns| t_ns - previous_ns) as f64;
        let ingested =
            ingest::ingest_samples(&self.sensor, &self.run.image, &|pixel| samples(pixel, length_ns));
        Ok(self.advance(t_ns, ingested, &Between::Exact(samples)))
    }

    /// Changes parameters between two frames. The size must stay the same. [`SensorModel::change_to`] tells what the
    /// camera discards or draws anew.
    pub fn set_sensor(&mut self, mut sensor: SensorModel) -> Result<(), SensorError> {
        sensor.validate()?;
        if self.run.times_ns.is_some() {
            let has_geometry = self.scene.is_some() && self.run.image.geometry.is_some();
            sensor.synthesis = sensor.synthesis.resolve(has_geometry, self.run.image.motion.is_some());
        }
        for (parameter, expected, actual) in
            [("width", self.sensor.width, sensor.width), ("height", self.sensor.height, sensor.height)]
        {
            if expected != actual {
                return Err(SensorError::Range {
                    parameter,
                    expected: format!("{expected}, as when the camera was made"),
                    actual: actual.to_string(),
                });
            }
        }
        let effects = self.sensor.change_to(&sensor);
        if effects.redraws_pixels {
            self.redraw(draw_constants(&sensor, self.camera));
        }
        self.sensor = with_dark_level(sensor);
        self.physical = match (self.sensor.pixel, self.physical.take()) {
            (Pixel::Log, _) => None,
            (Pixel::Physical, old) => {
                let new = Physical::new(&self.sensor, self.camera, self.sensor.physical_pixel());
                Some(Physical { states: old.map_or(new.states, |old| old.states), ..new })
            }
        };
        self.run.queue.set_readout(self.sensor.readout_model());
        if effects.resets_frames {
            self.reset();
        }
        Ok(())
    }

    fn redraw(&mut self, constants: Vec<PixelConstants>) {
        if let Some((epoch_ns, latest_ns)) = self.run.times_ns {
            for (pixel, state) in self.run.pixels.iter_mut().enumerate() {
                if let Some(state) = state {
                    state.change_leak(&self.constants[pixel], &constants[pixel], latest_ns - epoch_ns);
                }
            }
        }
        self.constants = constants;
    }

    /// Forgets every frame; the next one arms the camera. Packets keep counting, and stay complete up to their watermarks.
    pub fn reset(&mut self) {
        let Run { sequence, watermark_ns, .. } = self.run;
        self.run = Run { sequence, watermark_ns, ..Run::new(&self.sensor) };
        if let Some(old) = self.physical.take() {
            self.physical = Some(Physical::new(&self.sensor, self.camera, old.pixel));
        }
    }

    fn advance(&mut self, t_ns: i64, ingested: Ingested, between: &Between<'_>) -> Interval {
        let Ingested { image, valid } = ingested;
        let (epoch_ns, start_ns) = self.run.times_ns.unwrap_or((t_ns, t_ns));
        let complete_ns = stamp::complete_before(self.run.watermark_ns, t_ns);
        let mut interval = Interval {
            packet: Packet {
                sequence: self.run.sequence,
                width_px: self.sensor.width,
                height_px: self.sensor.height,
                base_ns: stamp::base_ns(&self.sensor, start_ns),
                watermark_ns: stamp::watermark_ns(&self.sensor, t_ns, complete_ns),
                ..Packet::default()
            },
            aps: None,
            diagnostics: Diagnostics::default(),
            substeps_per_block: Vec::new(),
            samples: None,
        };
        // The cast is exact: `check_time` keeps an interval within MAX_INTERVAL_NS.
        let interval_ns = (t_ns - start_ns) as u32;
        let before = self.run.times_ns.is_some().then_some(&self.run.image);
        let needs = needs(&self.sensor, before, &image, interval_ns);
        if self.run.times_ns.is_some() {
            self.cross_interval(start_ns, interval_ns, (&image, needs.as_ref()), between, &mut interval);
        }
        self.run.needs = needs;
        self.arm(&image, &valid, t_ns, t_ns - epoch_ns);
        interval.diagnostics.invalid_pixels = valid.iter().filter(|&&valid| !valid).count() as u64;
        interval.diagnostics.invalid_motion = image
            .motion
            .as_ref()
            .map_or(0, |motion| motion.iter().filter(|&&vector| !is_usable(vector)).count() as u64);
        if let (Synthesis::Rigid, Some(scene), Some((depth_m, ids))) =
            (self.sensor.synthesis, &self.scene, &image.geometry)
        {
            let geometry = Geometry { size: (image.width, image.height), depth_m, ids };
            interval.diagnostics.without_path = WithoutPath::of(&Surfaces::new(scene, &geometry));
        }
        let unarmed = match &self.physical {
            None => self.run.pixels.iter().filter(|p| p.is_none()).count(),
            Some(physical) => physical.states.iter().filter(|p| p.is_none()).count(),
        };
        interval.diagnostics.unarmed_pixels = unarmed as u64;
        interval.diagnostics.deferred_events =
            (self.run.requests.len() + self.run.queue.waiting() + self.run.deferred.len()) as u64;
        self.run.times_ns = Some((epoch_ns, t_ns));
        self.run.image = image;
        self.run.sequence += 1;
        self.run.watermark_ns = Some(interval.packet.watermark_ns);
        interval
    }

    /// Arms every unarmed pixel that is valid in this frame.
    fn arm(&mut self, image: &Image, valid: &[bool], t_ns: i64, age_ns: i64) {
        let planes = image.planes(self.sensor.intensity);
        let light = self.sensor.flicker().map_or(1.0, |lamp| lamp.factor(t_ns));
        for pixel in 0..self.sensor.pixels() {
            let unarmed = match &self.physical {
                None => self.run.pixels[pixel].is_none(),
                Some(physical) => physical.states[pixel].is_none(),
            };
            if valid[pixel] && unarmed {
                let (x, y) = (pixel % image.width, pixel / image.width);
                let intensity = planes[ingest::plane_of(self.sensor.intensity, x, y)][pixel] * light;
                let key = self.key(pixel);
                if let Some(physical) = &mut self.physical {
                    let draws = &physical.draws[pixel];
                    let state = PhysicalState::arm(&self.sensor, &physical.pixel, draws, key, intensity, 0);
                    physical.states[pixel] = Some(state);
                    continue;
                }
                let constants = &self.constants[pixel];
                self.run.pixels[pixel] =
                    Some(PixelState::arm(&self.sensor, constants, key, intensity, age_ns));
            }
        }
    }

    /// Blocks that pairs of a frame's vectors pass, and all blocks; `None` if the scene has no say in the number of layers.
    fn meeting_blocks(&self, end: &Image) -> Option<(u64, u64)> {
        let left_to_scene = self.sensor.synthesis == Synthesis::Motion && self.sensor.layers == 0;
        let motion = end.motion.as_ref().filter(|_| left_to_scene)?;
        let pairs = pairs_of(&Vectors { size: (end.width, end.height), motion });
        let (blocks_x, blocks_y) = pairs.blocks();
        Some((pairs.meeting_blocks(), (blocks_x * blocks_y) as u64))
    }

    fn note_meetings(&mut self, meeting: Option<(u64, u64)>) {
        let before = self.run.layers_for_scene;
        self.run.layers_for_scene =
            meeting.map_or(1, |(meeting, blocks)| layers_for_scene(before, meeting, blocks));
    }

    /// Most surfaces that a pixel may show in an interval.
    fn layers(&self) -> u32 {
        if self.sensor.layers == 0 { self.run.layers_for_scene } else { self.sensor.layers }
    }

    fn cross_interval(
        &mut self,
        start_ns: i64,
        interval_ns: u32,
        (end, end_needs): (&Image, Option<&Needs>),
        between: &Between<'_>,
        interval: &mut Interval,
    ) {
        let epoch_ns = self.run.times_ns.map_or(start_ns, |(epoch_ns, _)| epoch_ns);
        let start = std::mem::replace(&mut self.run.image, Image::black(&self.sensor));
        let meeting = self.meeting_blocks(end);
        if self.run.last_interval_ns.is_none() {
            self.note_meetings(meeting);
        }
        let sensor = &SensorModel { layers: self.layers(), ..self.sensor.clone() };
        let ratio = self.run.last_interval_ns.map(|last_ns| f64::from(last_ns) / f64::from(interval_ns));
        let times_ns = [start_ns, start_ns + i64::from(interval_ns)];
        let motions = self.scene.as_ref().map(|scene| Motions { scene, times_ns });
        let history = self.run.history.take();
        let gap = Gap::new(sensor, &start, end, ratio, history, self.sampling, motions);
        let plan = match between {
            Between::Synthesis => {
                let passing_px = gap.motion.as_ref().and_then(Motion::passing_px);
                let needs = [self.run.needs.as_ref(), end_needs];
                plan(sensor, &start, end, interval_ns, gap.rigid.as_ref(), passing_px.as_deref(), needs)
            }
            Between::Exact(_) => Plan::uniform(sensor, sensor.substeps),
        };
        let exposure_ns = aps::exposure_ns(sensor, interval_ns);
        let mut aps_frame = Vec::new();
        let mut kept = self.keep_samples.then(Samples::default);
        let mut samples = Vec::new();
        for pixel in 0..sensor.pixels() {
            let (x, y) = (pixel % end.width, pixel / end.width);
            match between {
                Between::Synthesis => gap.samples(x, y, plan.at(x, y), &mut samples),
                Between::Exact(exact) => {
                    exact_samples(sensor.substeps, interval_ns, &|t_ns| exact(pixel, t_ns), &mut samples);
                }
            }
            let frames = [samples[0], samples[samples.len() - 1]];
            light_by_lamp(sensor, (start_ns, interval_ns), &mut samples);
            if let Some(kept) = &mut kept {
                kept.push(&samples[1..]);
            }
            if let Some(exposure_ns) = exposure_ns {
                aps_frame.push(aps::quantise(sensor, aps::mean(&samples, interval_ns, exposure_ns)));
            }
            let key = PixelKey { seed: sensor.seed, camera: self.camera, pixel: pixel as u32 };
            if let Some(physical) = &mut self.physical {
                let Some(state) = &mut physical.states[pixel] else { continue };
                let span = Span { key, epoch_ns, start_ns, interval_ns, samples: &samples, frames };
                let (draws, requests) = (&physical.draws[pixel], &mut self.run.requests);
                let is_overrun =
                    physical::walk(sensor, &physical.pixel, draws, state, &span, &mut |crossing| {
                        requests.push(Event {
                            t_ns: stamp::delayed_ns(sensor, key, crossing.index, crossing.t_ns),
                            y: y as u16,
                            x: x as u16,
                            polarity: crossing.polarity,
                        });
                    });
                interval.diagnostics.overrun_pixels += u64::from(is_overrun);
                continue;
            }
            if let Some(state) = &mut self.run.pixels[pixel] {
                let span = Span { key, epoch_ns, start_ns, interval_ns, samples: &samples, frames };
                let requests = &mut self.run.requests;
                walk(sensor, &self.constants[pixel], state, &span, &mut |crossing| {
                    requests.push(Event {
                        t_ns: stamp::delayed_ns(sensor, key, crossing.index, crossing.t_ns),
                        y: y as u16,
                        x: x as u16,
                        polarity: crossing.polarity,
                    });
                });
            }
        }
        let end_ns = start_ns + i64::from(interval_ns);
        let mut requests = stamp::due(&mut self.run.requests, end_ns);
        requests.sort_unstable();
        let served = self.run.queue.serve(&requests, end_ns);
        interval.diagnostics.lost_events = served.lost;
        interval.diagnostics.capped_events = served.capped;
        self.run.deferred.extend(served.events);
        let complete_ns = stamp::complete_before(self.run.watermark_ns, end_ns);
        let due = stamp::due(&mut self.run.deferred, end_ns)
            .into_iter()
            .map(|event| Event { t_ns: stamp::stamp_ns(sensor, event.t_ns, complete_ns), ..event })
            .collect();
        sort(due, sensor.max_events_per_interval, &mut interval.packet);
        interval.diagnostics.unseen_samples = gap.unseen();
        self.run.history = gap.into_history();
        self.run.last_interval_ns = Some(interval_ns);
        self.note_meetings(meeting);
        interval.aps = exposure_ns.map(|_| aps_frame);
        interval.samples = kept;
        interval.substeps_per_block = plan.substeps;
    }

    fn key(&self, pixel: usize) -> PixelKey {
        PixelKey { seed: self.sensor.seed, camera: self.camera, pixel: pixel as u32 }
    }
}

/// The sensor with its dark level as `log_offset`, which the synthesis reads.
fn with_dark_level(sensor: SensorModel) -> SensorModel {
    let log_offset = sensor.dark_level();
    SensorModel { log_offset, ..sensor }
}

fn draw_constants(sensor: &SensorModel, camera: u32) -> Vec<PixelConstants> {
    (0..sensor.pixels() as u32)
        .map(|pixel| PixelConstants::draw(sensor, PixelKey { seed: sensor.seed, camera, pixel }))
        .collect()
}

/// Turns intensities in steady light, at the ends of sub-steps of an interval (start and length), into those in the light
/// of the lamp.
fn light_by_lamp(sensor: &SensorModel, (start_ns, interval_ns): (i64, u32), samples: &mut [f64]) {
    let Some(lamp) = sensor.flicker() else { return };
    let substeps = samples.len() as u32 - 1;
    for (i, sample) in (0..).zip(samples) {
        *sample *= lamp.factor(start_ns + i64::from(substep_end_ns(interval_ns, i, substeps)));
    }
}

/// Samples the exact intensity of one pixel at the ends of sub-steps. An invalid sample repeats the one before.
fn exact_samples(substeps: u32, interval_ns: u32, exact: &dyn Fn(f64) -> f64, samples: &mut Vec<f64>) {
    samples.clear();
    for i in 0..=substeps {
        let sample = exact(f64::from(substep_end_ns(interval_ns, i, substeps)));
        let valid = sample.is_finite() && sample >= 0.0;
        let held = samples.last().copied().unwrap_or(0.0);
        samples.push(if valid { sample } else { held });
    }
}
