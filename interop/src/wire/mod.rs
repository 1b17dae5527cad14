//! Messages on the socket: plain structs in the machine's byte order, one a packet, descriptors beside
//! them. `include/esaac_interop.h` declares the same for C; `README.md` says who sends what when.
//!
//! **Versions.** A producer's HELLO says which version it speaks, and the engine answers in that. The structs here
//! are those of version 2. In version 1 each is the same up to a length, and what follows is as if it were zero: no
//! depth, no ids, no lens, no poses. Only the framing knows the lengths. ERROR is the same in both, so that a peer
//! understands why it is refused before a version is agreed.
//!
//! Nothing that arrives is trusted: [`Message::parse`] gives a message whose kind, size, version and
//! number of descriptors are as they must be, and [`crate::session`] judges what it says.

mod framing;
mod poses;
mod refusal;

pub use framing::{Message, WireError};
pub(crate) use poses::in_messages;
pub use poses::{Sample, Track};
pub use refusal::{ErrorCode, Refusal};

use bytemuck::{Pod, Zeroable};

/// First word of every message: "ESIP" in memory.
pub const MAGIC: u32 = u32::from_le_bytes(*b"ESIP");
/// No message is longer.
pub const MAX_BYTES: usize = 1 << 16;
/// No message has more descriptors: four images and a timeline a slot.
pub const MAX_FDS: usize = 5 * MAX_SLOTS as usize;
/// No track has more samples: a second, the longest interval, at 1000 Hz.
pub const MAX_SAMPLES: usize = 1000;
/// No frame has more samples in all its tracks.
pub const MAX_POSES: usize = 1 << 16;
/// No ring has more slots.
pub const MAX_SLOTS: u32 = 16;
/// No motion images.
pub const NO_MOTION: u32 = u32::MAX;

/// No depth images, or no ids. Their formats are one more than in the model.
pub const NO_PLANE: u32 = 0;

/// The producer gives depth, ids and poses where a camera takes them.
pub const GIVES_GEOMETRY: u32 = 1;

/// No lens.
pub const NO_LENS: u32 = 0;
/// [`esaac_model::paths::Projection::Pinhole`].
pub const LENS_PINHOLE: u32 = 1;
/// [`esaac_model::paths::Projection::Fisheye`].
pub const LENS_FISHEYE: u32 = 2;

/// A producer that has no Vulkan driver, but a device.
pub const NO_DRIVER: [u8; 16] = [0; 16];
/// A memory type that the peer leaves to the importer.
pub const ANY_MEMORY_TYPE: u32 = u32::MAX;

/// The engine exports the ring's memory by `OPAQUE_FD`.
pub const MEMORY_EXPORTED: u32 = 1;
/// The ring lies in anonymous files that both sides map.
pub const MEMORY_HOST: u32 = 2;
/// The producer exports the ring's memory by `OPAQUE_FD`.
pub const MEMORY_BROUGHT: u32 = 4;
/// The producer exports images of optimal tiling by `OPAQUE_FD`; the engine copies each once.
pub const MEMORY_IMAGES: u32 = 8;

/// Timeline values travel over the socket.
pub const TIMELINE_CARRIED: u32 = 1;
/// Timeline semaphores travel by `OPAQUE_FD`.
pub const TIMELINE_EXPORTED: u32 = 2;

/// Memories by name.
#[must_use]
pub fn memory_names(bits: u32) -> String {
    names(bits, &["EXPORTED", "HOST", "BROUGHT", "IMAGES"])
}

/// Timelines by name.
#[must_use]
pub fn timeline_names(bits: u32) -> String {
    names(bits, &["CARRIED", "EXPORTED"])
}

fn names(bits: u32, all: &[&str]) -> String {
    let named: Vec<&str> = (0..).zip(all).filter(|(bit, _)| bits & 1 << bit != 0).map(|(_, n)| *n).collect();
    if named.is_empty() { "none".to_owned() } else { named.join(", ") }
}

/// A lens in words.
#[must_use]
pub fn lens_words(lens: &Lens) -> String {
    let Lens { projection, fx_px, fy_px, cx_px, cy_px, .. } = lens;
    let name = match *projection {
        NO_LENS => return "none".to_owned(),
        LENS_PINHOLE => "pinhole".to_owned(),
        LENS_FISHEYE => "fisheye".to_owned(),
        number => format!("lens {number}"),
    };
    format!("{name} fx={fx_px} fy={fy_px} cx={cx_px} cy={cy_px}")
}

/// The producer waits for a free slot; every frame counts.
pub const LOSSLESS: u32 = 0;
/// The newest frame counts; older ones are dropped.
pub const LATEST: u32 = 1;

/// A frame that was stepped.
pub const STEPPED: u32 = 0;
/// A frame that a newer one has replaced.
pub const DROPPED: u32 = 1;

/// What a peer speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u16)]
pub enum Version {
    /// Colour and motion.
    One = 1,
    /// Depth, ids, lens and poses as well.
    Two = 2,
}

impl Version {
    /// The newest.
    pub const NEWEST: Version = Version::Two;

    /// The version of this number.
    #[must_use]
    pub fn from_number(number: u16) -> Option<Self> {
        [Version::One, Version::Two].into_iter().find(|version| *version as u16 == number)
    }
}

/// Beginning of every message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Header {
    /// [`MAGIC`].
    pub magic: u32,
    /// [`Version`].
    pub version: u16,
    /// Which message.
    pub kind: u16,
    /// Bytes of the whole message.
    pub bytes: u32,
    /// Descriptors beside it.
    pub fds: u32,
}

/// Memory of each of a ring's images of one kind.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct ImageMemory {
    /// Size of the buffer, or of the image's texels tightly packed: a multiple of 16.
    pub bytes: u64,
    /// Size of its memory: of the allocation, or of the file.
    pub allocation_bytes: u64,
    /// Vulkan memory type.
    pub memory_type: u32,
    /// `VkImageUsageFlags` of an image, on both sides; zero of a buffer.
    pub image_usage: u32,
}

/// A lens, as [`esaac_model::paths::Intrinsics`] has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Lens {
    /// [`NO_LENS`], [`LENS_PINHOLE`] or [`LENS_FISHEYE`].
    pub projection: u32,
    /// Zero.
    pub reserved: u32,
    /// Focal lengths: pixels; of a fisheye pixels a radian.
    pub fx_px: f64,
    /// Along y.
    pub fy_px: f64,
    /// Principal point; the centre of the first pixel is 0.
    pub cx_px: f64,
    /// Its y, down.
    pub cy_px: f64,
}

/// Producer: I am this, and can do that.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Hello {
    /// Header.
    pub header: Header,
    /// `VkPhysicalDeviceIDProperties::deviceUUID`.
    pub device_uuid: [u8; 16],
    /// `VkPhysicalDeviceIDProperties::driverUUID`.
    pub driver_uuid: [u8; 16],
    /// Camera to feed.
    pub camera: u32,
    /// Columns that it renders, 0 for as the rig has it.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Memories that it can use, as bits.
    pub memories: u32,
    /// Timelines that it can use, as bits.
    pub timelines: u32,
    /// [`GIVES_GEOMETRY`] or zero.
    pub gives: u32,
    /// Lens that it renders with; [`NO_LENS`] for as the rig has it.
    pub lens: Lens,
}

/// Engine: this is your ring. Descriptors: memory of each slot's images (unless the producer brings
/// them), then a timeline of each slot if those are exported.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct RingOffer {
    /// Header.
    pub header: Header,
    /// The engine's device.
    pub device_uuid: [u8; 16],
    /// Its driver.
    pub driver_uuid: [u8; 16],
    /// Camera.
    pub camera: u32,
    /// Cameras of the rig.
    pub cameras: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// `HdrFormat`.
    pub hdr_format: u32,
    /// `MotionFormat`, or [`NO_MOTION`].
    pub motion_format: u32,
    /// One of the memory bits.
    pub memory: u32,
    /// One of the timeline bits.
    pub timeline: u32,
    /// Slots.
    pub slots: u32,
    /// [`LOSSLESS`] or [`LATEST`].
    pub backpressure: u32,
    /// `VkBufferUsageFlags` of every buffer of the ring, on both sides.
    pub buffer_usage: u32,
    /// Zero.
    pub reserved: u32,
    /// Colour.
    pub hdr: ImageMemory,
    /// Motion; zero without.
    pub motion: ImageMemory,
    /// Depth; zero without.
    pub depth: ImageMemory,
    /// Instance ids; zero without.
    pub ids: ImageMemory,
    /// [`NO_PLANE`], or one more than `DepthFormat`. With depth, poses come with every frame.
    pub depth_format: u32,
    /// [`NO_PLANE`], or one more than `IdFormat`.
    pub id_format: u32,
    /// Most instances that may have poses; zero without depth.
    pub max_instances: u32,
    /// Zero.
    pub reserved_2: u32,
    /// Lens of depth and poses; [`NO_LENS`] without depth.
    pub lens: Lens,
}

/// Producer: here is the memory that I bring. Descriptors: each slot's images.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Brought {
    /// Header.
    pub header: Header,
    /// Colour.
    pub hdr: ImageMemory,
    /// Motion; zero without.
    pub motion: ImageMemory,
    /// Depth; zero without.
    pub depth: ImageMemory,
    /// Instance ids; zero without.
    pub ids: ImageMemory,
}

/// Producer: this slot holds, or will hold at this value, a frame.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct FrameNotice {
    /// Header.
    pub header: Header,
    /// Slot.
    pub slot: u32,
    /// Copies on the device between what rendered the frame and the slot.
    pub device_copies: u32,
    /// Copies by way of the host.
    pub host_copies: u32,
    /// Samples in the POSES messages since the last FRAME.
    pub poses: u32,
    /// Value of the slot's timeline when the frame is there: 2k + 1 for its k-th.
    pub value: u64,
    /// Time of the frame, nanoseconds.
    pub t_ns: i64,
}

/// Engine: this slot is yours again.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct Released {
    /// Header.
    pub header: Header,
    /// Slot.
    pub slot: u32,
    /// [`STEPPED`] or [`DROPPED`].
    pub outcome: u32,
    /// Value of the slot's timeline: 2k + 2 after its k-th frame.
    pub value: u64,
}
