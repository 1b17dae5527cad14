//! Which images are copied together where some cameras wait.

use std::ops::Range;

/// Runs of cameras that have a time. Up to `gap` cameras without one between two runs belong to them.
pub fn runs(t_ns: &[Option<i64>], gap: usize) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for camera in (0..t_ns.len()).filter(|&camera| t_ns[camera].is_some()) {
        match runs.last_mut() {
            Some(run) if camera - run.end <= gap => run.end = camera + 1,
            _ => runs.push(camera..camera + 1),
        }
    }
    runs
}
