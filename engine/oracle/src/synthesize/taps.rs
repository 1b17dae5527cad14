//! Interpolation of an image between its pixels. Positions are clamped to the image.

use esaac_model::synthesis::cubic_weights;

/// Bilinear interpolation of the four pixels around `(x, y)`.
#[must_use]
pub fn bilinear(plane: &[f64], (width, height): (usize, usize), x: f64, y: f64) -> f64 {
    let (x0, x1, fx) = neighbours(x, width);
    let (y0, y1, fy) = neighbours(y, height);
    let row = |y: usize| plane[y * width + x0] * (1.0 - fx) + plane[y * width + x1] * fx;
    row(y0) * (1.0 - fy) + row(y1) * fy
}

/// Keys' cubic interpolation at `(x, y)`, pixels. The result is clamped to the range of the central four pixels. It has
/// sixteen taps, or twelve, of which the outer two rows are linear.
#[must_use]
pub fn cubic(
    plane: &[f64],
    (width, height): (usize, usize),
    x: f64,
    y: f64,
    parameter: f64,
    twelve_taps: bool,
) -> f64 {
    let (x0, _, fx) = neighbours(x, width);
    let (y0, _, fy) = neighbours(y, height);
    cubic_in(plane, (width, height), [x0, y0], [fx, fy], parameter, twelve_taps)
}

/// [`cubic`] with the taps of the cell whose first pixel is `(x0, y0)`. The fractions may lie slightly outside 0 to 1.
#[must_use]
pub fn cubic_in(
    plane: &[f64],
    (width, height): (usize, usize),
    [x0, y0]: [usize; 2],
    [fx, fy]: [f64; 2],
    parameter: f64,
    twelve_taps: bool,
) -> f64 {
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let columns = [x0.saturating_sub(1), x0, x1, (x0 + 2).min(width - 1)];
    let rows = [y0.saturating_sub(1), y0, y1, (y0 + 2).min(height - 1)];
    let cubic = cubic_weights(fx, parameter);
    let outer = if twelve_taps { [0.0, 1.0 - fx, fx, 0.0] } else { cubic };
    let across = [outer, cubic, cubic, outer];
    let down = cubic_weights(fy, parameter);
    let mut sum = 0.0;
    for j in 0..4 {
        let row = &plane[rows[j] * width..][..width];
        for i in 0..4 {
            sum += down[j] * across[j][i] * row[columns[i]];
        }
    }
    let centre = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| plane[y * width + x]);
    let low = centre.into_iter().fold(f64::INFINITY, f64::min);
    let high = centre.into_iter().fold(f64::NEG_INFINITY, f64::max);
    sum.clamp(low, high)
}

/// The two pixels around a coordinate, clamped to the image, and its fraction from the first to the second.
fn neighbours(coordinate: f64, size: usize) -> (usize, usize, f64) {
    let clamped = coordinate.clamp(0.0, (size - 1) as f64);
    let first = clamped as usize;
    (first, (first + 1).min(size - 1), clamped - first as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bilinear_is_exact_on_planes_and_clamps() {
        let plane: Vec<f64> = (0..12).map(|i| (i % 4) as f64 + 10.0 * (i / 4) as f64).collect();
        let at = |x, y| bilinear(&plane, (4, 3), x, y);
        assert!((at(1.25, 0.5) - 6.25).abs() < 1e-12);
        assert_eq!(at(3.0, 2.0), 23.0);
        assert_eq!(at(-7.0, 99.0), 20.0);
        assert_eq!(bilinear(&[5.0], (1, 1), 0.3, -0.2), 5.0);
    }

    #[test]
    fn cubic_is_the_pixel_at_a_pixel_and_never_overshoots() {
        let plane = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0];
        let at = |x, y| cubic(&plane, (4, 2), x, y, -0.75, true);
        assert_eq!((at(2.0, 1.0), at(0.0, 0.0), at(99.0, -3.0)), (1.0, 0.0, 1.0));
        assert!((at(1.5, 0.5) - 0.5).abs() < 1e-12);
        assert_eq!((at(0.5, 0.3), at(2.5, 0.3)), (0.0, 1.0));
        assert!(at(1.25, 0.0) < 0.25, "steeper than a straight line");
        assert_eq!(cubic(&[5.0], (1, 1), 0.3, 0.2, -1.0, true), 5.0);
    }

    /// Keys (1981): with the parameter -1/2 the kernel is exact for polynomials of the second degree, on each axis.
    #[test]
    fn sixteen_taps_are_exact_for_second_degrees_in_both_axes_and_twelve_are_not() {
        let surface = |x: f64, y: f64| (1.0 + 0.3 * x + 0.2 * x * x) * (2.0 + 0.5 * y + 0.1 * y * y);
        let plane: Vec<f64> = (0..36).map(|i| surface((i % 6) as f64, (i / 6) as f64)).collect();
        let error = |x: f64, y: f64, twelve_taps| {
            (cubic(&plane, (6, 6), x, y, -0.5, twelve_taps) - surface(x, y)).abs()
        };
        for (x, y) in [(2.5, 2.5), (1.25, 3.75), (3.9, 1.1), (2.0, 2.4)] {
            assert!(error(x, y, false) < 1e-12, "({x}, {y})");
        }
        assert!(error(2.5, 2.5, true) > 1e-3);
    }
}
