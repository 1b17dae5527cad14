//! Parts of tensors, without a device.

#[path = "../src/axes.rs"]
mod axes;

use axes::{NoPart, at, elements, slice};

/// `list(tensor)` ended quietly at the first element, as an index beyond the end ends it.
#[test]
fn a_tensor_of_one_axis_has_no_elements_to_give_at_any_index() {
    for index in [0, 1, 4, 5, -1, -6] {
        assert_eq!(at(&[5], index), Err(NoPart::Element));
    }
    assert_eq!(at(&[0], 0), Err(NoPart::Element));
    assert_eq!(at(&[], 0), Err(NoPart::Element));
}

#[test]
fn parts_along_the_first_axis_lie_one_after_the_other() {
    let shape = [4, 3, 2];
    let parts: Vec<_> = (0..4).map(|index| at(&shape, index).unwrap()).collect();
    assert_eq!(parts, [0, 6, 12, 18].map(|start| (start, vec![3, 2])));
    assert_eq!(at(&shape, -1), at(&shape, 3));
    assert_eq!(at(&shape, 4), Err(NoPart::Outside { index: 4, length: 4 }));
    assert_eq!(at(&shape, -5), Err(NoPart::Outside { index: -5, length: 4 }));
    assert_eq!(at(&[0, 3], 0), Err(NoPart::Outside { index: 0, length: 0 }));
}

#[test]
fn slices_are_contiguous() {
    assert_eq!(slice(&[5], 1, 3, 1), Ok((1, vec![2])));
    assert_eq!(slice(&[5, 7], 2, 5, 1), Ok((14, vec![3, 7])));
    assert_eq!(slice(&[5], 3, 1, 1), Ok((3, vec![0])));
    assert_eq!(slice(&[5], 0, 5, 2), Err(NoPart::Step(2)));
    assert_eq!(elements(&[5, 7]), 35);
}
