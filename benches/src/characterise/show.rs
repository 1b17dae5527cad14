//! A characterisation as plots and text.

use super::response::LightStep;
use super::{Characterisation, saturation};
use crate::cells;
use crate::document::{Document, short};
use crate::plot::{Axes, Series, draw};
use anyhow::Result;

/// Plots as SVG, by name. A curve without points has none.
pub fn plots(of: &Characterisation) -> Result<Vec<(&'static str, String)>> {
    let mut plots = Vec::new();
    let mut add = |name, axes: Axes<'_>, series: Vec<Series>| -> Result<()> {
        let (log_x, log_y) = axes.logarithmic;
        let shown = |p: &(f64, f64)| {
            p.0.is_finite() && p.1.is_finite() && (!log_x || p.0 > 0.0) && (!log_y || p.1 > 0.0)
        };
        if series.iter().any(|series| series.points.iter().any(shown)) {
            plots.push((name, draw(axes, &series)?));
        }
        Ok(())
    };
    let name = &of.sensor.name;
    let title = format!("{name}: share of pixels that answer a step");
    let axes = Axes { title: &title, x: "step, log", y: "share", logarithmic: (false, false) };
    let mut series = Vec::new();
    for curve in &of.s_curves {
        let points = |of: fn(&super::s_curve::StepAnswer) -> f64| {
            curve.steps.iter().map(|step| (step.step_log, of(step))).collect()
        };
        series.push(Series::scatter(&format!("{} lux, measured", curve.lux), points(|s| s.answered)));
        series.push(Series::path(&format!("{} lux, law of noise", curve.lux), points(|s| s.watched)));
    }
    add("s_curve", axes, series)?;

    let title = format!("{name}: noise in still light, after {} s", of.burn_in_s);
    let axes = Axes { title: &title, x: "light, lux", y: "events a pixel and s", logarithmic: (true, true) };
    let noise = |of: &[super::noise::NoisePoint], hz: fn(&super::noise::NoisePoint) -> f64| {
        of.iter().map(|point| (point.lux, hz(point))).collect()
    };
    let public = |hz: fn(&super::public::PublishedNoise) -> f64| {
        of.published.noise.iter().map(|point| (point.lux, hz(point))).collect()
    };
    let series = vec![
        Series::curve("ON", noise(&of.noise, |p| p.on_hz)),
        Series::curve("OFF", noise(&of.noise, |p| p.off_hz)),
        Series::path("leak alone", noise(&of.noise, |p| p.leak_hz.abs())),
        Series::scatter("published, ON", public(|p| p.on_hz)),
        Series::scatter("published, OFF", public(|p| p.off_hz)),
    ];
    add("noise", axes, series)?;

    let title = format!("{name}: frequency at which 3 dB are lost");
    let axes = Axes { title: &title, x: "light, lux", y: "Hz", logarithmic: (true, true) };
    let series = vec![
        Series::scatter("measured", of.bandwidth.iter().map(|p| (p.lux, p.f3db_hz)).collect()),
        Series::path("two poles", of.bandwidth.iter().map(|p| (p.lux, p.model_hz)).collect()),
        Series::scatter("published", of.published.bandwidth.iter().map(|p| (p.lux, p.hz)).collect()),
    ];
    add("bandwidth", axes, series)?;

    let title = format!("{name}: latency of the first event after a step");
    let axes = Axes { title: &title, x: "brighter light, lux", y: "us", logarithmic: (true, true) };
    let mut series = Vec::new();
    for step in LightStep::ALL {
        let own = of.latency.iter().filter(|point| point.step == step);
        series.push(Series::curve(step.name(), own.map(|p| (p.lux, p.median_us)).collect()));
    }
    for step in LightStep::ALL {
        let own = of.published.latency.iter().filter(|point| point.step == step);
        let points: Vec<(f64, f64)> = own.map(|p| (p.lux, p.us)).collect();
        if !points.is_empty() {
            series.push(Series::scatter(&format!("published, {}", step.name()), points));
        }
    }
    add("latency", axes, series)?;

    let title = format!("{name}: gaps between events of a pixel in a rise from darkness");
    let axes = Axes { title: &title, x: "light after the rise, lux", y: "us", logarithmic: (true, true) };
    let everywhere = |us: f64| of.refractory.iter().map(|point| (point.lux, us)).collect();
    let series = vec![
        Series::scatter("shortest", of.refractory.iter().map(|p| (p.lux, p.shortest_us)).collect()),
        Series::curve("median", of.refractory.iter().map(|p| (p.lux, p.median_us)).collect()),
        Series::path("refractory period", everywhere(refractory_us(of))),
        Series::path("published", of.published.refractory_us.map_or(Vec::new(), everywhere)),
    ];
    add("refractory", axes, series)?;

    let title = format!("{name}: leak without noise");
    let axes = Axes { title: &title, x: "light, lux", y: "events a pixel and s", logarithmic: (true, false) };
    let mut series = Vec::new();
    for of_temperature in of.leak.chunk_by(|a, b| a.temperature_c == b.temperature_c) {
        let celsius = short(of_temperature[0].temperature_c);
        let points = |hz: fn(&super::noise::LeakPoint) -> f64| {
            of_temperature.iter().map(|point| (point.lux, hz(point))).collect()
        };
        series.push(Series::scatter(&format!("{celsius} C, measured"), points(|p| p.measured_hz)));
        series.push(Series::path(&format!("{celsius} C, equation"), points(|p| p.model_hz)));
    }
    add("leak", axes, series)?;

    let title = format!("{name}: events that leave the bus");
    let axes = Axes { title: &title, x: "active pixels", y: "events a s", logarithmic: (true, true) };
    let of_bus = |hz: fn(&super::saturation::SaturationPoint) -> f64| {
        of.saturation.iter().map(|point| (point.active as f64, hz(point))).collect()
    };
    let series = vec![
        Series::scatter("left", of_bus(|p| p.left_hz)),
        Series::path("asked for", of_bus(|p| p.asked_hz)),
        Series::path("the bus at most", of_bus(|p| p.model_hz)),
    ];
    add("saturation", axes, series)?;
    Ok(plots)
}

/// The sensor's parameter, microseconds.
fn refractory_us(of: &Characterisation) -> f64 {
    f64::from(of.sensor.refractory_ns) * 1e-3
}

/// The text of a characterisation, with the plots that it names.
pub fn document(of: &Characterisation) -> Result<Document> {
    let mut document = Document::new(&format!("Sensor {}", of.sensor.name));
    document.say(&format!(
        "{} pixels for each level of light, of noise and S-curves. Noise is counted for {} s, {} s after the light is \
         switched on. Light is that on the focal plane.",
        of.pixels, of.seconds, of.burn_in_s
    ));
    let mut table = vec![cells!["light, lux", "ON, Hz", "OFF, Hz", "published ON, OFF", "all / published"]];
    for point in &of.noise {
        let public = of.published.noise.iter().find(|public| public.lux == point.lux);
        let both = public.map_or("".into(), |p| format!("{}, {}", short(p.on_hz), short(p.off_hz)));
        let ratio = public.map_or("".into(), |p| short(point.hz() / (p.on_hz + p.off_hz)));
        table.push(cells![short(point.lux), short(point.on_hz), short(point.off_hz), both, ratio]);
    }
    document.heading("Noise");
    document.table(&table);
    document.heading("Speed");
    let mut table = vec![cells!["light, lux", "3 dB lost at, Hz", "two poles, Hz"]];
    table.extend(of.bandwidth.iter().map(|p| cells![short(p.lux), short(p.f3db_hz), short(p.model_hz)]));
    document.table(&table);
    let mut table = vec![cells!["step", "light, lux", "latency, us", "+-", "without noise, us", "answered"]];
    table.extend(of.latency.iter().map(|p| {
        let answered = format!("{:.0}%", 100.0 * p.answered);
        cells![
            p.step.name(),
            short(p.lux),
            short(p.median_us),
            short(p.jitter_us),
            short(p.model_us),
            answered
        ]
    }));
    document.table(&table);
    document.heading("Refractory period");
    document.say(&format!(
        "The sensor's is {} us{}. A gap between two events is as long, and the time to the next threshold.",
        short(refractory_us(of)),
        of.published.refractory_us.map_or(String::new(), |us| format!(", published are {} us", short(us)))
    ));
    let mut table = vec![cells!["rise from darkness to, lux", "shortest gap, us", "median, us"]];
    table
        .extend(of.refractory.iter().map(|p| cells![short(p.lux), short(p.shortest_us), short(p.median_us)]));
    document.table(&table);
    document.heading("S-curve");
    let mut table =
        vec![cells!["light, lux", "half answer, log", "width, log", "noise, log", "mismatch, log"]];
    table.extend(of.s_curves.iter().map(|curve| {
        let mismatch = short(of.sensor.contrast_mismatch);
        let [half, width, sigma] = [curve.half_log, curve.width_log, curve.sigma_log].map(short);
        cells![short(curve.lux), half, width, sigma, mismatch]
    }));
    document.table(&table);
    document.heading("Saturation of the bus");
    document.say(&saturation::told());
    let mut table = vec![cells!["active pixels", "asked for, 1/s", "left, 1/s", "equation, 1/s", "lost"]];
    table.extend(of.saturation.iter().map(|p| {
        let lost = format!("{:.0}%", 100.0 * (1.0 - p.left_hz / p.asked_hz).max(0.0));
        cells![p.active, short(p.asked_hz), short(p.left_hz), short(p.model_hz), lost]
    }));
    document.table(&table);
    document.heading("Leak");
    let mut table = vec![cells!["light, lux", "temperature, C", "measured, Hz", "equation, Hz"]];
    table.extend(
        of.leak
            .iter()
            .map(|p| cells![short(p.lux), short(p.temperature_c), short(p.measured_hz), short(p.model_hz)]),
    );
    document.table(&table);
    for source in &of.published.sources {
        document.say(&format!("Published {source}."));
    }
    for (name, svg) in plots(of)? {
        document.plot(name, name, svg);
    }
    Ok(document)
}
