//! Work that several threads share. They are those of rayon's pool and are kept: to start one takes as long as a good part of
//! the work of a tick.

/// Threads that may work at the same time.
pub(crate) fn most() -> usize {
    rayon_core::current_num_threads()
}

/// Does `work` on all shares at the same time, and waits for it. The first share is the calling thread's.
pub(crate) fn share<T: Send>(shares: impl IntoIterator<Item = T>, work: impl Fn(T) + Sync) {
    let mut shares = shares.into_iter();
    let Some(own) = shares.next() else { return };
    let Some(second) = shares.next() else { return work(own) };
    let work = &work;
    rayon_core::in_place_scope(|scope| {
        for share in std::iter::once(second).chain(shares) {
            scope.spawn(move |_| work(share));
        }
        work(own);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_share_is_done_once_also_by_many_callers_at_a_time() {
        let doubled = |count: usize| {
            let mut numbers: Vec<usize> = (0..count).collect();
            share(numbers.chunks_mut(10), |chunk| chunk.iter_mut().for_each(|number| *number *= 2));
            assert!(numbers.into_iter().eq((0..count).map(|number| 2 * number)), "{count} numbers");
        };
        [0, 1, 10, 11, 999].into_iter().for_each(doubled);
        std::thread::scope(|scope| (0..4).for_each(|_| drop(scope.spawn(|| doubled(999)))));
        // From a thread of the pool itself, as where several rigs step at the same time.
        share(0..2 * most(), |_| doubled(99));
    }
}
