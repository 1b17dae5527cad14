//! Packets that outlive their tick, where the device wrote them.

use super::arena::{Arena, PacketBuffers};
use super::results::{ApsFrame, Results};
use super::{CameraState, PacketPlace};
use esaac_layout as layout;
use esaac_model::{Packet, PacketView};
use std::sync::Arc;

/// The packets of one tick, where the device wrote them. Only of a rig that keeps packets in place
/// ([`PacketPlace::InPlace`]).
///
/// The packets stay unchanged as long as this value, or a clone of it, lives: later ticks write elsewhere, even after
/// the rig has grown or is dropped. With [`RigOptions::packet_ring`](super::RigOptions::packet_ring) sets, holding the
/// packets of a tick over the next `packet_ring - 1` ticks costs nothing; for each set that is held longer, a tick
/// allocates new buffers. Slices and pointers into a [`HeldPackets::view`] do not move.
#[derive(Clone)]
pub struct HeldPackets {
    set: Arc<PacketBuffers>,
    cameras: Arc<[HeldCamera]>,
}

struct HeldCamera {
    header: Packet,
    events: u32,
    event_base: u32,
    aps: Option<ApsFrame>,
    aps_base: u32,
    pixels: u32,
}

impl HeldPackets {
    /// Holds the last tick's packets; `None` if packets are not kept in place.
    pub(super) fn of(
        place: PacketPlace,
        results: &Results,
        cameras: &[CameraState],
        arena: &Arena,
    ) -> Option<Self> {
        let held = |(number, camera): (usize, &CameraState)| HeldCamera {
            header: results.packets[number].clone(),
            events: results.events[number],
            event_base: camera.packet_base(),
            aps: results.aps[number].clone(),
            aps_base: camera.place.aps_base,
            pixels: camera.place.pixels,
        };
        (place == PacketPlace::InPlace).then(|| HeldPackets {
            set: Arc::clone(arena.packet_set()),
            cameras: cameras.iter().enumerate().map(held).collect(),
        })
    }

    /// Number of cameras.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cameras.len()
    }

    /// Whether there are no cameras.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cameras.is_empty()
    }

    /// A camera's packet. Panics if there is no such camera.
    #[must_use]
    pub fn view(&self, camera: usize) -> PacketView<'_> {
        let c = &self.cameras[camera];
        view_in(&self.set, c.header.view(), c.event_base, c.events)
    }

    /// A camera's APS frame, without its pixels. Panics if there is no such camera.
    #[must_use]
    pub fn aps(&self, camera: usize) -> Option<&ApsFrame> {
        self.cameras[camera].aps.as_ref()
    }

    /// The pixels of a camera's APS frame, row-major; empty if it has no frame. Panics if there is no such camera.
    #[must_use]
    pub fn aps_pixels(&self, camera: usize) -> &[u16] {
        let c = &self.cameras[camera];
        if c.aps.is_some() { aps_in(&self.set, c.aps_base, c.pixels) } else { &[] }
    }
}

/// A view of a packet whose events are in a packet set.
pub(super) fn view_in<'a>(
    set: &'a PacketBuffers,
    header: PacketView<'a>,
    event_base: u32,
    events: u32,
) -> PacketView<'a> {
    let (base, events) = (event_base as usize, events as usize);
    let column = |slot| set.get(slot).expect("a packet's column");
    PacketView {
        x: column(layout::EVENT_X).read(base, events),
        y: column(layout::EVENT_Y).read(base, events),
        t_offset_ns: column(layout::EVENT_T).read(base, events),
        polarity: column(layout::EVENT_P).read(base, events),
        host_copies: 0,
        ..header
    }
}

/// An APS frame's pixels in a packet set.
pub(super) fn aps_in(set: &PacketBuffers, aps_base: u32, pixels: u32) -> &[u16] {
    set.get(layout::APS).expect("a packet's column").read(aps_base as usize, pixels as usize)
}
