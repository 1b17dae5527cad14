//! A Vulkan device that is enough, its queue and its allocator.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::error::{Call, EngineError};
use crate::kernel::Commands;
use crate::memory::Buffer;
use crate::timeline::Timeline;
use ash::{ext, khr, vk};
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use std::ffi::{CStr, c_char, c_void};
use std::mem::ManuallyDrop;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Extensions for memory and semaphores that other processes share, each enabled where it is present.
const SHARING: [&CStr; 3] =
    [khr::external_memory_fd::NAME, khr::external_semaphore_fd::NAME, ext::external_memory_host::NAME];

/// The capability that [`Device::calibrate`] needs.
const CALIBRATED: &str = "VK_EXT_calibrated_timestamps";

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// The capability that [`crate::Kernel::statistics`] needs.
const STATISTICS: &str = "pipelineExecutableInfo";

/// Which device to open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The first that is enough, discrete before integrated before software.
    Best,
    /// By position in [`list_devices`].
    Index(usize),
    /// By UUID.
    Uuid([u8; 16]),
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

/// Whether the validation layer watches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Validation {
    /// No.
    Off,
    /// Core checks, GPU-assisted checks and synchronisation checks; see [`Device::validation_messages`].
    On,
}

impl Validation {
    /// `On` if the environment variable `ESAAC_VALIDATION` is set to anything but `0`.
    #[must_use]
    pub fn from_env() -> Self {
        match std::env::var_os("ESAAC_VALIDATION") {
            Some(value) if value != "0" => Validation::On,
            _ => Validation::Off,
        }
    }
}

/// Something that a device has or lacks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Capability {
    /// Vulkan's name.
    pub name: &'static str,
    /// Whether the engine needs it.
    pub required: bool,
    /// Whether it is there.
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
    /// What it has and lacks.
    pub capabilities: Vec<Capability>,
    /// Whether it is enough.
    pub suitable: bool,
}

impl DeviceInfo {
    /// Whether it has the capability of this name.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.capabilities.iter().any(|c| c.name == name && c.present)
    }

    fn missing(&self) -> String {
        let names: Vec<_> =
            self.capabilities.iter().filter(|c| c.required && !c.present).map(|c| c.name).collect();
        names.join(", ")
    }
}

type Messages = Mutex<Vec<String>>;

struct Instance {
    entry: ash::Entry,
    raw: ash::Instance,
    debug: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    messages: Box<Messages>,
}

/// Collects what the validation layer says.
///
/// # Safety
/// Called by the loader with a valid callback struct and the `Messages` registered with it.
unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: `user` is the boxed `Messages` of the instance, which outlives the messenger; `data`
    // and its message are valid for this call.
    let (messages, text) = unsafe {
        let message: *const c_char = (*data).p_message;
        (&*user.cast::<Messages>(), CStr::from_ptr(message).to_string_lossy().into_owned())
    };
    messages.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    vk::FALSE
}

impl Instance {
    fn new(validation: Validation) -> Result<Self, EngineError> {
        // SAFETY: loading the system's Vulkan loader runs its initialisers, which are trusted.
        let entry = unsafe { ash::Entry::load() }.map_err(EngineError::NoLoader)?;
        let application = vk::ApplicationInfo::default()
            .application_name(c"esaac")
            .engine_name(c"esaac")
            .api_version(vk::API_VERSION_1_3);
        let mut layers: Vec<*const c_char> = Vec::new();
        let mut extensions: Vec<*const c_char> = Vec::new();
        if validation == Validation::On {
            // SAFETY: the entry is loaded.
            let present = unsafe { entry.enumerate_instance_layer_properties() }
                .call("vkEnumerateInstanceLayerProperties")?;
            if !present.iter().any(|l| l.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
                return Err(EngineError::NoValidationLayer);
            }
            layers.push(VALIDATION_LAYER.as_ptr());
            extensions.push(ext::debug_utils::NAME.as_ptr());
            extensions.push(ext::validation_features::NAME.as_ptr());
        }
        let enabled = [
            vk::ValidationFeatureEnableEXT::GPU_ASSISTED,
            vk::ValidationFeatureEnableEXT::GPU_ASSISTED_RESERVE_BINDING_SLOT,
            vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION,
        ];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&enabled);
        let mut info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        if validation == Validation::On {
            info = info.push_next(&mut features);
        }
        // SAFETY: every pointer in `info` lives until the call returns.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(|result| match result {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => EngineError::NoDriver,
            result => EngineError::Vulkan { call: "vkCreateInstance", result },
        })?;
        let mut instance = Instance { entry, raw, debug: None, messages: Box::default() };
        if validation == Validation::On {
            let debug = ext::debug_utils::Instance::new(&instance.entry, &instance.raw);
            let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
                .message_severity(
                    vk::DebugUtilsMessageSeverityFlagsEXT::WARNING
                        | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
                )
                .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
                .pfn_user_callback(Some(on_message))
                .user_data((&raw const *instance.messages).cast_mut().cast());
            // SAFETY: the callback and the boxed messages outlive the messenger, destroyed in `drop`.
            let messenger = unsafe { debug.create_debug_utils_messenger(&info, None) }
                .call("vkCreateDebugUtilsMessengerEXT")?;
            instance.debug = Some((debug, messenger));
        }
        Ok(instance)
    }

    fn devices(&self) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo)>, EngineError> {
        // SAFETY: the instance is alive.
        let physical = unsafe { self.raw.enumerate_physical_devices() }.call("vkEnumeratePhysicalDevices")?;
        Ok(physical.into_iter().enumerate().map(|(index, p)| (p, describe(&self.raw, p, index))).collect())
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: the device made from this instance is gone (it owns the instance), and nothing else
        // uses the messenger.
        unsafe {
            if let Some((debug, messenger)) = self.debug.take() {
                debug.destroy_debug_utils_messenger(messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
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
    let compute = families.iter().any(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE));
    let needs = |name, present| Capability { name, required: true, present };
    let likes = |name, present| Capability { name, required: false, present };
    let capabilities = vec![
        needs("Vulkan 1.3", version >= vk::API_VERSION_1_3),
        needs("compute queue", compute),
        needs("shaderInt64", base.shader_int64 == vk::TRUE),
        needs("shaderInt16", base.shader_int16 == vk::TRUE),
        needs("shaderInt8", f12.shader_int8 == vk::TRUE),
        needs("storageBuffer8BitAccess", f12.storage_buffer8_bit_access == vk::TRUE),
        needs("storageBuffer16BitAccess", f11.storage_buffer16_bit_access == vk::TRUE),
        needs("bufferDeviceAddress", f12.buffer_device_address == vk::TRUE),
        needs("64 KiB uniform buffers", core.limits.max_uniform_buffer_range >= 65_536),
        needs("synchronization2", f13.synchronization2 == vk::TRUE),
        needs(
            "subgroup arithmetic in compute",
            subgroup.supported_operations.contains(vk::SubgroupFeatureFlags::ARITHMETIC)
                && subgroup.supported_stages.contains(vk::ShaderStageFlags::COMPUTE),
        ),
        needs("320 invocations a workgroup", core.limits.max_compute_work_group_invocations >= 320),
        needs("32 KiB of shared memory", core.limits.max_compute_shared_memory_size >= 32 * 1024),
        needs("18 storage buffers", core.limits.max_per_stage_descriptor_storage_buffers >= 18),
        likes("timelineSemaphore", f12.timeline_semaphore == vk::TRUE),
        likes("timestamps", core.limits.timestamp_compute_and_graphics == vk::TRUE),
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
            vk::PhysicalDeviceType::CPU => "software",
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

/// Every Vulkan device of this machine; an empty list if there is a loader but no driver.
pub fn list_devices() -> Result<Vec<DeviceInfo>, EngineError> {
    match Instance::new(Validation::Off) {
        Ok(instance) => Ok(instance.devices()?.into_iter().map(|(_, info)| info).collect()),
        Err(EngineError::NoDriver) => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

/// An open device with one compute queue.
pub struct Device {
    raw: ash::Device,
    physical: vk::PhysicalDevice,
    allocator: ManuallyDrop<Mutex<Allocator>>,
    queue: Mutex<vk::Queue>,
    queue_family: u32,
    timestamp_period_ns: f64,
    timestamp_mask: u64,
    unified_memory: bool,
    statistics: Option<khr::pipeline_executable_properties::Device>,
    calibrated: Option<ext::calibrated_timestamps::Device>,
    info: DeviceInfo,
    instance: Instance,
}

impl Device {
    /// Opens a device.
    pub fn open(choice: DeviceChoice, validation: Validation) -> Result<Arc<Self>, EngineError> {
        let instance = Instance::new(validation)?;
        let devices = instance.devices()?;
        if devices.is_empty() {
            return Err(EngineError::NoDriver);
        }
        let (physical, info) = choose(choice, devices)?;
        // SAFETY: `physical` comes from this instance.
        let families = unsafe { instance.raw.get_physical_device_queue_family_properties(physical) };
        let queue_family = families
            .iter()
            .position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE))
            .expect("a suitable device has a compute queue") as u32;
        let timestamp_bits = families[queue_family as usize].timestamp_valid_bits;

        let priorities = [1.0];
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(queue_family)
            .queue_priorities(&priorities)];
        let mut f11 = vk::PhysicalDeviceVulkan11Features::default().storage_buffer16_bit_access(true);
        let mut f12 = vk::PhysicalDeviceVulkan12Features::default()
            .shader_int8(true)
            .storage_buffer8_bit_access(true)
            .buffer_device_address(true)
            .timeline_semaphore(info.has("timelineSemaphore"));
        let mut f13 = vk::PhysicalDeviceVulkan13Features::default().synchronization2(true);
        let base = vk::PhysicalDeviceFeatures::default().shader_int64(true).shader_int16(true);
        let mut extensions: Vec<*const c_char> = SHARING
            .iter()
            .filter(|name| name.to_str().is_ok_and(|name| info.has(name)))
            .map(|name| name.as_ptr())
            .collect();
        let tells_statistics = info.has(STATISTICS);
        if tells_statistics {
            extensions.push(khr::pipeline_executable_properties::NAME.as_ptr());
        }
        if info.has(CALIBRATED) {
            extensions.push(ext::calibrated_timestamps::NAME.as_ptr());
        }
        let mut statistics = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default()
            .pipeline_executable_info(true);
        let mut create = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_features(&base)
            .enabled_extension_names(&extensions)
            .push_next(&mut f11)
            .push_next(&mut f12)
            .push_next(&mut f13);
        if tells_statistics {
            create = create.push_next(&mut statistics);
        }
        // SAFETY: every feature asked for was found present by `describe`; pointers outlive the call.
        let raw = unsafe { instance.raw.create_device(physical, &create, None) }.call("vkCreateDevice")?;
        let statistics =
            tells_statistics.then(|| khr::pipeline_executable_properties::Device::new(&instance.raw, &raw));
        let calibrated = crate::calibration::functions(&instance.raw, &raw, info.has(CALIBRATED));
        // SAFETY: one queue of this family was created.
        let queue = unsafe { raw.get_device_queue(queue_family, 0) };
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: raw.clone(),
            physical_device: physical,
            debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
            buffer_device_address: true,
            allocation_sizes: gpu_allocator::AllocationSizes::new(4 << 20, 4 << 20),
        })
        .map_err(|e| EngineError::OutOfMemory {
            name: "allocator".to_owned(),
            bytes: 0,
            reason: e.to_string(),
        })?;
        // SAFETY: `physical` comes from this instance.
        let (memory, properties) = unsafe {
            (
                instance.raw.get_physical_device_memory_properties(physical),
                instance.raw.get_physical_device_properties(physical),
            )
        };
        let types = &memory.memory_types[..memory.memory_type_count as usize];
        let own_and_cached = vk::MemoryPropertyFlags::DEVICE_LOCAL | vk::MemoryPropertyFlags::HOST_CACHED;
        Ok(Arc::new(Device {
            physical,
            allocator: ManuallyDrop::new(Mutex::new(allocator)),
            raw,
            queue: Mutex::new(queue),
            queue_family,
            timestamp_period_ns: f64::from(properties.limits.timestamp_period),
            timestamp_mask: if timestamp_bits >= 64 { u64::MAX } else { (1 << timestamp_bits) - 1 },
            unified_memory: types.iter().any(|t| t.property_flags.contains(own_and_cached)),
            statistics,
            calibrated,
            info,
            instance,
        }))
    }

    /// Whether the validation layer watches.
    pub(crate) fn is_validated(&self) -> bool {
        self.instance.debug.is_some()
    }

    /// What asks for a pipeline's registers and sizes, where the driver tells them.
    pub(crate) fn statistics(&self) -> Option<&khr::pipeline_executable_properties::Device> {
        self.statistics.as_ref()
    }

    /// What reads both clocks, where the device can.
    pub(crate) fn calibrated(&self) -> Option<&ext::calibrated_timestamps::Device> {
        self.calibrated.as_ref()
    }

    /// What it is.
    #[must_use]
    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    /// Vulkan device, for other recorders on it.
    #[must_use]
    pub fn raw(&self) -> &ash::Device {
        &self.raw
    }

    /// What the device was made from.
    #[must_use]
    pub fn physical(&self) -> vk::PhysicalDevice {
        self.physical
    }

    /// Vulkan instance, for questions about the physical device and for extensions.
    #[must_use]
    pub fn instance(&self) -> &ash::Instance {
        &self.instance.raw
    }

    /// Family of the queue.
    #[must_use]
    pub fn queue_family(&self) -> u32 {
        self.queue_family
    }

    /// Whether the host reads the device's own memory at full speed, so that nothing need be copied.
    #[must_use]
    pub fn unified_memory(&self) -> bool {
        self.unified_memory
    }

    /// Nanoseconds between two raw time stamps of this device.
    #[must_use]
    pub fn timestamp_span_ns(&self, from: u64, to: u64) -> u64 {
        ((to.wrapping_sub(from) & self.timestamp_mask) as f64 * self.timestamp_period_ns).round() as u64
    }

    /// A raw time stamp in nanoseconds since the device's clock began.
    #[cfg(feature = "tracy")]
    pub(crate) fn timestamp_ns(&self, stamp: u64) -> i64 {
        ((stamp & self.timestamp_mask) as f64 * self.timestamp_period_ns) as i64
    }

    /// What the validation layer has said so far; empty when it is off.
    #[must_use]
    pub fn validation_messages(&self) -> Vec<String> {
        self.instance.messages.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(crate) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A named buffer; storage and transfer usage are always included.
    pub fn allocate(
        self: &Arc<Self>,
        name: &str,
        bytes: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Buffer, EngineError> {
        let always = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        Buffer::new(self, name, bytes, usage | always, location)
    }

    pub(crate) fn submit(
        &self,
        commands: vk::CommandBuffer,
        around: &Around<'_>,
        fence: vk::Fence,
    ) -> Result<(), EngineError> {
        let commands: Vec<_> = around
            .before
            .iter()
            .map(|c| c.raw())
            .chain([commands])
            .chain(around.after.iter().map(|c| c.raw()))
            .collect();
        let split = |at: &[(&Timeline, u64)]| -> (Vec<vk::Semaphore>, Vec<u64>) {
            at.iter().map(|(timeline, value)| (timeline.raw(), *value)).unzip()
        };
        let ((waits, wait_values), (signals, signal_values)) = (split(around.waits), split(around.signals));
        let stages = vec![vk::PipelineStageFlags::ALL_COMMANDS; waits.len()];
        let mut values = vk::TimelineSemaphoreSubmitInfo::default()
            .wait_semaphore_values(&wait_values)
            .signal_semaphore_values(&signal_values);
        // Not vkQueueSubmit2: Debian's validation layer (1.3.239) loses the values of its signals.
        let mut submit = vk::SubmitInfo::default()
            .command_buffers(&commands)
            .wait_semaphores(&waits)
            .wait_dst_stage_mask(&stages)
            .signal_semaphores(&signals);
        if !(waits.is_empty() && signals.is_empty()) {
            submit = submit.push_next(&mut values);
        }
        let queue = self.queue.lock().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: the queue is held exclusively; the command buffers are recorded and not pending, the
        // fence unsignalled, the semaphores alive until the fence is (the caller waits for it).
        unsafe { self.raw.queue_submit(*queue, &[submit], fence) }.call("vkQueueSubmit")
    }

    /// Records with `record`, submits and waits: for set-up and producers, not for the hot path.
    pub fn run_once(self: &Arc<Self>, record: impl FnOnce(vk::CommandBuffer)) -> Result<(), EngineError> {
        let commands = Commands::new(self)?;
        commands.record(record)?;
        self.run_around(&commands, &Around::default())
    }

    /// As [`Device::run_once`], with GPU time stamps around it: nanoseconds from the first command's start
    /// to the end of the last. For measurements of the device itself.
    pub fn time_once(self: &Arc<Self>, record: impl FnOnce(vk::CommandBuffer)) -> Result<u64, EngineError> {
        let timer = crate::timing::StageTimer::new(self, 2)?;
        self.run_once(|commands| {
            timer.record_reset(commands, 0..2);
            timer.record(commands, 0);
            record(commands);
            timer.record(commands, 1);
        })?;
        timer.span_ns(0)
    }

    /// Submits commands with what goes around them, and waits.
    pub fn run_around(self: &Arc<Self>, commands: &Commands, around: &Around<'_>) -> Result<(), EngineError> {
        let fence = crate::timing::Fence::new(self)?;
        self.submit(commands.raw(), around, fence.raw())?;
        fence.wait()
    }
}

/// What goes around a submission: commands before and after, and values of timelines that it waits for
/// and signals. Commands are not pending anywhere else.
#[derive(Clone, Copy, Default)]
pub struct Around<'a> {
    /// Run first.
    pub before: &'a [&'a Commands],
    /// Run last.
    pub after: &'a [&'a Commands],
    /// Reached before anything runs.
    pub waits: &'a [(&'a Timeline, u64)],
    /// Reached once all has run.
    pub signals: &'a [(&'a Timeline, u64)],
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: buffers, kernels and rigs hold an Arc, so they are gone; the allocator goes before
        // the device that its blocks belong to, and is not used again.
        unsafe {
            ManuallyDrop::drop(&mut self.allocator);
            self.raw.destroy_device(None);
        }
    }
}

fn choose(
    choice: DeviceChoice,
    devices: Vec<(vk::PhysicalDevice, DeviceInfo)>,
) -> Result<(vk::PhysicalDevice, DeviceInfo), EngineError> {
    let list = |devices: &[(vk::PhysicalDevice, DeviceInfo)]| {
        devices.iter().map(|(_, d)| format!("{} {}", d.index, d.name)).collect::<Vec<_>>().join(", ")
    };
    let wanted = match choice {
        DeviceChoice::Best => {
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
        }
        DeviceChoice::Index(index) => devices.iter().position(|(_, d)| d.index == index),
        DeviceChoice::Uuid(uuid) => devices.iter().position(|(_, d)| d.uuid == uuid),
    };
    let Some(position) = wanted else {
        return Err(EngineError::NoSuchDevice { wanted: choice.to_string(), present: list(&devices) });
    };
    let (physical, info) = devices.into_iter().nth(position).expect("position is inside");
    if info.suitable {
        Ok((physical, info))
    } else {
        Err(EngineError::MissingCapability { device: info.name.clone(), missing: info.missing() })
    }
}
