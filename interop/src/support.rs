//! What a driver can share, asked before anything is made.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::wire::{
    MEMORY_BROUGHT, MEMORY_EXPORTED, MEMORY_HOST, MEMORY_IMAGES, TIMELINE_CARRIED, TIMELINE_EXPORTED,
};
use esaac_engine::Device;
use esaac_engine::ash::vk;

/// Usage of every shared buffer: what the engine needs of its own, and both sides must name alike.
pub const BUFFER_USAGE: vk::BufferUsageFlags = vk::BufferUsageFlags::from_raw(
    vk::BufferUsageFlags::STORAGE_BUFFER.as_raw()
        | vk::BufferUsageFlags::TRANSFER_SRC.as_raw()
        | vk::BufferUsageFlags::TRANSFER_DST.as_raw()
        | vk::BufferUsageFlags::SHADER_DEVICE_ADDRESS.as_raw(),
);

/// What a device can share with another process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Support {
    /// Buffers leave as POSIX file descriptors.
    pub export_buffer: bool,
    /// And come in as such.
    pub import_buffer: bool,
    /// Each such memory must be dedicated to one buffer.
    pub dedicated_only: bool,
    /// Timeline semaphores leave and come in as file descriptors.
    pub share_timeline: bool,
    /// Memory of the host can be given to the device; the alignment it must have, bytes.
    pub host_alignment: Option<u64>,
}

impl Support {
    /// Asks the driver.
    #[must_use]
    pub fn of(device: &Device) -> Self {
        let (instance, physical, info) = (device.instance(), device.physical(), device.info());
        let mut support = Support::default();
        if info.has("VK_KHR_external_memory_fd") {
            let query = vk::PhysicalDeviceExternalBufferInfo::default()
                .usage(BUFFER_USAGE)
                .handle_type(vk::ExternalMemoryHandleTypeFlags::OPAQUE_FD);
            let mut answer = vk::ExternalBufferProperties::default();
            // SAFETY: `physical` comes from this instance; both structs outlive the call.
            unsafe {
                instance.get_physical_device_external_buffer_properties(physical, &query, &mut answer);
            }
            let features = answer.external_memory_properties.external_memory_features;
            support.export_buffer = features.contains(vk::ExternalMemoryFeatureFlags::EXPORTABLE);
            support.import_buffer = features.contains(vk::ExternalMemoryFeatureFlags::IMPORTABLE);
            support.dedicated_only = features.contains(vk::ExternalMemoryFeatureFlags::DEDICATED_ONLY);
        }
        if info.has("VK_KHR_external_semaphore_fd") && info.has("timelineSemaphore") {
            let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
            let query = vk::PhysicalDeviceExternalSemaphoreInfo::default()
                .handle_type(vk::ExternalSemaphoreHandleTypeFlags::OPAQUE_FD)
                .push_next(&mut kind);
            let mut answer = vk::ExternalSemaphoreProperties::default();
            // SAFETY: as above.
            unsafe {
                instance.get_physical_device_external_semaphore_properties(physical, &query, &mut answer);
            }
            support.share_timeline = answer.external_semaphore_features.contains(
                vk::ExternalSemaphoreFeatureFlags::EXPORTABLE | vk::ExternalSemaphoreFeatureFlags::IMPORTABLE,
            );
        }
        if info.has("VK_EXT_external_memory_host") {
            let query = vk::PhysicalDeviceExternalBufferInfo::default()
                .usage(BUFFER_USAGE)
                .handle_type(vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT);
            let mut answer = vk::ExternalBufferProperties::default();
            let mut host = vk::PhysicalDeviceExternalMemoryHostPropertiesEXT::default();
            let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut host);
            // SAFETY: as above.
            unsafe {
                instance.get_physical_device_external_buffer_properties(physical, &query, &mut answer);
                instance.get_physical_device_properties2(physical, &mut properties);
            }
            let features = answer.external_memory_properties.external_memory_features;
            support.host_alignment = features
                .contains(vk::ExternalMemoryFeatureFlags::IMPORTABLE)
                .then_some(host.min_imported_host_pointer_alignment);
        }
        support
    }

    /// Bits of the memories that this device can offer as the engine's; whether it takes images depends on
    /// their formats.
    #[must_use]
    pub fn engine_memories(&self) -> u32 {
        bit(self.export_buffer, MEMORY_EXPORTED)
            | bit(self.host_alignment.is_some(), MEMORY_HOST)
            | bit(self.import_buffer, MEMORY_BROUGHT)
    }

    /// Bits of the memories that this device can take as a producer's; of images the driver has the last
    /// word once their formats are known.
    #[must_use]
    pub fn producer_memories(&self) -> u32 {
        bit(self.import_buffer, MEMORY_EXPORTED)
            | bit(self.host_alignment.is_some(), MEMORY_HOST)
            | bit(self.export_buffer, MEMORY_BROUGHT | MEMORY_IMAGES)
    }

    /// Bits of the timelines that it can use on either side.
    #[must_use]
    pub fn timelines(&self) -> u32 {
        TIMELINE_CARRIED | bit(self.share_timeline, TIMELINE_EXPORTED)
    }
}

fn bit(set: bool, value: u32) -> u32 {
    if set { value } else { 0 }
}
