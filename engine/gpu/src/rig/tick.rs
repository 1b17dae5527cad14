//! What a tick gave, and where its packets are.

use super::collect::{ApsFrame, Diagnostics};
use super::{CameraState, Rig};
use crate::memory::Buffer;
use esaac_model::{Packet, PacketView, layout};
use std::time::Instant;

/// Where the events of a tick's packets, and the pixels of its APS frames, are to be had.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PacketPlace {
    /// In [`Tick::packets`] and [`Tick::aps`], copied out of the memory that the device wrote.
    #[default]
    Owned,
    /// In the host's memory where the device wrote them: nothing is copied. [`Tick::view`] and
    /// [`Tick::aps_pixels`] show them until the next tick; [`Tick::packets`] have their headers and no
    /// events, [`Tick::aps`] no pixels.
    InPlace,
    /// In the device's own memory: [`Tick::packets`] have their headers and no events, and
    /// [`Rig::represent`] gives the events where they are wanted. APS frames are owned.
    OnDevice,
}

/// What one tick gave.
#[derive(Clone, Copy)]
pub struct Tick<'a> {
    /// A packet a camera; empty for a camera's first frame.
    pub packets: &'a [Packet],
    /// Events in each packet, wherever they lie.
    pub events: &'a [u32],
    /// An APS frame for each camera that has them and had an interval.
    pub aps: &'a [Option<ApsFrame>],
    /// What was counted, a camera.
    pub diagnostics: &'a [Diagnostics],
    /// GPU time of each stage with [`RigOptions::stage_times`](super::RigOptions::stage_times), and `again`
    /// for what ran again because events did not fit and for `merge`; else of the whole `tick`.
    pub stage_ns: &'a [(&'static str, u64)],
    /// From the call of submit to the packets in host memory.
    pub submit_to_packet_ns: u64,
    place: PacketPlace,
    cameras: &'a [CameraState],
    buffers: &'a [Buffer],
}

/// When a stage ran on the device, by the host's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageSpan {
    /// Stage, or `tick` for the whole.
    pub stage: &'static str,
    /// Start.
    pub start: Instant,
    /// End.
    pub end: Instant,
}

impl<'a> Tick<'a> {
    pub(super) fn of(rig: &'a Rig) -> Self {
        Tick {
            packets: &rig.packets,
            events: &rig.events,
            aps: &rig.aps,
            diagnostics: &rig.diagnostics,
            stage_ns: &rig.stage_ns,
            submit_to_packet_ns: rig.submit_to_packet_ns,
            place: rig.options.packets,
            cameras: &rig.cameras,
            buffers: &rig.arena.buffers,
        }
    }

    /// GPU time of all stages.
    #[must_use]
    pub fn gpu_ns(&self) -> u64 {
        self.stage_ns.iter().map(|(_, ns)| ns).sum()
    }

    /// A camera's packet where it lies on the host; without events if they are
    /// [on the device](PacketPlace::OnDevice). Panics beyond the cameras, as a slice does.
    #[must_use]
    pub fn view(&self, camera: usize) -> PacketView<'a> {
        let packet = self.packets[camera].view();
        if self.place != PacketPlace::InPlace {
            return packet;
        }
        let base = self.cameras[camera].place.event_base as usize;
        let events = self.events[camera] as usize;
        PacketView {
            x: self.buffers[layout::EVENT_X].read(base, events),
            y: self.buffers[layout::EVENT_Y].read(base, events),
            t_offset_ns: self.buffers[layout::EVENT_T].read(base, events),
            polarity: self.buffers[layout::EVENT_P].read(base, events),
            host_copies: 0,
            ..packet
        }
    }

    /// The pixels of a camera's APS frame where they lie on the host, row-major; none if it has no frame.
    /// Panics beyond the cameras, as a slice does.
    #[must_use]
    pub fn aps_pixels(&self, camera: usize) -> &'a [u16] {
        let Some(frame) = &self.aps[camera] else { return &[] };
        if self.place != PacketPlace::InPlace {
            return &frame.pixels;
        }
        let place = &self.cameras[camera].place;
        self.buffers[layout::APS].read(place.aps_base as usize, place.pixels as usize)
    }
}
