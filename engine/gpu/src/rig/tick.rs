//! The results of a tick, and where its packets lie.

use super::held::{HeldPackets, aps_in, view_in};
use super::results::{ApsFrame, Diagnostics};
use super::{CameraState, Rig};
use esaac_model::{Packet, PacketView};
use std::time::Instant;

/// Where the events of a tick's packets and the pixels of its APS frames lie.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PacketPlace {
    /// In [`Tick::packets`] and [`Tick::aps`], copied out of the memory that the device wrote.
    #[default]
    Owned,
    /// In host memory where the device wrote them: nothing is copied. [`Tick::view`] and [`Tick::aps_pixels`] show them
    /// until the next tick, and [`Tick::hold`] keeps them for longer. [`Tick::packets`] have headers but no events,
    /// [`Tick::aps`] have no pixels.
    InPlace,
    /// In the device's own memory: [`Tick::packets`] have headers but no events, and [`Rig::represent`] writes the
    /// events to a buffer. APS frames are owned.
    OnDevice,
}

/// The results of one tick.
#[derive(Clone, Copy)]
pub struct Tick<'a> {
    /// A packet for each camera; empty for a camera's first frame.
    pub packets: &'a [Packet],
    /// Number of events in each packet, wherever they lie.
    pub events: &'a [u32],
    /// For each camera an APS frame, if the sensor has them and the camera had an interval.
    pub aps: &'a [Option<ApsFrame>],
    /// Counters of each camera.
    pub diagnostics: &'a [Diagnostics],
    /// GPU time of the whole `tick` or, with [`RigOptions::stage_times`](super::RigOptions::stage_times), of each
    /// stage. With stages, `retry` is the time of all submissions after the first: retries and `merge`. Empty if the
    /// device has no times.
    pub stage_ns: &'a [(&'static str, u64)],
    /// Time from the submission to the packets in host memory. If the step was submitted and waited for in two calls, what
    /// the caller did between them is a part of it.
    pub submit_to_packet_ns: u64,
    rig: &'a Rig,
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
        let results = &rig.results;
        Tick {
            packets: &results.packets,
            events: &results.events,
            aps: &results.aps,
            diagnostics: &results.diagnostics,
            stage_ns: &results.stage_ns,
            submit_to_packet_ns: results.submit_to_packet_ns,
            rig,
        }
    }

    /// GPU time of all stages; `None` if the device has no times.
    #[must_use]
    pub fn gpu_ns(&self) -> Option<u64> {
        (!self.stage_ns.is_empty()).then(|| self.stage_ns.iter().map(|(_, ns)| ns).sum())
    }

    /// A view of a camera's packet; without events if they are [on the device](PacketPlace::OnDevice). Panics if there
    /// is no such camera.
    #[must_use]
    pub fn view(&self, camera: usize) -> PacketView<'a> {
        let packet = self.rig.results.view(camera);
        if self.rig.options.packets != PacketPlace::InPlace {
            return packet;
        }
        let base = self.camera(camera).packet_base();
        view_in(self.rig.arena.packet_set(), packet, base, self.events[camera])
    }

    /// The pixels of a camera's APS frame, row-major; empty if it has no frame. Panics if there is no such camera.
    #[must_use]
    pub fn aps_pixels(&self, camera: usize) -> &'a [u16] {
        let Some(frame) = &self.aps[camera] else { return &[] };
        if self.rig.options.packets != PacketPlace::InPlace {
            return &frame.pixels;
        }
        let place = &self.camera(camera).place;
        aps_in(self.rig.arena.packet_set(), place.aps_base, place.pixels)
    }

    /// Holds the tick's packets where they lie, for as long as the returned value lives; `None` unless they are
    /// [in place](PacketPlace::InPlace).
    #[must_use]
    pub fn hold(&self) -> Option<HeldPackets> {
        let rig = self.rig;
        HeldPackets::of(rig.options.packets, &rig.results, &rig.cameras, &rig.arena)
    }

    fn camera(&self, camera: usize) -> &'a CameraState {
        &self.rig.cameras[camera]
    }
}
