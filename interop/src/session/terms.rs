//! What both sides can do, and what they agree on.

use super::refused;
use crate::error::InteropError;
use crate::images::{Images, is_same_lens, lens_to_wire};
use crate::wire::{self, ErrorCode, Hello, Message, Version};
use esaac_engine::DeviceChoice;

/// What the engine offers for one camera, from its rig and its device.
#[derive(Clone, Debug, PartialEq)]
pub struct Terms {
    /// Camera.
    pub camera: u32,
    /// Its images, and the lens of depth and poses if it takes those.
    pub images: Images,
    /// Whether the camera cannot do without depth and poses.
    pub requires_geometry: bool,
    /// Most instances that may have poses.
    pub max_instances: u32,
    /// Slots of its ring.
    pub slots: u32,
    /// [`wire::LOSSLESS`] or [`wire::LATEST`].
    pub backpressure: u32,
    /// The engine's device.
    pub device_uuid: [u8; 16],
    /// Its driver.
    pub driver_uuid: [u8; 16],
    /// Memories that it can use, as bits.
    pub memories: u32,
    /// Why it cannot use memory of the host, in words, if its driver has refused it.
    pub host_refused: Option<String>,
    /// Timelines that it can use, as bits.
    pub timelines: u32,
}

/// What both sides will use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Agreement {
    /// What the producer speaks.
    pub version: Version,
    /// One memory bit.
    pub memory: u32,
    /// One timeline bit.
    pub timeline: u32,
    /// Whether depth, ids if the camera takes them, and poses come with the frames.
    pub geometry: bool,
}

impl Agreement {
    /// Whether the producer hands over memory.
    #[must_use]
    pub fn brings(&self) -> bool {
        matches!(self.memory, wire::MEMORY_BROUGHT | wire::MEMORY_IMAGES)
    }
}

impl Terms {
    /// The images of a camera's slots by what was agreed.
    #[must_use]
    pub fn images_by(&self, agreement: Agreement) -> Images {
        if agreement.geometry { self.images } else { Images { geometry: None, ..self.images } }
    }
}

/// The first message of a connection must be this.
pub fn hello(message: &Message) -> Result<&Hello, InteropError> {
    match message {
        Message::Hello(hello) => Ok(hello),
        other => Err(refused(ErrorCode::Protocol, format!("{} came first, expected HELLO", other.name()))),
    }
}

/// Chooses the best memory and timeline that both sides have, and whether depth and poses come.
pub fn agree(version: Version, hello: &Hello, terms: &Terms) -> Result<Agreement, InteropError> {
    let actual = (hello.width_px, hello.height_px);
    let expected = (terms.images.width_px, terms.images.height_px);
    if actual != (0, 0) && actual != expected {
        return Err(refused(
            ErrorCode::Camera,
            format!(
                "camera {} has {}x{} px in the rig, the producer renders {}x{} px",
                terms.camera, expected.0, expected.1, actual.0, actual.1
            ),
        ));
    }
    let geometry = agree_on_geometry(hello, terms)?;
    // CUDA names its device, but no Vulkan driver.
    let same_driver = hello.driver_uuid == terms.driver_uuid || hello.driver_uuid == wire::NO_DRIVER;
    let same_device = hello.device_uuid == terms.device_uuid && same_driver;
    let both = hello.memories & terms.memories;
    // The best first. A producer that offers its own memory renders there; any other would cost it a copy.
    let kinds = [wire::MEMORY_BROUGHT, wire::MEMORY_IMAGES, wire::MEMORY_EXPORTED, wire::MEMORY_HOST];
    let usable = |kind: &&u32| both & **kind != 0 && (same_device || **kind == wire::MEMORY_HOST);
    let Some(&memory) = kinds.iter().find(usable) else {
        return Err(if both == 0 {
            let why = terms.host_refused.as_ref().filter(|_| hello.memories & wire::MEMORY_HOST != 0);
            refused(
                ErrorCode::Unsupported,
                format!(
                    "memories: the producer has {}, the engine {}, none in common{}",
                    wire::memory_names(hello.memories),
                    wire::memory_names(terms.memories),
                    why.map_or_else(String::new, |why| format!("; on the engine's device {why}"))
                ),
            )
        } else {
            refused(
                ErrorCode::Device,
                format!(
                    "the producer is on device {}, the engine on {}; start both on one device",
                    names(hello.device_uuid, hello.driver_uuid),
                    names(terms.device_uuid, terms.driver_uuid)
                ),
            )
        });
    };
    let shared = hello.timelines & terms.timelines;
    let timeline = if same_device && shared & wire::TIMELINE_EXPORTED != 0 {
        wire::TIMELINE_EXPORTED
    } else if shared & wire::TIMELINE_CARRIED != 0 {
        wire::TIMELINE_CARRIED
    } else {
        return Err(refused(
            ErrorCode::Unsupported,
            format!(
                "timelines: the producer has {}, the engine {}, none in common",
                wire::timeline_names(hello.timelines),
                wire::timeline_names(terms.timelines)
            ),
        ));
    };
    Ok(Agreement { version, memory, timeline, geometry })
}

/// Whether depth and poses come: if the camera takes them and the producer gives them. A camera that can do without
/// is simulated by motion vectors, or without any, for a producer that does not give them.
fn agree_on_geometry(hello: &Hello, terms: &Terms) -> Result<bool, InteropError> {
    let camera = terms.camera;
    let Some(geometry) = &terms.images.geometry else { return Ok(false) };
    if hello.gives & wire::GIVES_GEOMETRY == 0 {
        if terms.requires_geometry {
            let text =
                format!("camera {camera} needs depth and poses by its synthesis, the producer gives none");
            return Err(refused(ErrorCode::Unsupported, text));
        }
        return Ok(false);
    }
    let (expected, actual) = (lens_to_wire(&geometry.lens), hello.lens);
    if actual.projection == wire::NO_LENS || is_same_lens(&actual, &expected) {
        return Ok(true);
    }
    let text = format!(
        "camera {camera} has the lens {} in the rig, the producer renders with {}",
        wire::lens_words(&expected),
        wire::lens_words(&actual)
    );
    Err(refused(ErrorCode::Camera, text))
}

/// UUID of a device, and of its driver if it has one, in words.
fn names(device: [u8; 16], driver: [u8; 16]) -> String {
    let device = DeviceChoice::Uuid(device);
    if driver == wire::NO_DRIVER {
        return device.to_string();
    }
    format!("{device} with driver {}", DeviceChoice::Uuid(driver))
}
