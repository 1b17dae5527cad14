//! Rows of an image from one place on the device to another, after a look at where they end.

#![expect(unsafe_code, reason = "CUDA's edge")]

use super::context::check;
use super::stream::Stream;
use crate::error::InteropError;
use cudarc::driver::sys;

/// An image on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strided {
    /// `CUdeviceptr` of the first row.
    pub pointer: u64,
    /// Bytes from row to row.
    pub stride_bytes: usize,
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
        srcXInBytes: 0,
        srcY: 0,
        srcMemoryType: sys::CUmemorytype::CU_MEMORYTYPE_DEVICE,
        srcHost: std::ptr::null(),
        srcDevice: source.pointer,
        srcArray: std::ptr::null_mut(),
        srcPitch: source.stride_bytes,
        dstXInBytes: 0,
        dstY: 0,
        dstMemoryType: sys::CUmemorytype::CU_MEMORYTYPE_DEVICE,
        dstHost: std::ptr::null_mut(),
        dstDevice: target,
        dstArray: std::ptr::null_mut(),
        dstPitch: target_stride_bytes,
        WidthInBytes: row_bytes,
        Height: rows,
    };
    // SAFETY: as the caller guarantees.
    check("cuMemcpy2DAsync", unsafe { sys::cuMemcpy2DAsync_v2(&copy, stream.raw) })
}

/// Whether an image lies inside its allocation.
pub(super) fn check_source(
    name: &str,
    source: Strided,
    row_bytes: usize,
    rows: usize,
) -> Result<(), InteropError> {
    let (mut base, mut size) = (0, 0);
    // SAFETY: a context is current; both results outlive the call.
    let known = unsafe { sys::cuMemGetAddressRange_v2(&mut base, &mut size, source.pointer) };
    check("cuMemGetAddressRange", known)?;
    fits(name, source, row_bytes, rows, base + size as u64)
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
    let expected = (rows.saturating_sub(1))
        .checked_mul(source.stride_bytes)
        .and_then(|bytes| bytes.checked_add(row_bytes))
        .unwrap_or(usize::MAX) as u64;
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
