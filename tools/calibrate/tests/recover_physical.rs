//! A physical pixel of known parameters is recovered from its own recordings under known light. The engine makes the
//! recordings and does the fit.

use esaac_calibrate::physical::{
    Exposures, Flicker, Light, PhysicalFit, Shape, expose, fit_physical, fit_scene, read_exposures,
};
use esaac_formats::event_file::{EventColumns, write_npz};
use esaac_model::presets::preset_with_physical_pixel;
use esaac_model::{Pixel, Polarity, SensorModel};
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::recording;
use std::path::Path;

/// Columns and rows of the recorded sensor.
const SIZE_PX: (u32, u32) = (24, 16);

/// Time after which still light is recorded, seconds.
const BURN_IN_S: f64 = 3.0;

/// Length of a recording of still light, seconds.
const SECONDS: f64 = 30.0;

/// Largest errors of a fit, as a share.
const THRESHOLD: f64 = 0.05;
const SPEED: f64 = 0.2;
const CHARGE: f64 = 0.15;
const REFRACTORY: f64 = 0.1;
/// The same of the mismatch (log), the leak (Hz), and of the dark current, as a factor.
const MISMATCH_LOG: f64 = 0.012;
const LEAK_HZ: f64 = 0.05;
const DARK: f64 = 1.6;
/// Largest root mean square of the differences, in their errors. Fits of ten seeds have .23 to .51. A search that stops
/// before the squares are least has .9 and more, with the second pole a quarter off.
const MISFIT: f64 = 0.6;
/// Both ends of the second pole's interval are apart by less than this factor if flicker of several hundred Hz tells it, by
/// more if only dim light does.
const TOLD: f64 = 1.6;

/// Unlike the first guess in every parameter.
fn known() -> SensorModel {
    SensorModel {
        name: "known".into(),
        width: SIZE_PX.0,
        height: SIZE_PX.1,
        contrast_on: 0.31,
        contrast_off: 0.27,
        contrast_mismatch: 0.03,
        refractory_ns: 200_000,
        response_e_per_lux_s: 1.6e5,
        photoreceptor_charge_e: 260.0,
        second_pole_hz: 500.0,
        dark_lux: 0.08,
        leak_rate_hz: 0.15,
        ..preset_with_physical_pixel("hd").expect("listed")
    }
}

fn lights() -> Vec<Light> {
    let still = [0.05, 0.4, 2.0, 6.0, 40.0].map(|lux| (lux, None, SECONDS));
    // Bright and slow: thresholds. Dim: the first pole. Bright and fast: the second.
    let swinging = [(100.0, 4.0), (0.4, 50.0), (300.0, 200.0), (300.0, 400.0), (300.0, 800.0)]
        .map(|(lux, hz)| (lux, Some(Flicker { hz, depth: 0.8, shape: Shape::Sine }), 8.0 / hz));
    still
        .into_iter()
        .chain(swinging)
        .map(|(lux, flicker, seconds)| Light { lux, flicker, burn_in_s: BURN_IN_S, seconds })
        .collect()
}

/// Records the sensor and writes the recordings and their list, as a user has them.
fn record(folder: &Path, sensor: &SensorModel, lights: &[Light]) {
    let mut list = format!("burn_in_s = {BURN_IN_S}\n");
    for (number, light) in lights.iter().enumerate() {
        let exposure = expose(&DEVICE, sensor, SIZE_PX, light).expect("an exposure");
        let mut columns = EventColumns::default();
        // What `expose` leaves out at the start is left out again when the list is read.
        for event in &exposure.events {
            columns.x.push(event.x);
            columns.y.push(event.y);
            columns.t_ns.push(event.t_ns + (BURN_IN_S * 1e9) as i64);
            columns.sign.push(if event.polarity == Polarity::On { 1 } else { -1 });
        }
        let file = std::fs::File::create(folder.join(format!("{number}.npz"))).expect("a file");
        write_npz(file, &columns, &sensor.to_toml()).expect("written");
        let seconds = exposure.seconds + BURN_IN_S;
        list.push_str(&format!(
            "[[exposure]]\nfile = \"{number}.npz\"\nlux = {}\nseconds = {seconds}\n",
            light.lux
        ));
        if let Some(flicker) = light.flicker {
            list.push_str(&format!("flicker_hz = {}\ndepth = {}\n", flicker.hz, flicker.depth));
            if flicker.shape == Shape::Step {
                list.push_str("kind = \"step\"\n");
            }
        }
    }
    std::fs::write(folder.join("list.toml"), list).expect("written");
}

/// Says whether a fit's interval of the second pole holds the known one, and by which factor its ends are apart.
fn second_pole(fit: &PhysicalFit, known: &SensorModel) -> (bool, f64) {
    let [least_hz, most_hz] =
        [fit.second_pole.least_hz, fit.second_pole.most_hz].map(|hz| hz.expect("an end of the interval"));
    ((least_hz..=most_hz).contains(&known.second_pole_hz), most_hz / least_hz)
}

/// Records the sensor and checks the fit. Returns the recordings too.
fn recover(known: &SensorModel) -> (Exposures, PhysicalFit) {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path(), known, &lights());
    let exposures = read_exposures(&folder.path().join("list.toml")).unwrap();
    let guess = preset_with_physical_pixel("hd").expect("listed");
    let fit = fit_physical(&DEVICE, &exposures, &guess, |_, _| {}).unwrap();
    let found = &fit.sensor;
    println!("{fit:#?}");
    let share = |what: &str, actual: f64, expected: f64, bound: f64| {
        println!("{what}: {actual:.4}, known {expected:.4}");
        (actual / expected - 1.0).abs() <= bound
    };
    let pole = |s: &SensorModel| s.response_e_per_lux_s / s.photoreceptor_charge_e;
    let (inside, apart) = second_pole(&fit, known);
    let holds = [
        share("contrast_on", found.contrast_on, known.contrast_on, THRESHOLD),
        share("contrast_off", found.contrast_off, known.contrast_off, THRESHOLD),
        share("response over charge", pole(found), pole(known), SPEED),
        share("second_pole_hz", found.second_pole_hz, known.second_pole_hz, SPEED),
        share("charge", found.photoreceptor_charge_e, known.photoreceptor_charge_e, CHARGE),
        share("refractory_ns", found.refractory_ns.into(), known.refractory_ns.into(), REFRACTORY),
        share("dark_lux", found.dark_lux, known.dark_lux, DARK - 1.0),
        (found.contrast_mismatch - known.contrast_mismatch).abs() <= MISMATCH_LOG,
        (found.leak_rate_hz - known.leak_rate_hz).abs() <= LEAK_HZ,
        inside && apart < TOLD,
        fit.misfit < MISFIT,
    ];
    println!("mismatch {} and {}", found.contrast_mismatch, known.contrast_mismatch);
    println!("leak {} and {}", found.leak_rate_hz, known.leak_rate_hz);
    assert!(holds.into_iter().all(|holds| holds), "{holds:?}");
    assert_eq!(fit.remarks, [""; 0]);
    assert_eq!(SensorModel::from_toml(&found.to_toml()).as_ref(), Ok(found));
    assert_silent();
    (exposures, fit)
}

/// With the recordings of this seed a search that stops too early is a quarter off in the second pole. Without fast flicker the
/// interval of the second pole is wide, and still holds it.
#[test]
fn a_known_physical_pixel_is_recovered_from_its_recordings_and_dim_ones_tell_less() {
    let known = SensorModel { seed: 1, ..known() };
    let (mut exposures, whole) = recover(&known);
    exposures.all.retain(|exposure| match exposure.flicker {
        Some(flicker) => flicker.hz < 100.0,
        None => exposure.lux < 1.0,
    });
    assert_eq!(exposures.all.len(), 4);
    let fit = fit_physical(&DEVICE, &exposures, &whole.sensor, |_, _| {}).unwrap();
    println!("{fit:#?}");
    let (inside, apart) = second_pole(&fit, &known);
    assert!(inside && apart > TOLD, "{:?}", fit.second_pole);
    assert_silent();
}

/// Steps in dim and in bright light tell both poles, without a flicker as fast as these.
#[test]
fn both_poles_are_recovered_from_steps() {
    let known = SensorModel { seed: 79, ..known() };
    let folder = tempfile::tempdir().unwrap();
    let light = |(lux, hz, depth, shape): (f64, f64, f64, Shape)| {
        let flicker = Some(Flicker { hz, depth, shape });
        Light { lux, flicker, burn_in_s: BURN_IN_S, seconds: 2.0 / hz }
    };
    let still = [2.0, 10.0].map(|lux| Light { lux, flicker: None, burn_in_s: BURN_IN_S, seconds: 8.0 });
    let swinging = [
        (100.0, 4.0, 0.8, Shape::Sine),
        (0.4, 5.0, 0.6, Shape::Step),
        (4.0, 25.0, 0.6, Shape::Step),
        (500.0, 100.0, 0.6, Shape::Step),
    ];
    let lights: Vec<Light> = still.into_iter().chain(swinging.map(light)).collect();
    record(folder.path(), &known, &lights);
    let exposures = read_exposures(&folder.path().join("list.toml")).unwrap();
    let guess = preset_with_physical_pixel("hd").expect("listed");
    let fit = fit_physical(&DEVICE, &exposures, &guess, |_, _| {}).unwrap();
    let pole = |s: &SensorModel| s.response_e_per_lux_s / s.photoreceptor_charge_e;
    let of = |s: &SensorModel| [pole(s), s.second_pole_hz, s.contrast_on, s.contrast_off];
    println!("known {:?}, found {:?}, guess {:?}\n{fit:#?}", of(&known), of(&fit.sensor), of(&guess));
    for (at, bound) in [SPEED, SPEED, THRESHOLD, THRESHOLD].into_iter().enumerate() {
        let ratio = of(&fit.sensor)[at] / of(&known)[at];
        assert!((ratio - 1.0).abs() <= bound, "{at}: {ratio}");
        assert!((of(&guess)[at] / of(&known)[at] - 1.0).abs() > 0.05, "{at}: the guess was unlike it");
    }
    assert!(fit.misfit < MISFIT, "{}", fit.misfit);
    let (inside, apart) = second_pole(&fit, &known);
    assert!(inside && apart < TOLD, "{:?}", fit.second_pole);
    assert_silent();
}

/// The scene is too slow to tell the refractory period, which stays that of the guess.
#[test]
fn thresholds_are_recovered_from_a_scene() {
    let pixel = preset_with_physical_pixel("davis346").expect("listed");
    let known = SensorModel {
        pixel: Pixel::Physical,
        contrast_on: 0.31,
        contrast_off: 0.27,
        contrast_mismatch: 0.02,
        refractory_ns: 800_000,
        ..recording::sensor().with_physical(&pixel.physical_pixel())
    };
    // Full scale of the frames is 4 units.
    let known = SensorModel { lux_per_unit: 25.0, ..known };
    let recorded = recording::record(&known, 31);
    let guess = SensorModel { lux_per_unit: 100.0, ..pixel };
    let found = fit_scene(&DEVICE, &recorded, 0.01, &guess).unwrap();
    println!("{found:?}");
    for (what, actual, expected) in [
        ("contrast_on", found.contrast_on, known.contrast_on),
        ("contrast_off", found.contrast_off, known.contrast_off),
    ] {
        assert!((actual / expected - 1.0).abs() <= THRESHOLD, "{what}: {actual}, known {expected}");
    }
    assert_eq!(found.refractory_ns, guess.refractory_ns);
    assert_silent();
}

#[test]
fn lists_that_say_too_little_or_something_impossible_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let sensor = SensorModel { width: 2, height: 1, ..known() };
    let file = std::fs::File::create(folder.path().join("a.npz")).unwrap();
    let columns = EventColumns {
        x: vec![0, 1],
        y: vec![0, 0],
        t_ns: vec![0, 2_000_000_000],
        sign: vec![1, -1],
        ids: None,
    };
    write_npz(file, &columns, &sensor.to_toml()).unwrap();
    let list = |text: &str| {
        let path = folder.path().join("list.toml");
        std::fs::write(&path, text).unwrap();
        read_exposures(&path)
    };
    let refused = |text: &str| format!("{:#}", list(text).unwrap_err());
    let entry = |rest: &str| format!("[[exposure]]\nfile = \"a.npz\"\n{rest}");
    assert!(refused("").contains("exposure"));
    assert!(refused(&entry("lux = -1.0")).contains("lux is -1, expected 1e-6 to 1e6"));
    assert!(refused(&entry("lux = 1.0\nflicker_hz = 5.0")).contains("flicker_hz and depth together"));
    assert!(refused(&entry("lux = 1.0\nflicker_hz = 5.0\ndepth = 1.5")).contains("depth is 1.5"));
    assert!(refused(&entry("lux = 1.0\nlight = 2")).contains("light"));
    assert!(refused(&entry("lux = 1.0\nkind = \"ramp\"")).contains("ramp"));
    assert!(refused(&entry("lux = 1.0\nkind = \"step\"")).contains("steps have both"));
    let step = "lux = 1.0\nkind = \"step\"\nflicker_hz = 5.0\ndepth = 0.5";
    assert!(refused(&entry(step)).contains("expected `seconds` for steps"));
    assert!(refused(&entry(&step.replace("5.0", "0.5"))).contains("flicker_hz is 0.5, expected 1 to 1e5"));
    assert!(refused(&format!("burn_in_s = 9.0\n{}", entry("lux = 1.0"))).contains("burn-in of 9 s"));
    assert!(refused("[[exposure]]\nfile = \"none.npz\"\nlux = 1.0").contains("cannot read"));
    assert!(refused("[[exposure]]\nfile = \"a.csv\"\nlux = 1.0").contains(".npz, .aedat4 or .raw"));
    let one = list(&entry("lux = 1.0")).unwrap();
    assert_eq!((one.all[0].events.len(), one.all[0].seconds), (2, 2.0));
    let guess = preset_with_physical_pixel("hd").expect("listed");
    let error = fit_physical(&DEVICE, &one, &guess, |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("1 exposure has still light, expected at least 2"), "{error}");
    let log = esaac_model::presets::preset("hd").expect("listed");
    let error = fit_physical(&DEVICE, &one, &log, |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("expected a physical one"), "{error}");
}
