//! What a driver can share, asked before anything is made.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::error::InteropError;
use crate::wire::{
    MEMORY_BROUGHT, MEMORY_EXPORTED, MEMORY_HOST, MEMORY_IMAGES, TIMELINE_CARRIED, TIMELINE_EXPORTED,
    memory_names,
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
#[derive(Clone, Debug, Default, PartialEq, Eq)]
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
    /// Why not, in words, if the driver has the extension and refused a first page of such memory: some take no pages of a file,
    /// and two processes share nothing else.
    pub host_refused: Option<String>,
}

impl Support {
    /// What the driver says that it can. [`Support::of`] also tries it.
    pub(crate) fn told(device: &Device) -> Self {
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

    /// The memories of `allowed` that the engine can offer on this device; an error if there are none.
    pub fn offers(&self, device: &str, allowed: u32) -> Result<u32, InteropError> {
        self.usable(device, self.engine_memories(), allowed)
    }

    /// The memories of `allowed` that a producer can take on this device; an error if there are none.
    pub fn takes(&self, device: &str, allowed: u32) -> Result<u32, InteropError> {
        self.usable(device, self.producer_memories(), allowed)
    }

    fn usable(&self, device: &str, able: u32, allowed: u32) -> Result<u32, InteropError> {
        if able & allowed != 0 {
            return Ok(able & allowed);
        }
        let reason = match (able, &self.host_refused) {
            (0, None) => {
                "it has neither VK_KHR_external_memory_fd nor VK_EXT_external_memory_host; update its driver or choose \
                 another device"
                    .to_owned()
            }
            (0, Some(why)) => {
                format!("it lacks VK_KHR_external_memory_fd, and {why}; update its driver or choose another device")
            }
            (able, refused) => {
                let why = refused.as_ref().filter(|_| allowed & MEMORY_HOST != 0);
                let why = why.map_or_else(String::new, |why| format!("; {why}"));
                format!("it can share {}, and {} is allowed{why}", memory_names(able), memory_names(allowed))
            }
        };
        Err(InteropError::Unsupported { device: device.to_owned(), reason })
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

/// Memories that do not let a hostile producer harm the engine, or all if producers are trusted.
///
/// Mesa's software driver shares memory as an anonymous file that begins with the driver's own notes: how long
/// the mapping is and where the texels begin. It reads them again when the memory is freed. The peer has the
/// same file mapped, so no check before the import helps; a changed length has the driver unmap whatever lies
/// behind. With memory of the host the engine maps the file itself and the driver is given an address.
pub(crate) fn safe_memories(is_software: bool, trusts_producers: bool) -> u32 {
    if is_software && !trusts_producers {
        MEMORY_HOST
    } else {
        MEMORY_EXPORTED | MEMORY_HOST | MEMORY_BROUGHT | MEMORY_IMAGES
    }
}

fn bit(set: bool, value: u32) -> u32 {
    if set { value } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: u32 = MEMORY_EXPORTED | MEMORY_HOST | MEMORY_BROUGHT | MEMORY_IMAGES;

    #[test]
    fn what_a_driver_reports_decides_what_is_offered() {
        let fd = Support { export_buffer: true, import_buffer: true, ..Support::default() };
        let host = Support { host_alignment: Some(4096), ..Support::default() };
        let exports = Support { export_buffer: true, ..Support::default() };
        let imports = Support { import_buffer: true, ..Support::default() };
        // The engine's side, then a producer's.
        for (support, engine, producer) in [
            (fd.clone(), MEMORY_EXPORTED | MEMORY_BROUGHT, MEMORY_EXPORTED | MEMORY_BROUGHT | MEMORY_IMAGES),
            (host, MEMORY_HOST, MEMORY_HOST),
            (exports.clone(), MEMORY_EXPORTED, MEMORY_BROUGHT | MEMORY_IMAGES),
            (imports, MEMORY_BROUGHT, MEMORY_EXPORTED),
            (
                Support { host_refused: Some("why".to_owned()), ..exports },
                MEMORY_EXPORTED,
                MEMORY_BROUGHT | MEMORY_IMAGES,
            ),
            (Support::default(), 0, 0),
        ] {
            assert_eq!(
                (support.engine_memories(), support.producer_memories()),
                (engine, producer),
                "{support:?}"
            );
            assert_eq!(support.offers("it", ALL).ok(), (engine != 0).then_some(engine), "{support:?}");
            assert_eq!(support.timelines(), TIMELINE_CARRIED, "{support:?}");
        }
        let shares = Support { share_timeline: true, ..fd };
        assert_eq!(shares.timelines(), TIMELINE_CARRIED | TIMELINE_EXPORTED);
    }

    #[test]
    fn a_software_driver_shares_only_memory_of_the_host_with_producers_that_are_not_trusted() {
        assert_eq!(safe_memories(true, false), MEMORY_HOST);
        for (is_software, trusts) in [(true, true), (false, true), (false, false)] {
            assert_eq!(safe_memories(is_software, trusts), ALL, "{is_software} {trusts}");
        }
    }

    #[test]
    fn a_device_that_can_share_nothing_is_told_what_it_lacks() {
        let nothing = Support::default().offers("card", ALL).unwrap_err().to_string();
        assert!(nothing.starts_with("device card cannot share memory"), "{nothing}");
        assert!(
            nothing.contains("neither VK_KHR_external_memory_fd nor VK_EXT_external_memory_host"),
            "{nothing}"
        );
        let host = Support { host_alignment: Some(4096), ..Support::default() };
        let other = host.offers("card", MEMORY_EXPORTED).unwrap_err().to_string();
        assert!(other.ends_with("it can share HOST, and EXPORTED is allowed"), "{other}");
    }

    #[test]
    fn a_device_that_refuses_the_host_s_memory_is_told_so_where_it_matters() {
        let refused = "the driver refuses memory of the host";
        let refuses = Support { host_refused: Some(refused.to_owned()), ..Support::default() };
        let exports = Support { export_buffer: true, import_buffer: true, ..refuses.clone() };
        let nothing = refuses.offers("card", ALL).unwrap_err().to_string();
        assert!(
            nothing.contains("lacks VK_KHR_external_memory_fd, and") && nothing.contains(refused),
            "{nothing}"
        );
        for asked in [exports.offers("card", MEMORY_HOST), exports.takes("card", MEMORY_HOST)] {
            let only = asked.unwrap_err().to_string();
            assert!(only.ends_with(&format!("and HOST is allowed; {refused}")), "{only}");
        }
        let other = Support { import_buffer: false, ..exports }
            .takes("card", MEMORY_EXPORTED)
            .unwrap_err()
            .to_string();
        assert!(other.ends_with("and EXPORTED is allowed"), "{other}");
    }
}
