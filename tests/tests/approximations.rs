//! Measures what the engine's approximations cost in accuracy, each alone and all together. Each is an oracle with the
//! approximation, compared with an oracle without any, by their errors against the exact light of the generated scenes.

use esaac_model::{HdrFormat, MotionFormat, SensorModel, SubstepPolicy, Taps};
use esaac_oracle::{Oracle, Sampling};
use esaac_scene::{SceneKind, log_intensity};
use esaac_tests::frames::{FRAME_NS, Sequence, scene, times};

const SIZE: (u32, u32) = (75, 61);

/// Five intervals, of which the first ones gather detail.
const FRAMES: usize = 6;

const SUBSTEPS: u32 = 8;

const TWELVE_TAPS: Sampling = Sampling { twelve_taps: true, ..Sampling::IDEAL };
const SHARED_FOOTPRINT: Sampling = Sampling { shared_footprint: true, ..Sampling::IDEAL };

/// Mean error of the log intensity over a region without approximations, nepers, and how much each approximation adds
/// to it, as a share of it: 0.01 is one hundredth.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Price {
    ideal_log: f64,
    twelve_taps: f64,
    shared_footprint: f64,
    all: f64,
}

const fn price([ideal_log, twelve_taps, shared_footprint, all]: [f64; 4]) -> Price {
    Price { ideal_log, twelve_taps, shared_footprint, all }
}

/// Pixels over which errors are averaged. The border is special: a surface point that has just entered the image is in
/// one frame alone, and taps are clamped there.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Region {
    Whole,
    /// The image without a border that no surface point crosses within the run.
    Inner,
}

const BORDER_PX: u32 = 16;

const REGIONS: [Region; 2] = [Region::Whole, Region::Inner];

impl Region {
    fn has(self, pixel: usize) -> bool {
        let (x, y) = (pixel as u32 % SIZE.0, pixel as u32 / SIZE.0);
        let inner = |at: u32, size: u32| (BORDER_PX..size - BORDER_PX).contains(&at);
        self == Region::Whole || (inner(x, SIZE.0) && inner(y, SIZE.1))
    }
}

/// How far a mean error may be from the recorded one, as a share of it. Covers different rounding of `exp` and `ln`
/// alone.
const ERROR_NOISE: f64 = 1e-3;

/// How far a price may be from the recorded one. A price is a small difference of two errors.
const PRICE_NOISE: f64 = 5e-4;

/// Recorded prices for each scene, number of transfers and region: the error without approximations, and how much
/// twelve taps, shared footprints, and both together add to it. If a change raises one, the approximations have become
/// less exact. If it lowers one, record the new price here.
const RECORDED: [(SceneKind, u32, Region, Price); 20] = [
    (SceneKind::Edge, 1, Region::Whole, price([0.000775760, 0.013188, 0.210903, 0.225155])),
    (SceneKind::Edge, 1, Region::Inner, price([0.000868255, 0.015944, 0.000000, 0.015944])),
    (SceneKind::Edge, 2, Region::Whole, price([0.000794579, 0.012856, 0.205908, 0.219803])),
    (SceneKind::Edge, 2, Region::Inner, price([0.000868255, 0.015944, 0.000000, 0.015944])),
    (SceneKind::Sinusoid, 1, Region::Whole, price([0.000554351, 0.033435, 0.714465, 0.757800])),
    (SceneKind::Sinusoid, 1, Region::Inner, price([0.000017003, 1.118333, 0.000000, 1.118333])),
    (SceneKind::Sinusoid, 2, Region::Whole, price([0.000620050, 0.030535, 0.615275, 0.654603])),
    (SceneKind::Sinusoid, 2, Region::Inner, price([0.000016979, 1.125859, 0.000000, 1.125859])),
    (SceneKind::Flight, 1, Region::Whole, price([0.002270869, 0.001724, 0.081540, 0.084973])),
    (SceneKind::Flight, 1, Region::Inner, price([0.004542516, 0.002143, 0.081480, 0.085567])),
    (SceneKind::Flight, 2, Region::Whole, price([0.002150413, 0.006006, 0.098673, 0.106578])),
    (SceneKind::Flight, 2, Region::Inner, price([0.004217949, 0.008091, 0.118526, 0.128248])),
    (SceneKind::Hdr, 1, Region::Whole, price([0.000901639, 0.022264, 0.473357, 0.504224])),
    (SceneKind::Hdr, 1, Region::Inner, price([0.000007140, 2.456759, 0.000000, 2.456759])),
    (SceneKind::Hdr, 2, Region::Whole, price([0.000929454, 0.022649, 0.448618, 0.478607])),
    (SceneKind::Hdr, 2, Region::Inner, price([0.000006793, 2.564258, 0.000000, 2.564258])),
    (SceneKind::Dark, 1, Region::Whole, price([0.000815197, 0.002804, 0.121853, 0.125728])),
    (SceneKind::Dark, 1, Region::Inner, price([0.002159636, 0.003837, 0.141678, 0.146540])),
    (SceneKind::Dark, 2, Region::Whole, price([0.000819044, 0.006804, 0.133887, 0.141398])),
    (SceneKind::Dark, 2, Region::Inner, price([0.002080756, 0.007778, 0.167574, 0.175635])),
];

fn sensor(transfers: u32) -> SensorModel {
    SensorModel {
        width: SIZE.0,
        height: SIZE.1,
        transfers,
        substeps: SUBSTEPS,
        substep_policy: SubstepPolicy::Fixed,
        ..SensorModel::default()
    }
}

fn frames(kind: SceneKind) -> Sequence {
    scene(kind, SIZE, &times(0, FRAMES), HdrFormat::F32x4, MotionFormat::F32x2)
}

/// An interval's exact log intensities, `[sub-step][pixel]`.
type Exact = Vec<Vec<f64>>;

fn exact_log(kind: SceneKind) -> Vec<Exact> {
    let (scene, sensor) = (kind.scene(SIZE.0, SIZE.1), sensor(1));
    let pixels = move || (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
    let at = |interval: usize, substep: u32| {
        let since_start = FRAME_NS as f64 * f64::from(substep) / f64::from(SUBSTEPS);
        let view = scene.view((interval as f64 * FRAME_NS as f64 + since_start) * 1e-9);
        pixels().map(|(x, y)| log_intensity(&view, &sensor, x, y)).collect()
    };
    (0..FRAMES - 1).map(|interval| (1..=SUBSTEPS).map(|substep| at(interval, substep)).collect()).collect()
}

/// Mean errors of an oracle's synthesised levels in each region, over all sub-steps between the frames, nepers.
fn mean_errors_log(sensor: &SensorModel, sampling: Sampling, frames: &Sequence, exact: &[Exact]) -> [f64; 2] {
    let mut oracle = Oracle::with_sampling(sensor.clone(), 0, sampling).expect("a valid sensor");
    oracle.keep_samples(true);
    oracle.step(&frames.oracle_frame(0)).expect("the first frame");
    let mut sums = REGIONS.map(|_| (0.0, 0.0));
    for (index, exact) in (1..).zip(exact) {
        let interval = oracle.step(&frames.oracle_frame(index)).expect("a frame in time");
        let samples = interval.samples.expect("asked for");
        for pixel in 0..sensor.pixels() {
            // Leaves out the last sub-step, which ends with the frame itself.
            for (sample, exact) in samples.at(pixel).iter().zip(exact).take(SUBSTEPS as usize - 1) {
                let error = ((sample + sensor.log_offset).ln() - exact[pixel]).abs();
                for ((sum, count), _) in sums.iter_mut().zip(REGIONS).filter(|(_, region)| region.has(pixel))
                {
                    *sum += error;
                    *count += 1.0;
                }
            }
        }
    }
    sums.map(|(sum, count)| sum / count)
}

/// Prices in each region.
fn prices(sensor: &SensorModel, frames: &Sequence, exact: &[Exact]) -> [Price; 2] {
    let errors_log = |sampling| mean_errors_log(sensor, sampling, frames, exact);
    let ideal = errors_log(Sampling::IDEAL);
    let [twelve_taps, shared_footprint, all] =
        [TWELVE_TAPS, SHARED_FOOTPRINT, Sampling::ENGINE].map(errors_log);
    [0, 1].map(|region| {
        let more = |errors_log: [f64; 2]| errors_log[region] / ideal[region] - 1.0;
        Price {
            ideal_log: ideal[region],
            twelve_taps: more(twelve_taps),
            shared_footprint: more(shared_footprint),
            all: more(all),
        }
    })
}

/// Compares a price with the recorded one. A lower price fails too, so that the record stays right.
fn judge(recorded: &Price, actual: &Price) -> Result<(), String> {
    let within = |actual: f64, recorded: f64, noise: f64| (actual - recorded).abs() <= noise;
    let holds = within(actual.ideal_log, recorded.ideal_log, ERROR_NOISE * recorded.ideal_log)
        && within(actual.twelve_taps, recorded.twelve_taps, PRICE_NOISE)
        && within(actual.shared_footprint, recorded.shared_footprint, PRICE_NOISE)
        && within(actual.all, recorded.all, PRICE_NOISE);
    if holds { Ok(()) } else { Err(format!("{actual:.6?}, expected {recorded:.6?}")) }
}

#[test]
fn each_approximation_costs_what_it_is_known_to_cost() {
    let mut failures = Vec::new();
    for kind in [SceneKind::Edge, SceneKind::Sinusoid, SceneKind::Flight, SceneKind::Hdr, SceneKind::Dark] {
        let (frames, exact) = (frames(kind), exact_log(kind));
        for transfers in [1, 2] {
            for (region, actual) in REGIONS.into_iter().zip(prices(&sensor(transfers), &frames, &exact)) {
                let Price { ideal_log, twelve_taps, shared_footprint, all } = actual;
                println!(
                    "(SceneKind::{kind:?}, {transfers}, Region::{region:?}, price([{ideal_log:.9}, {twelve_taps:.6}, \
                     {shared_footprint:.6}, {all:.6}])),"
                );
                let case = (kind, transfers, region);
                let recorded = RECORDED.iter().find(|(kind, number, of, _)| (*kind, *number, *of) == case);
                match recorded.map(|(.., recorded)| judge(recorded, &actual)) {
                    Some(Ok(())) => {}
                    Some(Err(error)) => failures.push(format!("{case:?}: {error}")),
                    None => failures.push(format!("{case:?}: no price is recorded")),
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn a_scene_at_rest_costs_nothing() {
    let frames = frames(SceneKind::Still);
    let sensor = sensor(1);
    let samples = |sampling| {
        let mut oracle = Oracle::with_sampling(sensor.clone(), 0, sampling).expect("a valid sensor");
        oracle.keep_samples(true);
        (0..3)
            .map(|index| oracle.step(&frames.oracle_frame(index)).expect("in time").samples)
            .collect::<Vec<_>>()
    };
    assert_eq!(samples(Sampling::ENGINE), samples(Sampling::IDEAL));
}

#[test]
fn a_price_that_is_another_is_found() {
    let kind = SceneKind::Edge;
    let (frames, exact) = (frames(kind), exact_log(kind));
    let [right, _] = prices(&sensor(1), &frames, &exact);
    assert_eq!(judge(&right, &right), Ok(()));
    // A known-bad price: four taps in place of twelve or sixteen.
    let [bilinear, _] = prices(&SensorModel { taps: Taps::Bilinear, ..sensor(1) }, &frames, &exact);
    assert!(judge(&right, &bilinear).is_err(), "{bilinear:?}");
    // Prices under the wrong name, and a price of zero where there is one.
    assert!(judge(&right, &Price { twelve_taps: right.shared_footprint, ..right }).is_err());
    assert!(judge(&right, &Price { all: 0.0, ..right }).is_err());
    for noise in [-2.0, 2.0] {
        assert!(judge(&right, &Price { all: right.all + noise * PRICE_NOISE, ..right }).is_err());
        let ideal_log = right.ideal_log * (1.0 + noise * ERROR_NOISE);
        assert!(judge(&right, &Price { ideal_log, ..right }).is_err());
    }
}
