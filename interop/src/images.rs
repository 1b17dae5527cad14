//! What a camera's images are: size, formats, and the lens of depth and poses. One place for all that there is for
//! each image of a frame.

use crate::image::{ImageKind, depth_format, hdr_format, id_format, motion_format};
use crate::memory::buffer_bytes;
use crate::wire::{self, Lens};
use esaac_engine::ash::vk;
use esaac_engine::{CameraConfig, Device, GeometryConfig};
use esaac_model::paths::{Intrinsics, Projection};
use esaac_model::{DepthFormat, HdrFormat, IdFormat, MotionFormat};

/// Something for each image of a frame, in the order in which descriptors are sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Planes<T> {
    /// Of the colour.
    pub hdr: T,
    /// Of the motion, if there is any.
    pub motion: Option<T>,
    /// Of the depth, if there is any.
    pub depth: Option<T>,
    /// Of the instance ids, if there are any.
    pub ids: Option<T>,
}

impl<T> Planes<T> {
    /// Of colour and motion alone.
    #[must_use]
    pub fn of(hdr: T, motion: Option<T>) -> Self {
        Planes { hdr, motion, depth: None, ids: None }
    }

    /// Those that are there, with the names of their images.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, &T)> {
        let Planes { hdr, motion, depth, ids } = self;
        let all = [
            ("hdr", Some(hdr)),
            ("motion", motion.as_ref()),
            ("depth", depth.as_ref()),
            ("ids", ids.as_ref()),
        ];
        all.into_iter().filter_map(|(name, plane)| Some((name, plane?)))
    }

    /// Those that are there.
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.named().map(|(_, plane)| plane)
    }

    /// References to those that are there.
    #[must_use]
    pub fn as_ref(&self) -> Planes<&T> {
        let Planes { hdr, motion, depth, ids } = self;
        Planes { hdr, motion: motion.as_ref(), depth: depth.as_ref(), ids: ids.as_ref() }
    }

    /// Those that are there, to change them.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        let Planes { hdr, motion, depth, ids } = self;
        [Some(hdr), motion.as_mut(), depth.as_mut(), ids.as_mut()].into_iter().flatten()
    }

    /// Makes something of each that is there, in their order.
    pub fn try_map<U, E>(
        &self,
        mut make: impl FnMut(&'static str, &T) -> Result<U, E>,
    ) -> Result<Planes<U>, E> {
        let Planes { hdr, motion, depth, ids } = self;
        let hdr = make("hdr", hdr)?;
        let mut other = |name, plane: &Option<T>| plane.as_ref().map(|plane| make(name, plane)).transpose();
        Ok(Planes {
            hdr,
            motion: other("motion", motion)?,
            depth: other("depth", depth)?,
            ids: other("ids", ids)?,
        })
    }

    /// Of each that is there, something else.
    #[must_use]
    pub fn map<U>(&self, mut make: impl FnMut(&T) -> U) -> Planes<U> {
        let Planes { hdr, motion, depth, ids } = self;
        let hdr = make(hdr);
        let mut other = |plane: &Option<T>| plane.as_ref().map(&mut make);
        Planes { hdr, motion: other(motion), depth: other(depth), ids: other(ids) }
    }

    /// With each that is there, its one of four things.
    #[must_use]
    pub fn paired<U>(self, [of_hdr, of_motion, of_depth, of_ids]: [U; 4]) -> Planes<(T, U)> {
        Planes {
            hdr: (self.hdr, of_hdr),
            motion: self.motion.map(|plane| (plane, of_motion)),
            depth: self.depth.map(|plane| (plane, of_depth)),
            ids: self.ids.map(|plane| (plane, of_ids)),
        }
    }

    /// All four; the default where there is none.
    #[must_use]
    pub fn all(self) -> [T; 4]
    where
        T: Default,
    {
        let Planes { hdr, motion, depth, ids } = self;
        [hdr, motion.unwrap_or_default(), depth.unwrap_or_default(), ids.unwrap_or_default()]
    }
}

/// Size and formats of a camera's images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Images {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Colour.
    pub hdr: HdrFormat,
    /// Motion, if there is any.
    pub motion: Option<MotionFormat>,
    /// Depth, ids and lens, if frames come with depth and poses.
    pub geometry: Option<GeometryConfig>,
}

impl From<&CameraConfig> for Images {
    fn from(config: &CameraConfig) -> Self {
        Images {
            width_px: config.sensor.width,
            height_px: config.sensor.height,
            hdr: config.hdr,
            motion: config.motion,
            geometry: config.geometry,
        }
    }
}

impl Images {
    /// Bytes of a texel of each image.
    #[must_use]
    pub fn texel_bytes(&self) -> Planes<usize> {
        Planes {
            hdr: self.hdr.texel_bytes(),
            motion: self.motion.map(MotionFormat::texel_bytes),
            depth: self.geometry.map(|geometry| geometry.depth.texel_bytes()),
            ids: self.geometry.and_then(|geometry| geometry.ids).map(IdFormat::texel_bytes),
        }
    }

    /// Bytes of the buffer of each image.
    #[must_use]
    pub fn bytes(&self) -> Planes<u64> {
        let pixels = u64::from(self.width_px) * u64::from(self.height_px);
        self.texel_bytes().map(|&texel_bytes| buffer_bytes(pixels * texel_bytes as u64))
    }

    /// Whether depth and poses of a renderer with this lens may be sent.
    #[must_use]
    pub fn takes_lens(&self, lens: &Intrinsics) -> bool {
        self.geometry.is_some_and(|geometry| is_same_lens(&lens_to_wire(&geometry.lens), &lens_to_wire(lens)))
    }

    /// Number of images in a slot.
    #[must_use]
    pub fn count(&self) -> usize {
        self.texel_bytes().iter().count()
    }

    /// Whether the engine can take them as images of optimal tiling on this device.
    pub(crate) fn are_importable(&self, device: &Device) -> bool {
        self.kinds().iter().all(|kind| kind.is_importable(device))
    }

    /// Each as an image of optimal tiling.
    pub(crate) fn kinds(&self) -> Planes<ImageKind> {
        let bytes = self.bytes();
        let kind = |format: vk::Format, bytes: u64| ImageKind {
            format,
            width_px: self.width_px,
            height_px: self.height_px,
            bytes,
        };
        let geometry = self.geometry.as_ref();
        Planes {
            hdr: kind(hdr_format(self.hdr), bytes.hdr),
            motion: self.motion.map(motion_format).zip(bytes.motion).map(|(f, b)| kind(f, b)),
            depth: geometry.map(|g| depth_format(g.depth)).zip(bytes.depth).map(|(f, b)| kind(f, b)),
            ids: geometry.and_then(|g| g.ids).map(id_format).zip(bytes.ids).map(|(f, b)| kind(f, b)),
        }
    }
}

/// Largest difference of a producer's lens from the rig's, pixels: what a focal length in single precision is wrong by.
const LENS_TOLERANCE_PX: f64 = 1e-2;

/// Whether two lenses are the same but for rounding.
pub(crate) fn is_same_lens(one: &Lens, other: &Lens) -> bool {
    let numbers = |lens: &Lens| [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px];
    let is_near = |(a, b): (f64, f64)| (a - b).abs() <= LENS_TOLERANCE_PX;
    one.projection == other.projection && numbers(one).into_iter().zip(numbers(other)).all(is_near)
}

/// Formats of depth and ids as an offer has them.
pub(crate) fn geometry_to_wire(geometry: Option<&GeometryConfig>) -> (u32, u32, Lens) {
    let Some(GeometryConfig { depth, ids, lens }) = geometry else {
        return (wire::NO_PLANE, wire::NO_PLANE, Lens::default());
    };
    (*depth as u32 + 1, ids.map_or(wire::NO_PLANE, |ids| ids as u32 + 1), lens_to_wire(lens))
}

/// The other way; the name and the number of what is unknown.
pub(crate) fn geometry_from_wire(
    depth: u32,
    ids: u32,
    lens: &Lens,
) -> Result<Option<GeometryConfig>, String> {
    if depth == wire::NO_PLANE {
        return Ok(None);
    }
    if depth != DepthFormat::F32 as u32 + 1 {
        return Err(format!("depth format {depth} is unknown"));
    }
    let ids = match ids {
        wire::NO_PLANE => None,
        number => Some(
            [IdFormat::U16, IdFormat::U32]
                .into_iter()
                .find(|format| *format as u32 + 1 == number)
                .ok_or_else(|| format!("id format {number} is unknown"))?,
        ),
    };
    let lens = lens_from_wire(lens)?.ok_or_else(|| "depth comes without a lens".to_owned())?;
    Ok(Some(GeometryConfig { depth: DepthFormat::F32, ids, lens }))
}

/// A lens as it is sent.
pub(crate) fn lens_to_wire(lens: &Intrinsics) -> Lens {
    let projection = match lens.projection() {
        Projection::Pinhole => wire::LENS_PINHOLE,
        Projection::Fisheye => wire::LENS_FISHEYE,
    };
    let (focal_px, centre_px) = (lens.focal_px(), lens.centre_px());
    Lens {
        projection,
        reserved: 0,
        fx_px: focal_px.x,
        fy_px: focal_px.y,
        cx_px: centre_px.x,
        cy_px: centre_px.y,
    }
}

/// The other way; `None` if there is none.
pub(crate) fn lens_from_wire(lens: &Lens) -> Result<Option<Intrinsics>, String> {
    let projection = match lens.projection {
        wire::NO_LENS => return Ok(None),
        wire::LENS_PINHOLE => Projection::Pinhole,
        wire::LENS_FISHEYE => Projection::Fisheye,
        number => return Err(format!("lens {number} is unknown")),
    };
    Intrinsics::new(projection, lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px)
        .map(Some)
        .map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_ids_and_lens_read_back_and_what_is_unknown_is_named() {
        let lens = Intrinsics::fisheye(100.0, 101.0, 20.5, 10.5).unwrap();
        assert_eq!(geometry_from_wire(0, 7, &Lens::default()), Ok(None));
        for ids in [None, Some(IdFormat::U16), Some(IdFormat::U32)] {
            let geometry = GeometryConfig { depth: DepthFormat::F32, ids, lens };
            let (depth, ids, lens) = geometry_to_wire(Some(&geometry));
            assert_eq!(geometry_from_wire(depth, ids, &lens), Ok(Some(geometry)));
        }
        let right = lens_to_wire(&lens);
        let error = |depth, ids, lens: Lens| geometry_from_wire(depth, ids, &lens).unwrap_err();
        assert_eq!(error(2, 0, right), "depth format 2 is unknown");
        assert_eq!(error(1, 3, right), "id format 3 is unknown");
        assert_eq!(error(1, 1, Lens::default()), "depth comes without a lens");
        assert_eq!(error(1, 1, Lens { projection: 3, ..right }), "lens 3 is unknown");
        assert!(error(1, 1, Lens { fx_px: f64::NAN, ..right }).contains("focal length fx is NaN"));
        assert!(error(1, 1, Lens { cy_px: f64::INFINITY, ..right }).contains("cy is inf"));
    }

    #[test]
    fn each_image_has_its_own_size() {
        let lens = Intrinsics::pinhole(10.0, 10.0, 5.0, 4.0).unwrap();
        let geometry = GeometryConfig { depth: DepthFormat::F32, ids: Some(IdFormat::U16), lens };
        let images = Images {
            width_px: 12,
            height_px: 9,
            hdr: HdrFormat::F16x4,
            motion: None,
            geometry: Some(geometry),
        };
        assert_eq!(images.bytes().all(), [864, 0, 432, 224]);
        let named: Vec<_> = images.bytes().named().map(|(name, &bytes)| (name, bytes)).collect();
        assert_eq!(named, [("hdr", 864), ("depth", 432), ("ids", 224)]);
        assert_eq!((images.count(), Images { geometry: None, ..images }.count()), (3, 1));
    }
}
