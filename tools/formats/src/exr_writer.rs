//! Writes one frame as an OpenEXR file, with the channels that [`exr_frame`](crate::exr_frame) reads.

use crate::exr_frame::{FrameImages, FrameLayout};
use anyhow::{Context, Result, ensure};
use esaac_model::{HdrFormat, MotionFormat};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use half::f16;
use std::io::{Seek, Write};

/// Writes `images`, so that [`read_frame`](crate::exr_frame::read_frame) with `layout` reads them again, bit for bit:
/// colour as half floats or floats, as it is in memory, motion and depth as floats, ids as uint32.
///
/// # Errors
/// If an image does not have the layout's size, or lacks the name of its channel.
pub fn write_frame(out: impl Write + Seek, layout: &FrameLayout, images: &FrameImages) -> Result<()> {
    let size = (layout.width_px as usize, layout.height_px as usize);
    let pixels = size.0 * size.1;
    let mut channels = Vec::new();
    let mut add = |name: &str, samples: FlatSamples| -> Result<()> {
        ensure!(
            samples.len() == pixels,
            "channel `{name}` has {} samples, expected {pixels} ({}x{} px)",
            samples.len(),
            size.0,
            size.1
        );
        channels.push(AnyChannel::new(name, samples));
        Ok(())
    };
    let texels = images.hdr.len() / layout.hdr.texel_bytes();
    for (component, name) in layout.names.colour.iter().enumerate() {
        let value = |texel| layout.hdr.decode(&images.hdr, texel)[component];
        add(
            name,
            match layout.hdr {
                HdrFormat::F16x4 => FlatSamples::F16((0..texels).map(|i| f16::from_f64(value(i))).collect()),
                HdrFormat::F32x4 | HdrFormat::Srgb8x4 => {
                    FlatSamples::F32((0..texels).map(|i| value(i) as f32).collect())
                }
            },
        )?;
    }
    if let Some(motion) = &images.motion {
        let format = layout.motion.unwrap_or(MotionFormat::F32x2);
        let texels = motion.len() / format.texel_bytes();
        for (component, name) in layout.names.motion.iter().enumerate() {
            let factor = layout.motion_factors[component];
            let value = |texel| format.decode(motion, texel)[component] as f32 / factor;
            add(name, FlatSamples::F32((0..texels).map(value).collect()))?;
        }
    }
    if let Some(depth) = &images.depth {
        let name = layout.depth.as_deref().context("depth without the name of its channel")?;
        add(name, FlatSamples::F32(depth.clone()))?;
    }
    if let Some(ids) = &images.ids {
        let name = layout.ids.as_deref().context("ids without the name of their channel")?;
        add(name, FlatSamples::U32(ids.clone()))?;
    }
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let layer = Layer::new(size, LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
    Image::from_layer(layer).write().to_buffered(out).context("OpenEXR")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exr_frame::{ChannelNames, read_frame, read_header};

    const SIZE_PX: (u32, u32) = (5, 3);

    fn layout(hdr: HdrFormat) -> FrameLayout {
        FrameLayout {
            width_px: SIZE_PX.0,
            height_px: SIZE_PX.1,
            names: ChannelNames::default(),
            hdr,
            motion: Some(MotionFormat::F32x2),
            motion_factors: [1.0, -1.0],
            depth: Some("depth.Z".to_owned()),
            ids: Some("id".to_owned()),
        }
    }

    fn images(hdr: HdrFormat) -> FrameImages {
        let mut images =
            FrameImages { depth: Some(vec![]), ids: Some(vec![]), motion: Some(vec![]), hdr: vec![] };
        for pixel in 0..SIZE_PX.0 * SIZE_PX.1 {
            let value = 0.3 * pixel as f32;
            for component in [value, 2.0 * value, 7.0 - value, 1.0] {
                match hdr {
                    HdrFormat::F16x4 => images.hdr.extend(f16::from_f32(component).to_le_bytes()),
                    _ => images.hdr.extend(component.to_le_bytes()),
                }
            }
            images
                .motion
                .as_mut()
                .unwrap()
                .extend([value, -value - 0.1].iter().flat_map(|v| v.to_le_bytes()));
            images.depth.as_mut().unwrap().push(if pixel == 4 { f32::INFINITY } else { 0.1 + value });
            images.ids.as_mut().unwrap().push(pixel * 100_000);
        }
        images
    }

    #[test]
    fn what_is_written_is_read_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key_0000.exr");
        for hdr in [HdrFormat::F16x4, HdrFormat::F32x4] {
            let (layout, images) = (layout(hdr), images(hdr));
            write_frame(std::fs::File::create(&path).unwrap(), &layout, &images).unwrap();
            assert_eq!(read_frame(&path, &layout).unwrap(), images);
            let header = read_header(&path, &layout.names).unwrap();
            assert_eq!((header.width_px, header.height_px), SIZE_PX);
            assert_eq!((header.half_colour, header.has_motion), (hdr == HdrFormat::F16x4, true));
            assert_eq!(header.channels, ["B", "G", "R", "depth.Z", "id", "motion.X", "motion.Y"]);
        }
    }

    #[test]
    fn floats_are_no_half_floats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key_0000.exr");
        let file = std::fs::File::create(&path).unwrap();
        write_frame(file, &layout(HdrFormat::F32x4), &images(HdrFormat::F32x4)).unwrap();
        let error = format!("{:#}", read_frame(&path, &layout(HdrFormat::F16x4)).unwrap_err());
        assert!(
            error.contains("key_0000.exr: `R`, `G` and `B` are not all half floats, expected half"),
            "{error}"
        );
    }

    #[test]
    fn images_that_do_not_fit_are_refused() {
        let refusal = |change: &dyn Fn(&mut FrameLayout, &mut FrameImages)| {
            let (mut layout, mut images) = (layout(HdrFormat::F32x4), images(HdrFormat::F32x4));
            change(&mut layout, &mut images);
            let written = write_frame(std::io::Cursor::new(Vec::new()), &layout, &images);
            format!("{:#}", written.unwrap_err())
        };
        let short = refusal(&|_, images| _ = images.depth.as_mut().unwrap().pop());
        assert!(short.contains("`depth.Z` has 14 samples, expected 15 (5x3 px)"), "{short}");
        assert!(refusal(&|layout, _| layout.width_px = 4).contains("`R` has 15 samples, expected 12"));
        assert!(refusal(&|layout, _| layout.ids = None).contains("ids without the name"));
    }
}
