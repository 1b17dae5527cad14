//! Writes tone-mapped PNGs of a scene: `preview NAME WIDTH HEIGHT OUT.png [SECONDS ...]`.

use esaac_scene::SceneKind;
use std::fs::File;
use std::io::BufWriter;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, width, height, path, times @ ..] = arguments.as_slice() else {
        return Err("usage: preview NAME WIDTH HEIGHT OUT.png [SECONDS ...]".into());
    };
    let (width, height): (u32, u32) = (width.parse()?, height.parse()?);
    let scene = name.parse::<SceneKind>()?.scene(width, height);
    let mut bytes = Vec::new();
    for time in times {
        let view = scene.view(time.parse()?);
        for y in 0..height {
            for x in 0..width {
                let rgb = view.radiance(f64::from(x), f64::from(y));
                bytes.extend(rgb.map(tone));
            }
        }
    }
    let rows = height * times.len() as u32;
    let mut encoder = png::Encoder::new(BufWriter::new(File::create(path)?), width, rows);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(&bytes)?;
    Ok(())
}

/// Tone mapping: Narkowicz's filmic curve, then an approximation of the sRGB transfer function.
fn tone(radiance: f64) -> u8 {
    let x = 0.75 * radiance;
    let filmic = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
    (255.0 * filmic.clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8
}
