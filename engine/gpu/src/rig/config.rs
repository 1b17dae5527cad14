//! What a rig is made of: cameras, what they get, and options.

use super::PacketPlace;
use super::geometry::Place;
use super::sensor::places_in_rig;
use crate::device::Device;
use crate::error::EngineError;
use crate::policy::KernelPolicy;
use esaac_layout::MAX_CAMERAS;
use esaac_model::paths::Intrinsics;
use esaac_model::{DepthFormat, FrameError, HdrFormat, IdFormat, MotionFormat, SensorModel, Synthesis};

/// A camera of a rig.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraConfig {
    /// The sensor.
    pub sensor: SensorModel,
    /// Its number in random counters: two cameras with the same number and seed have the same noise.
    pub camera: u32,
    /// Format of its colour images.
    pub hdr: HdrFormat,
    /// Format of its motion images; `None` if it gets none.
    pub motion: Option<MotionFormat>,
    /// Its depth, instance ids and lens; `None` if it gets none. Synthesis `rigid` needs them, and poses
    /// ([`Rig::set_scene`](super::Rig::set_scene)).
    pub geometry: Option<GeometryConfig>,
}

impl CameraConfig {
    /// A sensor with the synthesis that `auto` is for this camera's input.
    pub(super) fn resolved(&self, sensor: &SensorModel) -> SensorModel {
        let synthesis = sensor.synthesis.resolve(self.geometry.is_some(), self.motion.is_some());
        SensorModel { synthesis, ..sensor.clone() }
    }
}

/// What a camera gets of a scene's geometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometryConfig {
    /// Format of its depth images. Depth is what the lens measures; see [`esaac_model::paths::Intrinsics`].
    pub depth: DepthFormat,
    /// Format of its images of instance ids; `None` if all is the static world.
    pub ids: Option<IdFormat>,
    /// Its lens.
    pub lens: Intrinsics,
}

/// Most packet buffer sets of a rig.
pub const MOST_PACKET_SETS: u32 = 64;

/// Options of a rig; none of them changes an event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RigOptions {
    /// Keep every sub-step's log intensity for [`Rig::substeps_q24`](super::Rig::substeps_q24): for tests, at a cost.
    pub keep_substeps: bool,
    /// Take GPU time stamps between stages, which costs a microsecond or two each; else only around the whole tick.
    pub stage_times: bool,
    /// Initial capacity of the event buffers, events per camera; 0 for one and a half per pixel. The buffers grow as
    /// needed.
    pub initial_events: u32,
    /// Where the packets of a tick lie.
    pub packets: PacketPlace,
    /// Number of packet buffer sets that ticks write in turn; 0 for one. With [`PacketPlace::InPlace`], packets that
    /// are [held](super::Tick::hold) over the next `packet_ring - 1` ticks cost nothing. Packets that are held longer cost the
    /// next tick an allocation. Each set takes memory for the packets of all cameras. At most [`MOST_PACKET_SETS`].
    pub packet_ring: u32,
    /// How kernels are run; `None` for the policy that suits the device. Events are the same in any case.
    pub policy: Option<KernelPolicy>,
}

impl RigOptions {
    /// Number of packet sets, at least one.
    pub(super) fn ring(&self) -> usize {
        self.packet_ring.max(1) as usize
    }

    /// An error if no rig can have them.
    pub(super) fn check(&self) -> Result<(), EngineError> {
        if self.packet_ring > MOST_PACKET_SETS {
            let (name, expected) = ("packet_ring", format!("at most {MOST_PACKET_SETS}"));
            return Err(EngineError::Option { name, expected, actual: self.packet_ring });
        }
        self.policy.map_or(Ok(()), |policy| policy.check())
    }
}

/// An error if a sensor is not valid, or needs what its camera does not get.
pub(super) fn check_sensor(
    camera: usize,
    sensor: &SensorModel,
    config: &CameraConfig,
) -> Result<(), EngineError> {
    sensor.validate().map_err(|source| EngineError::Sensor { camera, source })?;
    let synthesis = sensor.synthesis;
    if synthesis == Synthesis::Rigid && config.geometry.is_none() {
        return Err(FrameError::MissingGeometry { camera: camera as u32 }.into());
    }
    if synthesis.needs_motion() && config.motion.is_none() {
        let synthesis = synthesis.name();
        return Err(FrameError::MissingMotion { camera: camera as u32, synthesis }.into());
    }
    Ok(())
}

/// An error if the table of cameras has too few rows: one for each camera, and one for each outlet.
pub(super) fn check_rows<'a>(sensors: impl Iterator<Item = &'a SensorModel>) -> Result<(), EngineError> {
    let actual = sensors.map(places_in_rig).sum();
    if actual > MAX_CAMERAS {
        return Err(EngineError::TooManyCameras { expected: MAX_CAMERAS, actual });
    }
    Ok(())
}

/// An error if a camera's dispatches are larger than the device allows.
pub(super) fn check_groups(
    device: &Device,
    policy: KernelPolicy,
    places: &[Place],
) -> Result<(), EngineError> {
    // The largest dispatch is that of `cross` with one workgroup per sub-tile.
    let of_a_tile = policy.cross_groups(false).max(policy.cross_groups(true));
    for (camera, place) in places.iter().enumerate() {
        let actual = place.tiles.saturating_mul(of_a_tile);
        if actual > device.most_groups() {
            let expected = device.most_groups();
            return Err(EngineError::TooManyGroups {
                camera,
                device: device.info().name.clone(),
                expected,
                actual,
            });
        }
    }
    Ok(())
}
