//! A simulated day in one run. At its end, time stamps, references, leak and random draws must be as exact as at its
//! start.

use crate::cells;
use crate::document::{Document, Outcome};
use crate::laboratory::Laboratory;
use anyhow::{Context, Result};
use esaac_engine::{CameraConfig, FrameBytes, Rig};
use esaac_model::packet::Event;
use esaac_model::{HdrFormat, Pixel, Polarity, SensorModel, Synthesis};
use serde::Serialize;

#[derive(Serialize)]
struct DayRow {
    what: &'static str,
    expected: String,
    actual: String,
    holds: bool,
}

/// Seconds of a day. `--quick` simulates its last ten minutes only.
const DAY_S: i64 = 86_400;
const HOUR_S: i64 = 3_600;
const QUICK_S: i64 = 600;

/// Largest relative rounding error of the leak. The engine holds the rate as a multiple of 2^-56 log/ns, so .002 log/s
/// is off by at most half of that.
const LEAK_ROUNDING: f64 = 3.5e-6;

/// Length of a tick: the longest interval that the engine takes.
const TICK_NS: i64 = 1_000_000_000;

pub(crate) fn run(laboratory: &Laboratory) -> Result<Outcome> {
    let mut document = Document::new("A simulated day");
    let seconds = if laboratory.options().quick { QUICK_S } else { DAY_S };
    let day = day(laboratory, seconds)?;
    document.say(&format!(
        "{seconds} intervals of one second that end 86400 s after zero, in one run without a reset. A column of \
         pixels each for the time stamps (log intensity goes up and down by .5 in turn), a reference after \
         millions of thresholds (up and down by 5.05), leak of .01 Hz, shot noise of 2 Hz, and the noise of a physical \
         pixel in the dark."
    ));
    let mut table = vec![cells!["what", "expected", "actual", "verdict"]];
    for row in &day {
        table.push(cells![row.what, row.expected, row.actual, if row.holds { "holds" } else { "**FAILS**" }]);
    }
    document.table(&table);
    Ok(Outcome { figures: serde_json::to_value(&day)?, document })
}

/// Number of pixels of the camera with leak.
const LEAK_PX: u16 = 4;

/// Number of pixels of each camera with noise.
const NOISE_PX: u32 = 64;

/// The events of the day's first and last part.
#[derive(Default)]
struct Ends {
    first: Vec<Event>,
    last: Vec<Event>,
    count: u64,
}

impl Ends {
    fn add(&mut self, tick: i64, seconds: i64, window: i64, events: impl ExactSizeIterator<Item = Event>) {
        self.count += events.len() as u64;
        if tick <= window {
            self.first.extend(events);
        } else if tick > seconds - window {
            self.last.extend(events);
        }
    }
}

fn day(laboratory: &Laboratory, seconds: i64) -> Result<Vec<DayRow>> {
    let still = SensorModel { height: 1, synthesis: Synthesis::Linear, ..SensorModel::default() };
    let steps = SensorModel { width: 2, synthesis: Synthesis::None, ..still.clone() };
    let leak = SensorModel { width: LEAK_PX.into(), leak_rate_hz: 0.01, ..still.clone() };
    let shot = SensorModel { width: NOISE_PX, shot_noise_rate_hz: 2.0, seed: 7, ..still.clone() };
    let physical = SensorModel {
        width: NOISE_PX,
        pixel: Pixel::Physical,
        contrast_on: 0.31,
        contrast_off: 0.29,
        refractory_ns: 100_000,
        dark_lux: 0.02,
        photoreceptor_charge_e: 150.0,
        seed: 8,
        ..still.clone()
    };
    let config = |(camera, sensor): (u32, &SensorModel)| CameraConfig {
        sensor: sensor.clone(),
        camera,
        hdr: HdrFormat::F32x4,
        motion: None,
        geometry: None,
    };
    let sensors = [&steps, &leak, &shot, &physical];
    let configs: Vec<CameraConfig> = (0..).zip(sensors).map(config).collect();
    let mut rig = Rig::new(laboratory.device(), &configs)?;
    let gray = |sensor: &SensorModel, log: &dyn Fn(usize) -> f64| -> Vec<u8> {
        (0..sensor.pixels())
            .flat_map(|pixel| [(log(pixel).exp() - sensor.log_offset) as f32; 4])
            .flat_map(f32::to_le_bytes)
            .collect()
    };
    // The image is dark: shot noise has its full rate there.
    let dark = gray(&shot, &|_| shot.log_offset.ln());
    let level = gray(&leak, &|_| 1.0);
    let swings = [0.0, 1.0].map(|up| gray(&steps, &|pixel| up * [0.5, 5.05][pixel]));
    rig.upload(1, &FrameBytes { hdr: &level, motion: None, ..FrameBytes::default() })?;
    for camera in [2, 3] {
        rig.upload(camera, &FrameBytes { hdr: &dark, motion: None, ..FrameBytes::default() })?;
    }
    let start_s = DAY_S - seconds;
    // Compares the last hour with the first; in a short run, the last quarter with the first.
    let window = (seconds / 4).min(HOUR_S);
    let mut ends: [Ends; 4] = Default::default();
    let ticks: Vec<i64> = (0..=seconds).collect();
    laboratory.rows("a day", ticks, |tick| {
        rig.upload(
            0,
            &FrameBytes { hdr: &swings[(tick % 2) as usize], motion: None, ..FrameBytes::default() },
        )?;
        let t_ns = (start_s + tick) * TICK_NS;
        let step = rig.step(&[t_ns; 4]).with_context(|| format!("second {tick}"))?;
        for (ends, packet) in ends.iter_mut().zip(step.packets) {
            ends.add(tick, seconds, window, packet.iter());
        }
        Ok(())
    })?;
    let [steps_ends, leak_ends, shot_ends, physical_ends] = &ends;
    let mut rows = vec![stamps(steps_ends, seconds), reference(steps_ends, seconds)];
    rows.push(leaked(leak_ends, seconds, start_s));
    rows.extend(noise(shot_ends, window));
    rows.push(physical_noise(physical_ends));
    Ok(rows)
}

fn times(events: &[Event], x: u16) -> Vec<(i64, Polarity)> {
    events.iter().filter(|e| e.x == x).map(|e| (e.t_ns, e.polarity)).collect()
}

/// Time stamps of the last two seconds. Brightness crosses thresholds at .4 and .8 of the rise, and at .6 and 1 of the
/// fall, because the reference then is .4 and not the peak.
fn stamps(ends: &Ends, seconds: i64) -> DayRow {
    let last = times(&ends.last, 0);
    let end_ns = DAY_S * TICK_NS;
    let tail: Vec<(i64, Polarity)> = last.into_iter().filter(|e| e.0 > end_ns - 2 * TICK_NS).collect();
    // An even number of seconds ends at the low level. The reference is 0 below and .4 above.
    let rise_ns = if seconds % 2 == 0 { end_ns - 2 * TICK_NS } else { end_ns - TICK_NS };
    let fall_ns = if seconds % 2 == 0 { end_ns - TICK_NS } else { end_ns - 2 * TICK_NS };
    let at = |start_ns: i64, share: f64| start_ns + (share * 1e9).round() as i64;
    let mut expected = [
        (at(rise_ns, 0.4), Polarity::On),
        (at(rise_ns, 0.8), Polarity::On),
        (at(fall_ns, 0.6), Polarity::Off),
        (at(fall_ns, 1.0), Polarity::Off),
    ];
    expected.sort();
    let worst = tail.iter().zip(&expected).map(|(a, b)| (a.0 - b.0).abs()).max().unwrap_or(i64::MAX);
    let same = tail.iter().map(|e| e.1).eq(expected.iter().map(|e| e.1));
    DayRow {
        what: "time stamps of the last two seconds",
        expected: "4 events within 1 us of their closed form".to_owned(),
        actual: format!("{} events, the worst {worst} ns off", tail.len()),
        holds: same && worst <= 1000,
    }
}

/// Brightness goes up or down by 25.25 thresholds each second. That gives 25 events each time, also at the day's end.
fn reference(ends: &Ends, seconds: i64) -> DayRow {
    let of_second = |events: &[Event], second: i64| {
        let start_ns = (DAY_S - seconds + second) * TICK_NS;
        let within = |e: &&Event| e.x == 1 && e.t_ns > start_ns && e.t_ns <= start_ns + TICK_NS;
        let times = events.iter().filter(within).map(|e| (e.t_ns - start_ns, e.polarity));
        times.collect::<Vec<_>>()
    };
    // Seconds alternate between rise and fall, and the reference needs some of them to settle into this cycle. So
    // compare the fifth second with a late one of the same direction.
    let (early, late) = (of_second(&ends.first, 4), of_second(&ends.last, seconds - 2 + seconds % 2));
    DayRow {
        what: "reference after a day of thresholds",
        expected: format!("{} events at the same nanoseconds as in the fifth second", early.len()),
        actual: format!("{} events, {}", late.len(), if early == late { "the same" } else { "OTHERS" }),
        holds: early == late && early.len() == 25,
    }
}

/// Each pixel begins anywhere on its way to its first leak event, and sends one after each period from then on.
fn leaked(ends: &Ends, seconds: i64, start_s: i64) -> DayRow {
    const PERIOD_NS: i64 = 100 * TICK_NS;
    let bound_ns = LEAK_ROUNDING * (seconds * TICK_NS) as f64;
    let (mut begin_in_time, mut worst_ns, mut due) = (true, 0, 0);
    for x in 0..LEAK_PX {
        let (first, last) = (times(&ends.first, x), times(&ends.last, x));
        let [first_ns, last_ns] =
            [first.first(), last.last()].map(|e| e.map_or(0, |e| e.0 - start_s * TICK_NS));
        begin_in_time &= (1..=PERIOD_NS).contains(&first_ns);
        let periods = (last_ns - first_ns + PERIOD_NS / 2) / PERIOD_NS;
        worst_ns = worst_ns.max((last_ns - first_ns - periods * PERIOD_NS).abs());
        due += 1 + (seconds * TICK_NS - first_ns) / PERIOD_NS;
    }
    DayRow {
        what: "leak of .01 Hz",
        expected: format!(
            "{due} events on {LEAK_PX} pixels, by their first ones; the last ones within {bound_ns:.0} ns"
        ),
        actual: format!("{} events, the worst {worst_ns} ns off", ends.count),
        // Rounding decides whether the event at the very end is in.
        holds: begin_in_time
            && worst_ns as f64 <= bound_ns
            && ends.count.abs_diff(due as u64) <= u64::from(LEAK_PX),
    }
}

/// Shot noise at both ends of the day: its rates, and whether a draw is repeated.
fn noise(ends: &Ends, window: i64) -> Vec<DayRow> {
    let mean = 2.0 * f64::from(NOISE_PX) * window as f64;
    let bound = 5.0 * mean.sqrt();
    let rate = |what: &'static str, events: &[Event]| DayRow {
        what,
        expected: format!("{mean:.0} +- {bound:.0} events (5 sigma)"),
        actual: format!("{} events", events.len()),
        holds: (events.len() as f64 - mean).abs() <= bound,
    };
    // Gaps between the events of a pixel follow from draws, so a counter that wrapped would repeat them in order. One
    // gap may repeat by chance. Two in a row practically cannot: there are some 1e5 pairs, and 1e15 pairs are possible.
    let pairs = |events: &[Event]| {
        let mut last = vec![[None, None]; NOISE_PX as usize];
        let mut pairs = Vec::new();
        for e in events {
            let [before, gap] = &mut last[usize::from(e.x)];
            if let Some(before_ns) = before.replace(e.t_ns) {
                let now = e.t_ns - before_ns;
                pairs.extend(gap.replace(now).map(|earlier: i64| (earlier, now)));
            }
        }
        pairs
    };
    let early: std::collections::HashSet<(i64, i64)> = pairs(&ends.first).into_iter().collect();
    let late = pairs(&ends.last);
    let again = late.iter().filter(|pair| early.contains(pair)).count();
    vec![
        rate("shot noise at the start", &ends.first),
        rate("shot noise at the end", &ends.last),
        DayRow {
            what: "random counters at the end",
            expected: format!("none of {} pairs of gaps as at the start", late.len()),
            actual: format!("{again}"),
            holds: again == 0 && late.len() > 100,
        },
    ]
}

/// Noise of the physical pixel in the dark at both ends of the day.
fn physical_noise(ends: &Ends) -> DayRow {
    let [first, last] = [&ends.first, &ends.last].map(Vec::len);
    DayRow {
        what: "noise of a physical pixel at the end",
        expected: format!("{first} events as at the start, to a tenth"),
        actual: format!("{last} events"),
        // Such a window has some thousand events.
        holds: first > 1000 && last.abs_diff(first) <= first / 10,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_that_drifts_and_a_counter_that_wraps_are_found() {
        let swing = |second: i64, shift_ns: i64| {
            (1..=25).map(move |i| Event {
                t_ns: (DAY_S - 100 + second) * TICK_NS + i * 1_000_000 + shift_ns,
                y: 0,
                x: 1,
                polarity: Polarity::On,
            })
        };
        let ends =
            |shift_ns| Ends { first: swing(4, 0).collect(), last: swing(98, shift_ns).collect(), count: 50 };
        assert!(reference(&ends(0), 100).holds);
        assert!(!reference(&ends(1), 100).holds);
        // Periods of 100 s from another time on in each pixel; the last one `off_ns` late, in a leak that is off by more.
        let leak = |off_ns: i64, missing: u64| {
            let begin_ns = |x: u16| (DAY_S - QUICK_S) * TICK_NS + (i64::from(x) + 1) * 20 * TICK_NS;
            let event = |x, t_ns| Event { t_ns, y: 0, x, polarity: Polarity::On };
            let first = (0..LEAK_PX).map(|x| event(x, begin_ns(x))).collect();
            let last = (0..LEAK_PX).map(|x| event(x, begin_ns(x) + 500 * TICK_NS + off_ns)).collect();
            leaked(&Ends { first, last, count: 24 - missing }, QUICK_S, DAY_S - QUICK_S)
        };
        assert!(leak(0, 0).holds && leak(2_000, 0).holds, "{}", leak(0, 0).actual);
        assert!(!leak(3_000_000, 0).holds && !leak(0, 5).holds);
        let noise_of = |last_seed: u64| {
            let stream = |seed: u64| {
                let mut state = seed;
                (0..12_800_u64)
                    .map(|i| {
                        state = state
                            .wrapping_mul(6_364_136_223_846_793_005)
                            .wrapping_add(1_442_695_040_888_963_407);
                        Event {
                            t_ns: (i * 7_812_500 + (state >> 44)) as i64,
                            y: 0,
                            x: (i % 64) as u16,
                            polarity: Polarity::On,
                        }
                    })
                    .collect::<Vec<_>>()
            };
            noise(&Ends { first: stream(1), last: stream(last_seed), count: 0 }, 100)
        };
        assert!(noise_of(2).iter().all(|row| row.holds), "{}", noise_of(2)[2].actual);
        assert!(!noise_of(1)[2].holds);
        let physical = |count: i64| {
            let events = |count: i64| (0..count).flat_map(|second| swing(second, 0)).collect();
            physical_noise(&Ends { first: events(100), last: events(count), count: 0 }).holds
        };
        assert!(physical(105) && !physical(120) && !physical(80));
    }
}
