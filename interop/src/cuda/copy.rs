//! Images from one place on the device to another: rows, after a look at where they end, and textures, after one
//! at what they hold.

#![expect(unsafe_code, reason = "CUDA's edge")]

use super::context::check;
use super::stream::Stream;
use crate::error::InteropError;
use cudarc::driver::sys;
use esaac_model::HdrFormat;

/// An image on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strided {
    /// `CUdeviceptr` of the first row.
    pub pointer: u64,
    /// Bytes from row to row.
    pub stride_bytes: usize,
}

/// An image in CUDA's own layout, as renderers' textures are to CUDA.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Texture {
    /// `CUarray` or `CUmipmappedArray`.
    pub handle: u64,
    /// Which of the two; of mipmaps the largest is the image.
    pub mipmapped: bool,
}

/// The array of a texture, whose size and format are held against what is expected. The context is current.
///
/// # Safety
/// The handle is what `texture` says, of the current context: the driver believes it.
pub(super) unsafe fn array_of(
    name: &str,
    texture: Texture,
    size_px: (u32, u32),
    format: HdrFormat,
) -> Result<sys::CUarray, InteropError> {
    let mut array = texture.handle as sys::CUarray;
    if texture.mipmapped {
        // SAFETY: as the caller guarantees; the result outlives the call.
        check("cuMipmappedArrayGetLevel", unsafe {
            sys::cuMipmappedArrayGetLevel(&mut array, texture.handle as sys::CUmipmappedArray, 0)
        })?;
    }
    let mut actual = std::mem::MaybeUninit::<sys::CUDA_ARRAY_DESCRIPTOR>::uninit();
    // SAFETY: as above.
    check("cuArrayGetDescriptor", unsafe { sys::cuArrayGetDescriptor_v2(actual.as_mut_ptr(), array) })?;
    // SAFETY: the call has written it.
    let actual = unsafe { actual.assume_init() };
    let expected = match format {
        HdrFormat::F16x4 => sys::CUarray_format::CU_AD_FORMAT_HALF,
        HdrFormat::F32x4 => sys::CUarray_format::CU_AD_FORMAT_FLOAT,
        HdrFormat::Srgb8x4 => sys::CUarray_format::CU_AD_FORMAT_UNSIGNED_INT8,
    };
    let same_size = (actual.Width, actual.Height) == (size_px.0 as usize, size_px.1 as usize);
    if same_size && actual.NumChannels == 4 && actual.Format == expected {
        return Ok(array);
    }
    Err(InteropError::Texture {
        name: name.to_owned(),
        expected: format!("{}x{} px of 4 x {expected:?}", size_px.0, size_px.1),
        actual: format!(
            "{}x{} px of {} x {:?}",
            actual.Width, actual.Height, actual.NumChannels, actual.Format
        ),
    })
}

/// Has an array copied to rows without gaps, in the stream's order. The context is current.
///
/// # Safety
/// The array has `rows` rows of `row_bytes` until the stream has copied them, and so has the target.
pub(super) unsafe fn copy_array(
    stream: &Stream,
    array: sys::CUarray,
    row_bytes: usize,
    rows: usize,
    target: sys::CUdeviceptr,
) -> Result<(), InteropError> {
    let copy = sys::CUDA_MEMCPY2D {
        srcMemoryType: sys::CUmemorytype::CU_MEMORYTYPE_ARRAY,
        srcArray: array,
        ..rows_to(target, row_bytes, rows, row_bytes)
    };
    // SAFETY: as the caller guarantees.
    check("cuMemcpy2DAsync", unsafe { sys::cuMemcpy2DAsync_v2(&copy, stream.raw) })
}

/// Has rows copied on the device, in the stream's order. The context is current.
///
/// # Safety
/// Source and target have `rows` rows of `row_bytes` at their strides until the stream has copied them.
pub(super) unsafe fn copy_rows(
    stream: &Stream,
    source: Strided,
    row_bytes: usize,
    rows: usize,
    target: sys::CUdeviceptr,
    target_stride_bytes: usize,
) -> Result<(), InteropError> {
    let copy = sys::CUDA_MEMCPY2D {
        srcDevice: source.pointer,
        srcPitch: source.stride_bytes,
        ..rows_to(target, row_bytes, rows, target_stride_bytes)
    };
    // SAFETY: as the caller guarantees.
    check("cuMemcpy2DAsync", unsafe { sys::cuMemcpy2DAsync_v2(&copy, stream.raw) })
}

/// A copy on the device without its source.
fn rows_to(
    target: sys::CUdeviceptr,
    row_bytes: usize,
    rows: usize,
    target_stride_bytes: usize,
) -> sys::CUDA_MEMCPY2D {
    sys::CUDA_MEMCPY2D {
        srcXInBytes: 0,
        srcY: 0,
        srcMemoryType: sys::CUmemorytype::CU_MEMORYTYPE_DEVICE,
        srcHost: std::ptr::null(),
        srcDevice: 0,
        srcArray: std::ptr::null_mut(),
        srcPitch: 0,
        dstXInBytes: 0,
        dstY: 0,
        dstMemoryType: sys::CUmemorytype::CU_MEMORYTYPE_DEVICE,
        dstHost: std::ptr::null_mut(),
        dstDevice: target,
        dstArray: std::ptr::null_mut(),
        dstPitch: target_stride_bytes,
        WidthInBytes: row_bytes,
        Height: rows,
    }
}

/// Whether an image lies inside memory that is there. An allocation may be mapped in several parts, one behind the other.
pub(super) fn check_source(
    name: &str,
    source: Strided,
    row_bytes: usize,
    rows: usize,
) -> Result<(), InteropError> {
    let wanted = source.pointer.saturating_add(extent_bytes(source, row_bytes, rows));
    let mut end = part_at(source.pointer)?.1;
    while end < wanted {
        match part_at(end) {
            Ok((base, next)) if base == end => end = next,
            _ => break,
        }
    }
    fits(name, source, row_bytes, rows, end)
}

/// Where the part of an allocation begins and ends that an address lies in.
fn part_at(address: sys::CUdeviceptr) -> Result<(sys::CUdeviceptr, sys::CUdeviceptr), InteropError> {
    let (mut base, mut size) = (0, 0);
    // SAFETY: a context is current; both results outlive the call.
    let known = unsafe { sys::cuMemGetAddressRange_v2(&mut base, &mut size, address) };
    check("cuMemGetAddressRange", known)?;
    Ok((base, base + size as u64))
}

/// Bytes from the first to the last of rows at a stride; the most that there is if they are more.
fn extent_bytes(source: Strided, row_bytes: usize, rows: usize) -> u64 {
    (rows.saturating_sub(1))
        .checked_mul(source.stride_bytes)
        .and_then(|bytes| bytes.checked_add(row_bytes))
        .unwrap_or(usize::MAX) as u64
}

/// Whether rows at a stride end before `end`.
fn fits(
    name: &str,
    source: Strided,
    row_bytes: usize,
    rows: usize,
    end: sys::CUdeviceptr,
) -> Result<(), InteropError> {
    if source.stride_bytes < row_bytes {
        return Err(InteropError::Size {
            name: format!("{name} row"),
            expected: row_bytes as u64,
            actual: source.stride_bytes as u64,
        });
    }
    let expected = extent_bytes(source, row_bytes, rows);
    let actual = end.saturating_sub(source.pointer);
    if expected <= actual {
        Ok(())
    } else {
        Err(InteropError::Size { name: name.to_owned(), expected, actual })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_end_where_their_allocation_does() {
        let at = |stride_bytes| Strided { pointer: 1000, stride_bytes };
        // Four rows of 16 bytes, the last without its padding.
        assert!(fits("hdr", at(16), 16, 4, 1064).is_ok());
        assert!(fits("hdr", at(32), 16, 4, 1112).is_ok());
        for (stride_bytes, end, words) in [
            (16, 1063, "`hdr` has 63 bytes, expected 64"),
            (32, 1111, "`hdr` has 111 bytes, expected 112"),
            (15, 2000, "`hdr row` has 15 bytes, expected 16"),
            (16, 900, "`hdr` has 0 bytes, expected 64"),
            (usize::MAX, u64::MAX - 1000, "expected 18446744073709551615"),
            (usize::MAX / 3, u64::MAX - 1000, "expected 18446744073709551615"),
        ] {
            let error = fits("hdr", at(stride_bytes), 16, 4, end).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
