//! Which part of a tensor an index or a slice asks for. It needs no device, so it is tested without one.

/// A part: where it begins, in elements, and its shape.
pub type Part = (usize, Vec<usize>);

/// Why there is no such part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoPart {
    /// The tensor has one axis, and its elements lie on the device.
    Element,
    /// The index is not below the length.
    Outside {
        /// What was asked for.
        index: isize,
        /// Length of the first axis.
        length: usize,
    },
    /// Parts are contiguous: slices have no step but 1.
    Step(isize),
}

/// Part `index` along the first axis; negative ones count from the end.
pub fn at(shape: &[usize], index: isize) -> Result<Part, NoPart> {
    let (&length, rest) = shape.split_first().ok_or(NoPart::Element)?;
    if rest.is_empty() {
        return Err(NoPart::Element);
    }
    let from_start = if index < 0 { index + length as isize } else { index };
    if !(0..length as isize).contains(&from_start) {
        return Err(NoPart::Outside { index, length });
    }
    Ok((from_start as usize * elements(rest), rest.to_vec()))
}

/// Parts `start..stop` along the first axis.
pub fn slice(shape: &[usize], start: isize, stop: isize, step: isize) -> Result<Part, NoPart> {
    if step != 1 {
        return Err(NoPart::Step(step));
    }
    let (_, rest) = shape.split_first().ok_or(NoPart::Element)?;
    let count = (stop - start).max(0) as usize;
    Ok((start.max(0) as usize * elements(rest), [count].iter().chain(rest).copied().collect()))
}

/// Elements of a shape.
pub fn elements(shape: &[usize]) -> usize {
    shape.iter().product()
}
