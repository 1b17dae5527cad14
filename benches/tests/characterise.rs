//! What is measured of a sensor through the engine against the model's closed forms and published figures.

use esaac_benches::characterise::noise::{leak, noise_at};
use esaac_benches::characterise::public::{NIST_W_PER_M2, lux_of, published};
use esaac_benches::characterise::response::{LightStep, bandwidth_at, latency, latency_at, refractory};
use esaac_benches::characterise::s_curve::{SCurve, s_curve};
use esaac_benches::characterise::saturation::saturation_at;
use esaac_benches::characterise::{Lab, characterise};
use esaac_model::physical::DOUBLING_K;
use esaac_model::presets::{preset, preset_with_physical_pixel};
use esaac_model::{ReadoutKind, SensorModel};
use esaac_tests::device::{DEVICE, assert_silent};

fn hd() -> SensorModel {
    preset_with_physical_pixel("hd").expect("listed")
}

fn lab(pixels: u32, burn_in_s: u32, seconds: u32) -> Lab<'static> {
    Lab::new(&DEVICE, pixels, burn_in_s, seconds)
}

/// Largest difference of two shares at a step.
fn apart(curve: &SCurve, of: fn(&esaac_benches::characterise::s_curve::StepAnswer) -> f64) -> f64 {
    curve.steps.iter().map(|step| (step.answered - of(step)).abs()).fold(0.0, f64::max)
}

#[test]
fn the_guide_takes_published_light_as_the_code_does() {
    let guide = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/guide/sensors.md");
    let guide = std::fs::read_to_string(guide).expect("the guide's page on sensors");
    let stated = format!("white light of {} lm/W", lux_of(1.0));
    assert!(guide.contains(&stated), "{stated} is not in the guide, which has pictures by it");
}

#[test]
fn s_curves_are_those_of_the_law_of_noise() {
    let lab = lab(1024, 0, 1);
    // Mismatch alone, and mismatch that outweighs the noise: the normal distribution of both.
    let wide = SensorModel { contrast_mismatch: 0.05, ..hd() };
    for (sensor, lux) in [(SensorModel { noise_gain: 0.0, ..wide.clone() }, 30.0), (wide, 3e4)] {
        let curve = s_curve(&lab, &sensor, lux).unwrap();
        // A share of 1024 pixels has a deviation of at most .016.
        let apart = apart(&curve, |step| step.one_look);
        assert!(apart < 0.055, "{apart}: {curve:?}");
        assert!((curve.half_log / sensor.contrast_on - 1.0).abs() < 0.03, "{}", curve.half_log);
    }
    // Noise that outweighs the mismatch: a comparator that watches sees more of it than one that looks once.
    for lux in [1.0, 30.0] {
        let curve = s_curve(&lab, &hd(), lux).unwrap();
        let (watched, looked) = (apart(&curve, |step| step.watched), apart(&curve, |step| step.one_look));
        println!("{lux} lux: {watched:.3} from the law of noise, {looked:.3} from one look");
        assert!(watched < 0.08 && watched < 0.5 * looked, "{lux} lux: {watched} and {looked}");
    }
    assert_silent();
}

#[test]
fn hd_has_the_published_noise_in_the_engine() {
    let public = published("hd").noise;
    let levels: Vec<f64> = public.iter().map(|point| point.lux).filter(|lux| *lux <= 20.0).collect();
    assert_eq!(levels.len(), 7);
    let measured = noise_at(&lab(256, 5, 30), &hd(), &levels).unwrap();
    for (point, public) in measured.iter().zip(&public) {
        let ratio = point.hz() / (public.on_hz + public.off_hz);
        println!("{} lux: {ratio:.2} of the published rate", point.lux);
        assert!((1.0 / 1.5..1.5).contains(&ratio), "{point:?} {public:?}");
    }
    let peak = measured.iter().max_by(|a, b| a.hz().total_cmp(&b.hz())).unwrap();
    assert!((1.0..=5.0).contains(&peak.lux), "{peak:?}");
    assert_silent();
}

#[test]
fn hd_is_as_fast_as_published_and_as_its_equations_say() {
    let lab = lab(64, 0, 1);
    for lux in [0.1, 10.0, 300.0] {
        let point = bandwidth_at(&lab, &hd(), lux).unwrap();
        assert!((point.f3db_hz / point.model_hz - 1.0).abs() < 0.03, "{point:?}");
    }
    let measured = latency(&lab, &hd()).unwrap();
    for point in measured.iter().filter(|point| point.step == LightStep::FromDark && point.lux >= 0.3) {
        let ratio = point.median_us / point.model_us;
        assert!((ratio - 1.0).abs() < 0.06 && point.answered == 1.0, "{point:?}");
    }
    // NIST's slope: latency against one over irradiance, 3.34 us W/m2; by the engine and by the equations.
    let nist = latency_at(&lab, &hd(), &NIST_W_PER_M2.map(lux_of)).unwrap();
    let nist: Vec<_> = nist.iter().filter(|point| point.step == LightStep::FromDark).collect();
    let per_watt = 1.0 / NIST_W_PER_M2[0] - 1.0 / NIST_W_PER_M2[2];
    for slope in [nist[0].median_us - nist[2].median_us, nist[0].model_us - nist[2].model_us] {
        let slope = slope / per_watt;
        println!("slope {slope:.2} us W/m2");
        assert!((slope / 3.34 - 1.0).abs() < 0.2, "{slope}: {nist:?}");
    }
    let gaps = refractory(&lab, &hd()).unwrap();
    let period_us = f64::from(hd().refractory_ns) * 1e-3;
    assert!(gaps.iter().all(|point| (period_us..=point.median_us).contains(&point.shortest_us)), "{gaps:?}");
    assert!(gaps.windows(2).all(|pair| pair[1].shortest_us <= pair[0].shortest_us), "{gaps:?}");
    let brightest = gaps.last().expect("levels of light");
    assert!(brightest.shortest_us < period_us + 11.0, "{brightest:?}");
    assert_silent();
}

/// The tick of the time stamps, jitter and the bus say when an event is told, not when its pixel sends it.
#[test]
fn speed_is_that_of_the_pixel() {
    let lab = lab(64, 0, 1);
    let told_late = SensorModel {
        timestamp_quantum_ns: 1_000_000,
        latency_jitter_ns: 300_000,
        readout: ReadoutKind::Fifo,
        readout_event_ns: 5_000.0,
        ..hd()
    };
    let point = bandwidth_at(&lab, &told_late, 100.0).unwrap();
    assert!((point.f3db_hz / point.model_hz - 1.0).abs() < 0.03, "{point:?}");
    let gaps = refractory(&lab, &told_late).unwrap();
    let period_us = f64::from(told_late.refractory_ns) * 1e-3;
    assert!(gaps.iter().all(|point| point.shortest_us >= period_us), "{gaps:?}");
    let coarse = SensorModel { latency_jitter_ns: 0, ..told_late };
    let measured = latency_at(&lab, &coarse, &[10.0]).unwrap();
    let point = measured.iter().find(|point| point.step == LightStep::FromDark).unwrap();
    assert!((point.median_us / point.model_us - 1.0).abs() < 0.06, "{point:?}");
    assert_silent();
}

/// No frequency is 0 Hz.
#[test]
fn a_bandwidth_that_light_below_the_dark_current_hides_is_none() {
    let hot = SensorModel { temperature_c: 125.0, ..hd() };
    let point = bandwidth_at(&lab(64, 0, 1), &hot, 0.01).unwrap();
    assert!(point.f3db_hz.is_nan() && point.model_hz > 0.0, "{point:?}");
    let json = serde_json::to_value(point).unwrap();
    assert!(json["f3db_hz"].is_null(), "{json}");
    assert_silent();
}

#[test]
fn the_leak_of_a_hot_chip_is_compared_with_a_cooler_ones() {
    let hot = SensorModel { temperature_c: 116.3, ..hd() };
    let points = leak(&lab(32, 0, 1), &hot).unwrap();
    let (warm, cold) = points.split_at(points.len() / 2);
    for (warm, cold) in warm.iter().zip(cold) {
        assert_eq!((warm.temperature_c, cold.temperature_c), (116.3, 116.3 - DOUBLING_K));
        assert!((warm.measured_hz / cold.measured_hz - 2.0).abs() < 0.06, "{cold:?} {warm:?}");
    }
    assert_silent();
}

#[test]
fn leak_and_dark_current_double_with_warmth() {
    let lab = lab(32, 0, 1);
    let points = leak(&lab, &hd()).unwrap();
    for point in &points {
        assert!((point.measured_hz / point.model_hz - 1.0).abs() < 0.03, "{point:?}");
    }
    let (cold, warm) = points.split_at(points.len() / 2);
    for (cold, warm) in cold.iter().zip(warm) {
        assert!((warm.measured_hz / cold.measured_hz - 2.0).abs() < 0.06, "{cold:?} {warm:?}");
    }
    // In light as dim as the dark current, the corner frequency tells it.
    let cold = SensorModel { temperature_c: 25.0, ..hd() };
    let warm = SensorModel { temperature_c: 25.0 + DOUBLING_K, ..hd() };
    let lux = cold.dark_lux;
    let [cold, warm] = [cold, warm].map(|sensor| bandwidth_at(&lab, &sensor, lux).unwrap().f3db_hz);
    assert!((warm / cold - 1.5).abs() < 0.06, "{cold} and {warm} Hz");
    assert_silent();
}

#[test]
fn a_log_intensity_pixel_is_refused() {
    let error = characterise(&lab(8, 0, 1), &preset("hd").expect("listed")).unwrap_err().to_string();
    assert!(error.contains("`hd` has a log-intensity pixel"), "{error}");
}

#[test]
fn a_bus_that_has_no_saturation_is_told_before_anything_is_measured() {
    let sensor = SensorModel { readout_row_ns: 0.0, readout_event_ns: 0.0, ..hd() };
    let error = format!("{:#}", characterise(&lab(8, 0, 1), &sensor).unwrap_err());
    assert!(
        error.contains("curve of its saturation") && error.contains("`readout_event_ns` is 0"),
        "{error}"
    );
}

/// One by one a bus sends at most an event a service, however many pixels ask; by row it sends more the more of a row wait.
#[test]
fn a_bus_saturates_as_its_services_say() {
    let lab = lab(64, 0, 1);
    for name in ["davis346", "hd"] {
        let sensor = preset_with_physical_pixel(name).expect("listed");
        for (active, saturated) in [(64, false), (1024, false), (4096, true)] {
            let point = saturation_at(&lab, &sensor, active).unwrap();
            println!("{name}, {active} pixels: {point:?}");
            assert_eq!(point.left_hz < 0.9 * point.asked_hz, saturated, "{name}: {point:?}");
            assert!((point.left_hz / point.model_hz - 1.0).abs() < 0.05, "{name}: {point:?}");
        }
    }
    assert_silent();
}
