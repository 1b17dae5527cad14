//! A case: a rig, what its cameras see, and what happens tick by tick. All of it follows from a seed.

use crate::dice::Dice;
use crate::sensors::{self, Input};
use esaac_engine::{KernelPolicy, LevelsFirst, PacketPlace, Resting, RigOptions};
use esaac_model::{HdrFormat, IdFormat, MotionFormat, SensorModel, Synthesis};
use esaac_scene::SceneKind;
use std::fmt::{self, Display, Formatter};

/// Images that are drawn into a frame, or that a frame lacks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spoils {
    /// One in so many pixels has a colour that is NaN, infinite or negative; 0 for none.
    pub colour_one_in: u32,
    /// The same for vectors that are NaN, infinite or far too large. 1: the renderer had none.
    pub motion_one_in: u32,
    /// The same for depth that is NaN, negative, zero or infinite.
    pub depth_one_in: u32,
    /// The same for instances without poses.
    pub ids_one_in: u32,
}

/// A camera's frame in a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameAt {
    pub t_ns: i64,
    pub spoils: Spoils,
}

/// Depth, ids and lens of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometryOf {
    /// Format of its ids; `None` if it gets none, and all is the static world.
    pub ids: Option<IdFormat>,
    /// Whether its images are taken for those of a fisheye.
    pub fisheye: bool,
}

/// A camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraCase {
    /// Its number in random draws.
    pub number: u32,
    pub sensor: SensorModel,
    pub scene: SceneKind,
    /// When the scene begins, nanoseconds.
    pub epoch_ns: i64,
    /// How fast the scene's clock is. Scenes move by whole and half pixels in a usual interval, so that at their own pace
    /// roundings would decide.
    pub pace: f64,
    pub hdr: HdrFormat,
    pub motion: Option<MotionFormat>,
    pub geometry: Option<GeometryOf>,
}

impl CameraCase {
    pub fn input(&self) -> Input {
        Input { motion: self.motion.is_some(), geometry: self.geometry.is_some() }
    }

    pub fn size_px(&self) -> (u32, u32) {
        (self.sensor.width, self.sensor.height)
    }

    /// Time of the scene, nanoseconds.
    pub fn scene_ns(&self, t_ns: i64) -> i64 {
        ((t_ns - self.epoch_ns) as f64 * self.pace).round() as i64
    }

    /// A sensor with the synthesis that `auto` is for this camera.
    pub fn resolved(&self, sensor: &SensorModel) -> SensorModel {
        let synthesis = sensor.synthesis.resolve(self.geometry.is_some(), self.motion.is_some());
        SensorModel { synthesis, ..sensor.clone() }
    }
}

/// What the engine must refuse, and what must leave no trace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// A colour image that is a byte short.
    ShortImage,
    /// No motion image, though the camera takes one.
    NoMotion,
    /// A step to the time of the last frame.
    SameTime,
    /// A sensor of another size.
    OtherSize,
}

/// What happens to a camera between two ticks.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    Reset(usize),
    Sensor(usize, Box<SensorModel>),
    Refused(usize, Refusal),
}

/// A tick, and what happens before it.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    pub changes: Vec<Change>,
    /// For each camera its frame, if it has a new one.
    pub frames: Vec<Option<FrameAt>>,
}

/// When a state is saved, and what it is restored into.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Saving {
    /// Before the changes of this tick.
    pub tick: usize,
    pub into_the_same_rig: bool,
}

/// All that a seed gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    pub cameras: Vec<CameraCase>,
    pub ticks: Vec<Tick>,
    pub saving: Saving,
    pub options: RigOptions,
    /// Options of a second run. No option changes an event.
    pub other_options: RigOptions,
    /// Whether each camera has a rig of its own in the second run.
    pub other_alone: bool,
}

/// Largest image, pixels: the oracle follows each of them.
const MOST_PIXELS: u32 = 1_500;

const MOST_SIDE_PX: u32 = 61;

const LEAST_SIDE_PX: u32 = 7;

/// Lengths of intervals, nanoseconds. The longest is the longest that a camera takes.
const GAPS_NS: [i64; 14] = [
    33_333_333,
    33_333_333,
    33_333_333,
    16_666_667,
    8_333_333,
    4_000_000,
    1_000_000,
    100_000_000,
    400_000_000,
    1_000_000_000,
    999_999_937,
    10_007,
    61,
    1,
];

/// Times of the first frame, nanoseconds: around 0, that of a clock since 1970, and close to the farthest of all.
const EPOCHS_NS: [i64; 6] =
    [0, 20_000_000_007, -50_000_001, 1_790_000_000_123_456_789, -(1 << 62), (1 << 62) - 30_000_000_000];

/// Scenes of cameras with depth and poses. A card has no depth that poses predict, and the shaken and the still flight stand
/// for the world. A seed draws a scene by its place in this list.
const SCENES_WITH_GEOMETRY: [SceneKind; 6] = [
    SceneKind::Still,
    SceneKind::Shake,
    SceneKind::Poles,
    SceneKind::Foliage,
    SceneKind::Propeller,
    SceneKind::Bounce,
];

impl Case {
    /// The case of a seed.
    pub fn draw(seed: u64) -> Self {
        let mut dice = Dice::new(seed);
        let cameras: Vec<CameraCase> =
            (0..dice.shared.pick(&[1, 1, 2, 2, 3])).map(|number| camera(&mut dice, number)).collect();
        let options = options(&mut dice);
        let other_options = other_options(&mut dice, options);
        let other_alone = dice.own.chance(0.3);
        let ticks = ticks(&mut dice, &cameras);
        let saving = Saving {
            tick: 1 + dice.own.below(ticks.len() as u32 - 1) as usize,
            into_the_same_rig: dice.own.chance(0.5),
        };
        Case { cameras, ticks, saving, options, other_options, other_alone }
    }

    /// The camera's sensor before each tick's changes, and after the last tick, as it was asked for.
    pub fn sensors(&self, camera: usize) -> Vec<SensorModel> {
        let mut sensors = vec![self.cameras[camera].sensor.clone()];
        for tick in &self.ticks {
            let last = sensors.last().expect("there is a first");
            let changed = tick.changes.iter().rev().find_map(|change| match change {
                Change::Sensor(number, sensor) if *number == camera => Some((**sensor).clone()),
                _ => None,
            });
            sensors.push(changed.unwrap_or_else(|| last.clone()));
        }
        sensors
    }

    /// The same case without what comes behind the pixels, whose events are then seen as they come: no bus, no cap of a
    /// packet. A bus floors the stamps of what leaves it, so that what comes to it has stamps that are not floored.
    pub fn without_bus_and_cap(&self) -> Case {
        let mut case = self.clone();
        for (number, camera) in case.cameras.iter_mut().enumerate() {
            let mut sensors = self.sensors(number).into_iter();
            let mut sensor = sensors.next().expect("there is a first");
            camera.sensor = plain(&sensor);
            for (tick, next) in case.ticks.iter_mut().zip(sensors) {
                let [before, after] = [&sensor, &next].map(|sensor| camera.resolved(sensor));
                let resets = before.change_to(&after).resets_frames;
                let plain_resets = plain(&before).change_to(&plain(&after)).resets_frames;
                for change in &mut tick.changes {
                    if let Change::Sensor(of, sensor) = change
                        && *of == number
                    {
                        **sensor = plain(sensor);
                    }
                }
                if resets && !plain_resets {
                    tick.changes.push(Change::Reset(number));
                }
                sensor = next;
            }
        }
        case
    }

    /// The same case without what is refused.
    pub fn without_refusals(&self) -> Case {
        let mut case = self.clone();
        for tick in &mut case.ticks {
            tick.changes.retain(|change| !matches!(change, Change::Refused(..)));
        }
        case
    }

    /// The case of one camera alone.
    pub fn alone(&self, camera: usize) -> Case {
        let of_camera = |change: &Change| match change {
            Change::Reset(number) => (*number == camera).then_some(Change::Reset(0)),
            Change::Sensor(number, sensor) => (*number == camera).then(|| Change::Sensor(0, sensor.clone())),
            Change::Refused(number, what) => (*number == camera).then_some(Change::Refused(0, *what)),
        };
        let tick = |tick: &Tick| Tick {
            changes: tick.changes.iter().filter_map(of_camera).collect(),
            frames: vec![tick.frames[camera]],
        };
        Case {
            cameras: vec![self.cameras[camera].clone()],
            ticks: self.ticks.iter().map(tick).collect(),
            ..self.clone()
        }
    }
}

/// For each camera and each tick what is in it. Of sensors only what is not as in `davis346`.
impl Display for Case {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        for (number, camera) in self.cameras.iter().enumerate() {
            let CameraCase { number: drawn, sensor, scene, epoch_ns, pace, hdr, motion, geometry } = camera;
            writeln!(
                out,
                "camera {number}: number {drawn}, {scene:?}, {hdr:?}, motion {motion:?}, {geometry:?}, pace {pace:.3}"
            )?;
            writeln!(out, "  from {epoch_ns} ns on; {}", parameters(sensor, &SensorModel::default()))?;
        }
        let mut sensors: Vec<&SensorModel> = self.cameras.iter().map(|camera| &camera.sensor).collect();
        for (index, tick) in self.ticks.iter().enumerate() {
            writeln!(out, "tick {index}:")?;
            for change in &tick.changes {
                match change {
                    Change::Sensor(camera, sensor) => {
                        let before = std::mem::replace(&mut sensors[*camera], sensor);
                        writeln!(out, "  camera {camera} changes: {}", parameters(sensor, before))?;
                    }
                    other => writeln!(out, "  {other:?}")?,
                }
            }
            for (camera, frame) in tick.frames.iter().enumerate() {
                writeln!(out, "  camera {camera}: {frame:?}")?;
            }
        }
        writeln!(out, "{:?}\n{:?}", self.saving, self.options)?;
        writeln!(out, "another run, cameras alone: {}, {:?}", self.other_alone, self.other_options)
    }
}

/// Parameters of a sensor that another one does not have.
fn parameters(sensor: &SensorModel, other: &SensorModel) -> String {
    let table = |sensor: &SensorModel| toml::Table::try_from(sensor).expect("a sensor is a table");
    let other = table(other);
    let all = table(sensor).into_iter().filter(|(name, value)| other.get(name) != Some(value));
    all.map(|(name, value)| format!("{name} = {value}")).collect::<Vec<_>>().join(", ")
}

/// A sensor whose packets are what its pixels send.
pub fn plain(sensor: &SensorModel) -> SensorModel {
    let plain = SensorModel { max_events_per_interval: 0, ..sensor.clone() };
    match sensor.readout {
        esaac_model::ReadoutKind::None => plain,
        _ => SensorModel {
            readout: esaac_model::ReadoutKind::None,
            readout_cap_events: 0,
            timestamp_quantum_ns: 1,
            ..plain
        },
    }
}

fn camera(dice: &mut Dice, number: u32) -> CameraCase {
    let synthesis = sensors::synthesis(dice);
    let geometry = synthesis == Synthesis::Rigid
        || dice.shared.chance(if synthesis == Synthesis::Auto { 0.5 } else { 0.1 });
    let motion = matches!(synthesis, Synthesis::Motion | Synthesis::Paper) || dice.shared.chance(0.5);
    let width = LEAST_SIDE_PX + dice.own.below(MOST_SIDE_PX + 1 - LEAST_SIDE_PX);
    let most_height = (MOST_PIXELS / width).min(MOST_SIDE_PX);
    let height = LEAST_SIDE_PX + dice.own.below(most_height + 1 - LEAST_SIDE_PX);
    let scenes = if geometry { &SCENES_WITH_GEOMETRY[..] } else { &SceneKind::ALL[..] };
    // Vectors that contradict the poses would be a reason to doubt these, of which the oracle knows nothing.
    let may_contradict = !motion;
    CameraCase {
        number: if dice.own.chance(0.9) { number } else { dice.own.below(u32::MAX) },
        sensor: sensors::sensor(dice, (width, height), Input { motion, geometry }, Some(synthesis)),
        scene: dice.own.pick(scenes),
        epoch_ns: dice.own.pick(&EPOCHS_NS),
        pace: dice.own.between(0.5, 1.5),
        hdr: dice.shared.pick(&[HdrFormat::F32x4, HdrFormat::F32x4, HdrFormat::F16x4, HdrFormat::Srgb8x4]),
        motion: motion
            .then(|| dice.shared.pick(&[MotionFormat::F32x2, MotionFormat::F16x2, MotionFormat::F32x4])),
        geometry: geometry.then(|| GeometryOf {
            ids: if may_contradict && dice.shared.chance(0.2) {
                None
            } else {
                Some(dice.shared.pick(&[IdFormat::U32, IdFormat::U16]))
            },
            fisheye: may_contradict && dice.shared.chance(0.15),
        }),
    }
}

fn ticks(dice: &mut Dice, cameras: &[CameraCase]) -> Vec<Tick> {
    let count = 4 + dice.own.below(4) as usize;
    let skips = if dice.own.chance(0.5) { 0.2 } else { 0.0 };
    let spoils = if dice.own.chance(0.4) { 0.4 } else { 0.0 };
    let changes = dice.shared.pick(&[0.0, 0.1, 0.3]);
    let even = dice.own.chance(0.4);
    // Since a camera's own first frame, or the last that it had.
    let mut clocks_ns: Vec<i64> = cameras.iter().map(|camera| camera.epoch_ns).collect();
    let mut sensors: Vec<SensorModel> = cameras.iter().map(|camera| camera.sensor.clone()).collect();
    (0..count)
        .map(|tick| {
            let mut now = Vec::new();
            for (number, sensor) in sensors.iter_mut().enumerate() {
                if tick > 0 && dice.shared.chance(changes) {
                    now.push(change(dice, number, sensor, &cameras[number]));
                }
            }
            let gap_ns = if even { GAPS_NS[0] } else { dice.own.pick(&GAPS_NS) };
            let mut frame = |camera: &CameraCase, clock_ns: &mut i64| {
                if dice.own.chance(skips) {
                    return None;
                }
                if tick > 0 {
                    *clock_ns += if dice.own.chance(0.1) { dice.own.pick(&GAPS_NS) } else { gap_ns };
                }
                Some(FrameAt { t_ns: *clock_ns, spoils: spoil(dice, spoils, camera) })
            };
            let frames = cameras.iter().zip(&mut clocks_ns).map(|(camera, clock_ns)| frame(camera, clock_ns));
            let frames = frames.collect();
            Tick { changes: now, frames }
        })
        .collect()
}

fn change(dice: &mut Dice, number: usize, sensor: &mut SensorModel, camera: &CameraCase) -> Change {
    match dice.shared.below(8) {
        0 => Change::Reset(number),
        1 => Change::Refused(number, Refusal::ShortImage),
        2 if camera.motion.is_some() => Change::Refused(number, Refusal::NoMotion),
        3 => Change::Refused(number, Refusal::OtherSize),
        4 => Change::Refused(number, Refusal::SameTime),
        _ => {
            *sensor = sensors::changed(dice, sensor, camera.input());
            Change::Sensor(number, Box::new(sensor.clone()))
        }
    }
}

fn spoil(dice: &mut Dice, share: f64, camera: &CameraCase) -> Spoils {
    let mut one_in = |taken: bool| if taken && dice.own.chance(share) { dice.own.whole(1, 200) } else { 0 };
    Spoils {
        colour_one_in: one_in(camera.hdr != HdrFormat::Srgb8x4),
        motion_one_in: one_in(camera.motion.is_some()),
        depth_one_in: one_in(camera.geometry.is_some()),
        ids_one_in: one_in(camera.geometry.is_some_and(|geometry| geometry.ids.is_some())),
    }
}

fn options(dice: &mut Dice) -> RigOptions {
    RigOptions {
        keep_substeps: dice.shared.chance(0.5),
        stage_times: false,
        initial_events: dice.own.pick(&[0, 0, 64]),
        packets: dice.own.pick(&[PacketPlace::Owned, PacketPlace::InPlace]),
        packet_ring: dice.own.pick(&[0, 1, 2, 3]),
        policy: if dice.shared.chance(0.15) { policy(dice) } else { None },
    }
}

/// Options of a second run of the same case. Most have the same kernels, which take longer to compile than to run.
fn other_options(dice: &mut Dice, options: RigOptions) -> RigOptions {
    let other = self::options(dice);
    let keep_substeps = if dice.shared.chance(0.2) { other.keep_substeps } else { options.keep_substeps };
    let policy = if dice.shared.chance(0.3) { policy(dice) } else { options.policy };
    RigOptions { keep_substeps, policy, ..other }
}

fn policy(dice: &mut Dice) -> Option<KernelPolicy> {
    let resting = dice.shared.pick(&[Resting::Never, Resting::WherePaid, Resting::Always]);
    let levels_first = dice.shared.pick(&[LevelsFirst::Never, LevelsFirst::WherePaid, LevelsFirst::Always]);
    match dice.shared.below(3) {
        0 => Some(KernelPolicy { resting, ..KernelPolicy::software_driver() }),
        1 => Some(KernelPolicy { levels_first, resting, ..KernelPolicy::gpu() }),
        _ => None,
    }
}
