//! What a command publishes of a camera.

use esaac_engine::Tick;
use esaac_model::paths::{Intrinsics, Projection};
use esaac_model::{Intensity, SensorModel};
use esaac_ros::{ApsImage, CameraPlan, Imu, Split, TickMessages};
use glam::DVec2;
use std::borrow::Cow;

/// Lowest rate of an IMU's samples.
const IMU_RATE_HZ: f64 = 1000.0;

/// A camera that publishes events and APS frames only. `lens` is what its `camera_info` tells, if it is known.
#[must_use]
pub fn camera(name: String, sensor: &SensorModel, lens: Option<Intrinsics>) -> CameraPlan {
    let (sensor, split) = (sensor.clone(), Split::default());
    CameraPlan {
        name,
        sensor,
        lens,
        image: false,
        depth: false,
        imu: false,
        event_ids: false,
        split,
        frame_id: None,
    }
}

/// Depth along the optical axis, metres, from depth as `lens` measures it. A fisheye's is NaN at 90 degrees from the axis and
/// beyond.
#[must_use]
pub fn depth_along_axis<'a>(lens: &Intrinsics, depth_m: &'a [f32], width_px: u32) -> Cow<'a, [f32]> {
    if lens.projection() == Projection::Pinhole {
        return Cow::Borrowed(depth_m);
    }
    let width = width_px as usize;
    let along_axis = |(i, &depth_m): (usize, &f32)| {
        let ray = lens.ray(DVec2::new((i % width) as f64, (i / width) as f64));
        let forward = ray.map(|ray| -ray.z).filter(|&forward| forward > 0.0);
        forward.map_or(f32::NAN, |forward| (f64::from(depth_m) * forward) as f32)
    };
    Cow::Owned(depth_m.iter().enumerate().map(along_axis).collect())
}

/// Adds a camera's packet and APS frame to a tick's messages; `ids` are those of the packet's events, for a camera that was
/// announced with them.
pub fn add_camera(
    out: &mut TickMessages<'_>,
    camera: usize,
    sensor: &SensorModel,
    tick: &Tick<'_>,
    ids: Option<&[i64]>,
) {
    match ids {
        Some(ids) => out.events_with_ids(camera, &tick.view(camera), ids),
        None => out.events(camera, &tick.view(camera)),
    };
    if let Some(aps) = &tick.aps[camera] {
        let bayer = sensor.intensity == Intensity::BayerRggb;
        let pixels = tick.aps_pixels(camera);
        out.aps(camera, &ApsImage { pixels, bits: aps.bits, bayer, t_ns: aps.t_ns });
    }
}

/// Evenly spaced samples of an IMU between two frames. The last sample has the second frame's time. `sample`
/// returns angular rate and specific force in optical axes (x right, y down, z forward).
#[must_use]
pub fn imu_samples(from_ns: i64, to_ns: i64, sample: impl Fn(i64) -> [[f64; 3]; 2]) -> Vec<Imu> {
    let span_ns = to_ns - from_ns;
    let count = (span_ns as f64 * 1e-9 * IMU_RATE_HZ).ceil() as i64;
    // To x forward, y left, z up.
    let body = |[right, down, forward]: [f64; 3]| [forward, -right, -down];
    (1..=count)
        .map(|i| {
            let t_ns = from_ns + span_ns * i / count;
            let [rate, force] = sample(t_ns).map(body);
            Imu { t_ns, angular_rate_rad_s: rate, specific_force_m_s2: force }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_along_the_axis_and_a_pinhole_s_is_so_already() {
        let depth_m = [2.0, 2.0, 2.0, f32::INFINITY];
        let pinhole = Intrinsics::pinhole(1.0, 1.0, 0.0, 0.0).unwrap();
        assert!(matches!(depth_along_axis(&pinhole, &depth_m, 2), Cow::Borrowed(_)));
        // One radian a pixel: the third is in the second row, and the last one at the square root of 2 radians.
        let fisheye = Intrinsics::fisheye(1.0, 1.0, 0.0, 0.0).unwrap();
        let along = depth_along_axis(&fisheye, &depth_m, 2);
        let expected = (2.0 * 1_f64.cos()) as f32;
        assert_eq!(along[..], [2.0, expected, expected, f32::INFINITY]);
        let beyond = Intrinsics::fisheye(0.5, 0.5, 0.0, 0.0).unwrap();
        assert!(depth_along_axis(&beyond, &depth_m, 2)[1].is_nan(), "2 radians from the axis");
    }

    #[test]
    fn imu_samples_are_at_least_at_their_rate_and_end_with_the_frame() {
        let samples = imu_samples(33_333_333, 66_666_666, |_| [[1.0, 2.0, 3.0], [0.0, -9.81, 0.0]]);
        assert_eq!((samples.len(), samples[33].t_ns), (34, 66_666_666));
        assert_eq!(samples[0].angular_rate_rad_s, [3.0, -1.0, -2.0]);
        assert_eq!(samples[0].specific_force_m_s2, [0.0, 0.0, 9.81], "at rest, upwards");
        assert!(samples.windows(2).all(|pair| pair[0].t_ns < pair[1].t_ns));
    }
}
