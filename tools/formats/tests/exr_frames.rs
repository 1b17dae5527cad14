//! Frames as Blender writes them: in one part or a part for each pass, a background of 1e10, ids as floats.

use esaac_formats::exr_frame::{
    ChannelNames, FrameImages, FrameLayout, channel_names, read_frame, read_header,
};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer,
    LayerAttributes, Vec2, WritableImage,
};
use std::path::{Path, PathBuf};

const SIZE_PX: (usize, usize) = (2, 2);
const PASSES: [(&str, [f32; 4]); 7] = [
    ("L.Combined.B", [0.1, 0.2, 0.3, 0.4]),
    ("L.Combined.G", [1.1, 1.2, 1.3, 1.4]),
    ("L.Combined.R", [2.1, 2.2, 2.3, 2.4]),
    ("L.Depth.Z", [4.0, 1e10, 9e9, 0.0]),
    ("L.Object Index.X", [0.0, 7.0, 32_767.0, 16_777_216.0]),
    ("L.Vector.X", [-1.0, 2.0, 0.0, 0.5]),
    ("L.Vector.Y", [3.0, -4.0, 0.5, 0.25]),
];

fn write(folder: &Path, parts: &[&[(&str, [f32; 4])]]) -> PathBuf {
    let layer = |(number, passes): (usize, &&[(&str, [f32; 4])])| {
        let samples = |values: &[f32; 4]| FlatSamples::F32(values.to_vec());
        let channels = passes.iter().map(|(name, values)| AnyChannel::new(*name, samples(values)));
        let attributes = LayerAttributes::named(&*format!("part {number}"));
        Layer::new(SIZE_PX, attributes, Encoding::FAST_LOSSLESS, AnyChannels::sort(channels.collect()))
    };
    let layers: Vec<_> = parts.iter().enumerate().map(layer).collect();
    let window = IntegerBounds::from_dimensions(Vec2(SIZE_PX.0, SIZE_PX.1));
    let path = folder.join("frame_0001.exr");
    Image::from_layers(ImageAttributes::new(window), layers).write().to_file(&path).unwrap();
    path
}

fn names() -> ChannelNames {
    ChannelNames {
        colour: ["R", "G", "B"].map(|name| format!("L.Combined.{name}")),
        motion: ["X", "Y"].map(|name| format!("L.Vector.{name}")),
    }
}

fn layout(path: &Path) -> FrameLayout {
    let header = read_header(path, &names()).unwrap();
    FrameLayout {
        depth: Some("L.Depth.Z".to_owned()),
        ids: Some("L.Object Index.X".to_owned()),
        ..FrameLayout::new(&header, &names(), [1.0, -1.0])
    }
}

#[test]
fn passes_are_read_from_one_part_or_many() {
    let folder = tempfile::tempdir().unwrap();
    let pixels = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let colour: Vec<f32> =
        (0..4).flat_map(|i| [PASSES[2].1[i], PASSES[1].1[i], PASSES[0].1[i], 1.0]).collect();
    let expected = FrameImages {
        hdr: pixels(&colour),
        motion: Some(pixels(&[-1.0, -3.0, 2.0, 4.0, 0.0, -0.5, 0.5, -0.25])),
        depth: Some(vec![4.0, f32::INFINITY, 9e9, 0.0]),
        ids: Some(vec![0, 7, 32_767, 16_777_216]),
    };
    for parts in [vec![&PASSES[..]], PASSES.chunks(1).collect(), PASSES.chunks(3).collect()] {
        let path = write(folder.path(), &parts);
        let mut all = channel_names(&path).unwrap();
        all.sort();
        assert_eq!(all, PASSES.map(|(name, _)| name), "{} parts", parts.len());
        assert_eq!(read_frame(&path, &layout(&path)).unwrap(), expected, "{} parts", parts.len());
    }
}

#[test]
fn ids_that_are_no_whole_numbers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (id, told) in [
        (2.5, "2.5"),
        (-1.0, "-1"),
        (f32::NAN, "NaN"),
        (f32::INFINITY, "inf"),
        (4_294_967_296.0, "4294967300"),
    ] {
        let mut passes = PASSES;
        passes[4].1[2] = id;
        let path = write(folder.path(), &[&passes[..]]);
        let error = format!("{:#}", read_frame(&path, &layout(&path)).unwrap_err());
        let expected = format!(
            "channel `L.Object Index.X`: {told} is no id, expected whole numbers from 0 to 4294967295"
        );
        assert!(error.contains(&expected) && error.contains("frame_0001.exr"), "{error}");
    }
}

#[test]
fn channels_that_several_parts_have_are_named_after_their_part() {
    let folder = tempfile::tempdir().unwrap();
    let [left, right] = [1.0, 2.0].map(|v| ["B", "G", "R"].map(|name| (name, [v; 4])));
    for parts in [[&left[..], &right[..]], [&right[..], &left[..]]] {
        let path = write(folder.path(), &parts);
        let all = ["part 0.B", "part 0.G", "part 0.R", "part 1.B", "part 1.G", "part 1.R"];
        assert_eq!(channel_names(&path).unwrap(), all);
        let error = read_header(&path, &ChannelNames::default()).unwrap_err().to_string();
        assert!(error.contains("no colour channel `R`; it has: part 0.B, part 0.G"), "{error}");
        let names = ChannelNames {
            colour: ["R", "G", "B"].map(|name| format!("part 1.{name}")),
            ..ChannelNames::default()
        };
        let header = read_header(&path, &names).unwrap();
        let images = read_frame(&path, &FrameLayout::new(&header, &names, [1.0, 1.0])).unwrap();
        assert_eq!(images.hdr[..4], parts[1][0].1[0].to_le_bytes());
    }
}

#[test]
fn a_compression_that_is_not_known_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = write(folder.path(), &[&PASSES[..]]);
    let mut bytes = std::fs::read(&path).unwrap();
    // Name, type and length of the attribute, and then its number.
    let attribute = b"compression\0compression\0\x01\0\0\0";
    let at = bytes.windows(attribute.len()).position(|window| window == attribute).unwrap();
    bytes[at + attribute.len()] = 12;
    std::fs::write(&path, bytes).unwrap();
    let error = format!("{:#}", channel_names(&path).unwrap_err());
    assert!(error.contains("has a compression that is not supported, expected none, RLE"), "{error}");
}
