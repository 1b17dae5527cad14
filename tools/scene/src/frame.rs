//! Images of the scene, computed in f64 and encoded in a renderer's formats.

use crate::scene::{Scene, seconds};
use esaac_model::{HdrFormat, MotionFormat};
use half::f16;
use std::thread;

/// One frame, rows tightly packed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// Linear colour; alpha is 1. F16 saturates at 65504.
    pub hdr: Vec<u8>,
    /// Previous position less position, pixels, y down. Zero without a previous frame.
    pub motion: Vec<u8>,
    /// Metres along the view axis as f32. Infinite for hills and sky.
    pub depth: Vec<u8>,
    /// Instance id as u32. 0 for what stands still in the world.
    pub ids: Vec<u8>,
}

/// Renders a frame at `t_ns` without a GPU. Motion is towards `previous_t_ns`.
#[must_use]
pub fn render_cpu(
    scene: &Scene,
    t_ns: i64,
    previous_t_ns: Option<i64>,
    hdr: HdrFormat,
    motion: MotionFormat,
) -> Frame {
    let view = scene.view(seconds(t_ns));
    let previous = previous_t_ns.map(|t_ns| scene.view(seconds(t_ns)));
    let threads = thread::available_parallelism().map_or(1, usize::from) as u32;
    let rows = scene.height_px.div_ceil(threads);
    let band = |first_row: u32| {
        let mut frame = Frame::default();
        for y in first_row..(first_row + rows).min(scene.height_px) {
            for x in 0..scene.width_px {
                let sample = view.sample(f64::from(x), f64::from(y));
                let moved = previous.as_ref().map_or([0.0; 2], |previous| view.motion(&sample, previous));
                push_colour(&mut frame.hdr, hdr, sample.radiance.to_array());
                push_motion(&mut frame.motion, motion, moved);
                frame.depth.extend((sample.depth_m as f32).to_le_bytes());
                frame.ids.extend(sample.instance.to_le_bytes());
            }
        }
        frame
    };
    let bands: Vec<Frame> = thread::scope(|scope| {
        let workers: Vec<_> =
            (0..threads).map(|i| scope.spawn(move || band((i * rows).min(scene.height_px)))).collect();
        workers
            .into_iter()
            .map(|worker| worker.join().expect("a band of pixels is plain arithmetic"))
            .collect()
    });
    let join = |part: fn(&Frame) -> &[u8]| bands.iter().map(part).collect::<Vec<_>>().concat();
    Frame {
        hdr: join(|f| &f.hdr),
        motion: join(|f| &f.motion),
        depth: join(|f| &f.depth),
        ids: join(|f| &f.ids),
    }
}

fn push_colour(bytes: &mut Vec<u8>, format: HdrFormat, rgb: [f64; 3]) {
    let [r, g, b] = rgb;
    for value in [r, g, b, 1.0] {
        match format {
            HdrFormat::F16x4 => bytes.extend(f16::from_f64(value.min(f16::MAX.to_f64())).to_le_bytes()),
            HdrFormat::F32x4 => bytes.extend((value as f32).to_le_bytes()),
            HdrFormat::Srgb8x4 => bytes.push(srgb_encoded(value)),
        }
    }
}

fn push_motion(bytes: &mut Vec<u8>, format: MotionFormat, [x, y]: [f64; 2]) {
    match format {
        MotionFormat::F16x2 => bytes.extend([x, y].map(|v| f16::from_f64(v).to_le_bytes()).concat()),
        MotionFormat::F32x2 => bytes.extend([x, y].map(|v| (v as f32).to_le_bytes()).concat()),
        MotionFormat::F32x4 => bytes.extend([x, y, 0.0, 0.0].map(|v| (v as f32).to_le_bytes()).concat()),
    }
}

fn srgb_encoded(linear: f64) -> u8 {
    let encoded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round().clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneKind;

    #[test]
    fn every_scene_and_size_gives_whole_valid_frames() {
        for kind in SceneKind::ALL {
            for (width_px, height_px) in [(1, 1), (1, 7), (5, 1), (33, 17)] {
                let scene = kind.scene(width_px, height_px);
                let frame =
                    render_cpu(&scene, 66_666_667, Some(33_333_333), HdrFormat::F32x4, MotionFormat::F32x2);
                let pixels = (width_px * height_px) as usize;
                assert_eq!(
                    (frame.hdr.len(), frame.motion.len(), frame.depth.len(), frame.ids.len()),
                    (16 * pixels, 8 * pixels, 4 * pixels, 4 * pixels)
                );
                for index in 0..pixels {
                    let rgb = HdrFormat::F32x4.decode(&frame.hdr, index);
                    assert!(rgb.iter().all(|c| c.is_finite() && *c > 0.0), "{kind:?} {rgb:?}");
                    let motion = MotionFormat::F32x2.decode(&frame.motion, index);
                    assert!(motion.iter().all(|c| c.is_finite()), "{kind:?} {motion:?}");
                }
            }
        }
    }

    #[test]
    fn srgb_is_the_models() {
        for byte in 0..=255_u8 {
            assert_eq!(srgb_encoded(esaac_model::intensity::srgb_to_linear(byte)), byte);
        }
    }
}
