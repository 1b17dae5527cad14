//! What a service gathers: events of each camera, run by run.

use crate::run_record::RunRecord;
use crate::warnings::Warnings;
use anyhow::Result;
use esaac_formats::event_file::EventColumns;
use esaac_interop::ServiceTick;
use std::path::{Path, PathBuf};

/// The report's timings are of so many intervals at least, the last ones.
const TIMINGS: usize = 50_000;

/// What a service has gathered so far.
pub struct Gathered {
    /// Counts of all runs, and the events of each camera's last run.
    pub record: RunRecord,
    /// Ticks that ended an interval of some camera.
    pub intervals: usize,
    /// By camera.
    streams: Vec<Stream>,
    /// Where events go; without it they are counted alone.
    out: Option<PathBuf>,
}

/// The frames of one camera. A run of them ends where time goes back, as with a producer that begins again: events of
/// both in one file would be out of order.
#[derive(Default)]
struct Stream {
    /// Time of the last frame.
    last_ns: Option<i64>,
    simulated_ns: i64,
    /// Whether the last run has an interval. One without has no events.
    has_interval: bool,
    /// Events of the runs before the last.
    earlier: Vec<EventColumns>,
}

impl Stream {
    /// Takes note of a frame. `first`: no interval ends with it. Returns whether it begins another run.
    fn add(&mut self, t_ns: i64, first: bool) -> bool {
        let last_ns = self.last_ns.replace(t_ns);
        if !first {
            self.has_interval = true;
            let interval_ns = last_ns.map_or(0, |last_ns| t_ns.saturating_sub(last_ns));
            self.simulated_ns = self.simulated_ns.saturating_add(interval_ns);
            return false;
        }
        let is_other = self.has_interval && last_ns.is_some_and(|last_ns| t_ns < last_ns);
        self.has_interval &= !is_other;
        is_other
    }
}

impl Gathered {
    /// Nothing yet. Events go to files in `out`.
    pub fn new(cameras: usize, out: Option<&Path>) -> Self {
        Gathered {
            record: RunRecord::new(cameras),
            intervals: 0,
            streams: (0..cameras).map(|_| Stream::default()).collect(),
            out: out.map(Path::to_owned),
        }
    }

    /// Adds a tick. Returns lines for the log.
    pub fn add(&mut self, tick: &ServiceTick<'_>, warnings: &mut Warnings) -> Result<Vec<String>> {
        let mut starts = Vec::new();
        let mut is_interval = false;
        for (camera, &t_ns) in tick.t_ns.iter().enumerate() {
            let Some(t_ns) = t_ns else { continue };
            let is_other_run = self.streams[camera].add(t_ns, tick.first[camera]);
            if tick.first[camera] {
                self.record.begin_anew(camera);
                starts.push(format!("camera {camera}: first frame, of {t_ns} ns"));
            } else {
                is_interval = true;
                self.record.add_camera(camera, &tick.tick, self.out.is_some())?;
            }
            if is_other_run {
                self.begin_file(camera, t_ns, warnings);
            }
        }
        // A first frame ends no interval.
        if is_interval {
            self.record.add_timing(tick.tick.stage_ns, tick.tick.submit_to_packet_ns);
            self.record.forget_old_timings(TIMINGS);
            self.intervals += 1;
        }
        Ok(starts)
    }

    /// Sets the events of the run that has ended apart. Warns once a camera: a producer may begin again and again.
    fn begin_file(&mut self, camera: usize, t_ns: i64, warnings: &mut Warnings) {
        let Some(out) = &self.out else { return };
        let earlier = &mut self.streams[camera].earlier;
        earlier.push(std::mem::take(&mut self.record.cameras[camera].events));
        if earlier.len() == 1 {
            warnings.tell(format_args!(
                "camera {camera}: its time goes back, to {t_ns} ns: the events from there on are in {}, and a file more \
                 each time that this happens again",
                file(out, camera, 1).display()
            ));
        }
    }

    /// Whether a camera had a frame.
    pub fn had_frame(&self, camera: usize) -> bool {
        self.streams[camera].last_ns.is_some()
    }

    /// Files of a camera's events, run by run. A camera without a frame has none.
    pub fn files(&self, camera: usize) -> Vec<(PathBuf, &EventColumns)> {
        let stream = &self.streams[camera];
        let Some(out) = self.out.as_ref().filter(|_| self.had_frame(camera)) else { return Vec::new() };
        let last = &self.record.cameras[camera].events;
        // A first run without an interval has an empty file: the camera had a frame.
        let last = (stream.has_interval || stream.earlier.is_empty()).then_some(last);
        let runs = stream.earlier.iter().chain(last);
        runs.enumerate().map(|(run, events)| (file(out, camera, run), events)).collect()
    }

    /// A file that looks like one of a camera's next run, if one lies in the folder: it is of an earlier service.
    pub fn left_over(&self, camera: usize) -> Option<PathBuf> {
        let next = file(self.out.as_ref()?, camera, self.files(camera).len().max(1));
        (self.had_frame(camera) && next.exists()).then_some(next)
    }

    /// Time that the intervals of a camera cover, of the camera with the most. Pauses do not count.
    pub fn simulated_ns(&self) -> i64 {
        self.streams.iter().map(|stream| stream.simulated_ns).max().unwrap_or(0)
    }
}

/// The file of a camera's run, which counts from 0.
pub fn file(out: &Path, camera: usize, run: usize) -> PathBuf {
    let of_run = if run == 0 { String::new() } else { format!("_run_{}", run + 1) };
    out.join(format!("camera_{camera}{of_run}.npz"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_time_is_that_of_the_intervals_wherever_zero_is() {
        let simulated_ns = |frames: &[(i64, bool)]| {
            let mut stream = Stream::default();
            frames.iter().for_each(|&(t_ns, first)| _ = stream.add(t_ns, first));
            stream.simulated_ns
        };
        assert_eq!(simulated_ns(&[(-500, true), (-300, false), (100, false)]), 600);
        assert_eq!((simulated_ns(&[]), simulated_ns(&[(-500, true)])), (0, 0));
        assert_eq!(simulated_ns(&[(0, true), (90, false), (0, true), (90, false)]), 180, "two runs");
        assert_eq!(simulated_ns(&[(0, true), (90, false), (5000, true), (5010, false)]), 100, "a pause");
        assert_eq!(simulated_ns(&[(i64::MIN, true), (i64::MAX, false)]), i64::MAX);
    }

    #[test]
    fn a_run_ends_where_time_goes_back_and_not_with_a_pause() {
        let mut stream = Stream::default();
        let mut begins = |t_ns, first| stream.add(t_ns, first);
        assert!(!begins(50, true));
        assert!(!begins(10, true), "the first run had no interval");
        assert!(!begins(20, false));
        assert!(!begins(20, true) && !begins(30, false), "it goes on");
        assert!(begins(29, true));
        assert!(!begins(0, true), "nor had this one");
        assert!(!begins(5, false));
        assert!(begins(0, true));
    }
}
