//! An RGB picture with rectangles, images and text.

use crate::colour::{Rgb, mix};
use ab_glyph::{Font, FontRef, PxScale, ScaleFont};
use anyhow::Result;
use std::io::Write;

/// Pixels in rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Canvas {
    /// Width, pixels.
    pub width_px: usize,
    /// Height, pixels.
    pub height_px: usize,
    /// Row-major pixels.
    pub pixels: Vec<Rgb>,
}

/// How a text is placed relative to its x.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// x is its left end.
    Left,
    /// x is its middle.
    Centre,
    /// x is its right end.
    Right,
}

impl Canvas {
    /// A canvas of one colour.
    #[must_use]
    pub fn new(width_px: usize, height_px: usize, colour: Rgb) -> Self {
        Canvas { width_px, height_px, pixels: vec![colour; width_px * height_px] }
    }

    /// Fills a rectangle, clipped to the canvas.
    pub fn fill(&mut self, (x, y): (usize, usize), (width, height): (usize, usize), colour: Rgb) {
        for row in y..(y + height).min(self.height_px) {
            let start = row * self.width_px;
            let (from, to) = (x.min(self.width_px), (x + width).min(self.width_px));
            self.pixels[start + from..start + to].fill(colour);
        }
    }

    /// Copies a picture to `(x, y)`, clipped to the canvas.
    pub fn draw(&mut self, (x, y): (usize, usize), picture: &Canvas) {
        for row in 0..picture.height_px.min(self.height_px.saturating_sub(y)) {
            let columns = picture.width_px.min(self.width_px.saturating_sub(x));
            let to = (y + row) * self.width_px + x;
            let from = row * picture.width_px;
            self.pixels[to..to + columns].copy_from_slice(&picture.pixels[from..from + columns]);
        }
    }

    /// The picture enlarged by a whole factor. Each pixel becomes a square.
    #[must_use]
    pub fn enlarged(&self, factor: usize) -> Canvas {
        let (width, height) = (self.width_px * factor, self.height_px * factor);
        let pixels = (0..width * height)
            .map(|i| self.pixels[(i / width / factor) * self.width_px + (i % width) / factor])
            .collect();
        Canvas { width_px: width, height_px: height, pixels }
    }

    /// The picture reduced by a whole factor. Each pixel is the mean of a square.
    #[must_use]
    pub fn reduced(&self, factor: usize) -> Canvas {
        let (width, height) = (self.width_px / factor, self.height_px / factor);
        let mean = |i: usize| {
            let (x, y) = (i % width * factor, i / width * factor);
            let mut sum = [0_usize; 3];
            for row in y..y + factor {
                for pixel in &self.pixels[row * self.width_px + x..][..factor] {
                    sum.iter_mut().zip(pixel).for_each(|(s, &v)| *s += usize::from(v));
                }
            }
            sum.map(|s| (s / (factor * factor)) as u8)
        };
        Canvas { width_px: width, height_px: height, pixels: (0..width * height).map(mean).collect() }
    }

    /// Writes `text` with its baseline at `y`.
    pub fn text(&mut self, text: &str, (x, y): (f32, f32), align: Align, height_px: f32, colour: Rgb) {
        let font = font();
        let scaled = font.as_scaled(PxScale::from(height_px));
        let shift = match align {
            Align::Left => 0.0,
            Align::Centre => 0.5,
            Align::Right => 1.0,
        };
        let mut pen = x - shift * text_width_px(text, height_px);
        for character in text.chars() {
            let id = scaled.glyph_id(character);
            let glyph = id.with_scale_and_position(height_px, ab_glyph::point(pen, y));
            pen += scaled.h_advance(id);
            if let Some(outline) = font.outline_glyph(glyph) {
                let corner = outline.px_bounds().min;
                outline.draw(|dx, dy, coverage| {
                    let (px, py) = (corner.x as i64 + i64::from(dx), corner.y as i64 + i64::from(dy));
                    self.blend(px, py, colour, coverage);
                });
            }
        }
    }

    fn blend(&mut self, x: i64, y: i64, colour: Rgb, coverage: f32) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x < self.width_px && y < self.height_px {
            let pixel = &mut self.pixels[y * self.width_px + x];
            *pixel = mix(*pixel, colour, coverage.clamp(0.0, 1.0));
        }
    }

    /// Writes it as PNG.
    pub fn write_png(&self, out: impl Write) -> Result<()> {
        let mut encoder =
            png::Encoder::new(out, u32::try_from(self.width_px)?, u32::try_from(self.height_px)?);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        writer.finish()?;
        Ok(())
    }
}

/// Width of a text, pixels.
#[must_use]
pub fn text_width_px(text: &str, height_px: f32) -> f32 {
    let font = font();
    let scaled = font.as_scaled(PxScale::from(height_px));
    text.chars().map(|c| scaled.h_advance(scaled.glyph_id(c))).sum()
}

fn font() -> FontRef<'static> {
    FontRef::try_from_slice(epaint_default_fonts::UBUNTU_LIGHT).expect("the crate's font is a font")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawing_beyond_the_edge_is_cut() {
        let mut canvas = Canvas::new(4, 3, [0; 3]);
        canvas.draw((3, 2), &Canvas::new(5, 5, [9; 3]));
        canvas.fill((2, 0), (9, 1), [7; 3]);
        canvas.text("W", (-3.0, 2.0), Align::Left, 12.0, [255; 3]);
        assert_eq!(canvas.pixels[11], [9; 3]);
        assert_eq!(canvas.pixels.len(), 12);
    }

    #[test]
    fn enlarging_and_reducing_are_inverse() {
        let mut canvas = Canvas::new(3, 2, [0; 3]);
        for (i, pixel) in canvas.pixels.iter_mut().enumerate() {
            *pixel = [i as u8 * 10; 3];
        }
        assert_eq!(canvas.enlarged(4).reduced(4), canvas);
    }

    #[test]
    fn text_leaves_ink_where_it_is_aligned() {
        let ink = |align| {
            let mut canvas = Canvas::new(200, 30, [255; 3]);
            canvas.text("events", (100.0, 22.0), align, 20.0, [0; 3]);
            let dark: Vec<usize> =
                (0..200 * 30).filter(|&i| canvas.pixels[i][0] < 128).map(|i| i % 200).collect();
            (*dark.iter().min().unwrap(), *dark.iter().max().unwrap())
        };
        assert!(ink(Align::Left).0 >= 99 && ink(Align::Right).1 <= 101);
        let (left, right) = ink(Align::Centre);
        assert!(left < 100 && right > 100);
    }

    #[test]
    fn a_png_reads_back() {
        let canvas = Canvas { width_px: 2, height_px: 1, pixels: vec![[1, 2, 3], [4, 5, 6]] };
        let mut bytes = Vec::new();
        canvas.write_png(&mut bytes).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut buffer = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut buffer).unwrap();
        assert_eq!(buffer, [1, 2, 3, 4, 5, 6]);
    }
}
