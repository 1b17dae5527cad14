//! How events leave the sensor: a bus that pixels wait for.

use crate::{SensorError, SensorModel};
use serde::{Deserialize, Serialize};

/// Longest service of one event or row, picoseconds: 1 ms.
pub const MAX_SERVICE_PS: u64 = 1_000_000_000;

/// Longest time in which a bus serves all its pixels, picoseconds: 3 s. No event waits longer.
pub const MAX_DRAIN_PS: u64 = 3_000_000_000_000;

/// How events leave the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReadoutKind {
    /// Each when it happens.
    None,
    /// One by one over a bus that pixels wait for.
    Fifo,
    /// Row by row over such a bus.
    Rows,
}

impl ReadoutKind {
    /// Name, as in TOML and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            ReadoutKind::None => "none",
            ReadoutKind::Fifo => "fifo",
            ReadoutKind::Rows => "rows",
        }
    }
}

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
    /// 0 for no cap. The events of a row's service are kept or dropped together. A cap that is switched on counts from then
    /// on.
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

impl SensorModel {
    /// The readout that the parameters describe.
    #[must_use]
    pub fn readout_model(&self) -> Readout {
        // Out of range saturates, and `validate` refuses it.
        let ps = |ns: f64| (ns * 1e3).round() as u64;
        let bus = match self.readout {
            ReadoutKind::None => Bus::Ideal,
            ReadoutKind::Fifo => Bus::Fifo { event_ps: ps(self.readout_event_ns) },
            ReadoutKind::Rows => {
                Bus::Rows { row_ps: ps(self.readout_row_ns), event_ps: ps(self.readout_event_ns) }
            }
        };
        Readout { bus, cap_events: self.readout_cap_events, cap_period_ns: self.readout_cap_period_ns }
    }

    /// Checks the parameters of the readout.
    pub(crate) fn check_readout(&self) -> Result<(), SensorError> {
        let most_ns = MAX_SERVICE_PS as f64 * 1e-3;
        let least_ns = |kind| if self.readout == kind { 0.001 } else { 0.0 };
        for (parameter, actual, least_ns) in [
            ("readout_event_ns", self.readout_event_ns, least_ns(ReadoutKind::Fifo)),
            ("readout_row_ns", self.readout_row_ns, least_ns(ReadoutKind::Rows)),
        ] {
            if !(least_ns..=most_ns).contains(&actual) {
                let kind = self.readout.name();
                let expected = format!("{least_ns} to {most_ns} for readout `{kind}`");
                return Err(SensorError::Range { parameter, expected, actual: actual.to_string() });
            }
        }
        if self.readout == ReadoutKind::None && self.readout_cap_events > 0 {
            return Err(SensorError::Range {
                parameter: "readout_cap_events",
                expected: "0 for readout `none`: only a bus has a rate controller".to_owned(),
                actual: self.readout_cap_events.to_string(),
            });
        }
        let readout = self.readout_model();
        readout.validate()?;
        let (pixels, rows) = (self.pixels() as u64, u64::from(self.height));
        let drain_ps = match readout.bus {
            Bus::Ideal => 0,
            Bus::Fifo { event_ps } => pixels * event_ps,
            Bus::Rows { row_ps, event_ps } => rows * row_ps + pixels * event_ps,
        };
        if drain_ps > MAX_DRAIN_PS {
            let (width, height) = (self.width, self.height);
            return Err(SensorError::Range {
                parameter: "readout_event_ns",
                expected: format!(
                    "so little that a bus of {width}x{height} pixels serves all of them within 3 s"
                ),
                actual: format!("{}, which takes {} s", self.readout_event_ns, drain_ps as f64 * 1e-12),
            });
        }
        Ok(())
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
