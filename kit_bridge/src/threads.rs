//! Threads for the cameras of a rig that are too many for one. They are kept: one that is made anew at each step takes
//! memory from another part of the allocator each time, and a long run grows by that.

use crate::error::Fault;
use rayon_core::{ThreadPool, ThreadPoolBuilder};
use std::num::NonZero;

/// Cameras whose poses are worth a thread.
const CAMERAS_A_THREAD: usize = 128;

/// Threads for so many cameras; none for few.
pub struct Threads(Option<ThreadPool>);

impl Threads {
    /// One for each of so many banks, or for its share of the cameras' poses.
    pub fn of(banks: usize, cameras: usize) -> Result<Self, Fault> {
        let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
        let count = banks.max((cameras / CAMERAS_A_THREAD).min(cores));
        if count < 2 {
            return Ok(Threads(None));
        }
        let pool =
            ThreadPoolBuilder::new().num_threads(count).thread_name(|i| format!("esaac cameras {i}")).build();
        pool.map(|pool| Threads(Some(pool)))
            .map_err(|error| Fault::Device(format!("no {count} threads: {error}")))
    }

    /// Shares that so many cameras are worth.
    pub fn shares(&self, cameras: usize) -> usize {
        let threads = self.0.as_ref().map_or(1, ThreadPool::current_num_threads);
        (cameras / CAMERAS_A_THREAD).clamp(1, threads)
    }

    /// Does something with each of some things at the same time, given their numbers. Fails with the first that failed.
    pub fn each<T: Send, R: Send>(
        &self,
        things: Vec<T>,
        work: impl Fn(usize, T) -> Result<R, Fault> + Sync,
    ) -> Result<Vec<R>, Fault> {
        let things = things.into_iter().enumerate();
        let pool = match &self.0 {
            Some(pool) if things.len() > 1 => pool,
            _ => return things.map(|(number, thing)| work(number, thing)).collect(),
        };
        let mut done: Vec<Option<Result<R, Fault>>> = (0..things.len()).map(|_| None).collect();
        let work = &work;
        pool.in_place_scope(|scope| {
            for ((number, thing), done) in things.zip(&mut done) {
                scope.spawn(move |_| *done = Some(work(number, thing)));
            }
        });
        done.into_iter().map(|done| done.expect("the scope waits for all")).collect()
    }
}
