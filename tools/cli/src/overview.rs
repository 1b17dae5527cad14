//! The overview picture: RGB, APS, gray events, Bayer events and depth at several instants.

use crate::canvas::{Align, Canvas, text_width_px};
use crate::colour::{self, Rgb};
use esaac_model::Packet;

const PAPER: Rgb = [0xff, 0xff, 0xff];
const INK: Rgb = [0x20, 0x24, 0x2b];
const FAINT: Rgb = [0x6b, 0x72, 0x7d];
const LINE: Rgb = [0xd9, 0xdc, 0xe1];
const COLUMNS: [&str; 5] = ["RGB", "APS", "Gray events", "Bayer events", "Depth"];

/// Panels are enlarged or reduced by a whole factor to about this width.
const PANEL_WIDTH_PX: usize = 340;
/// Brightness of the RGB panels relative to middle gray's.
const KEY: f32 = 1.6;
const GAP_PX: usize = 10;
const MARGIN_PX: usize = 28;
const LABEL_PX: usize = 84;
const TITLE_PX: usize = 96;
const LEGEND_PX: usize = 64;

/// A row of the picture: a frame, and the events of the interval that it ends.
#[derive(Clone, Debug, Default)]
pub struct Instant {
    /// Time of the frame, nanoseconds.
    pub t_ns: i64,
    /// Linear radiance of each pixel.
    pub rgb: Vec<[f32; 3]>,
    /// APS frame, 0 to 1, if there is one.
    pub aps: Option<Vec<f32>>,
    /// Events of the gray camera in the interval.
    pub gray: Packet,
    /// Events of the Bayer camera in the interval.
    pub bayer: Packet,
    /// Depth of each pixel, metres.
    pub depth_m: Vec<f32>,
}

/// Text above the picture.
#[derive(Clone, Debug, Default)]
pub struct Caption {
    /// In large type.
    pub title: String,
    /// In small type, below the title.
    pub subtitle: String,
}

/// Draws a row for each instant, from the top. Images have `width_px` x `height_px`.
#[must_use]
pub fn draw(caption: &Caption, (width_px, height_px): (usize, usize), instants: &[Instant]) -> Canvas {
    let scale = Scale::for_width(width_px);
    let panel = (scale.apply(width_px), scale.apply(height_px));
    let width = 2 * MARGIN_PX + LABEL_PX + COLUMNS.len() * panel.0 + (COLUMNS.len() - 1) * GAP_PX;
    let height = MARGIN_PX + TITLE_PX + instants.len() * (panel.1 + GAP_PX) + LEGEND_PX;
    let mut canvas = Canvas::new(width, height, PAPER);
    let (left, top) = (MARGIN_PX + LABEL_PX, MARGIN_PX + TITLE_PX);
    let column_x = |column: usize| left + column * (panel.0 + GAP_PX);

    canvas.text(&caption.title, (left as f32, 46.0), Align::Left, 34.0, INK);
    canvas.text(&caption.subtitle, (left as f32, 74.0), Align::Left, 20.0, FAINT);
    for (column, name) in COLUMNS.iter().enumerate() {
        let middle = column_x(column) as f32 + panel.0 as f32 / 2.0;
        canvas.text(name, (middle, top as f32 - 12.0), Align::Centre, 24.0, INK);
    }

    let exposure =
        KEY * colour::exposure(instants.iter().flat_map(|i| &i.rgb).map(|&c| colour::luminance(c)));
    let depths = DepthRange::of(instants.iter().flat_map(|i| i.depth_m.iter().copied()));
    for (row, instant) in instants.iter().enumerate() {
        let y = top + row * (panel.1 + GAP_PX);
        let middle = y as f32 + panel.1 as f32 / 2.0;
        let end = (left - 14) as f32;
        canvas.text(
            &format!("{:.0} ms", instant.t_ns as f64 * 1e-6),
            (end, middle + 8.0),
            Align::Right,
            24.0,
            INK,
        );
        let picture = |pixels: Vec<Rgb>| Canvas { width_px, height_px, pixels };
        let panels = [
            Some(picture(instant.rgb.iter().map(|&c| colour::tone_map(c, exposure)).collect())),
            instant
                .aps
                .as_ref()
                .map(|aps| picture(aps.iter().map(|&v| [colour::encode_srgb(v); 3]).collect())),
            Some(picture(event_pixels(&instant.gray, width_px * height_px, width_px))),
            Some(picture(event_pixels(&instant.bayer, width_px * height_px, width_px))),
            Some(picture(instant.depth_m.iter().map(|&d| depths.colour(d)).collect())),
        ];
        for (column, picture) in panels.into_iter().enumerate() {
            let x = column_x(column);
            canvas.fill((x - 1, y - 1), (panel.0 + 2, panel.1 + 2), LINE);
            match picture {
                Some(picture) => canvas.draw((x, y), &scale.resample(&picture)),
                None => canvas.fill((x, y), panel, PAPER),
            }
        }
    }

    let baseline = top + instants.len() * (panel.1 + GAP_PX) + 34;
    draw_event_legend(&mut canvas, column_x(2), baseline);
    draw_depth_legend(&mut canvas, column_x(4), baseline, panel.0, &depths);
    canvas
}

fn event_pixels(packet: &Packet, pixels: usize, width_px: usize) -> Vec<Rgb> {
    let mut counts = vec![[0_u32; 2]; pixels];
    for ((&x, &y), &polarity) in packet.x.iter().zip(&packet.y).zip(&packet.polarity) {
        counts[usize::from(y) * width_px + usize::from(x)][usize::from(polarity)] += 1;
    }
    counts.into_iter().map(|[off, on]| colour::events(on, off)).collect()
}

fn draw_event_legend(canvas: &mut Canvas, x: usize, baseline: usize) {
    let mut pen = x;
    for (name, colour) in [("ON", colour::ON), ("OFF", colour::OFF)] {
        canvas.fill((pen, baseline - 14), (16, 16), colour);
        canvas.text(name, ((pen + 24) as f32, baseline as f32), Align::Left, 20.0, FAINT);
        pen += 24 + text_width_px(name, 20.0) as usize + 28;
    }
    canvas.text("events since the previous frame", (pen as f32, baseline as f32), Align::Left, 20.0, FAINT);
}

fn draw_depth_legend(canvas: &mut Canvas, x: usize, baseline: usize, width: usize, depths: &DepthRange) {
    let (near, far) = (format!("{:.1} m", depths.near_m), format!("{:.1} m", depths.far_m));
    let (before, after) = (text_width_px(&near, 20.0) as usize + 10, text_width_px(&far, 20.0) as usize + 10);
    let bar = width.saturating_sub(before + after);
    canvas.text(&near, (x as f32, baseline as f32), Align::Left, 20.0, FAINT);
    for column in 0..bar {
        let shade = colour::depth(column as f32 / bar as f32);
        canvas.fill((x + before + column, baseline - 14), (1, 16), shade);
    }
    canvas.text(&far, ((x + width) as f32, baseline as f32), Align::Right, 20.0, FAINT);
}

/// Range of depths that the colour map covers, on a logarithmic scale.
#[derive(Clone, Copy, Debug, PartialEq)]
struct DepthRange {
    near_m: f32,
    far_m: f32,
}

impl DepthRange {
    /// The 1st to the 98th percentile of the valid depths, so that a far background leaves colours for the
    /// rest.
    fn of(depths_m: impl Iterator<Item = f32>) -> Self {
        let mut sorted: Vec<f32> = depths_m.filter(|d| is_surface(*d)).collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let at = |quantile: f64| {
            let rank = (quantile * sorted.len().saturating_sub(1) as f64).round() as usize;
            sorted.get(rank).copied()
        };
        let near_m = at(0.01).unwrap_or(1.0);
        let far_m = at(0.98).unwrap_or(10.0).max(near_m * 1.01);
        DepthRange { near_m, far_m }
    }

    fn colour(&self, depth_m: f32) -> Rgb {
        if !is_surface(depth_m) {
            return colour::depth(1.0);
        }
        colour::depth((depth_m / self.near_m).ln() / (self.far_m / self.near_m).ln())
    }
}

fn is_surface(depth_m: f32) -> bool {
    depth_m > 0.0 && depth_m < 1e4
}

/// The whole factor between the sensor's size and a panel's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scale {
    Enlarge(usize),
    Reduce(usize),
}

impl Scale {
    fn for_width(width_px: usize) -> Self {
        if width_px > PANEL_WIDTH_PX * 3 / 2 {
            Scale::Reduce(width_px.div_ceil(PANEL_WIDTH_PX * 3 / 2))
        } else {
            Scale::Enlarge((PANEL_WIDTH_PX / width_px.max(1)).max(1))
        }
    }

    fn apply(self, length_px: usize) -> usize {
        match self {
            Scale::Enlarge(factor) => length_px * factor,
            Scale::Reduce(factor) => length_px / factor,
        }
    }

    fn resample(self, picture: &Canvas) -> Canvas {
        match self {
            Scale::Enlarge(factor) => picture.enlarged(factor),
            Scale::Reduce(factor) => picture.reduced(factor),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Polarity;
    use esaac_model::packet::Event;

    fn instant(width: usize, height: usize) -> Instant {
        let mut gray = Packet::default();
        gray.push(Event { t_ns: 0, x: 0, y: 0, polarity: Polarity::On });
        Instant {
            rgb: vec![[1.0; 3]; width * height],
            depth_m: vec![f32::INFINITY; width * height],
            gray,
            ..Instant::default()
        }
    }

    #[test]
    fn any_size_is_drawn() {
        for (width, height) in [(1, 1), (37, 23), (346, 260), (1280, 720), (2049, 3)] {
            let picture = draw(&Caption::default(), (width, height), &[instant(width, height)]);
            assert!((200..4000).contains(&picture.width_px), "{width}x{height}: {}", picture.width_px);
        }
    }

    #[test]
    fn an_event_is_drawn_at_its_pixel() {
        let picture = draw(&Caption::default(), (346, 260), &[instant(346, 260)]);
        let (x, y) = (MARGIN_PX + LABEL_PX + 2 * (346 + GAP_PX), MARGIN_PX + TITLE_PX);
        assert_eq!(picture.pixels[y * picture.width_px + x], colour::events(1, 0));
        assert_eq!(picture.pixels[y * picture.width_px + x + 1], colour::NO_EVENT);
    }

    #[test]
    fn depth_range_ignores_the_background() {
        let mut depths = vec![2.0; 50];
        depths.extend([4.0; 50]);
        depths.extend([0.0, f32::INFINITY, f32::NAN, 1e10]);
        assert_eq!(DepthRange::of(depths.into_iter()), DepthRange { near_m: 2.0, far_m: 4.0 });
    }
}
