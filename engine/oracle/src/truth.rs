//! The events that densely rendered frames imply: log intensity is linear in time from each frame to the next, and
//! every crossing counts.

use crate::oracle::Oracle;
use esaac_model::packet::Event;
use esaac_model::{SensorError, SensorModel, SubstepPolicy};
use thiserror::Error;

/// Why no events could be computed.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum TruthError {
    /// The sensor is not valid.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The times are not valid.
    #[error(transparent)]
    Frame(#[from] esaac_model::FrameError),
    /// A frame has the wrong size.
    #[error("truth frame {index} has {actual} pixels, expected {expected}")]
    Size {
        /// Number of the frame.
        index: usize,
        /// Pixels of the sensor.
        expected: usize,
        /// Pixels of the frame.
        actual: usize,
    },
}

/// Events between the first and the last of `frames`, sorted by (t, y, x, polarity). Each frame is a time in
/// nanoseconds and the intensities of all pixels (`y * width + x`), scene units.
pub fn events<'a>(
    sensor: &SensorModel,
    camera: u32,
    frames: impl IntoIterator<Item = (i64, &'a [f64])>,
) -> Result<Vec<Event>, TruthError> {
    let exact = SensorModel { substeps: 1, substep_policy: SubstepPolicy::Fixed, ..sensor.clone() };
    let mut oracle = Oracle::new(exact, camera)?;
    let mut events = Vec::new();
    let mut previous: Option<&[f64]> = None;
    for (index, (t_ns, frame)) in frames.into_iter().enumerate() {
        if frame.len() != sensor.pixels() {
            return Err(TruthError::Size { index, expected: sensor.pixels(), actual: frame.len() });
        }
        let start = previous.unwrap_or(frame);
        // With one sub-step the oracle samples the interval's two ends alone.
        let sample = |pixel: usize, from_start_ns: f64| {
            if from_start_ns > 0.0 { frame[pixel] } else { start[pixel] }
        };
        events.extend(oracle.step_samples(t_ns, &sample)?.packet.iter());
        previous = Some(frame);
    }
    Ok(events)
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_model::Polarity;

    #[test]
    fn crossings_lie_on_the_log_linear_path() {
        let sensor = SensorModel { width: 2, height: 1, log_offset: 1.0, ..SensorModel::default() };
        let log = |l: f64| l.exp() - 1.0;
        let frames = [[log(0.1), 0.5], [log(0.6), 0.5], [log(0.0), 0.5]];
        let got = events(&sensor, 0, (0..3).map(|i| (i as i64 * 1_000_000, &frames[i][..]))).unwrap();
        let expect = [(400_000, Polarity::On), (800_000, Polarity::On)];
        let expect = expect.into_iter().chain([(1_500_000, Polarity::Off), (1_833_334, Polarity::Off)]);
        for (event, (t_ns, polarity)) in got.iter().zip(expect) {
            assert!((event.t_ns - t_ns).abs() <= 1 && event.polarity == polarity, "{event:?}");
        }
        assert_eq!(got.len(), 4);
    }

    #[test]
    fn errors_say_what_is_wrong() {
        let sensor = SensorModel { width: 2, height: 1, ..SensorModel::default() };
        let short = events(&sensor, 0, [(0, &[1.0][..])]).unwrap_err();
        assert_eq!(short.to_string(), "truth frame 0 has 1 pixels, expected 2");
        let back = events(&sensor, 0, [(5, &[1.0, 1.0][..]), (5, &[1.0, 1.0][..])]);
        assert!(matches!(back, Err(TruthError::Frame(_))));
    }
}
