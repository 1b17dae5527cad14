//! A tick that was submitted, as a state machine. Its only loop is here. What comes before is in [`super::submit`].
//!
//! ```text
//! Submitted -> Ran -> Done
//!              |  ^
//!              v  |      events did not fit: grow what is too small, resume the counters, run the rest
//!             Retry
//!              |
//!              v
//!             Merge      some packets are left to `merge`
//!
//! With a bus before a packet, Done is reached by way of
//!
//! Outlets -> Readout -> Outlets      `readout` has to go on, with what was merged or with the rest of a long packet
//!    |
//!    v
//!  Merge of outlets -> Done
//! ```
//!
//! [`read_back`] decides from the counters alone which state follows. A [`TickDevice`] does the work of a state: a rig,
//! or a fake in the tests below. The device has begun the tick: after a failure its state is half updated, and the rig is
//! lost.

use super::merge::passes;
use crate::error::EngineError;
use esaac_layout::{Counters, ReadoutProgress};

/// Retries after which a tick is given up. Each provides the storage that the one before asked for, so that a handful
/// are enough for any tick.
const MOST_RETRIES: u32 = 64;

/// Submissions of `readout` after which a tick is given up. Each serves some hundred events at least.
const MOST_READOUTS: u32 = 1 << 20;

/// The operations that the state machine needs.
pub(super) trait TickDevice {
    /// Waits for the tick that was submitted.
    fn wait(&mut self) -> Result<(), EngineError>;
    /// The counters of a camera after the last submission that it took part in.
    fn counters(&self, camera: usize) -> Counters;
    /// The counters of a camera's outlet after the last submission; `None` if the camera has no bus.
    fn outlet(&self, camera: usize) -> Option<Counters>;
    /// Grows the buffers, submits the part of the tick that is left, and waits.
    fn retry(&mut self, retry: &Retry) -> Result<(), EngineError>;
    /// Sorts heavy packets, which `sort` leaves unsorted, and waits.
    fn merge(&mut self, merge: &Merge) -> Result<(), EngineError>;
    /// Lets `readout` go on for these cameras, whose packets are sorted, and waits. The first time in a tick all that it
    /// has to go on for are among them.
    fn readout(&mut self, cameras: &[usize], is_first: bool) -> Result<(), EngineError>;
}

/// What a retry needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Retry {
    /// Cameras that resume, and the counters from which they resume.
    pub resumed: Vec<(usize, Counters)>,
    /// Events that each camera must have storage for; 0 if it has enough.
    pub wanted_events: Vec<u32>,
}

impl Retry {
    /// Whether any event buffer is too small.
    pub(super) fn grows(&self) -> bool {
        self.wanted_events.iter().any(|&events| events > 0)
    }
}

/// Packets to merge.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Merge {
    /// Cameras whose packets are heavy.
    pub cameras: Vec<usize>,
    /// Events of the largest of these packets.
    pub most_events: u32,
    /// Passes of `merge` that these need at most.
    pub passes: u32,
    /// Whether `sort` then sorts the bins of some.
    pub sorts_bins: bool,
    /// Whether they are the packets of the cameras' outlets.
    pub outlets: bool,
}

impl Merge {
    /// The heavy ones of the packets that these counters are of.
    fn of(counters: &[Option<Counters>], outlets: bool) -> Self {
        let mut merge = Merge { outlets, ..Merge::default() };
        for (camera, counted) in counters.iter().enumerate() {
            if let Some(counted) = counted.filter(|counted| counted.heavy != 0) {
                merge.cameras.push(camera);
                merge.most_events = merge.most_events.max(counted.packet);
                let passes = passes(counted.packet, counted.largest_bin);
                merge.sorts_bins |= passes == 1;
                merge.passes = merge.passes.max(passes);
            }
        }
        merge
    }
}

/// State of a tick.
#[derive(Clone, Debug, PartialEq)]
enum State {
    Submitted,
    Ran,
    Retry(Retry),
    Merge(Merge),
    Outlets,
    Readout(Vec<usize>),
    Done,
}

/// Results of a tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct TickEnd {
    /// Counters of each camera; `None` for cameras that took no part.
    pub counters: Vec<Option<Counters>>,
    /// Those of their outlets; `None` also for cameras without a bus.
    pub outlets: Vec<Option<Counters>>,
    /// How often each camera's event buffers grew.
    pub regrown: Vec<u64>,
    /// Sub-tiles of all cameras with more events than their queue holds, in the first submission. What runs again has
    /// another queue.
    pub queue_overflows: u64,
    /// Those that a second run in the same submission may take, of the camera that has most.
    pub most_crowded: u32,
    /// Those that were left to another submission.
    pub left_sub_tiles: u64,
}

/// How far a tick has come.
struct Progress {
    /// Cameras whose events do not all fit yet.
    pending: Vec<bool>,
    /// Submissions that run again.
    retries: u32,
    end: TickEnd,
}

/// The next state, from the counters of the pending cameras.
fn read_back(progress: &mut Progress, counters: impl Fn(usize) -> Counters) -> State {
    let mut retry = Retry { resumed: Vec::new(), wanted_events: vec![0; progress.pending.len()] };
    for (camera, pending) in progress.pending.iter_mut().enumerate().filter(|(_, pending)| **pending) {
        let counted = counters(camera);
        if progress.retries == 0 {
            // A second run has taken some of those in the list.
            let overflows = counted.queue_overflows.max(counted.crowded_sub_tiles);
            progress.end.queue_overflows += u64::from(overflows);
            progress.end.left_sub_tiles += u64::from(counted.queue_overflows);
            progress.end.most_crowded = progress.end.most_crowded.max(counted.crowded_sub_tiles);
        }
        let fitted = counted.emitted_fit == u32::MAX;
        if fitted && counted.queue_overflows == 0 && counted.without_levels == 0 {
            progress.end.counters[camera] = Some(counted);
            *pending = false;
            continue;
        }
        // Events that fit stay. `cross` resumes with the sub-tiles that are not done.
        let emitted = if fitted { counted.emitted } else { counted.emitted_fit };
        if !fitted {
            retry.wanted_events[camera] = counted.emitted;
            progress.end.regrown[camera] += 1;
        }
        let resumed = Counters {
            emitted,
            emitted_fit: u32::MAX,
            queue_overflows: 0,
            crowded_sub_tiles: 0,
            without_levels: 0,
            ..counted
        };
        retry.resumed.push((camera, resumed));
    }
    if !retry.resumed.is_empty() {
        return State::Retry(retry);
    }
    let merge = Merge::of(&progress.end.counters, false);
    if merge.cameras.is_empty() { State::Outlets } else { State::Merge(merge) }
}

/// The next state, from the counters of the outlets.
fn read_outlets(end: &mut TickEnd, outlet: impl Fn(usize) -> Option<Counters>) -> State {
    for (camera, counters) in end.counters.iter().enumerate() {
        end.outlets[camera] = counters.and_then(|_| outlet(camera));
    }
    let undone = |counters: &Option<Counters>| {
        counters.is_some_and(|counters| counters.progress == ReadoutProgress::Undone as u32)
    };
    let cameras: Vec<usize> = (0..end.outlets.len()).filter(|&camera| undone(&end.outlets[camera])).collect();
    let merge = Merge::of(&end.outlets, true);
    match (cameras.is_empty(), merge.cameras.is_empty()) {
        (false, _) => State::Readout(cameras),
        (true, false) => State::Merge(merge),
        (true, true) => State::Done,
    }
}

/// Brings a tick that was submitted to its end. `in_tick` tells for each camera whether it takes part. After an error the
/// rig is lost.
pub(super) fn finish(device: &mut impl TickDevice, in_tick: Vec<bool>) -> Result<TickEnd, EngineError> {
    let cameras = in_tick.len();
    let end = TickEnd {
        counters: vec![None; cameras],
        outlets: vec![None; cameras],
        regrown: vec![0; cameras],
        queue_overflows: 0,
        most_crowded: 0,
        left_sub_tiles: 0,
    };
    let mut progress = Progress { pending: in_tick, retries: 0, end };
    let mut state = State::Submitted;
    let mut readouts = 0;
    loop {
        state = match state {
            State::Submitted => {
                device.wait()?;
                State::Ran
            }
            State::Ran => read_back(&mut progress, |camera| device.counters(camera)),
            State::Retry(_) if progress.retries == MOST_RETRIES => {
                return Err(EngineError::Endless(progress.retries));
            }
            State::Retry(retry) => {
                progress.retries += 1;
                device.retry(&retry)?;
                State::Ran
            }
            State::Merge(merge) => {
                device.merge(&merge)?;
                if merge.outlets { State::Done } else { State::Outlets }
            }
            State::Outlets => read_outlets(&mut progress.end, |camera| device.outlet(camera)),
            State::Readout(_) if readouts == MOST_READOUTS => {
                return Err(EngineError::Endless(readouts));
            }
            State::Readout(cameras) => {
                device.readout(&cameras, readouts == 0)?;
                readouts += 1;
                State::Outlets
            }
            State::Done => return Ok(progress.end),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ash::vk;

    const FITTED: Counters = Counters { emitted_fit: u32::MAX, ..ZERO };
    const ZERO: Counters = Counters {
        emitted: 0,
        emitted_fit: 0,
        packet: 0,
        deferred: 0,
        invalid_pixels: 0,
        invalid_motion: 0,
        unarmed_pixels: 0,
        skipped_blocks: 0,
        substeps: 0,
        still_blocks: 0,
        queue_overflows: 0,
        crowded_sub_tiles: 0,
        without_levels: 0,
        level_rows: 0,
        largest_bin: 0,
        slow_tiles: 0,
        quick_tiles: 0,
        overflow: 0,
        heavy: 0,
        gathered_deferred: 0,
        without_depth: 0,
        without_poses: 0,
        without_lens: 0,
        unseen_samples: 0,
        meeting_blocks: 0,
        overrun_pixels: 0,
        lost: 0,
        capped: 0,
        waiting: 0,
        progress: 0,
    };

    #[derive(Clone, Debug, PartialEq)]
    enum Call {
        Wait,
        Retry(Retry),
        Merge(Merge),
        Readout(Vec<usize>, bool),
    }

    /// Counts what a script says, submission after submission, and fails at one call.
    struct Fake {
        counted: Vec<Vec<Counters>>,
        /// The outlet of camera 0, call of `outlet` after call.
        outlets: std::cell::RefCell<Vec<Counters>>,
        submissions: usize,
        calls: Vec<Call>,
        fails_at: Option<(usize, vk::Result)>,
    }

    impl Fake {
        fn new(counted: &[&[Counters]]) -> Self {
            let counted = counted.iter().map(|cameras| cameras.to_vec()).collect();
            Fake { counted, outlets: Vec::new().into(), submissions: 0, calls: Vec::new(), fails_at: None }
        }

        fn call(&mut self, call: Call) -> Result<(), EngineError> {
            self.calls.push(call);
            match self.fails_at {
                Some((at, result)) if at == self.calls.len() - 1 => {
                    Err(EngineError::Vulkan { call: "fake", result })
                }
                _ => Ok(()),
            }
        }
    }

    impl TickDevice for Fake {
        fn wait(&mut self) -> Result<(), EngineError> {
            self.submissions += 1;
            self.call(Call::Wait)
        }
        fn counters(&self, camera: usize) -> Counters {
            self.counted[(self.submissions - 1).min(self.counted.len() - 1)][camera]
        }
        fn outlet(&self, camera: usize) -> Option<Counters> {
            let mut outlets = self.outlets.borrow_mut();
            if camera == 0 && !outlets.is_empty() { Some(outlets.remove(0)) } else { None }
        }
        fn readout(&mut self, cameras: &[usize], is_first: bool) -> Result<(), EngineError> {
            self.call(Call::Readout(cameras.to_vec(), is_first))
        }
        fn retry(&mut self, retry: &Retry) -> Result<(), EngineError> {
            self.submissions += 1;
            self.call(Call::Retry(retry.clone()))
        }
        fn merge(&mut self, merge: &Merge) -> Result<(), EngineError> {
            self.call(Call::Merge(merge.clone()))
        }
    }

    #[test]
    fn a_tick_that_fits_is_waited_for_once() {
        let counted = Counters { packet: 7, ..FITTED };
        let mut fake = Fake::new(&[&[counted, ZERO]]);
        let end = finish(&mut fake, vec![true, false]).unwrap();
        assert_eq!(
            end,
            TickEnd {
                counters: vec![Some(counted), None],
                outlets: vec![None; 2],
                regrown: vec![0, 0],
                queue_overflows: 0,
                most_crowded: 0,
                left_sub_tiles: 0,
            }
        );
        assert_eq!(fake.calls, [Call::Wait]);
    }

    #[test]
    fn a_tick_without_cameras_is_waited_for_all_the_same() {
        // It has the commands of its hooks.
        let mut fake = Fake::new(&[&[ZERO]]);
        assert_eq!(finish(&mut fake, vec![false]).unwrap().counters, [None]);
        assert_eq!(fake.calls, [Call::Wait]);
    }

    #[test]
    fn what_did_not_fit_goes_on_from_what_did_and_packets_are_merged_once_at_the_end() {
        let heavy = Counters { packet: 900, heavy: 1, ..FITTED };
        // A second run has done seven of nine.
        let overflown = Counters {
            emitted: 500,
            emitted_fit: 60,
            queue_overflows: 2,
            crowded_sub_tiles: 9,
            without_levels: 3,
            substeps: 3,
            ..ZERO
        };
        // These were walked again at once: they are counted already.
        let overflowed = Counters { emitted: 500, crowded_sub_tiles: 5, without_levels: 3, ..FITTED };
        let done = Counters { emitted: 620, packet: 620, ..FITTED };
        let mut fake = Fake::new(&[&[heavy, overflown], &[heavy, overflowed], &[heavy, done]]);
        let end = finish(&mut fake, vec![true, true]).unwrap();
        assert_eq!(
            end,
            TickEnd {
                counters: vec![Some(heavy), Some(done)],
                outlets: vec![None; 2],
                regrown: vec![0, 1],
                queue_overflows: 9,
                most_crowded: 9,
                left_sub_tiles: 2,
            }
        );
        let from_60 = Counters { emitted: 60, substeps: 3, ..FITTED };
        let from_500 = Counters { emitted: 500, ..FITTED };
        let grow = Retry { resumed: vec![(1, from_60)], wanted_events: vec![0, 500] };
        let walk = Retry { resumed: vec![(1, from_500)], wanted_events: vec![0, 0] };
        assert!(grow.grows() && !walk.grows());
        let merge = Merge { cameras: vec![0], most_events: 900, passes: 1, sorts_bins: true, outlets: false };
        let expected = [Call::Wait, Call::Retry(grow), Call::Retry(walk), Call::Merge(merge)];
        assert_eq!(fake.calls, expected);
    }

    #[test]
    fn a_bus_serves_what_is_merged_and_what_leaves_it_is_merged_last() {
        let heavy = Counters { packet: 900, heavy: 1, ..FITTED };
        let undone = Counters { progress: ReadoutProgress::Undone as u32, heavy: 1, packet: 1, ..FITTED };
        let done = Counters { progress: ReadoutProgress::Done as u32, ..heavy };
        let mut fake = Fake::new(&[&[heavy, FITTED, ZERO]]);
        fake.outlets = vec![undone, undone, done].into();
        let end = finish(&mut fake, vec![true, true, false]).unwrap();
        assert_eq!(
            (end.counters, end.outlets),
            (vec![Some(heavy), Some(FITTED), None], vec![Some(done), None, None])
        );
        let merge = |outlets| {
            Call::Merge(Merge { cameras: vec![0], most_events: 900, passes: 1, sorts_bins: true, outlets })
        };
        let readout = |is_first| Call::Readout(vec![0], is_first);
        assert_eq!(fake.calls, [Call::Wait, merge(false), readout(true), readout(false), merge(true)]);
    }

    #[test]
    fn nothing_is_called_after_a_failure() {
        let heavy = Counters { packet: 5, heavy: 1, ..FITTED };
        let overflown = Counters { emitted: 5, ..ZERO };
        for at in 0..3 {
            let mut fake = Fake::new(&[&[overflown], &[heavy]]);
            fake.fails_at = Some((at, vk::Result::ERROR_OUT_OF_HOST_MEMORY));
            let error = finish(&mut fake, vec![true]).unwrap_err();
            assert!(matches!(error, EngineError::Vulkan { call: "fake", .. }), "call {at}: {error:?}");
            assert_eq!(fake.calls.len(), at + 1, "call {at}");
        }
    }

    #[test]
    fn a_tick_that_never_fits_is_given_up() {
        let mut fake = Fake::new(&[&[Counters { emitted: 5, ..ZERO }]]);
        let error = finish(&mut fake, vec![true]).unwrap_err();
        assert!(matches!(error, EngineError::Endless(MOST_RETRIES)), "{error:?}");
    }
}
