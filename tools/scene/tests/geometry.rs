//! Compares motion, depth and radiance of the f64 implementation with each other and with plain geometry.

use esaac_scene::view::ViewShape;
use esaac_scene::{Scene, SceneKind, View};
use glam::DVec3;

const WIDTH_PX: u32 = 173;
const HEIGHT_PX: u32 = 131;
const INTERVAL_S: f64 = 1.0 / 30.0;

/// Tolerance for f64 rounding of a projection, pixels.
const PROJECTION_TOLERANCE_PX: f64 = 1e-9;

/// Pixel at which a point in camera axes is seen.
fn project(view: &View, p: DVec3) -> [f64; 2] {
    [
        view.focal_px * p.x / p.z + 0.5 * f64::from(view.width_px - 1),
        view.focal_px * p.y / p.z + 0.5 * f64::from(view.height_px - 1),
    ]
}

fn pixels() -> impl Iterator<Item = (f64, f64)> {
    (0..HEIGHT_PX)
        .step_by(3)
        .flat_map(|y| (0..WIDTH_PX).step_by(3).map(move |x| (f64::from(x), f64::from(y))))
}

/// Takes the seen point to the world, moves it with its object, and projects it to the earlier camera.
#[test]
fn motion_is_the_reprojection_of_the_surface_point() {
    let scene = SceneKind::Flight.scene(WIDTH_PX, HEIGHT_PX);
    for step in 0..12 {
        let t_s = 0.7 * f64::from(step);
        let previous_s = t_s - INTERVAL_S;
        let (view, previous) = (scene.view(t_s), scene.view(previous_s));
        let (camera, camera_before) = (scene.camera_state(t_s), scene.camera_state(previous_s));
        for (x, y) in pixels() {
            let sample = view.sample(x, y);
            let object = &view.objects[sample.object];
            let (origin, turn) = scene.objects[object.id].motion.pose(t_s);
            let (origin_before, turn_before) = scene.objects[object.id].motion.pose(previous_s);
            let at_infinity = matches!(object.shape, ViewShape::Sky | ViewShape::Ridge { .. });
            let expected = if at_infinity {
                let direction = camera.world_from_body * sample.position;
                project(&previous, camera_before.world_from_body.transpose() * direction)
            } else {
                let world = camera.position_m + camera.world_from_body * sample.position;
                let own = turn.transpose() * (world - origin);
                let world_before = origin_before + turn_before * own;
                let seen =
                    camera_before.world_from_body.transpose() * (world_before - camera_before.position_m);
                project(&previous, seen)
            };
            let motion = view.motion(&sample, &previous);
            assert!((x + motion[0] - expected[0]).abs() < PROJECTION_TOLERANCE_PX, "({x}, {y}) at {t_s}");
            assert!((y + motion[1] - expected[1]).abs() < PROJECTION_TOLERANCE_PX, "({x}, {y}) at {t_s}");
        }
    }
}

#[test]
fn a_seen_point_is_on_its_surface_and_on_the_pixels_ray() {
    let scene = SceneKind::Flight.scene(WIDTH_PX, HEIGHT_PX);
    let view = scene.view(2.0);
    let mut seen = std::collections::BTreeMap::new();
    for (x, y) in pixels() {
        let sample = view.sample(x, y);
        let object = &view.objects[sample.object];
        *seen.entry(object.id).or_insert(0) += 1;
        let p = sample.position;
        let [px, py] = project(&view, p);
        assert!((px - x).abs() < PROJECTION_TOLERANCE_PX && (py - y).abs() < PROJECTION_TOLERANCE_PX);
        match object.shape {
            // A sphere's edge is rounded off over a pixel.
            ViewShape::Sphere { radius_m } => {
                let off_m = ((p - object.origin).length() - radius_m).abs();
                assert!(off_m < 2.0 * p.z / view.focal_px, "{off_m}");
            }
            ViewShape::Panel { normal, offset_m, .. } => assert!((normal.dot(p) - offset_m).abs() < 1e-9),
            ViewShape::Ground { height_m, .. } => {
                let off = view.light.up.dot(p) / height_m + 1.0;
                assert!(off.abs() < 0.02 || p.length() > 50.0, "{off}");
            }
            _ => assert_eq!(sample.depth_m, f64::INFINITY),
        }
        assert!(at_infinity(&view, sample.object) || sample.depth_m == p.z);
    }
    assert!(seen.len() >= 8, "several depth layers: {seen:?}");
}

fn at_infinity(view: &View, object: usize) -> bool {
    matches!(view.objects[object].shape, ViewShape::Sky | ViewShape::Ridge { .. })
}

/// Along the motion vector a matt surface nearly keeps its radiance. Exceptions are the light on turning spheres, the
/// sharpness that changes with distance, and pixels shared by two surfaces.
#[test]
fn radiance_along_the_motion_path_is_nearly_constant() {
    let scene = SceneKind::Flight.scene(WIDTH_PX, HEIGHT_PX);
    let mut changes = Vec::new();
    for step in 0..8 {
        let t_s = 1.1 * f64::from(step);
        let (view, previous) = (scene.view(t_s), scene.view(t_s - 0.1 * INTERVAL_S));
        for (x, y) in pixels() {
            let sample = view.sample(x, y);
            if !matches!(
                view.objects[sample.object].shape,
                ViewShape::Ground { .. } | ViewShape::Panel { .. }
            ) {
                continue;
            }
            let [dx, dy] = view.motion(&sample, &previous);
            let [_, now, _] = sample.radiance.to_array();
            let [_, before, _] = previous.radiance(x + dx, y + dy);
            changes.push((now / before).ln().abs());
        }
    }
    changes.sort_by(f64::total_cmp);
    let quantile = |q: f64| changes[(q * changes.len() as f64) as usize];
    assert!(quantile(0.5) < 1e-3, "median {}", quantile(0.5));
    assert!(quantile(0.95) < 2e-2, "95% {}", quantile(0.95));
}

#[test]
fn a_card_moves_as_one_and_keeps_its_radiance_exactly() {
    for kind in [SceneKind::Edge, SceneKind::Sinusoid, SceneKind::Hdr, SceneKind::Lamp] {
        let scene = kind.scene(WIDTH_PX, HEIGHT_PX);
        let velocity = scene.objects[0].motion.velocity;
        let period_s = if kind == SceneKind::Lamp { 1.0 / scene.lamp.rate_hz } else { INTERVAL_S };
        let (t_s, previous_s) = (2.0, 2.0 - period_s);
        for (x, y) in pixels() {
            let [dx, dy] = scene.motion(x, y, t_s, previous_s);
            assert!((dx + velocity.x * period_s).abs() < 1e-9 && (dy + velocity.y * period_s).abs() < 1e-9);
            let (now, before) = (scene.radiance(x, y, t_s), scene.radiance(x + dx, y + dy, previous_s));
            for (a, b) in now.into_iter().zip(before) {
                assert!((a / b - 1.0).abs() < 1e-9, "{kind:?}: {a} {b}");
            }
        }
    }
}

/// The log radiance of neighbouring instants and points differs little: it does not jump where the order of objects
/// changes, at borders, or where a surface ends.
#[test]
fn radiance_is_continuous_in_time_and_space() {
    let scene = SceneKind::Flight.scene(WIDTH_PX, HEIGHT_PX);
    let dt_s = 1e-6;
    let step_px = 1e-3;
    for step in 0..40 {
        let t_s = 0.377 * f64::from(step);
        let (view, next) = (scene.view(t_s), scene.view(t_s + dt_s));
        for (x, y) in pixels() {
            let log = |rgb: [f64; 3]| rgb[1].ln();
            let here = log(view.radiance(x, y));
            assert!((log(next.radiance(x, y)) - here).abs() < 5e-3, "time {t_s} ({x}, {y})");
            assert!((log(view.radiance(x + step_px, y)) - here).abs() < 1e-2, "x {t_s} ({x}, {y})");
            assert!((log(view.radiance(x, y + step_px)) - here).abs() < 1e-2, "y {t_s} ({x}, {y})");
        }
    }
}

/// Radiance has no frequencies near that of the pixel grid. For nearly all pixels the second difference of log radiance
/// stays far below that of a pattern that alternates from pixel to pixel.
#[test]
fn radiance_is_band_limited() {
    for kind in SceneKind::ALL {
        let scene: Scene = kind.scene(WIDTH_PX, HEIGHT_PX);
        let view = scene.view(1.0);
        let mut interpolation_errors: Vec<f64> = pixels()
            .map(|(x, y)| {
                let at = |dx: f64| view.radiance(x + dx, y)[1].ln();
                let cubic = (9.0 * (at(-0.5) + at(0.5)) - at(-1.5) - at(1.5)) / 16.0;
                (cubic - at(0.0)).abs()
            })
            .collect();
        interpolation_errors.sort_by(f64::total_cmp);
        let quantile = interpolation_errors[interpolation_errors.len() * 99 / 100];
        // A pole's two borders are closer than they are soft, so its profile is as sharp as one can be.
        let allowed = if kind == SceneKind::Poles { 0.15 } else { 0.06 };
        assert!(quantile < allowed, "{kind:?}: {quantile}");
    }
}

#[test]
fn nothing_moves_in_the_still_scene() {
    let scene = SceneKind::Still.scene(WIDTH_PX, HEIGHT_PX);
    assert_eq!(scene.view(0.0), scene.view(3600.0));
    assert!(pixels().all(|(x, y)| scene.motion(x, y, 5.0, 4.0) == [0.0, 0.0]));
}

#[test]
fn the_wide_range_spans_eight_decades() {
    let scene = SceneKind::Hdr.scene(346, 260);
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    for step in 0..10 {
        let view = scene.view(0.5 * f64::from(step));
        for y in (0..260).step_by(4) {
            for x in (0..346).step_by(4) {
                let [_, g, _] = view.radiance(f64::from(x), f64::from(y));
                (low, high) = (low.min(g), high.max(g));
            }
        }
    }
    assert!((0.9e-3..2e-3).contains(&low) && (5e4..1.2e5).contains(&high), "{low} {high}");
}
