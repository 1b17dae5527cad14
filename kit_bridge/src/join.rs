//! Columns of many cameras' packets copied one after the other, by several threads if there is much to copy.

use esaac_model::PacketView;
use std::num::NonZero;

/// Events for which a thread is worth starting.
const EVENTS_A_THREAD: usize = 200_000;

/// More threads than this do not copy faster: memory is the limit.
const MOST_THREADS: usize = 8;

/// One column of all packets. `fill` writes a packet's part of it.
pub fn joined<T: Clone + Default + Send>(
    packets: &[PacketView<'_>],
    fill: impl Fn(&PacketView<'_>, &mut [T]) + Sync,
) -> Vec<T> {
    let all: usize = packets.iter().map(PacketView::len).sum();
    let mut column = vec![T::default(); all];
    let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
    let threads = (all / EVENTS_A_THREAD).clamp(1, cores.min(MOST_THREADS));
    let share = all.div_ceil(threads);
    let fill = &fill;
    std::thread::scope(|scope| {
        let (mut packets, mut column) = (packets, &mut column[..]);
        while !packets.is_empty() {
            let (count, events) = first_of(packets, share);
            let (own, others) = packets.split_at(count);
            let (mut target, rest) = std::mem::take(&mut column).split_at_mut(events);
            let mut work = move || {
                for packet in own {
                    let (part, after) = std::mem::take(&mut target).split_at_mut(packet.len());
                    fill(packet, part);
                    target = after;
                }
            };
            // The last share is this thread's own.
            if others.is_empty() {
                work();
            } else {
                scope.spawn(work);
            }
            (packets, column) = (others, rest);
        }
    });
    column
}

/// How many of the first packets have `share` events together, or a little more; and their events.
fn first_of(packets: &[PacketView<'_>], share: usize) -> (usize, usize) {
    let mut events = 0;
    for (index, packet) in packets.iter().enumerate() {
        events += packet.len();
        if events >= share {
            let rest_is_empty = packets[index + 1..].iter().all(PacketView::is_empty);
            return if rest_is_empty { (packets.len(), events) } else { (index + 1, events) };
        }
    }
    (packets.len(), events)
}
