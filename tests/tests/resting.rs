//! Pixels at rest: where light is still, pixels whose noise cannot send anything are passed over, and settled physical
//! pixels pass an interval in closed form. Packets and counts are those of rigs that walk every pixel.

use esaac_engine::{KernelPolicy, Resting, Rig, RigOptions};
use esaac_layout::{CrossConstants, PhysicalWord};
use esaac_model::{HdrFormat, Intensity, MotionFormat, Pixel, SensorModel, SubstepPolicy, Synthesis, Taps};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{Frame, Sequence};
use esaac_tests::run::{Step, rig, step};

const SIZE: (u32, u32) = (45, 21);
const PIXELS: usize = (SIZE.0 * SIZE.1) as usize;

/// Side of a patch of the image that changes at once.
const PATCH_PX: usize = 10;

/// Frames from one change of a patch to the next.
const STILL_FRAMES: usize = 23;

/// A number that looks random.
fn hash(words: [usize; 3]) -> u32 {
    let mut h = 2_166_136_261_u32;
    for word in words {
        h = (h ^ word as u32).wrapping_mul(16_777_619);
        h ^= h >> 15;
    }
    h.wrapping_mul(2_654_435_769)
}

/// A frame in which each patch has changed `change(patch)` times, and has moved if `moves(patch)`.
fn frame(t_ns: i64, change: impl Fn(usize) -> usize, moves: impl Fn(usize) -> bool) -> Frame {
    let (mut hdr, mut motion) = (Vec::new(), Vec::new());
    for pixel in 0..PIXELS {
        let (x, y) = (pixel % SIZE.0 as usize, pixel / SIZE.0 as usize);
        let patch = y / PATCH_PX * 7 + x / PATCH_PX;
        let step = f64::from(hash([patch, change(patch), 1]) % 1000) * 1e-3;
        let value = 0.02 + 0.3 * step + 0.01 * f64::from(hash([x, y, 2]) % 100);
        for channel in [0.9, 1.0, 1.2, 1.0] {
            hdr.extend(((value * channel) as f32).to_le_bytes());
        }
        let vector = if moves(patch) { [2.5_f32, -0.5] } else { [0.0; 2] };
        motion.extend(vector.iter().flat_map(|v| v.to_le_bytes()));
    }
    Frame { t_ns, hdr, motion: Some(motion) }
}

fn sequence(frames: Vec<Frame>) -> Sequence {
    Sequence { hdr: HdrFormat::F32x4, motion: Some(MotionFormat::F32x2), frames }
}

/// Light in which a patch changes here and there, and sometimes has motion. Most intervals have one of two lengths.
fn patches(frames: usize) -> Sequence {
    let mut t_ns = 1_000_000_000;
    let mut all = Vec::new();
    for number in 0..frames {
        let begin = |patch: usize| hash([patch, 0, 0]) as usize % STILL_FRAMES;
        let changes = |patch| (number + begin(patch)) / STILL_FRAMES;
        let moves = |patch| patch % 5 == 0 && (number + begin(patch)) % STILL_FRAMES == 0;
        all.push(frame(t_ns, changes, moves));
        let is_odd = number % 40 == 39;
        t_ns += if is_odd { 210_000_000 + number as i64 } else { 33_333_333 + i64::from(number % 3 == 0) };
    }
    sequence(all)
}

/// The same frame at all times.
fn still(times_ns: impl Iterator<Item = i64>) -> Sequence {
    sequence(times_ns.map(|t_ns| frame(t_ns, |_| 0, |_| false)).collect())
}

/// A sensor whose pixels rest for long.
fn quiet() -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        synthesis: Synthesis::Linear,
        substeps: 8,
        contrast_mismatch: 0.05,
        leak_rate_hz: 0.1,
        leak_spread_log: 0.2,
        shot_noise_rate_hz: 0.02,
        seed: 3,
        ..SensorModel::default()
    }
}

/// A sensor whose pixels seldom rest for long.
fn noisy() -> SensorModel {
    SensorModel {
        refractory_ns: 40_000_000,
        shot_noise_rate_hz: 5.0,
        latency_ns: 100_000,
        latency_jitter_ns: 10_000,
        ..quiet()
    }
}

fn bayer() -> SensorModel {
    SensorModel {
        synthesis: Synthesis::Motion,
        taps: Taps::Cubic,
        intensity: Intensity::BayerRggb,
        substep_policy: SubstepPolicy::Fixed,
        refractory_ns: 500_000,
        ..noisy()
    }
}

/// A sensor that tells surfaces apart where patches begin to move.
fn layered() -> SensorModel {
    SensorModel { synthesis: Synthesis::Motion, taps: Taps::Cubic, layers: 3, refractory_ns: 0, ..noisy() }
}

/// The kernels that a device can run: those of GPUs, and on the software driver its own too.
fn policies() -> Vec<KernelPolicy> {
    let own = DEVICE.is_software().then(KernelPolicy::software_driver);
    std::iter::once(KernelPolicy::gpu()).chain(own).collect()
}

/// Two rigs of one camera: in one all pixels are walked, in the other they rest or pass whenever they can, or as it chooses.
struct Pair {
    sequence: Sequence,
    walked: Rig,
    rested: Rig,
}

impl Pair {
    fn rig(sensor: &SensorModel, sequence: &Sequence, policy: KernelPolicy) -> Rig {
        // Event buffers that have to grow.
        rig(
            sensor,
            sequence,
            RigOptions { initial_events: 64, policy: Some(policy), ..RigOptions::default() },
        )
    }

    fn new(sensor: &SensorModel, sequence: Sequence, policy: KernelPolicy, resting: Resting) -> Self {
        let walks = KernelPolicy { resting: Resting::Never, passes_still: false, ..policy };
        let walked = Pair::rig(sensor, &sequence, walks);
        let rested = Pair::rig(sensor, &sequence, KernelPolicy { resting, ..policy });
        Pair { sequence, walked, rested }
    }

    /// Steps both to frame `index`, and returns what the one whose pixels rest has sent.
    #[track_caller]
    fn step(&mut self, index: usize) -> Step {
        let walked = step(&mut self.walked, &self.sequence, index);
        let rested = step(&mut self.rested, &self.sequence, index);
        let (wanted, got) = (walked.packet.len(), rested.packet.len());
        assert!(walked == rested, "frame {index}: {got} events, expected {wanted}: {rested:?}");
        rested
    }

    fn change(&mut self, change: impl Fn(&mut SensorModel)) {
        for rig in [&mut self.walked, &mut self.rested] {
            let mut sensor = rig.sensor(0).expect("a camera").clone();
            change(&mut sensor);
            rig.set_sensor(0, sensor).expect("a valid sensor");
        }
    }

    /// Some of the words of state in which the rigs differ: the word, the pixel and both values.
    fn differing_words(&self) -> Vec<(usize, usize, [u32; 2])> {
        let [walked, rested] =
            [&self.walked, &self.rested].map(|rig| rig.words(0, "state").expect("a state"));
        assert_eq!(walked.len(), rested.len());
        let both = walked.iter().zip(&rested).enumerate().filter(|(_, (walked, rested))| walked != rested);
        both.map(|(i, (&walked, &rested))| (i / PIXELS, i % PIXELS, [walked, rested])).take(8).collect()
    }

    /// Words of saved state in which the rigs differ, besides the words of rest themselves.
    fn words_behind(&self) -> usize {
        let [walked, rested] = [&self.walked, &self.rested].map(|rig| body(&rig.save().expect("a state")));
        assert_eq!(walked.len(), rested.len());
        let differ = walked.chunks_exact(4).zip(rested.chunks_exact(4)).filter(|(a, b)| a != b);
        differ.count().saturating_sub(PIXELS)
    }
}

/// The buffers of a saved state, which follow eight bytes, the length of the header, and the header.
fn body(saved: &[u8]) -> Vec<u8> {
    let header = u64::from_le_bytes(saved[8..16].try_into().expect("eight bytes"));
    saved[16 + header as usize..].to_vec()
}

/// Whether a permutation of `cross` in which pixels rest (`rests`), or all are walked, has been compiled.
fn has_kernel(rig: &Rig, rests: bool) -> bool {
    has_constant(rig, "pixels_rest", rests)
}

/// Whether a permutation of `cross` in which this constant has this value has been compiled.
fn has_constant(rig: &Rig, field: &str, value: bool) -> bool {
    let word = CrossConstants::LIST.constants.iter().position(|c| c.field == field);
    let word = word.expect("a constant of `cross`");
    rig.permutations_compiled()
        .iter()
        .any(|(name, words)| name.starts_with("cross") && words[word] == u32::from(value))
}

#[test]
fn pixels_at_rest_would_have_sent_nothing() {
    let frames = 120;
    for (sensor, policy) in
        policies().into_iter().flat_map(|p| [quiet(), noisy(), bayer(), layered()].map(|s| (s, p)))
    {
        let mut pair = Pair::new(&sensor, patches(frames), policy, Resting::Always);
        let mut sent = 0;
        let mut behind = 0;
        for index in 0..frames {
            sent += pair.step(index).packet.len();
            if index % 10 == 9 {
                behind = pair.words_behind().max(behind);
            }
        }
        println!("{sent} events, {behind} words behind");
        assert!(sent > 1000, "{sent} events of {sensor:?}");
        assert!(behind > PIXELS / 2, "{behind} words behind: no pixel of {sensor:?} rests");
        assert!(!has_kernel(&pair.walked, true) && !has_kernel(&pair.rested, false));
        drop(pair);
        assert_silent();
    }
}

#[test]
fn rest_outlives_what_happens_to_a_camera() {
    let frames = 130;
    for policy in policies() {
        let sensor = SensorModel { shot_noise_rate_hz: 0.5, ..noisy() };
        let mut pair = Pair::new(&sensor, patches(frames), policy, Resting::Always);
        let mut sent = 0;
        for index in 0..frames {
            match index {
                15 => pair.change(|sensor| sensor.shot_noise_rate_hz *= 2.0),
                25 => pair.change(|sensor| sensor.leak_rate_hz = 0.4),
                // Only the last of two changes takes effect.
                35 => {
                    pair.change(|sensor| sensor.leak_rate_hz = 3.0);
                    pair.change(|sensor| (sensor.leak_rate_hz, sensor.white_level) = (0.2, 0.3));
                }
                45 => {
                    // Each goes on with the state of the other.
                    let [walked, rested] =
                        [&pair.walked, &pair.rested].map(|rig| rig.save().expect("a state"));
                    assert!(pair.words_behind() > PIXELS, "no pixel rests");
                    pair.walked.restore(&rested).expect("a state of such a rig");
                    pair.rested.restore(&walked).expect("a state of such a rig");
                }
                60 => pair.change(|sensor| (sensor.leak_rate_hz, sensor.shot_noise_rate_hz) = (0.0, 0.0)),
                70 => pair.change(|sensor| (sensor.leak_rate_hz, sensor.shot_noise_rate_hz) = (0.3, 1.0)),
                80 => pair.change(|sensor| sensor.contrast_on *= 0.7),
                90 => {
                    pair.walked.reset(0).expect("a camera");
                    pair.rested.reset(0).expect("a camera");
                }
                100 => pair.change(|sensor| sensor.seed += 1),
                // While there are APS frames, no pixel rests.
                110 => pair.change(|sensor| sensor.aps_exposure_ns = 1_000_000),
                115 => pair.change(|sensor| sensor.aps_exposure_ns = 0),
                _ => {}
            }
            sent += pair.step(index).packet.len();
        }
        assert!(sent > 2000, "{sent} events");
        drop(pair);
        assert_silent();
    }
}

/// A new rig has ordered no tiles yet when it catches up with what has rested in the one that was saved.
#[test]
fn rest_goes_on_in_a_new_rig() {
    const SAVED: usize = 30;
    let frames: Vec<Frame> = (0..SAVED + 20)
        .map(|number| {
            let changes = number.max(SAVED + 3);
            frame(number as i64 * 33_333_333, |_| changes, |_| number >= SAVED + 3)
        })
        .collect();
    let sensor = SensorModel { shot_noise_rate_hz: 0.05, ..noisy() };
    for policy in policies() {
        for (resting, changes) in
            [(Resting::WherePaid, false), (Resting::WherePaid, true), (Resting::Always, true)]
        {
            let mut pair = Pair::new(&sensor, sequence(frames.clone()), policy, resting);
            for index in 0..SAVED {
                pair.step(index);
            }
            assert!(pair.words_behind() > PIXELS, "no pixel rests");
            let saved = pair.rested.save().expect("a state");
            pair.rested = Pair::rig(&sensor, &pair.sequence, KernelPolicy { resting, ..policy });
            pair.rested.restore(&saved).expect("a state of such a rig");
            if changes {
                pair.change(|sensor| sensor.leak_rate_hz = 0.4);
            }
            let sent: usize = (SAVED..frames.len()).map(|index| pair.step(index).packet.len()).sum();
            assert!(sent > PIXELS, "{sent} events");
            drop(pair);
            assert_silent();
        }
    }
}

#[test]
fn a_rest_may_outlast_every_counter() {
    // Rests end after at most 250 intervals and 7 s.
    let sensor =
        SensorModel { leak_rate_hz: 0.02, shot_noise_rate_hz: 0.01, contrast_mismatch: 0.1, ..quiet() };
    // Of the first 600, each third is longer: what one counter loses, the other does not tell.
    let times_ns = (0..600)
        .map(|i| i * 1_000_000 + i / 3 * 100_000)
        .chain((1..50).map(|i| 600_000_000 + i * 900_000_000));
    let times_ns: Vec<i64> = times_ns.collect();
    for policy in policies() {
        let mut pair = Pair::new(&sensor, still(times_ns.iter().copied()), policy, Resting::Always);
        let sent: usize = (0..times_ns.len()).map(|index| pair.step(index).packet.len()).sum();
        println!("{sent} events");
        assert!(sent > PIXELS / 2, "{sent} events");
        assert!(pair.words_behind() > PIXELS, "no pixel rests");
        drop(pair);
        assert_silent();
    }
}

#[test]
fn a_rig_chooses_by_what_has_moved() {
    let moving = |number: usize| (30..60).contains(&number);
    let frames: Vec<Frame> = (0..90)
        .map(|number| {
            let changes = number.clamp(30, 60);
            frame(number as i64 * 33_333_333, |_| changes, |_| moving(number))
        })
        .collect();
    let sensor = SensorModel { shot_noise_rate_hz: 0.05, ..noisy() };
    for policy in policies() {
        let mut pair = Pair::new(&sensor, sequence(frames.clone()), policy, Resting::WherePaid);
        let mut rested = Vec::new();
        for index in 0..frames.len() {
            pair.step(index);
            if index % 10 == 9 {
                rested.push(pair.words_behind() > PIXELS);
            }
        }
        assert_eq!(rested, [false, true, true, false, false, false, false, true, true]);
        assert!(has_kernel(&pair.rested, true) && has_kernel(&pair.rested, false));
        drop(pair);
        assert_silent();
    }
}

/// A physical pixel with every effect, between 2 and 130 lux.
fn physical() -> SensorModel {
    SensorModel {
        pixel: Pixel::Physical,
        refractory_ns: 200_000,
        leak_rate_hz: -0.4,
        leak_per_lux_hz: 0.002,
        dark_spread_log: 0.3,
        photoreceptor_charge_e: 150.0,
        lux_per_unit: 100.0,
        ..quiet()
    }
}

/// The sensors whose settled pixels pass: with every effect, in the dark, without noise, and with nothing but the light.
fn settling() -> [SensorModel; 4] {
    let plain = SensorModel {
        contrast_mismatch: 0.0,
        refractory_ns: 0,
        leak_rate_hz: 0.0,
        leak_per_lux_hz: 0.0,
        dark_spread_log: 0.0,
        ..physical()
    };
    [
        physical(),
        SensorModel { lux_per_unit: 0.1, contrast_on: 0.25, contrast_off: 0.25, ..physical() },
        SensorModel { noise_gain: 0.0, ..physical() },
        SensorModel { noise_gain: 0.0, ..plain },
    ]
}

/// Pixels whose photoreceptor has settled for good, which a pixel that passes has.
fn settled(rig: &Rig) -> usize {
    let words = rig.words(0, "state").expect("a rig that is not lost");
    let [excess, lag] =
        [PhysicalWord::Excess, PhysicalWord::Lag].map(|word| &words[word as usize * PIXELS..][..PIXELS]);
    excess.iter().zip(lag).filter(|&(&excess, &lag)| excess | lag == 0).count()
}

#[test]
fn settled_physical_pixels_pass_as_if_they_were_walked() {
    let frames = 90;
    for (sensor, policy) in policies().into_iter().flat_map(|p| settling().map(|s| (s, p))) {
        let mut pair = Pair::new(&sensor, patches(frames), policy, Resting::WherePaid);
        let (mut sent, mut most_settled) = (0, 0);
        for index in 0..frames {
            sent += pair.step(index).packet.len();
            let differing = pair.differing_words();
            assert!(differing.is_empty(), "frame {index}: {differing:?} of {sensor:?}");
            most_settled = most_settled.max(settled(&pair.rested));
        }
        println!("{sent} events, up to {most_settled} of {PIXELS} pixels settled");
        assert!(sent > 1000, "{sent} events of {sensor:?}");
        assert!(most_settled > PIXELS / 2, "{most_settled} pixels of {sensor:?} settled");
        assert!(!has_constant(&pair.walked, "passes_still", true), "all are walked");
        assert!(!has_constant(&pair.rested, "passes_still", false), "settled ones pass");
        drop(pair);
        assert_silent();
    }
}

#[test]
fn what_happens_to_a_camera_finds_settled_physical_pixels_up_to_date() {
    let frames = 100;
    for policy in policies() {
        let mut pair = Pair::new(&physical(), patches(frames), policy, Resting::WherePaid);
        let mut sent = 0;
        for index in 0..frames {
            match index {
                15 => pair.change(|sensor| sensor.contrast_on *= 0.7),
                25 => pair.change(|sensor| sensor.leak_rate_hz = 0.5),
                35 => {
                    // Each goes on with the state of the other.
                    let [walked, passed] =
                        [&pair.walked, &pair.rested].map(|rig| rig.save().expect("a state"));
                    pair.walked.restore(&passed).expect("a state of such a rig");
                    pair.rested.restore(&walked).expect("a state of such a rig");
                }
                45 => pair.change(|sensor| sensor.temperature_c = 60.0),
                55 => pair.change(|sensor| sensor.photoreceptor_charge_e = 90.0),
                65 => pair.change(|sensor| (sensor.noise_gain, sensor.refractory_ns) = (0.0, 0)),
                75 => pair.change(|sensor| (sensor.noise_gain, sensor.refractory_ns) = (1.0, 40_000_000)),
                // While there are APS frames, or the lamp flickers, all are walked.
                80 => pair.change(|sensor| sensor.aps_exposure_ns = 1_000_000),
                84 => pair.change(|sensor| (sensor.aps_exposure_ns, sensor.flicker_depth) = (0, 0.3)),
                88 => pair.change(|sensor| sensor.flicker_depth = 0.0),
                92 => {
                    pair.walked.reset(0).expect("a camera");
                    pair.rested.reset(0).expect("a camera");
                }
                _ => {}
            }
            sent += pair.step(index).packet.len();
        }
        println!("{sent} events");
        assert!(sent > 2000, "{sent} events");
        drop(pair);
        assert_silent();
    }
}
