//! How events leave the sensor: a bus that pixels wait for.

use crate::SensorError;
use serde::{Deserialize, Serialize};

/// Longest service of one event or row, picoseconds: 1 ms.
pub const MAX_SERVICE_PS: u64 = 1_000_000_000;

/// Longest time in which a bus serves all its pixels, picoseconds: 3 s. No event waits longer.
pub const MAX_DRAIN_PS: u64 = 3_000_000_000_000;

/// Who is served next, and how long that takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bus {
    /// Every event leaves when it happens.
    Ideal,
    /// Word-serial (DAVIS): events leave one by one in the order (t, y, x, polarity). An event leaves when its service
    /// ends.
    Fifo {
        /// Service of an event, picoseconds.
        event_ps: u64,
    },
    /// Row arbiter (Prophesee): all events that wait in a row are read together. The row whose first waiting event is
    /// the oldest is next; of rows equal in that, the upper one. An event is read if it happens no later than the
    /// service of its row begins. All events of a service leave when it ends.
    Rows {
        /// Service of a row, picoseconds.
        row_ps: u64,
        /// Further service for each event in it, picoseconds.
        event_ps: u64,
    },
}

/// A sensor's readout.
///
/// An event at `t` (after the latency) takes its pixel's place until it is served. Another event of that pixel at
/// `t' <= t_out`, where `t_out` is when the first one leaves, is lost. A served event's time stamp is `t_out`, floored to
/// the sensor's `timestamp_quantum_ns`. It belongs to the packet of the interval in which `t_out` lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Readout {
    /// The bus.
    pub bus: Bus,
    /// Once so many events have left in a period, the sensor's rate controller drops what is served in the rest of it;
    /// 0 for no cap. The events of a row's service are kept or dropped together.
    pub cap_events: u32,
    /// Length of a period, nanoseconds. Periods begin at multiples of it.
    pub cap_period_ns: u32,
}

impl Default for Readout {
    fn default() -> Self {
        Readout { bus: Bus::Ideal, cap_events: 0, cap_period_ns: 50_000 }
    }
}

impl Readout {
    /// Checks that every parameter is in its range.
    ///
    /// # Errors
    /// `SensorError::Range` names the first parameter that is not.
    pub fn validate(&self) -> Result<(), SensorError> {
        let check = |parameter, actual: u64, low: u64, high: u64| {
            if (low..=high).contains(&actual) {
                Ok(())
            } else {
                let expected = format!("{low} to {high}");
                Err(SensorError::Range { parameter, expected, actual: actual.to_string() })
            }
        };
        match self.bus {
            Bus::Ideal => {}
            Bus::Fifo { event_ps } => check("event_ps", event_ps, 1, MAX_SERVICE_PS)?,
            Bus::Rows { row_ps, event_ps } => {
                check("row_ps", row_ps, 1, MAX_SERVICE_PS)?;
                check("event_ps", event_ps, 0, MAX_SERVICE_PS)?;
            }
        }
        check("readout_cap_period_ns", u64::from(self.cap_period_ns), 1, 1_000_000_000)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bus_that_takes_no_time_or_forever_is_refused() {
        let readout = |bus| Readout { bus, ..Readout::default() };
        for (bad, parameter) in [
            (readout(Bus::Fifo { event_ps: 0 }), "event_ps"),
            (readout(Bus::Rows { row_ps: 0, event_ps: 10 }), "row_ps"),
            (readout(Bus::Fifo { event_ps: MAX_SERVICE_PS + 1 }), "event_ps"),
            (Readout { cap_period_ns: 0, ..Readout::default() }, "readout_cap_period_ns"),
        ] {
            let error = bad.validate().expect_err(parameter).to_string();
            assert!(error.contains(parameter), "{error}");
        }
        readout(Bus::Fifo { event_ps: 83_000 }).validate().expect("DAVIS346");
    }
}
