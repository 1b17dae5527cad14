//! Time per interval.

use super::sensors::{MODES, RIGID_MODES, clean, noisy, stages};
use crate::amount::Amount;
use crate::cells;
use crate::document::{Document, Outcome, short};
use crate::floor::FORMATS;
use crate::laboratory::Laboratory;
use crate::measure::{Run, Stand, Timing};
use crate::paper::{FACTORS, SENSORS, TIME_MS};
use crate::plot::{Axes, Series, draw};
use anyhow::Result;
use esaac_engine::{PacketPlace, RigOptions};
use esaac_model::{Intensity, SensorModel, Synthesis, Taps};
use esaac_scene::SceneKind;
use serde::Serialize;

/// Rows with bilinear taps, in addition to those with the default taps.
const BILINEAR_MODES: [(&str, Intensity); 2] =
    [("gray, bilinear", Intensity::Gray), ("bayer, bilinear", Intensity::BayerRggb)];

/// The mode of many cameras, and what tells a mode with synthesis `rigid` from the same without.
const LUMINANCE_RIGID: &str = "luminance, rigid";
const RIGID_SUFFIX: &str = ", rigid";

/// The modes of synthesis `motion` with several surfaces where motions meet, and what tells them from the same with one.
const GRAY_LAYERS: &str = "gray, layers";
const LUMINANCE_LAYERS: &str = "luminance, layers";
const LAYERS_SUFFIX: &str = ", layers";
const LAYERS: u32 = 3;

/// The modes of the physical pixel with its noise, and what tells them from the same with the noisy log pixel.
const GRAY_PHYSICAL: &str = "gray, physical";
const LUMINANCE_PHYSICAL: &str = "luminance, physical";
const PHYSICAL_SUFFIX: &str = ", physical";

/// The sensor of the rows with every effect off, as a preset is by default.
const CLEAN_SENSOR: &str = "davis346";
const CLEAN_MODES: [(&str, Intensity, Taps); 4] = [
    ("gray, clean", Intensity::Gray, Taps::Cubic),
    ("bayer, clean", Intensity::BayerRggb, Taps::Cubic),
    ("gray, bilinear, clean", Intensity::Gray, Taps::Bilinear),
    ("bayer, bilinear, clean", Intensity::BayerRggb, Taps::Bilinear),
];

#[derive(Serialize)]
struct Row {
    sensor: String,
    mode: &'static str,
    substeps: u32,
    cameras: usize,
    pixels: usize,
    #[serde(flatten)]
    timing: Timing,
    stages_us: Vec<(&'static str, f64)>,
    /// Median GPU time of ticks whose packets stay on the device, microseconds. `None` on a software device, which has
    /// no bus.
    on_device_us: Option<f64>,
}

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let mut cases = Vec::new();
    let shortest = laboratory.is_software() && laboratory.options().quick;
    let factors = if shortest { &FACTORS[FACTORS.len() - 1..] } else { &FACTORS };
    for sensor in SENSORS {
        for &substeps in factors {
            for (mode, intensity) in MODES {
                cases.push((SensorModel { substeps, intensity, ..noisy(sensor) }, mode, 1));
            }
        }
        for (mode, intensity) in BILINEAR_MODES {
            cases.push((SensorModel { taps: Taps::Bilinear, intensity, ..noisy(sensor) }, mode, 1));
        }
        if sensor == CLEAN_SENSOR {
            for (mode, intensity, taps) in CLEAN_MODES {
                cases.push((SensorModel { taps, intensity, ..clean(sensor) }, mode, 1));
            }
        }
        for (mode, intensity) in RIGID_MODES {
            cases.push((SensorModel { synthesis: Synthesis::Rigid, intensity, ..noisy(sensor) }, mode, 1));
        }
    }
    for sensor in SENSORS {
        cases.push((SensorModel { layers: LAYERS, ..noisy(sensor) }, GRAY_LAYERS, 1));
    }
    for sensor in SENSORS {
        cases.push((noisy(sensor).with_preset_pixel(), GRAY_PHYSICAL, 1));
    }
    if !shortest {
        cases.push((noisy("vga"), "luminance", 1));
        cases.push((noisy("hd"), "luminance", 1));
    }
    if !laboratory.is_software() {
        cases.push((noisy("vga"), "luminance", 8));
        cases.push((noisy("vga"), "luminance", 64));
        cases.push((SensorModel { synthesis: Synthesis::Rigid, ..noisy("vga") }, LUMINANCE_RIGID, 64));
        cases.push((SensorModel { layers: LAYERS, ..noisy("vga") }, LUMINANCE_LAYERS, 64));
        cases.push((noisy("vga").with_preset_pixel(), LUMINANCE_PHYSICAL, 64));
        cases.push((noisy("davis346"), "luminance", 8));
    }
    let name = |(s, mode, cameras): &(SensorModel, &str, usize)| {
        format!("{cameras} x {} x{} {mode}", s.name, s.substeps)
    };
    cases.retain(|case| laboratory.wants(&name(case)));
    // Rows of one size share rigs, because a software driver takes seconds to compile for a new one.
    let mut stands: Option<Stands<'_>> = None;
    let rows = laboratory.rows("time", cases, |(sensor, mode, cameras)| {
        let rigid = sensor.synthesis == Synthesis::Rigid;
        let fits =
            |s: &Stands<'_>| (s.size, s.cameras, s.rigid) == ((sensor.width, sensor.height), cameras, rigid);
        let stands = match &mut stands {
            Some(stands) if fits(stands) => stands,
            other => other.insert(Stands::new(laboratory, &sensor, cameras)?),
        };
        stands.measure(laboratory, &sensor, mode)
    })?;
    let document = show(&rows)?;
    Ok(Outcome { figures: serde_json::to_value(&rows)?, document })
}

/// Three rigs: one without time stamps between stages, one with them, because they cost time, and one that leaves its
/// packets on the device.
struct Stands<'l> {
    size: (u32, u32),
    cameras: usize,
    /// Whether they take depth, ids and poses.
    rigid: bool,
    plain: Stand<'l>,
    /// `None` on a software device, where time stamps cost too little to show.
    stamped: Option<Stand<'l>>,
    on_device: Option<Stand<'l>>,
}

impl<'l> Stands<'l> {
    fn new(laboratory: &'l Laboratory, sensor: &SensorModel, cameras: usize) -> Result<Self> {
        let size = (sensor.width, sensor.height);
        let rigid = sensor.synthesis == Synthesis::Rigid;
        let stand = |stage_times, packets| {
            let feed = laboratory.scene(SceneKind::Flight, size)?;
            let options = RigOptions { stage_times, packets, ..RigOptions::default() };
            Stand::new(laboratory, sensor, cameras, FORMATS, feed, options)
        };
        let owned = PacketPlace::Owned;
        if laboratory.is_software() {
            let plain = stand(true, owned)?;
            return Ok(Stands { size, cameras, rigid, plain, stamped: None, on_device: None });
        }
        let (stamped, on_device) = (stand(true, owned)?, stand(false, PacketPlace::OnDevice)?);
        let plain = stand(false, owned)?;
        Ok(Stands { size, cameras, rigid, plain, stamped: Some(stamped), on_device: Some(on_device) })
    }

    fn measure(&mut self, laboratory: &Laboratory, sensor: &SensorModel, mode: &'static str) -> Result<Row> {
        let amount = laboratory.amount();
        self.plain.set_sensor(sensor)?;
        let Run { timing, mut stages_us, .. } = self.plain.run(amount)?;
        if let Some(stamped) = &mut self.stamped {
            let timed = (amount.frames - 1 - amount.warm_up).div_ceil(3);
            stamped.set_sensor(sensor)?;
            stages_us = stamped.run(Amount { frames: 1 + amount.warm_up + timed, ..amount })?.stages_us;
        }
        let mut on_device_us = None;
        if let Some(on_device) = &mut self.on_device {
            on_device.set_sensor(sensor)?;
            on_device_us = Some(on_device.run(amount)?.timing.gpu_us.median);
        }
        Ok(Row {
            sensor: sensor.name.clone(),
            mode,
            substeps: sensor.substeps,
            cameras: self.cameras,
            pixels: sensor.pixels(),
            timing,
            stages_us,
            on_device_us,
        })
    }
}

impl Row {
    /// Formats the time with packets to the host, and after a slash with packets on the device.
    fn times(&self) -> String {
        let on_device = self.on_device_us.map(|us| format!(" / {}", short(us)));
        short(self.timing.gpu_us.median) + &on_device.unwrap_or_default()
    }
}

fn show(rows: &[Row]) -> Result<Document> {
    let mut document = Document::new("Time per interval");
    let [gray, bayer] = TIME_MS;
    document.say(&format!(
        "Microseconds of GPU time per interval, the whole tick with the packet's way to host memory, and, after the \
         stroke, of ticks whose packets stay on the device; profile `noisy` but for the rows called clean, scene `flight`, motion \
         with cubic taps and two transfers but for those called bilinear, and along exact paths and with three those called rigid. The paper's figure (RTX 4060) runs from {} to {} ms in gray and {} to {} ms in Bayer over the same cells.",
        gray[0], gray[1], bayer[0], bayer[1]
    ));
    let in_table = |r: &&Row| r.cameras == 1 && MODES.iter().any(|&(mode, _)| r.mode == mode);
    let factors: Vec<u32> =
        FACTORS.into_iter().filter(|&n| rows.iter().filter(in_table).any(|r| r.substeps == n)).collect();
    let mut head = cells!["sensor"];
    for substeps in &factors {
        head.extend(MODES.map(|(mode, _)| format!("x{substeps} {mode}")));
    }
    let mut table = vec![head];
    for sensor in SENSORS {
        let of_sensor: Vec<&Row> = rows.iter().filter(in_table).filter(|r| r.sensor == sensor).collect();
        if !of_sensor.is_empty() && of_sensor.len() == factors.len() * MODES.len() {
            let figures = of_sensor.iter().map(|r| r.times());
            table.push(std::iter::once(sensor.to_owned()).chain(figures).collect());
        }
    }
    if table.len() > 1 {
        document.table(&table);
        document.plot("time", "Time per interval", plot(rows)?);
    }
    for (suffix, columns, about) in [
        (
            RIGID_SUFFIX,
            ["motion", "rigid"],
            "What exact paths cost, x32: `rigid` from depth, ids and poses beside `motion` from vectors.",
        ),
        (
            LAYERS_SUFFIX,
            ["one surface", "three"],
            "What several surfaces a pixel cost where motions meet, x32: synthesis `motion` with `layers` 3 beside 0, which is \
             one surface in this scene.",
        ),
        (
            PHYSICAL_SUFFIX,
            ["log pixel", "physical pixel"],
            "What the physical pixel costs, x32: the preset's with its noise beside the log pixel with every effect.",
        ),
    ] {
        let prices = prices(rows, suffix, columns);
        if prices.len() > 1 {
            document.say(about);
            document.table(&prices);
        }
    }
    document.say(
        "Floor: the greater of compulsory bytes over measured memory bandwidth and counted operations over \
         measured arithmetic rate, for the sub-steps and events that there were.",
    );
    let mut table = vec![cells![
        "row",
        "GPU us",
        "quartiles",
        "floor us",
        "ratio",
        "packet p50 us",
        "p99",
        "events a px",
        "sub-steps",
        "Mev/s",
        "stages, us"
    ]];
    for row in rows {
        let t = &row.timing;
        table.push(cells![
            format!("{} x {} x{} {}", row.cameras, row.sensor, row.substeps, row.mode),
            row.times(),
            format!("{}-{}", short(t.gpu_us.lower_quartile), short(t.gpu_us.upper_quartile)),
            short(t.floor_us),
            short(t.gpu_us.median / t.floor_us),
            short(t.packet_us.median),
            short(t.packet_us.p99),
            short(t.events_per_pixel),
            short(t.substeps_per_block),
            short(t.events / t.gpu_us.median),
            stages(&row.stages_us)
        ]);
    }
    document.table(&table);
    Ok(document)
}

/// A line for each pair of rows whose modes differ in `suffix` alone; `columns` names a row without it and one with it.
fn prices(rows: &[Row], suffix: &str, columns: [&str; 2]) -> Vec<Vec<String>> {
    let [without, with] = columns;
    let mut table = vec![cells![
        "row",
        format!("{without}, us"),
        format!("{with}, us"),
        "ratio",
        format!("{with}: stages, us")
    ]];
    for row in rows {
        let Some(mode) = row.mode.strip_suffix(suffix) else { continue };
        let same = |r: &&Row| {
            r.mode == mode && (&r.sensor, r.cameras, r.substeps) == (&row.sensor, row.cameras, row.substeps)
        };
        let Some(plain) = rows.iter().find(same) else { continue };
        table.push(cells![
            format!("{} x {} {mode}", row.cameras, row.sensor),
            plain.times(),
            row.times(),
            format!("{:.2}", row.timing.gpu_us.median / plain.timing.gpu_us.median),
            stages(&row.stages_us)
        ]);
    }
    table
}

fn plot(rows: &[Row]) -> Result<String> {
    let mut series = Vec::new();
    for (mode, _) in MODES {
        for substeps in FACTORS {
            let points: Vec<(f64, f64)> = rows
                .iter()
                .filter(|r| r.mode == mode && r.substeps == substeps)
                .map(|r| (r.pixels as f64, r.timing.gpu_us.median))
                .collect();
            series.push(Series::curve(&format!("x{substeps} {mode}"), points));
        }
    }
    let floor = rows.iter().filter(|r| r.mode == "gray" && r.substeps == 32);
    series.push(Series::curve(
        "floor, x32 gray",
        floor.map(|r| (r.pixels as f64, r.timing.floor_us)).collect(),
    ));
    let axes = Axes { title: "Time per interval", x: "pixels", y: "GPU time, us", logarithmic: (true, true) };
    draw(axes, &series)
}
