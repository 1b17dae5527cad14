//! Times of samples, which many tracks may share.

use super::TrackError;
use super::velocity::Stencil;
use std::sync::Arc;

/// Times of samples, which many tracks may share: what follows from times alone is worked out once.
#[derive(Clone, Debug)]
pub struct PoseTimes(pub(super) Arc<Times>);

#[derive(Debug)]
pub(super) struct Times {
    pub times_ns: Vec<i64>,
    pub stencils: Vec<Stencil>,
}

impl PoseTimes {
    /// Times of samples.
    ///
    /// # Errors
    /// If there are none, or a time is not after the one before.
    pub fn new(times_ns: Vec<i64>) -> Result<Self, TrackError> {
        if times_ns.is_empty() {
            return Err(TrackError::Empty);
        }
        if let Some(i) = times_ns.windows(2).position(|pair| pair[1] <= pair[0]) {
            return Err(TrackError::Order {
                index: i + 1,
                previous_ns: times_ns[i],
                actual_ns: times_ns[i + 1],
            });
        }
        let stencils = (0..times_ns.len()).map(|i| Stencil::new(&times_ns, i)).collect();
        Ok(PoseTimes(Arc::new(Times { times_ns, stencils })))
    }

    /// The times.
    #[must_use]
    pub fn times_ns(&self) -> &[i64] {
        &self.0.times_ns
    }
}

impl PartialEq for PoseTimes {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0) || self.times_ns() == other.times_ns()
    }
}
