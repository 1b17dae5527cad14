//! One frame from an OpenEXR file: its header, and its pixels in a format of the engine.

use anyhow::{Context, Result, bail, ensure};
use esaac_model::{HdrFormat, MotionFormat};
use exr::meta::header::Header;
use exr::prelude::{AnyChannels, FlatSamples, Layer, MetaData, SampleType, Vec2};
use half::f16;
use std::path::Path;

/// Channel of depth, unless another is named.
pub const DEPTH_CHANNEL: &str = "depth.Z";

/// Channel of instance ids, unless another is named.
pub const ID_CHANNEL: &str = "id";

/// From this depth on a file means a background at infinity: Cycles writes it where a ray hits nothing.
pub const BACKGROUND_DEPTH: f32 = 1e10;

/// Names of the channels to read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelNames {
    /// Linear red, green, blue.
    pub colour: [String; 3],
    /// Motion x and y.
    pub motion: [String; 2],
}

impl Default for ChannelNames {
    /// `R G B motion.X motion.Y`.
    fn default() -> Self {
        ChannelNames {
            colour: ["R", "G", "B"].map(str::to_owned),
            motion: ["motion.X", "motion.Y"].map(str::to_owned),
        }
    }
}

/// The contents of a file's header that matter here.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameHeader {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Names of all channels, in the file's order; of a channel that several parts have, after its part.
    pub channels: Vec<String>,
    /// Whether red, green and blue are all half floats.
    pub half_colour: bool,
    /// Whether both motion channels are there.
    pub has_motion: bool,
}

/// What to decode; the same for all frames of a folder.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameLayout {
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
    /// Channels.
    pub names: ChannelNames,
    /// Format of the colour image.
    pub hdr: HdrFormat,
    /// Format of the motion image, if there is one.
    pub motion: Option<MotionFormat>,
    /// Factors that turn the file's motion x and y into the engine's convention.
    pub motion_factors: [f32; 2],
    /// Channel of depth, if it is to be read.
    pub depth: Option<String>,
    /// Channel of instance ids, if it is to be read.
    pub ids: Option<String>,
}

/// A decoded frame: tightly packed rows, little endian.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameImages {
    /// Colour image, in the layout's format.
    pub hdr: Vec<u8>,
    /// Motion image: previous position = position + motion, pixels, y down.
    pub motion: Option<Vec<u8>>,
    /// Depth, as the file has it; infinite from [`BACKGROUND_DEPTH`] on.
    pub depth: Option<Vec<f32>>,
    /// Instance ids.
    pub ids: Option<Vec<u32>>,
}

/// Names of all channels of a file, in its order. A channel whose name several parts have, as the two views of a stereo
/// camera, is named after its part too: `left.R`.
pub fn channel_names(path: &Path) -> Result<Vec<String>> {
    let meta = MetaData::read_from_file(path, false).map_err(|e| unreadable(path, e))?;
    Ok(names_of_parts(&meta).concat())
}

/// The same, part by part.
fn names_of_parts(meta: &MetaData) -> Vec<Vec<String>> {
    let part = |header: &Header| {
        let channels = header.channels.list.iter().map(|channel| channel.name.to_string());
        (header.own_attributes.layer_name.as_ref().map(ToString::to_string), channels.collect())
    };
    full_names(&meta.headers.iter().map(part).collect::<Vec<_>>())
}

/// The names of the channels of parts; a part without a name has its number.
fn full_names(parts: &[(Option<String>, Vec<String>)]) -> Vec<Vec<String>> {
    let full = |(number, (part, names)): (usize, &(Option<String>, Vec<String>))| {
        let full = |name: &String| match parts.iter().filter(|(_, names)| names.contains(name)).count() {
            1 => name.clone(),
            _ => format!("{}.{name}", part.clone().unwrap_or_else(|| number.to_string())),
        };
        names.iter().map(full).collect()
    };
    parts.iter().enumerate().map(full).collect()
}

/// Reads and checks a header without reading pixels. Fails, with the file's name, if the file cannot be read, has deep
/// images, parts of different sizes or a data window other than its display window, or lacks a channel.
pub fn read_header(path: &Path, names: &ChannelNames) -> Result<FrameHeader> {
    let meta = MetaData::read_from_file(path, false).map_err(|e| unreadable(path, e))?;
    ensure!(meta.headers.iter().all(|h| !h.deep), "{}: deep images cannot be read", path.display());
    let first = meta.headers.first().with_context(|| format!("{}: holds no image", path.display()))?;
    let Vec2(width, height) = first.layer_size;
    let display = first.shared_attributes.display_window;
    for header in &meta.headers {
        let (Vec2(w, h), Vec2(x, y)) = (header.layer_size, header.own_attributes.layer_position);
        ensure!(
            header.layer_size == first.layer_size,
            "{}: one part is {w}x{h} px, expected {width}x{height} px like the first",
            path.display()
        );
        ensure!(
            (header.layer_size, Vec2(x, y)) == (display.size, display.position),
            "{}: its data window is {w}x{h} px at ({x}, {y}), expected the whole display window of {}x{} px at ({}, {})",
            path.display(),
            display.size.0,
            display.size.1,
            display.position.0,
            display.position.1
        );
    }
    let kinds = meta.headers.iter().flat_map(|h| h.channels.list.iter()).map(|c| c.sample_type);
    let all: Vec<(String, SampleType)> = names_of_parts(&meta).concat().into_iter().zip(kinds).collect();
    let find = |name: &str| all.iter().find(|(channel, _)| channel == name).map(|&(_, kind)| kind);
    let listed = || all.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    let mut half_colour = true;
    for name in &names.colour {
        match find(name) {
            Some(kind) => half_colour &= kind == SampleType::F16,
            None => bail!("{}: no colour channel `{name}`; it has: {}", path.display(), listed()),
        }
    }
    let motion = names.motion.each_ref().map(|name| find(name).is_some());
    if motion[0] != motion[1] {
        let missing = &names.motion[usize::from(motion[0])];
        bail!("{}: no motion channel `{missing}`; it has: {}", path.display(), listed());
    }
    Ok(FrameHeader {
        width_px: u32::try_from(width)?,
        height_px: u32::try_from(height)?,
        half_colour,
        has_motion: motion[0],
        channels: all.into_iter().map(|(name, _)| name).collect(),
    })
}

/// Decodes a file's images as `layout` says. Fails, with the file's name, if a channel is missing or has another size, if
/// half floats are expected and colour has others, or if ids are no whole numbers.
pub fn read_frame(path: &Path, layout: &FrameLayout) -> Result<FrameImages> {
    let image = exr::prelude::read_all_flat_layers_from_file(path).map_err(|e| unreadable(path, e))?;
    let pixels = layout.width_px as usize * layout.height_px as usize;
    let part = |layer: &Layer<AnyChannels<FlatSamples>>| {
        let channels = layer.channel_data.list.iter().map(|channel| channel.name.to_string());
        (layer.attributes.layer_name.as_ref().map(ToString::to_string), channels.collect())
    };
    let full_names = full_names(&image.layer_data.iter().map(part).collect::<Vec<_>>()).concat();
    let channel = |name: &str| -> Result<&FlatSamples> {
        let all = image.layer_data.iter().flat_map(|layer| layer.channel_data.list.iter());
        let samples = full_names
            .iter()
            .zip(all)
            .find(|(full_name, _)| *full_name == name)
            .map(|(_, channel)| &channel.sample_data)
            .with_context(|| format!("{}: no channel `{name}`", path.display()))?;
        ensure!(
            samples.len() == pixels,
            "{}: channel `{name}` has {} samples, expected {pixels} ({}x{} px)",
            path.display(),
            samples.len(),
            layout.width_px,
            layout.height_px
        );
        Ok(samples)
    };
    let [r, g, b] = &layout.names.colour;
    let colour = [channel(r)?, channel(g)?, channel(b)?];
    let motion = match layout.motion {
        None => None,
        Some(_) => {
            let [x, y] = &layout.names.motion;
            let (x, y) = (channel(x)?, channel(y)?);
            let [sx, sy] = layout.motion_factors;
            let mut bytes = Vec::with_capacity(pixels * MotionFormat::F32x2.texel_bytes());
            for (x, y) in x.values_as_f32().zip(y.values_as_f32()) {
                bytes.extend_from_slice(&(sx * x).to_le_bytes());
                bytes.extend_from_slice(&(sy * y).to_le_bytes());
            }
            Some(bytes)
        }
    };
    let depth = match &layout.depth {
        None => None,
        Some(name) => {
            let at_infinity = |depth| if depth >= BACKGROUND_DEPTH { f32::INFINITY } else { depth };
            Some(channel(name)?.values_as_f32().map(at_infinity).collect())
        }
    };
    let ids = match &layout.ids {
        None => None,
        Some(name) => match channel(name)? {
            FlatSamples::U32(ids) => Some(ids.clone()),
            // Blender's are floats. Blended where two surfaces meet, they would be fractions.
            floats => Some(
                floats
                    .values_as_f32()
                    .map(whole_id)
                    .collect::<Result<_>>()
                    .with_context(|| format!("{}: channel `{name}`", path.display()))?,
            ),
        },
    };
    let half_colour = colour.iter().all(|samples| matches!(samples, FlatSamples::F16(_)));
    ensure!(
        half_colour || layout.hdr != HdrFormat::F16x4,
        "{}: `{r}`, `{g}` and `{b}` are not all half floats, expected half floats",
        path.display()
    );
    Ok(FrameImages { hdr: pack_colour(colour, layout.hdr, pixels), motion, depth, ids })
}

fn whole_id(id: f32) -> Result<u32> {
    const IDS: f32 = 4_294_967_296.0;
    ensure!(
        id.fract() == 0.0 && (0.0..IDS).contains(&id),
        "{id} is no id, expected whole numbers from 0 to {}",
        u32::MAX
    );
    Ok(id as u32)
}

fn pack_colour(colour: [&FlatSamples; 3], format: HdrFormat, pixels: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(pixels * format.texel_bytes());
    if let (HdrFormat::F16x4, [FlatSamples::F16(r), FlatSamples::F16(g), FlatSamples::F16(b)]) =
        (format, colour)
    {
        for ((r, g), b) in r.iter().zip(g).zip(b) {
            for component in [*r, *g, *b, f16::ONE] {
                bytes.extend_from_slice(&component.to_le_bytes());
            }
        }
        return bytes;
    }
    let [r, g, b] = colour.map(FlatSamples::values_as_f32);
    for ((r, g), b) in r.zip(g).zip(b) {
        for component in [r, g, b, 1.0] {
            bytes.extend_from_slice(&component.to_le_bytes());
        }
    }
    bytes
}

fn unreadable(path: &Path, error: exr::error::Error) -> anyhow::Error {
    let bytes = std::fs::metadata(path).map(|m| m.len()).unwrap_or(0);
    let reason = match &error {
        exr::error::Error::Io(_) => "cannot be read",
        exr::error::Error::NotSupported(_) => "uses a feature of OpenEXR that is not supported",
        // What the library says of a compression whose number it does not know, such as Zstandard's.
        exr::error::Error::Invalid(why) if why.contains("compression attribute") => {
            "has a compression that is not supported, expected none, RLE, ZIP, PIZ, PXR24, B44 or DWA"
        }
        _ => "is no OpenEXR file, or truncated",
    };
    anyhow::Error::new(error).context(format!("{} ({bytes} bytes) {reason}", path.display()))
}

impl FrameLayout {
    /// Layout of a folder whose first frame has `header`.
    #[must_use]
    pub fn new(header: &FrameHeader, names: &ChannelNames, motion_factors: [f32; 2]) -> Self {
        FrameLayout {
            width_px: header.width_px,
            height_px: header.height_px,
            names: names.clone(),
            hdr: if header.half_colour { HdrFormat::F16x4 } else { HdrFormat::F32x4 },
            motion: header.has_motion.then_some(MotionFormat::F32x2),
            motion_factors,
            depth: None,
            ids: None,
        }
    }
}
