//! Lines for the service's log, no more than a person can read. A peer that connects and fails in a loop
//! must not fill the disk: what comes faster is counted and summed up in one line.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// So many lines may come at once: more than a whole rig says when it starts.
const BURST: u32 = 64;

/// After a burst, one line in this time.
const PERIOD: Duration = Duration::from_secs(1);

/// Lines kept until someone asks for them.
const MAX_LINES: usize = 256;

/// The lines, and how many were left out.
pub(super) struct Notices {
    lines: VecDeque<String>,
    /// Lines that may be written now.
    allowed: u32,
    /// When `allowed` was last raised.
    raised: Instant,
    left_out: u64,
    last_left_out: String,
}

impl Notices {
    pub(super) fn new(now: Instant) -> Self {
        Notices {
            lines: VecDeque::new(),
            allowed: BURST,
            raised: now,
            left_out: 0,
            last_left_out: String::new(),
        }
    }

    /// Adds a line, or counts it.
    pub(super) fn say(&mut self, text: String, now: Instant) {
        self.sum_up(now);
        if self.may_write(now) {
            self.lines.push_back(text);
        } else {
            self.left_out += 1;
            self.last_left_out = text;
        }
    }

    /// Takes all lines.
    pub(super) fn take(&mut self, now: Instant) -> Vec<String> {
        self.sum_up(now);
        self.lines.drain(..).collect()
    }

    /// Says how many lines were left out, once a line may be written again.
    fn sum_up(&mut self, now: Instant) {
        if self.left_out > 0 && self.may_write(now) {
            let text =
                format!("{} more lines were left out, the last: {}", self.left_out, self.last_left_out);
            self.left_out = 0;
            self.lines.push_back(text);
        }
    }

    fn may_write(&mut self, now: Instant) -> bool {
        let periods = now.saturating_duration_since(self.raised).as_nanos() / PERIOD.as_nanos();
        if periods > 0 {
            let more = u32::try_from(periods).unwrap_or(u32::MAX);
            self.allowed = self.allowed.saturating_add(more).min(BURST);
            self.raised = now;
        }
        if self.allowed == 0 || self.lines.len() == MAX_LINES {
            return false;
        }
        self.allowed -= 1;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_lines_is_summed_up_and_none_is_lost_from_the_count() {
        let start = Instant::now();
        let mut notices = Notices::new(start);
        let (mut lines, mut counted) = (0, 0);
        let seconds = 90;
        for index in 0..93_000_u64 {
            let now = start + Duration::from_secs(seconds) * index as u32 / 93_000;
            notices.say(format!("connection {index}"), now);
            for line in notices.take(now) {
                lines += 1;
                counted += match line.split_once(" more lines were left out, the last: connection ") {
                    Some((count, _)) => count.parse::<u64>().unwrap(),
                    None => 1,
                };
            }
        }
        assert!(lines <= u64::from(BURST) + seconds + 1, "{lines} lines");
        let rest = notices.take(start + Duration::from_secs(seconds + 5)).join("\n");
        assert!(rest.ends_with("the last: connection 92999"), "{rest}");
        counted += rest.split(' ').next().unwrap().parse::<u64>().unwrap();
        assert_eq!(counted, 93_000);
    }

    #[test]
    fn a_line_that_comes_alone_is_said_at_once_and_as_it_is() {
        let start = Instant::now();
        let mut notices = Notices::new(start);
        notices.say("camera 0: gone".to_owned(), start);
        assert_eq!(notices.take(start), ["camera 0: gone"]);
        assert!(notices.take(start).is_empty());
        for second in 1..200 {
            let now = start + Duration::from_secs(second);
            notices.say("again".to_owned(), now);
            assert_eq!(notices.take(now), ["again"]);
        }
    }

    #[test]
    fn lines_that_nobody_takes_are_bounded_and_counted() {
        let start = Instant::now();
        let mut notices = Notices::new(start);
        let lines = MAX_LINES as u64 + 10;
        for second in 0..lines {
            notices.say(second.to_string(), start + Duration::from_secs(second));
        }
        let end = start + Duration::from_secs(lines + 5);
        assert_eq!(notices.take(end).len(), MAX_LINES);
        assert_eq!(notices.take(end), ["10 more lines were left out, the last: 265"]);
    }
}
