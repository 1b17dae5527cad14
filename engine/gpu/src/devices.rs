//! The Vulkan devices of this machine: their capabilities, and the choice of one.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::error::{Call, EngineError};
use crate::instance::{Instance, Validation};
use ash::{ext, vk};
use esaac_layout::UNIFORM_BYTES;
use std::ffi::{CStr, c_char};

/// The capability that [`crate::Kernel::statistics`] needs.
pub(crate) const STATISTICS: &str = "pipelineExecutableInfo";

/// The capability that [`crate::Device::calibrate`] needs.
pub(crate) const CALIBRATED: &str = "VK_EXT_calibrated_timestamps";

/// The capability that poses from the device need.
pub(crate) const FLOAT64: &str = "shaderFloat64";

/// Storage buffers that a rig's kernels are bound to: the capability, and their number.
pub(crate) const STORAGE_BUFFERS: (&str, u32) = ("29 storage buffers", 29);

/// The capability that GPU times need.
pub(crate) const TIMESTAMPS: &str = "timestamps";

/// The kind of a software driver.
const SOFTWARE: &str = "software";

/// Which device to open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The first suitable one: discrete before integrated before virtual before any other.
    Best,
    /// By position in [`list_devices`].
    Index(usize),
    /// By UUID.
    Uuid([u8; 16]),
}

impl DeviceChoice {
    /// The place of the chosen device among these. [`DeviceChoice::Best`] chooses none by itself.
    ///
    /// # Errors
    /// [`EngineError::NoSuchDevice`] if it is not there.
    pub fn place_among<'a>(
        self,
        devices: impl Iterator<Item = &'a DeviceInfo> + Clone,
    ) -> Result<Option<usize>, EngineError> {
        let place = match self {
            DeviceChoice::Best => return Ok(None),
            DeviceChoice::Index(index) => devices.clone().position(|d| d.index == index),
            DeviceChoice::Uuid(uuid) => devices.clone().position(|d| d.uuid == uuid),
        };
        let present = || devices.map(|d| format!("{} {}", d.index, d.name)).collect::<Vec<_>>().join(", ");
        let missing = || EngineError::NoSuchDevice { wanted: self.to_string(), present: present() };
        place.ok_or_else(missing).map(Some)
    }
}

impl std::fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            DeviceChoice::Best => f.write_str("that is enough"),
            DeviceChoice::Index(index) => write!(f, "{index}"),
            DeviceChoice::Uuid(uuid) => {
                // As vulkaninfo and nvidia-smi print it: 8-4-4-4-12 hexadecimal digits.
                for (i, byte) in uuid.iter().enumerate() {
                    if matches!(i, 4 | 6 | 8 | 10) {
                        f.write_str("-")?;
                    }
                    write!(f, "{byte:02x}")?;
                }
                Ok(())
            }
        }
    }
}

/// A feature, limit or extension that a device has or lacks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Capability {
    /// Vulkan's name, or a description.
    pub name: &'static str,
    /// Whether the engine needs it.
    pub required: bool,
    /// Whether the device has it.
    pub present: bool,
}

/// A device as it presents itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Position in the list.
    pub index: usize,
    /// Name.
    pub name: String,
    /// "discrete GPU", "integrated GPU", "virtual GPU", "software" or "other".
    pub kind: &'static str,
    /// Device UUID.
    pub uuid: [u8; 16],
    /// Driver UUID.
    pub driver_uuid: [u8; 16],
    /// Driver name and version.
    pub driver: String,
    /// Vulkan version.
    pub api_version: String,
    /// Bytes of the largest device-local heap.
    pub memory_bytes: u64,
    /// Lanes of a subgroup.
    pub subgroup_size: u32,
    /// Capabilities that the engine needs or uses, present or not.
    pub capabilities: Vec<Capability>,
    /// Whether it has every required capability.
    pub suitable: bool,
}

impl DeviceInfo {
    /// Whether it has the capability of this name.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.capabilities.iter().any(|c| c.name == name && c.present)
    }

    /// Whether it is a software driver, which runs on the processor.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.kind == SOFTWARE
    }

    fn missing(&self) -> String {
        let names: Vec<_> =
            self.capabilities.iter().filter(|c| c.required && !c.present).map(|c| c.name).collect();
        names.join(", ")
    }
}

/// The family that [`Device::open`](crate::Device::open) takes its queue from: the first that computes, with its index.
pub(crate) fn compute_family(
    families: &[vk::QueueFamilyProperties],
) -> Option<(u32, &vk::QueueFamilyProperties)> {
    (0..).zip(families).find(|(_, family)| family.queue_flags.contains(vk::QueueFlags::COMPUTE))
}

fn describe(instance: &ash::Instance, physical: vk::PhysicalDevice, index: usize) -> DeviceInfo {
    let mut id = vk::PhysicalDeviceIDProperties::default();
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default()
        .push_next(&mut id)
        .push_next(&mut driver)
        .push_next(&mut subgroup);
    let mut f11 = vk::PhysicalDeviceVulkan11Features::default();
    let mut f12 = vk::PhysicalDeviceVulkan12Features::default();
    let mut f13 = vk::PhysicalDeviceVulkan13Features::default();
    let mut executable = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default();
    let mut features = vk::PhysicalDeviceFeatures2::default()
        .push_next(&mut f11)
        .push_next(&mut f12)
        .push_next(&mut f13)
        .push_next(&mut executable);
    // SAFETY: `physical` comes from this instance; every chained struct outlives the calls.
    let (memory, families, extensions) = unsafe {
        instance.get_physical_device_properties2(physical, &mut properties);
        instance.get_physical_device_features2(physical, &mut features);
        (
            instance.get_physical_device_memory_properties(physical),
            instance.get_physical_device_queue_family_properties(physical),
            instance.enumerate_device_extension_properties(physical).unwrap_or_default(),
        )
    };
    let core = properties.properties;
    let base = features.features;
    let version = core.api_version;
    let has = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
    let compute = compute_family(&families);
    let stamps = compute.is_some_and(|(_, family)| family.timestamp_valid_bits > 0);
    let needs = |name, present| Capability { name, required: true, present };
    let likes = |name, present| Capability { name, required: false, present };
    let capabilities = vec![
        needs("Vulkan 1.3", version >= vk::API_VERSION_1_3),
        needs("compute queue", compute.is_some()),
        needs("shaderInt64", base.shader_int64 == vk::TRUE),
        needs("shaderInt16", base.shader_int16 == vk::TRUE),
        needs("shaderInt8", f12.shader_int8 == vk::TRUE),
        needs("storageBuffer8BitAccess", f12.storage_buffer8_bit_access == vk::TRUE),
        needs("storageBuffer16BitAccess", f11.storage_buffer16_bit_access == vk::TRUE),
        needs("bufferDeviceAddress", f12.buffer_device_address == vk::TRUE),
        needs("64 KiB uniform buffers", core.limits.max_uniform_buffer_range as usize >= UNIFORM_BYTES),
        needs("synchronization2", f13.synchronization2 == vk::TRUE),
        needs(
            "subgroup arithmetic in compute",
            subgroup.supported_operations.contains(vk::SubgroupFeatureFlags::ARITHMETIC)
                && subgroup.supported_stages.contains(vk::ShaderStageFlags::COMPUTE),
        ),
        needs("256 invocations a workgroup", core.limits.max_compute_work_group_invocations >= 256),
        needs("32 KiB of shared memory", core.limits.max_compute_shared_memory_size >= 32 * 1024),
        needs(STORAGE_BUFFERS.0, core.limits.max_per_stage_descriptor_storage_buffers >= STORAGE_BUFFERS.1),
        likes("timelineSemaphore", f12.timeline_semaphore == vk::TRUE),
        likes(TIMESTAMPS, stamps),
        likes(FLOAT64, base.shader_float64 == vk::TRUE),
        likes("VK_KHR_external_memory_fd", has(ash::khr::external_memory_fd::NAME)),
        likes("VK_KHR_external_semaphore_fd", has(ash::khr::external_semaphore_fd::NAME)),
        likes("VK_EXT_external_memory_host", has(ext::external_memory_host::NAME)),
        likes(CALIBRATED, has(ext::calibrated_timestamps::NAME)),
        likes("VK_EXT_memory_budget", has(ext::memory_budget::NAME)),
        likes(STATISTICS, executable.pipeline_executable_info == vk::TRUE),
    ];
    let text = |raw: &[c_char]| {
        let bytes: Vec<u8> = raw.iter().take_while(|&&c| c != 0).map(|&c| c as u8).collect();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    let heaps = &memory.memory_heaps[..memory.memory_heap_count as usize];
    DeviceInfo {
        index,
        name: text(&core.device_name),
        kind: match core.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => "discrete GPU",
            vk::PhysicalDeviceType::INTEGRATED_GPU => "integrated GPU",
            vk::PhysicalDeviceType::VIRTUAL_GPU => "virtual GPU",
            vk::PhysicalDeviceType::CPU => SOFTWARE,
            _ => "other",
        },
        uuid: id.device_uuid,
        driver_uuid: id.driver_uuid,
        driver: format!("{} {}", text(&driver.driver_name), text(&driver.driver_info)),
        api_version: format!(
            "{}.{}.{}",
            vk::api_version_major(version),
            vk::api_version_minor(version),
            vk::api_version_patch(version)
        ),
        memory_bytes: heaps
            .iter()
            .filter(|h| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
            .map(|h| h.size)
            .max()
            .unwrap_or(0),
        subgroup_size: subgroup.subgroup_size,
        suitable: capabilities.iter().all(|c| c.present || !c.required),
        capabilities,
    }
}

/// The devices of the instance's drivers.
pub(crate) fn devices(instance: &Instance) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo)>, EngineError> {
    // SAFETY: the instance is alive.
    let physical =
        unsafe { instance.raw().enumerate_physical_devices() }.call("vkEnumeratePhysicalDevices")?;
    Ok(physical.into_iter().enumerate().map(|(index, p)| (p, describe(instance.raw(), p, index))).collect())
}

/// Every Vulkan device of this machine; an empty list if there is a loader but no driver, an error if there is no
/// loader.
pub fn list_devices() -> Result<Vec<DeviceInfo>, EngineError> {
    match Instance::new(Validation::Off) {
        Ok(instance) => Ok(devices(&instance)?.into_iter().map(|(_, info)| info).collect()),
        Err(EngineError::NoDriver) => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

/// The device that [`Device::open`](crate::Device::open) opens.
pub fn find_device(choice: DeviceChoice) -> Result<DeviceInfo, EngineError> {
    let devices = devices(&Instance::new(Validation::Off)?)?;
    if devices.is_empty() {
        return Err(EngineError::NoDriver);
    }
    Ok(choose(choice, devices)?.1)
}

/// The chosen device; an error if it does not exist or is not suitable.
pub(crate) fn choose(
    choice: DeviceChoice,
    devices: Vec<(vk::PhysicalDevice, DeviceInfo)>,
) -> Result<(vk::PhysicalDevice, DeviceInfo), EngineError> {
    let Some(position) = choice.place_among(devices.iter().map(|(_, info)| info))? else {
        let rank = |d: &DeviceInfo| match d.kind {
            "discrete GPU" => 0,
            "integrated GPU" => 1,
            "virtual GPU" => 2,
            _ => 3,
        };
        let lacks =
            devices.iter().map(|(_, d)| format!("{} lacks {}", d.name, d.missing())).collect::<Vec<_>>();
        return devices
            .into_iter()
            .filter(|(_, d)| d.suitable)
            .min_by_key(|(_, d)| (rank(d), d.index))
            .ok_or_else(|| EngineError::NoSuitableDevice(lacks.join("; ")));
    };
    let (physical, info) = devices.into_iter().nth(position).expect("position is inside");
    if info.suitable {
        Ok((physical, info))
    } else {
        Err(EngineError::MissingCapability { device: info.name.clone(), missing: info.missing() })
    }
}
