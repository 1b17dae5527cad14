//! `esaac compare`: how far one file of events is from another.

use crate::outcome::Outcome;
use crate::{stderr, table};
use anyhow::{Result, ensure};
use esaac_benches::truth::MATCH_WINDOW_US;
use esaac_formats::any_events::{self, AnyEvents};
use esaac_model::packet::Event;
use esaac_oracle::metrics::{Comparison, SHIFT_NS, TimeError, compare};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Arguments of `compare`.
#[derive(clap::Args, Clone, Debug)]
pub struct CompareArguments {
    /// True events: .npz, .raw (EVT3) or .aedat4
    #[arg(value_name = "TRUTH")]
    pub truth: PathBuf,
    /// Events to compare with them, of a sensor of the same size
    #[arg(value_name = "EVENTS")]
    pub events: PathBuf,
    /// Leave out what comes up to this time, seconds [default: 0 with a truth of `render --truth`]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub from: Option<f64>,
    /// Leave out what comes after this time, seconds [default: where a truth of `render --truth` ends]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub to: Option<f64>,
}

/// What `--json` prints.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct CompareReport {
    /// ON and OFF events of the truth.
    truth_on_off: (u64, u64),
    /// ON and OFF events of the other file.
    on_off: (u64, u64),
    /// Events per true event.
    count_ratio: f64,
    /// Harmonic mean of precision and recall.
    f1: f64,
    /// Largest time between two events that match, microseconds.
    match_window_us: f64,
    /// Victor-Purpura distance per true event.
    victor_purpura: f64,
    /// Time shift that costs as much as an event too few or too many, microseconds.
    victor_purpura_shift_us: f64,
    /// Share of pixels that have the same polarities in the same order.
    same_sequence: f64,
    /// Time between matched events, microseconds: median, 99% and largest; `null` where none match.
    time_error_us: Option<[f64; 3]>,
}

impl CompareReport {
    fn new(found: &Comparison) -> Self {
        let TimeError { p50_us, p99_us, max_us, .. } = found.matched;
        CompareReport {
            truth_on_off: found.truth_on_off,
            on_off: found.tested_on_off,
            count_ratio: found.count_ratio,
            f1: found.f1,
            match_window_us: MATCH_WINDOW_US,
            victor_purpura: found.victor_purpura,
            victor_purpura_shift_us: SHIFT_NS * 1e-3,
            same_sequence: found.same_sequence,
            time_error_us: (found.f1 > 0.0).then_some([p50_us, p99_us, max_us]),
        }
    }

    fn text(&self) -> String {
        let time_error = self.time_error_us.map_or("-".to_owned(), |[median, most, largest]| {
            format!("median {median:.1} us, 99% {most:.1} us, largest {largest:.1} us")
        });
        let counts = |(on, off): (u64, u64)| format!("{} ({on} ON, {off} OFF)", on + off);
        let rows = [
            ("true events", counts(self.truth_on_off)),
            ("events", counts(self.on_off)),
            ("events per true event", format!("{:.3}", self.count_ratio)),
            ("F1", format!("{:.3} within {} us", self.f1, self.match_window_us)),
            (
                "Victor-Purpura",
                format!(
                    "{:.3} per true event, {} us a shift",
                    self.victor_purpura, self.victor_purpura_shift_us
                ),
            ),
            ("same sequence", format!("{:.1}% of the pixels", 100.0 * self.same_sequence)),
            ("time error", time_error),
        ];
        table::render(&rows.map(|(name, value)| vec![name.to_owned(), value]))
    }
}

/// Runs the command.
pub fn run(arguments: &CompareArguments, json: bool) -> Result<Outcome> {
    let other = any_events::read(&arguments.events)?;
    let truth = any_events::read_truth(&arguments.truth, other.size_px)?;
    ensure!(
        truth.size_px == other.size_px,
        "{} is of a sensor of {}x{} px, expected {}x{} as {}",
        arguments.events.display(),
        other.size_px.0,
        other.size_px.1,
        truth.size_px.0,
        truth.size_px.1,
        arguments.truth.display()
    );
    let span_ns = span_ns(arguments, &truth)?;
    let chosen = |events: &AnyEvents| -> Vec<Event> {
        events.events.iter().copied().filter(|e| e.t_ns > span_ns.0 && e.t_ns <= span_ns.1).collect()
    };
    let (true_events, events) = (chosen(&truth), chosen(&other));
    ensure!(
        !true_events.is_empty(),
        "no true event lies in the time that is compared, so that nothing can be said: {}, {}; expected --from and --to \
         around true events",
        told(&arguments.truth, &truth.events),
        told(&arguments.events, &other.events)
    );
    if let Some(warning) = apart((&arguments.truth, &true_events), (&arguments.events, &events)) {
        stderr::line(warning);
    }
    let report = CompareReport::new(&compare(truth.size_px, true_events, events));
    let text = if json { serde_json::to_string_pretty(&report)? + "\n" } else { report.text() };
    Ok(Outcome::complete(text))
}

/// The times of events that count: after the first, up to the second.
fn span_ns(arguments: &CompareArguments, truth: &AnyEvents) -> Result<(i64, i64)> {
    for (flag, seconds) in [("--from", arguments.from), ("--to", arguments.to)] {
        ensure!(seconds.is_none_or(f64::is_finite), "{flag} is no number of seconds");
    }
    // Before its first frame an exact truth knows nothing; other recordings begin where they do.
    let from_ns = arguments.from.map_or(truth.end_ns.map_or(i64::MIN, |_| 0), |s| (s * 1e9).round() as i64);
    let to_ns = arguments.to.map_or(truth.end_ns.unwrap_or(i64::MAX), |s| (s * 1e9).round() as i64);
    ensure!(
        from_ns < to_ns,
        "nothing lies between {:.6} and {:.6} s, expected --from before --to",
        from_ns as f64 * 1e-9,
        to_ns as f64 * 1e-9
    );
    Ok((from_ns, to_ns))
}

/// A file, and when its events are.
fn told(path: &Path, events: &[Event]) -> String {
    let path = path.display();
    match events {
        [first, .., last] => {
            format!("{path} from {:.6} to {:.6} s", first.t_ns as f64 * 1e-9, last.t_ns as f64 * 1e-9)
        }
        [only] => format!("{path} at {:.6} s", only.t_ns as f64 * 1e-9),
        [] => format!("{path} has no events"),
    }
}

/// A warning if all events of one file come before those of the other, as where they have other clocks.
fn apart(a: (&Path, &[Event]), b: (&Path, &[Event])) -> Option<String> {
    let ends_ns = |events: &[Event]| Some((events.first()?.t_ns, events.last()?.t_ns));
    let ((first_a, last_a), (first_b, last_b)) = (ends_ns(a.1)?, ends_ns(b.1)?);
    (last_a < first_b || last_b < first_a).then(|| {
        format!(
            "warning: the times of the files do not overlap: {}, {}; expected one clock",
            told(a.0, a.1),
            told(b.0, b.1)
        )
    })
}
