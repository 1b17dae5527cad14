//! Plots as SVG.

use anyhow::{Result, anyhow};
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;

/// Width and height of a plot.
const SIZE_PX: (u32, u32) = (980, 520);

/// Width of the legend at the plot's right.
const LEGEND_PX: u32 = 220;

/// Colours that colour-blind readers can tell apart (the palette of Okabe and Ito).
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(100, 100, 100),
    RGBColor(0, 0, 0),
];

/// Points that share a colour and a name.
#[derive(Clone, Debug)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Points, in order.
    pub points: Vec<(f64, f64)>,
    /// Whether a line joins them.
    pub line: bool,
    /// Whether each point has a mark.
    pub marks: bool,
}

impl Series {
    /// Marks joined by a line.
    #[must_use]
    pub fn curve(name: &str, points: Vec<(f64, f64)>) -> Self {
        Series { name: name.to_owned(), points, line: true, marks: true }
    }

    /// Marks alone.
    #[must_use]
    pub fn scatter(name: &str, points: Vec<(f64, f64)>) -> Self {
        Series { name: name.to_owned(), points, line: false, marks: true }
    }

    /// A line alone.
    #[must_use]
    pub fn path(name: &str, points: Vec<(f64, f64)>) -> Self {
        Series { name: name.to_owned(), points, line: true, marks: false }
    }
}

/// Titles of a plot and whether its axes are logarithmic.
#[derive(Clone, Copy, Debug)]
pub struct Axes<'a> {
    /// Title.
    pub title: &'a str,
    /// Title of the horizontal axis, with its unit.
    pub x: &'a str,
    /// Title of the vertical axis, with its unit.
    pub y: &'a str,
    /// Whether x and y are logarithmic. A logarithmic axis leaves out points at or below zero.
    pub logarithmic: (bool, bool),
}

/// Draws series and returns the SVG.
pub fn draw(axes: Axes<'_>, series: &[Series]) -> Result<String> {
    let (log_x, log_y) = axes.logarithmic;
    let shown = |p: &&(f64, f64)| {
        p.0.is_finite() && p.1.is_finite() && (!log_x || p.0 > 0.0) && (!log_y || p.1 > 0.0)
    };
    let series: Vec<Series> = series
        .iter()
        .map(|s| Series { points: s.points.iter().filter(shown).copied().collect(), ..s.clone() })
        .filter(|s| !s.points.is_empty())
        .collect();
    let all: Vec<(f64, f64)> = series.iter().flat_map(|s| s.points.iter().copied()).collect();
    if all.is_empty() {
        return Err(anyhow!("plot `{}` has no points", axes.title));
    }
    let x = range(all.iter().map(|p| p.0), log_x);
    let y = range(all.iter().map(|p| p.1), log_y);
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, SIZE_PX).into_drawing_area();
    root.fill(&WHITE).map_err(failed)?;
    let mut builder = ChartBuilder::on(&root);
    builder
        .caption(axes.title, ("sans-serif", 20))
        .margin(12)
        .margin_right(LEGEND_PX)
        .x_label_area_size(44)
        .y_label_area_size(64);
    let area = &mut builder;
    match axes.logarithmic {
        (false, false) => paint(area, x.0..x.1, y.0..y.1, axes, &series)?,
        (true, false) => paint(area, (x.0..x.1).log_scale(), y.0..y.1, axes, &series)?,
        (false, true) => paint(area, x.0..x.1, (y.0..y.1).log_scale(), axes, &series)?,
        (true, true) => paint(area, (x.0..x.1).log_scale(), (y.0..y.1).log_scale(), axes, &series)?,
    }
    legend(&root, &series)?;
    root.present().map_err(failed)?;
    drop(builder);
    drop(root);
    Ok(svg)
}

fn failed(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("plot: {error}")
}

/// The range of the values, with a margin.
fn range(values: impl Iterator<Item = f64>, logarithmic: bool) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if logarithmic {
        (low / 1.3, high * 1.3)
    } else {
        let room = 0.05 * (high - low).max(high.abs() * 0.02).max(1e-9);
        (if low >= 0.0 { 0.0 } else { low - room }, high + room)
    }
}

type Area<'a, 'b> = ChartBuilder<'a, 'b, SVGBackend<'b>>;

fn paint<'b, X, Y>(area: &mut Area<'_, 'b>, x: X, y: Y, axes: Axes<'_>, series: &[Series]) -> Result<()>
where
    X: AsRangedCoord<Value = f64>,
    Y: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64>,
    Y::CoordDescType: ValueFormatter<f64>,
{
    let mut chart = area.build_cartesian_2d(x, y).map_err(failed)?;
    let label = |v: &f64| tick(*v);
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc(axes.x)
        .y_desc(axes.y)
        .x_label_formatter(&label)
        .y_label_formatter(&label)
        .label_style(("sans-serif", 14))
        .draw()
        .map_err(failed)?;
    for (index, s) in series.iter().enumerate() {
        let colour = COLOURS[index % COLOURS.len()];
        if s.line {
            chart
                .draw_series(LineSeries::new(s.points.iter().copied(), colour.stroke_width(2)))
                .map_err(failed)?;
        }
        if s.marks {
            let mark = |&p: &(f64, f64)| Circle::new(p, 4, colour.filled());
            chart.draw_series(s.points.iter().map(mark)).map_err(failed)?;
        }
    }
    Ok(())
}

/// Draws the names of the series beside the chart, where they hide no points.
fn legend(root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>, series: &[Series]) -> Result<()> {
    let x = (SIZE_PX.0 - LEGEND_PX) as i32 + 12;
    for (index, s) in series.iter().enumerate() {
        let (y, colour) = (60 + 22 * index as i32, COLOURS[index % COLOURS.len()]);
        let height = if s.line && !s.marks { 1 } else { 5 };
        root.draw(&Rectangle::new([(x, y - height), (x + 12, y + height)], colour.filled()))
            .map_err(failed)?;
        root.draw(&Text::new(s.name.clone(), (x + 18, y - 6), ("sans-serif", 13))).map_err(failed)?;
    }
    Ok(())
}

/// Formats a figure at an axis. Whole numbers have no decimals.
fn tick(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e7 {
        format!("{value:.0}")
    } else {
        crate::document::short(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_hold_their_points_and_leave_out_what_no_axis_has() {
        let axes = Axes { title: "Cost", x: "time, us", y: "error", logarithmic: (true, true) };
        let points = vec![(1.0, 0.5), (10.0, 0.0), (100.0, 0.1), (f64::NAN, 1.0)];
        let svg = draw(axes, &[Series::scatter("a choice", points)]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 2, "{svg}");
        assert!(svg.contains("Cost") && svg.contains("a choice") && svg.contains("time, us"));
        assert!(draw(axes, &[Series::curve("none", vec![(0.0, 0.0)])]).is_err());
    }
}
