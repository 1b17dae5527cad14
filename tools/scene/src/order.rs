//! Finds which of two solids can hide the other, and a drawing order in which no solid is hidden by a later one.
//!
//! Two solids change places in the order only while they do not overlap on the screen. So a change of order causes no
//! jump in the radiance over time.

use crate::view::{ViewObject, ViewShape};
use glam::DVec3;

/// Sorts solids so that each comes before all that it can hide.
pub(crate) fn front_to_back(solids: &mut [ViewObject]) {
    for place in 0..solids.len() {
        let free = (place..solids.len())
            .find(|&i| (place..solids.len()).all(|j| j == i || !hides(&solids[j], &solids[i])))
            .unwrap_or(place);
        solids[place..=free].rotate_right(1);
    }
}

/// Whether `a` can hide `b` from the origin.
fn hides(a: &ViewObject, b: &ViewObject) -> bool {
    match (a.shape, b.shape) {
        // The product of the distances to entry and exit is the same along every ray: the power of the origin with
        // respect to the sphere. Where spheres overlap on the screen, the smaller power is nearer.
        (ViewShape::Sphere { radius_m: ra }, ViewShape::Sphere { radius_m: rb }) => {
            a.origin.length_squared() - ra * ra < b.origin.length_squared() - rb * rb
        }
        (ViewShape::Panel { axes, half_m, .. }, ViewShape::Sphere { radius_m }) => {
            panel_hides_sphere(a.origin, axes, half_m, b.origin, radius_m)
        }
        (ViewShape::Sphere { radius_m }, ViewShape::Panel { axes, half_m, .. }) => {
            !panel_hides_sphere(b.origin, axes, half_m, a.origin, radius_m)
        }
        (ViewShape::Panel { .. }, ViewShape::Panel { .. }) => panel_hides_panel(a, b),
        _ => false,
    }
}

/// The plane half-way between the sphere and its nearest point on the panel separates the two.
fn panel_hides_sphere(
    centre: DVec3,
    axes: [DVec3; 2],
    half_m: [f64; 2],
    sphere: DVec3,
    radius_m: f64,
) -> bool {
    let offset = sphere - centre;
    let nearest: DVec3 =
        centre + (0..2).map(|i| axes[i] * offset.dot(axes[i]).clamp(-half_m[i], half_m[i])).sum::<DVec3>();
    let gap = sphere - nearest;
    let distance = gap.length();
    let toward_sphere = gap / distance;
    let middle = nearest + toward_sphere * (0.5 * (distance - radius_m));
    toward_sphere.dot(middle) > 0.0
}

/// If one panel lies wholly on one side of the other's plane, that plane separates the two.
fn panel_hides_panel(a: &ViewObject, b: &ViewObject) -> bool {
    if let Some(b_is_behind) = behind(a, b) {
        return b_is_behind;
    }
    if let Some(a_is_behind) = behind(b, a) {
        return !a_is_behind;
    }
    a.origin.length_squared() < b.origin.length_squared()
}

/// Whether `panel` lies beyond the plane of `plane` as seen from the origin. `None` if it crosses that plane.
fn behind(plane: &ViewObject, panel: &ViewObject) -> Option<bool> {
    let ViewShape::Panel { normal, offset_m, .. } = plane.shape else { return None };
    let ViewShape::Panel { axes, half_m, .. } = panel.shape else { return None };
    let middle = normal.dot(panel.origin) - offset_m;
    let reach = (normal.dot(axes[0]) * half_m[0]).abs() + (normal.dot(axes[1]) * half_m[1]).abs();
    (middle.abs() >= reach).then_some(middle < 0.0)
}
