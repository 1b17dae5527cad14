//! Chooses the engine's format for an array by its shape and type, and copies it there.

#![expect(unsafe_code, reason = "arrays of other libraries")]

use crate::error::Fault;
use crate::image::{Element, Image, Place, Plane};
use esaac_interop::cuda::{Rows, Texture};
use esaac_model::{HdrFormat, IdFormat, MotionFormat};

/// An array as images of one kind, one for each camera: `[cameras][rows][columns][channels]`.
pub struct Tiles {
    image: Image,
    height: usize,
    width: usize,
    channels: usize,
    /// Bytes from one to the next: camera, row, column, channel.
    strides: [isize; 4],
}

/// Format of one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Texel {
    /// Channels that the engine's format has.
    pub channels: usize,
    /// Type of each.
    pub element: Element,
}

impl Texel {
    /// Bytes of one.
    pub fn bytes(self) -> usize {
        self.channels * self.element.bytes()
    }

    /// The engine's format for such colours.
    pub fn hdr(self) -> HdrFormat {
        match self.element {
            Element::F16 => HdrFormat::F16x4,
            Element::U8 => HdrFormat::Srgb8x4,
            _ => HdrFormat::F32x4,
        }
    }

    /// The engine's format for such motion vectors.
    pub fn motion(self) -> MotionFormat {
        match (self.element, self.channels) {
            (Element::F16, _) => MotionFormat::F16x2,
            (_, 4) => MotionFormat::F32x4,
            _ => MotionFormat::F32x2,
        }
    }

    /// The engine's format for such instance ids.
    pub fn ids(self) -> IdFormat {
        if self.element == Element::U16 { IdFormat::U16 } else { IdFormat::U32 }
    }
}

impl Tiles {
    /// Takes an array as one image (`cameras` is `None`) or as one for each camera.
    pub fn of(image: Image, cameras: Option<usize>, size_px: (u32, u32)) -> Result<Self, Fault> {
        let (width, height) = (size_px.0 as usize, size_px.1 as usize);
        let (plane, name) = (image.plane, image.plane.name());
        let leading: Vec<usize> = cameras.into_iter().chain([height, width]).collect();
        let axes = leading.len();
        let flat = plane.channels().contains(&1) && image.shape.len() == axes;
        let channels = if flat { 1 } else { image.shape.get(axes).copied().unwrap_or(0) };
        let right = image.shape.get(..axes) == Some(&leading[..])
            && image.shape.len() <= axes + 1
            && plane.channels().contains(&channels);
        if !right {
            let leading: Vec<String> = leading.iter().map(usize::to_string).collect();
            let allowed: Vec<String> = plane.channels().iter().map(usize::to_string).collect();
            let expected = match plane.channels() {
                [1] => leading.join(", "),
                _ => format!("{}, {}", leading.join(", "), allowed.join(" or ")),
            };
            let message = format!("{name} has shape {:?}, expected ({expected})", image.shape);
            return Err(Fault::Frame(message));
        }
        let element = image.element.bytes() as isize;
        let at = |axis: usize| image.strides.get(axis).copied().unwrap_or(element);
        let first = axes - 2;
        let camera_stride = if cameras.is_some() { at(0) } else { 0 };
        // The stride of an axis of one element means nothing, and libraries write anything there.
        let channel_stride = if channels == 1 { element } else { at(first + 2) };
        let strides = [camera_stride, at(first), at(first + 1), channel_stride];
        if image.texture.is_some() && cameras.is_some() {
            let message = format!("{name} is a texture, expected an array of all environments");
            return Err(Fault::Frame(message));
        }
        let tiles = Tiles { image, height, width, channels, strides };
        if matches!(tiles.image.place, Place::Cuda { .. }) {
            tiles.check_on_device()?;
        }
        Ok(tiles)
    }

    /// The memory that the array is in.
    pub fn place(&self) -> Place {
        self.image.place
    }

    /// Address of the first element.
    pub fn pointer(&self) -> u64 {
        self.image.pointer as u64
    }

    /// The texture, if it is one.
    pub fn texture(&self) -> Option<Texture> {
        self.image.texture
    }

    /// Columns and rows.
    pub fn size_px(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }

    /// What they hold.
    pub fn plane(&self) -> Plane {
        self.image.plane
    }

    /// The engine's format for it. Motion of four floats keeps all four, since that is how renderers store it.
    pub fn texel(&self) -> Texel {
        let element = self.image.element;
        let channels = match self.image.plane {
            Plane::Motion if element == Element::F32 && self.pixel_channels() == 4 => 4,
            Plane::Motion => 2,
            Plane::Hdr => 4,
            Plane::Depth | Plane::Ids => 1,
        };
        Texel { channels, element }
    }

    /// Channels from one pixel to the next. A view of some channels does not change this.
    fn pixel_channels(&self) -> usize {
        let per_pixel = self.strides[2] / self.image.element.bytes() as isize;
        if self.strides[2] > 0 && per_pixel == 4 { 4 } else { self.channels }
    }

    /// The bytes of a camera's image, if they are in the engine's format already.
    pub fn as_bytes(&self, camera: usize) -> Option<&[u8]> {
        let texel = self.texel().bytes();
        let strides = [(self.width * texel) as isize, texel as isize, self.image.element.bytes() as isize];
        (self.channels == self.texel().channels && self.strides[1..] == strides).then(|| {
            // SAFETY: the array's owner guarantees shape and strides, and the image keeps the array. If somebody
            // writes to it during a step, the frame is torn, as with any array.
            unsafe { std::slice::from_raw_parts(self.at(camera), self.height * self.width * texel) }
        })
    }

    /// Writes a camera's image in the engine's format, whatever its strides are.
    pub fn pack(&self, camera: usize, into: &mut Vec<u8>) {
        let (texel, element) = (self.texel(), self.image.element.bytes());
        into.clear();
        into.resize(self.height * self.width * texel.bytes(), 0);
        let used = if self.channels == 1 { 3 } else { self.channels.min(texel.channels) };
        let channel_stride = if self.channels == 1 { 0 } else { self.strides[3] };
        for (y, row) in into.chunks_exact_mut(self.width * texel.bytes()).enumerate() {
            for (x, pixel) in row.chunks_exact_mut(texel.bytes()).enumerate() {
                let offset = y as isize * self.strides[1] + x as isize * self.strides[2];
                for (channel, value) in pixel.chunks_exact_mut(element).take(used).enumerate() {
                    // SAFETY: the address is inside the array, by its shape and strides.
                    unsafe {
                        let from = self.at(camera).offset(offset + channel as isize * channel_stride);
                        std::ptr::copy_nonoverlapping(from, value.as_mut_ptr(), element);
                    }
                }
            }
        }
    }

    fn at(&self, camera: usize) -> *const u8 {
        (self.image.pointer as *const u8).wrapping_offset(camera as isize * self.strides[0])
    }

    /// Fails if a device cannot copy it: pixels must be contiguous, and no stride negative.
    fn check_on_device(&self) -> Result<(), Fault> {
        let name = self.image.plane.name();
        if self.channels != self.texel().channels && self.channels == 1 {
            return Err(Fault::Frame(format!(
                "{name} has one channel on a CUDA device, expected 3 or 4; repeat it there"
            )));
        }
        let (element, pixel) = (self.image.element.bytes() as isize, self.strides[2]);
        let packed_pixels = pixel >= self.channels as isize * element;
        let packed_rows = self.strides[1] >= pixel * self.width as isize;
        let even = pixel == self.texel().bytes() as isize || self.strides[1] == pixel * self.width as isize;
        if self.strides[3] == element && packed_pixels && packed_rows && even && self.strides[0] >= 0 {
            return Ok(());
        }
        Err(Fault::Frame(format!(
            "{name} has strides {:?} bytes on a CUDA device, expected whole pixels one after the other and rows \
             in order; make it contiguous there",
            self.image.strides
        )))
    }

    /// The copies of cameras `first..first + count` into a buffer of whole images, each with its offset there.
    pub fn rows(&self, first: usize, count: usize) -> Vec<(Rows, u64)> {
        let (texel, element) = (self.texel().bytes(), self.image.element.bytes());
        let image_bytes = self.image_bytes();
        let pixel = self.strides[2] as usize;
        let row = self.strides[1] as usize;
        // In a view of some channels, the other channels of the last pixel may be outside the array.
        let unused =
            if pixel == texel { texel - self.channels.min(self.texel().channels) * element } else { 0 };
        let pointer = |camera: usize| self.pointer() + camera as u64 * self.strides[0] as u64;
        let one = |pointer: u64, cameras: usize| {
            if pixel != texel {
                let channels = self.channels.min(self.texel().channels);
                Rows {
                    pointer,
                    row_bytes: channels * element,
                    rows: cameras * self.height * self.width,
                    stride_bytes: pixel,
                    target_stride_bytes: texel,
                }
            } else if row == self.width * texel {
                let bytes = cameras * image_bytes;
                Rows {
                    pointer,
                    row_bytes: bytes - unused,
                    rows: 1,
                    stride_bytes: bytes,
                    target_stride_bytes: bytes,
                }
            } else {
                Rows {
                    pointer,
                    row_bytes: self.width * texel - unused,
                    rows: cameras * self.height,
                    stride_bytes: row,
                    target_stride_bytes: self.width * texel,
                }
            }
        };
        let together = count == 1 || self.strides[0] as usize == self.height * row;
        if together {
            vec![(one(pointer(first), count), 0)]
        } else {
            (0..count).map(|k| (one(pointer(first + k), 1), (k * image_bytes) as u64)).collect()
        }
    }

    /// Bytes of a camera's image in the engine's format.
    pub fn image_bytes(&self) -> usize {
        self.height * self.width * self.texel().bytes()
    }
}
