//! A rate of frames or poses on the command line.

/// A rate in Hz.
pub fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if (1.0..=1e6).contains(&rate) => Ok(rate),
        _ => Err("expected 1 to 1000000".to_owned()),
    }
}
