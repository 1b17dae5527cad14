//! Stage `ingest`: decodes the bytes of a rendered frame to linear RGB behind the lens, times the exposure gain. An invalid
//! pixel keeps its previous value.

use esaac_model::frame::{check_size, check_time};
use esaac_model::intensity::{bayer_component, weights};
use esaac_model::optics::{PSF_RADIUS_PX, psf_weights, vignetting};
use esaac_model::{
    DepthFormat, FrameError, HdrFormat, IdFormat, Intensity, MotionFormat, SensorModel, Synthesis,
};

/// A rendered frame: rows tightly packed, top row first.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Time, nanoseconds.
    pub t_ns: i64,
    /// Colour.
    pub hdr: (HdrFormat, &'a [u8]),
    /// Motion, pixels: previous position = position + motion.
    pub motion: Option<(MotionFormat, &'a [u8])>,
    /// Depth, metres, as the lens measures it.
    pub depth: Option<(DepthFormat, &'a [u8])>,
    /// Instance ids; without them all is the static world.
    pub ids: Option<(IdFormat, &'a [u8])>,
}

/// Checks a frame before any of it is read: its time, the sizes of its images, and motion where the synthesis needs it.
pub fn check(
    sensor: &SensorModel,
    camera: u32,
    previous_ns: Option<i64>,
    frame: &Frame<'_>,
) -> Result<(), FrameError> {
    check_time(camera, previous_ns, frame.t_ns)?;
    let size = (sensor.width, sensor.height);
    check_size(camera, "hdr", size, frame.hdr.0.texel_bytes(), frame.hdr.1.len())?;
    if let Some((format, bytes)) = frame.motion {
        check_size(camera, "motion", size, format.texel_bytes(), bytes.len())?;
    }
    if let Some((format, bytes)) = frame.depth {
        check_size(camera, "depth", size, format.texel_bytes(), bytes.len())?;
    }
    if let Some((format, bytes)) = frame.ids {
        check_size(camera, "ids", size, format.texel_bytes(), bytes.len())?;
    }
    let missing = |synthesis| Err(FrameError::MissingMotion { camera, synthesis });
    match (sensor.synthesis, frame.motion) {
        (Synthesis::Motion, None) => missing("motion"),
        (Synthesis::Paper, None) => missing("paper"),
        (Synthesis::Rigid, _) if frame.depth.is_none() => Err(FrameError::MissingGeometry { camera }),
        _ => Ok(()),
    }
}

/// One decoded frame: linear RGB times the exposure gain, finite and not negative, with its motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// R, G, B of each pixel, scene units.
    pub rgb: Vec<[f64; 3]>,
    /// Motion of each pixel, pixels, as the renderer gave it. It may be non-finite.
    pub motion: Option<Vec<[f64; 2]>>,
    /// Depth of each pixel, metres, as the renderer gave it, and its instance.
    pub geometry: Option<(Vec<f64>, Vec<u32>)>,
}

impl Image {
    /// A black image without motion.
    #[must_use]
    pub fn black(sensor: &SensorModel) -> Self {
        Image {
            width: sensor.width as usize,
            height: sensor.height as usize,
            rgb: vec![[0.0; 3]; sensor.pixels()],
            motion: None,
            geometry: None,
        }
    }

    /// The scalar planes that a synthesis works on: one of intensity, or three colours for a mosaic, which is sampled
    /// after the warp.
    #[must_use]
    pub fn planes(&self, intensity: Intensity) -> Vec<Vec<f64>> {
        match intensity {
            Intensity::BayerRggb => (0..3).map(|c| self.rgb.iter().map(|rgb| rgb[c]).collect()).collect(),
            _ => {
                vec![self.rgb.iter().map(|rgb| dot(weights(intensity, 0, 0), *rgb)).collect()]
            }
        }
    }
}

/// Index in [`Image::planes`] of the plane that pixel `(x, y)` reads.
#[must_use]
pub fn plane_of(intensity: Intensity, x: usize, y: usize) -> usize {
    match intensity {
        Intensity::BayerRggb => bayer_component(x as u32, y as u32),
        _ => 0,
    }
}

/// A decoded frame and which of its pixels are valid.
#[derive(Clone, Debug, PartialEq)]
pub struct Ingested {
    /// The image. Invalid pixels keep the previous image's value.
    pub image: Image,
    /// Whether each pixel was valid in this frame.
    pub valid: Vec<bool>,
}

/// Decodes a checked frame. An invalid pixel takes its value from `held`, the previous image (black at the start).
#[must_use]
pub fn ingest(sensor: &SensorModel, held: &Image, frame: &Frame<'_>) -> Ingested {
    let (format, bytes) = frame.hdr;
    let rendered: Vec<[f64; 3]> = (0..sensor.pixels()).map(|pixel| format.decode(bytes, pixel)).collect();
    let lens = Lens::new(sensor, &rendered);
    let mut ingested = hold_invalid(sensor, held, &|pixel| lens.light_on(pixel), sensor.exposure_gain);
    ingested.image.motion = frame
        .motion
        .map(|(format, bytes)| (0..sensor.pixels()).map(|pixel| format.decode(bytes, pixel)).collect());
    ingested.image.geometry = frame.depth.map(|(format, bytes)| {
        let depth_m = (0..sensor.pixels()).map(|pixel| f64::from(format.decode(bytes, pixel))).collect();
        let id = |pixel| {
            frame.ids.map_or(esaac_model::paths::STATIC_WORLD, |(format, bytes)| format.decode(bytes, pixel))
        };
        (depth_m, (0..sensor.pixels()).map(id).collect())
    });
    ingested
}

/// Builds an image from given intensities in place of a frame: gray RGB without the exposure gain. An invalid pixel
/// takes its value from `held`.
#[must_use]
pub fn ingest_samples(sensor: &SensorModel, held: &Image, intensity: &dyn Fn(usize) -> f64) -> Ingested {
    hold_invalid(sensor, held, &|pixel| [intensity(pixel); 3], 1.0)
}

/// What a lens makes of a rendered image.
struct Lens<'a> {
    sensor: &'a SensorModel,
    rendered: &'a [[f64; 3]],
    weights: [f64; PSF_RADIUS_PX + 1],
}

impl<'a> Lens<'a> {
    fn new(sensor: &'a SensorModel, rendered: &'a [[f64; 3]]) -> Self {
        Lens { sensor, rendered, weights: psf_weights(sensor.psf_sigma_px) }
    }

    /// Light on a pixel; that of an invalid pixel is invalid.
    fn light_on(&self, pixel: usize) -> [f64; 3] {
        let own = self.rendered[pixel];
        if !is_valid(own, self.sensor.exposure_gain) {
            return own;
        }
        let (width, height) = (self.sensor.width as usize, self.sensor.height as usize);
        let (x, y) = (pixel % width, pixel / width);
        let mut light = own;
        if self.sensor.psf_sigma_px > 0.0 {
            let near =
                |at: usize, size: usize, step: usize| (at + step).saturating_sub(PSF_RADIUS_PX).min(size - 1);
            let weight = |step: usize| self.weights[step.abs_diff(PSF_RADIUS_PX)];
            let (mut sum, mut weights) = ([0.0; 3], 0.0);
            for (down, across) in
                (0..=2 * PSF_RADIUS_PX).flat_map(|d| (0..=2 * PSF_RADIUS_PX).map(move |a| (d, a)))
            {
                let colour = self.rendered[near(y, height, down) * width + near(x, width, across)];
                if is_valid(colour, self.sensor.exposure_gain) {
                    let weight = weight(down) * weight(across);
                    weights += weight;
                    (0..3).for_each(|c| sum[c] += weight * colour[c]);
                }
            }
            light = sum.map(|c| c / weights);
        }
        light.map(|c| c * vignetting(self.sensor, x as u32, y as u32))
    }
}

/// Whether a colour is finite and not negative, and so is its sum times the gain in f32.
fn is_valid(colour: [f64; 3], gain: f64) -> bool {
    let [red, green, blue] = colour.map(|c| c as f32);
    colour.iter().all(|c| c.is_finite() && *c >= 0.0) && ((red + green + blue) * gain as f32).is_finite()
}

fn hold_invalid(
    sensor: &SensorModel,
    held: &Image,
    linear: &dyn Fn(usize) -> [f64; 3],
    gain: f64,
) -> Ingested {
    let mut image = Image::black(sensor);
    let mut valid = Vec::with_capacity(sensor.pixels());
    for (pixel, rgb) in image.rgb.iter_mut().enumerate() {
        let given = linear(pixel);
        valid.push(is_valid(given, gain));
        *rgb = if valid[pixel] { given.map(|c| c * gain) } else { held.rgb[pixel] };
    }
    Ingested { image, valid }
}

fn dot(weights: [f64; 3], rgb: [f64; 3]) -> f64 {
    weights[0] * rgb[0] + weights[1] * rgb[1] + weights[2] * rgb[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(intensity: Intensity) -> SensorModel {
        SensorModel {
            width: 2,
            height: 2,
            exposure_gain: 2.0,
            intensity,
            synthesis: Synthesis::Linear,
            ..SensorModel::default()
        }
    }

    fn bytes(texels: &[[f32; 4]]) -> Vec<u8> {
        texels.iter().flatten().flat_map(|v| v.to_le_bytes()).collect()
    }

    fn frame(hdr: &[u8]) -> Frame<'_> {
        Frame { t_ns: 0, hdr: (HdrFormat::F32x4, hdr), motion: None, depth: None, ids: None }
    }

    #[test]
    fn invalid_texels_are_held_whole() {
        let sensor = sensor(Intensity::Luminance);
        let mut held = Image::black(&sensor);
        held.rgb = vec![[7.0, 8.0, 9.0]; 4];
        let hdr = bytes(&[
            [1.0, 2.0, 3.0, f32::NAN],
            [f32::NAN, 1.0, 1.0, 1.0],
            [1.0, f32::INFINITY, 1.0, 1.0],
            [1.0, 1.0, -1e-30, 1.0],
        ]);
        let got = ingest(&sensor, &held, &frame(&hdr));
        assert_eq!(got.valid, [true, false, false, false], "alpha does not count");
        assert_eq!(got.image.rgb[0], [2.0, 4.0, 6.0]);
        assert_eq!(got.image.rgb[1..], [[7.0, 8.0, 9.0]; 3]);
    }

    #[test]
    fn a_mosaic_keeps_three_planes_and_the_others_one() {
        let hdr = bytes(&[[1.0, 2.0, 3.0, 0.0]; 4]);
        let image = |intensity| {
            let sensor = sensor(intensity);
            ingest(&sensor, &Image::black(&sensor), &frame(&hdr)).image.planes(intensity)
        };
        assert_eq!(image(Intensity::BayerRggb), [[2.0; 4], [4.0; 4], [6.0; 4]]);
        assert!((image(Intensity::Gray)[0][3] - 4.0).abs() < 1e-15);
        assert_eq!([(0, 0), (1, 0), (1, 1)].map(|(x, y)| plane_of(Intensity::BayerRggb, x, y)), [0, 1, 2]);
    }

    #[test]
    fn a_blur_spreads_light_of_valid_pixels_and_darkens_no_border() {
        let sensor = SensorModel { width: 9, height: 1, psf_sigma_px: 0.7, ..sensor(Intensity::Gray) };
        let light = |rendered: &[[f32; 4]]| {
            let hdr = bytes(rendered);
            ingest(&sensor, &Image::black(&sensor), &frame(&hdr)).image.rgb
        };
        let even = light(&[[1.0; 4]; 9]);
        assert!(even.iter().all(|c| (c[0] - 2.0).abs() < 1e-12), "{even:?}");
        let mut point = [[0.0; 4]; 9];
        point[4] = [1.0; 4];
        let spread = light(&point);
        let sum: f64 = spread.iter().map(|c| c[0]).sum();
        assert!(
            (sum - 2.0).abs() < 1e-12 && spread[4][0] > spread[5][0] && spread[8][0] == 0.0,
            "{spread:?}"
        );
        let mut broken = [[1.0; 4]; 9];
        broken[4] = [f32::NAN; 4];
        let kept = light(&broken);
        assert_eq!(kept[4][0], 0.0, "it keeps its last value");
        assert!((kept[5][0] - 2.0).abs() < 1e-12, "its neighbours do not take it: {kept:?}");
    }

    #[test]
    fn frames_are_checked_before_they_are_read() {
        let sensor = sensor(Intensity::Gray);
        let hdr = bytes(&[[1.0; 4]; 4]);
        assert_eq!(check(&sensor, 0, None, &frame(&hdr)), Ok(()));
        assert!(matches!(
            check(&sensor, 0, None, &frame(&hdr[1..])),
            Err(FrameError::Size { image: "hdr", .. })
        ));
        assert!(matches!(check(&sensor, 0, Some(0), &frame(&hdr)), Err(FrameError::Time { .. })));
        let motion = Frame { motion: Some((MotionFormat::F16x2, &hdr[..15])), ..frame(&hdr) };
        assert!(matches!(check(&sensor, 0, None, &motion), Err(FrameError::Size { image: "motion", .. })));
        for (synthesis, name) in [(Synthesis::Motion, "motion"), (Synthesis::Paper, "paper")] {
            let sensor = SensorModel { synthesis, ..sensor.clone() };
            assert_eq!(
                check(&sensor, 3, None, &frame(&hdr)),
                Err(FrameError::MissingMotion { camera: 3, synthesis: name })
            );
        }
    }
}
