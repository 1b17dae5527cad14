//! What a command publishes of a camera.

use esaac_engine::Tick;
use esaac_model::{Intensity, SensorModel};
use esaac_ros::{ApsImage, CameraPlan, Imu, Intrinsics, Split, TickMessages};

/// Lowest rate of an IMU's samples.
const IMU_RATE_HZ: f64 = 1000.0;

/// A camera that publishes events and APS frames only.
#[must_use]
pub fn camera(name: String, sensor: &SensorModel) -> CameraPlan {
    let (sensor, split) = (sensor.clone(), Split::default());
    CameraPlan {
        name,
        sensor,
        intrinsics: None,
        image: false,
        depth: false,
        imu: false,
        split,
        frame_id: None,
    }
}

/// Intrinsics of a camera whose view axis meets the middle of the image.
#[must_use]
pub fn centred(focal_px: f64, width_px: u32, height_px: u32) -> Intrinsics {
    let centre_px = [width_px, height_px].map(|side| 0.5 * (f64::from(side) - 1.0));
    Intrinsics { focal_px: [focal_px; 2], centre_px }
}

/// Adds a camera's packet and APS frame to a tick's messages.
pub fn add_camera(out: &mut TickMessages<'_>, camera: usize, sensor: &SensorModel, tick: &Tick<'_>) {
    out.events(camera, &tick.view(camera));
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
    fn imu_samples_are_at_least_at_their_rate_and_end_with_the_frame() {
        let samples = imu_samples(33_333_333, 66_666_666, |_| [[1.0, 2.0, 3.0], [0.0, -9.81, 0.0]]);
        assert_eq!((samples.len(), samples[33].t_ns), (34, 66_666_666));
        assert_eq!(samples[0].angular_rate_rad_s, [3.0, -1.0, -2.0]);
        assert_eq!(samples[0].specific_force_m_s2, [0.0, 0.0, 9.81], "at rest, upwards");
        assert!(samples.windows(2).all(|pair| pair[0].t_ns < pair[1].t_ns));
    }
}
