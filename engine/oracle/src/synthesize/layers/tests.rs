use super::*;

const SIZE: (usize, usize) = (64, 24);

/// Whether column `x` shows a bar 3 px wide that moves by 8 px a frame before a wall at rest.
fn is_bar(x: usize, frame: usize) -> bool {
    (10 + 8 * frame..13 + 8 * frame).contains(&x)
}

fn vectors(frame: usize) -> Vec<[f64; 2]> {
    (0..SIZE.0 * SIZE.1).map(|i| if is_bar(i % SIZE.0, frame) { [-8.0, 0.0] } else { [0.0; 2] }).collect()
}

/// A bright bar before a dark wall.
struct Bar;

impl Levels for Bar {
    fn at(&self, frame: usize, position: DVec2) -> f64 {
        corners(SIZE, position).map(|((x, y), weight)| weight * self.pixel(frame, x, y)).sum()
    }

    fn pixel(&self, frame: usize, x: i64, _y: i64) -> f64 {
        if is_bar(x as usize, frame + 1) { 1.0 } else { 0.0 }
    }
}

fn layers(has_start: bool) -> Layers {
    let (start, end) = (vectors(1), vectors(2));
    Layers::new(SIZE, &end, Some(&start), has_start.then_some(1.0), 3)
}

#[test]
fn a_bar_is_whole_and_alone_at_every_instant() {
    for has_start in [false, true] {
        let layers = layers(has_start);
        for fraction in [0.125, 0.25, 0.5, 0.875] {
            for x in 0..SIZE.0 {
                let pixel = 12 * SIZE.0 + x;
                let first = 18.0 + 8.0 * fraction;
                let expected = f64::from(u8::from((first..first + 3.0).contains(&(x as f64))));
                if layers.has(pixel) {
                    let level = layers.level(&Bar, pixel, fraction).expect("both are seen");
                    assert!((level - expected).abs() < 1e-12, "{has_start} {fraction} {x}: {level}");
                } else {
                    assert_eq!(expected, 0.0, "column {x} is the wall's all the time");
                }
            }
        }
    }
}

/// A bright wire with soft borders before a dark wall. Only the pixels in its middle have its vector.
struct Wire;

impl Wire {
    const MIDDLE: i64 = 10;

    fn vectors(frame: i64) -> Vec<[f64; 2]> {
        let is_wire = |i: usize| (i % SIZE.0) as i64 == Wire::MIDDLE + 8 * frame;
        (0..SIZE.0 * SIZE.1).map(|i| if is_wire(i) { [-8.0, 0.0] } else { [0.0; 2] }).collect()
    }

    fn profile(off: i64) -> f64 {
        [1.0, 0.5].get(off.unsigned_abs() as usize).copied().unwrap_or(0.0)
    }
}

impl Levels for Wire {
    fn at(&self, frame: usize, position: DVec2) -> f64 {
        corners(SIZE, position).map(|((x, y), weight)| weight * self.pixel(frame, x, y)).sum()
    }

    fn pixel(&self, frame: usize, x: i64, _y: i64) -> f64 {
        Wire::profile(x - Wire::MIDDLE - 8 * (frame as i64 + 1))
    }
}

#[test]
fn soft_borders_move_with_what_they_are_of() {
    let (start, end) = (Wire::vectors(1), Wire::vectors(2));
    let layers = Layers::new(SIZE, &end, Some(&start), Some(1.0), 3);
    let mut shown = 0;
    for x in 0..SIZE.0 as i64 {
        let pixel = 12 * SIZE.0 + x as usize;
        let expected = Wire::profile(x - Wire::MIDDLE - 12);
        if layers.has(pixel) {
            let level = layers.level(&Wire, pixel, 0.5).expect("both are seen");
            // What is left of a border where the wire was, in a level of the wall, is a mixed pixel's share.
            assert!((level - expected).abs() < 0.1, "column {x}: {level}, expected {expected}");
            shown += usize::from(expected > 0.0);
        }
    }
    assert_eq!(shown, 3, "the middle and both borders");
}

#[test]
fn what_disappears_is_behind() {
    // A gap in a wall that moves, through which what is at rest is seen.
    let gap = |frame: usize| -> Vec<[f64; 2]> {
        let shows_rest = |x: usize| (10 + 8 * frame..22 + 8 * frame).contains(&x);
        (0..SIZE.0 * SIZE.1).map(|i| if shows_rest(i % SIZE.0) { [0.0; 2] } else { [-8.0, 0.0] }).collect()
    };
    let front = |start: Vec<[f64; 2]>, end: Vec<[f64; 2]>| {
        let layers = Layers::new(SIZE, &end, Some(&start), Some(1.0), 3);
        // The block of columns 24 to 31 in the second row.
        let block = &layers.blocks()[SIZE.0 / BLOCK_PX + 3];
        assert_eq!(block.layers.len(), 2);
        block.layers[0].motion.x
    };
    assert_eq!(front(vectors(1), vectors(2)), -8.0);
    assert_eq!(front(gap(1), gap(2)), -8.0);
    // A wall that moves behind a bar at rest: what it shows anew was hidden by the bar, though the bar is slower.
    let still = |[_, _]: [f64; 2], x: usize| if is_bar(x, 1) { [0.0, 0.0] } else { [-8.0, 0.0] };
    let fixed: Vec<[f64; 2]> =
        vectors(1).into_iter().enumerate().map(|(i, v)| still(v, i % SIZE.0)).collect();
    assert_eq!(front(fixed.clone(), fixed), 0.0);
}

#[test]
fn one_motion_has_no_layers() {
    let zoom: Vec<[f64; 2]> =
        (0..SIZE.0 * SIZE.1).map(|i| [0.1 * (i % SIZE.0) as f64, -0.1 * (i / SIZE.0) as f64]).collect();
    let layers = Layers::new(SIZE, &zoom, Some(&zoom), Some(1.0), 3);
    assert!((0..zoom.len()).all(|pixel| !layers.has(pixel)) && layers.motion_px().all(|px| px == 0.0));
}

#[test]
fn unusable_vectors_meet_nothing() {
    let mut end = vec![[0.0; 2]; SIZE.0 * SIZE.1];
    end[700] = [f64::NAN, 50.0];
    let layers = Layers::new(SIZE, &end, None, None, 3);
    assert!((0..end.len()).all(|pixel| !layers.has(pixel)));
}

#[test]
fn a_layer_that_turns_leads_to_the_pixel_at_both_ends() {
    // A quarter of a turn in eight frames around the middle.
    let (sine, cosine) = (std::f64::consts::FRAC_PI_2 / 8.0).sin_cos();
    let turn = |i: usize| {
        let at = DVec2::new((i % SIZE.0) as f64 - 32.0, (i / SIZE.0) as f64 - 12.0);
        (DVec2::new(cosine * at.x + sine * at.y, cosine * at.y - sine * at.x) - at).to_array()
    };
    let field: Vec<[f64; 2]> = (0..SIZE.0 * SIZE.1).map(turn).collect();
    let vectors = Vectors { size: SIZE, motion: &field };
    let layer = Layer::new(&vectors, Some((&vectors, 1.0)), (40, 10)).expect("a path that is known");
    let at = DVec2::new(37.0, 9.0);
    assert!(
        (layer.sources(at, 0.0)[0] - at).length() < 1e-9 && (layer.sources(at, 1.0)[1] - at).length() < 1e-9
    );
    let expected = DVec2::from(field[9 * SIZE.0 + 37]);
    assert!((layer.motion_at(at) - expected).length() < 1e-9, "vectors of what turns are linear");
    let halfway = DVec2::new(at.x - 32.0, at.y - 12.0);
    let (sine, cosine) = (std::f64::consts::FRAC_PI_2 / 16.0).sin_cos();
    let in_start = DVec2::new(cosine * halfway.x + sine * halfway.y, cosine * halfway.y - sine * halfway.x);
    let off = layer.sources(at, 0.5)[0] - (in_start + DVec2::new(32.0, 12.0));
    assert!(off.length() < 0.02, "{off}");
}
