//! An open device: its queue, its allocator, and submission.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::commands::{OneShot, SubmitHooks};
use crate::devices::{
    CALIBRATED, DeviceChoice, DeviceInfo, FLOAT64, STATISTICS, choose, compute_family, devices,
};
use crate::error::{Call, EngineError};
use crate::faults::{FaultPoint, Faults};
use crate::instance::{Instance, Validation};
use crate::memory::Buffer;
use crate::pipeline::Pipelines;
use crate::retire::Retired;
use crate::timeline::Timeline;
use ash::{ext, khr, vk};
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use std::ffi::{CStr, c_char};
use std::mem::ManuallyDrop;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Extensions for memory and semaphores shared with other processes, each enabled if it is present.
const SHARING: [&CStr; 3] =
    [khr::external_memory_fd::NAME, khr::external_semaphore_fd::NAME, ext::external_memory_host::NAME];

/// An open device with one compute queue.
pub struct Device {
    raw: ash::Device,
    physical: vk::PhysicalDevice,
    allocator: ManuallyDrop<Mutex<Allocator>>,
    retired: Retired,
    faults: Faults,
    queue: Mutex<vk::Queue>,
    /// Number of buffer addresses that were asked for.
    addresses: AtomicU64,
    one_shots: Mutex<Vec<OneShot>>,
    pipelines: Pipelines,
    queue_family: u32,
    timestamp_period_ns: f64,
    timestamp_mask: u64,
    most_texels: u64,
    statistics: Option<khr::pipeline_executable_properties::Device>,
    calibrated: Option<ext::calibrated_timestamps::Device>,
    most_groups: u32,
    most_storage_bytes: u64,
    info: DeviceInfo,
    instance: ManuallyDrop<Instance>,
}

/// Capabilities that a test takes from a device, to see how the engine runs on a lesser one.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Restrictions {
    /// Whether its queue has no clock.
    pub no_timestamps: bool,
    /// Most workgroups of a dispatch along x; 0 for the device's own limit.
    pub most_groups: u32,
    /// Most bytes of a storage buffer that kernels see; 0 for the device's own limit.
    pub most_storage_bytes: u64,
}

/// How long a device that is being closed waits for abandoned submissions. After that it stays open, with everything
/// that they may use.
const CLOSING: Duration = Duration::from_secs(10);

impl Device {
    /// Opens a device. An error if there is no driver, or if the chosen device does not exist or lacks a required
    /// capability.
    pub fn open(choice: DeviceChoice, validation: Validation) -> Result<Arc<Self>, EngineError> {
        Device::open_restricted(choice, validation, Restrictions::default())
    }

    /// As [`Device::open`], with capabilities taken away: for tests.
    #[doc(hidden)]
    pub fn open_restricted(
        choice: DeviceChoice,
        validation: Validation,
        restrictions: Restrictions,
    ) -> Result<Arc<Self>, EngineError> {
        let instance = Instance::new(validation)?;
        let devices = devices(&instance)?;
        if devices.is_empty() {
            return Err(EngineError::NoDriver);
        }
        let (physical, info) = choose(choice, devices)?;
        // SAFETY: `physical` comes from this instance.
        let families = unsafe { instance.raw().get_physical_device_queue_family_properties(physical) };
        let (queue_family, family) =
            compute_family(&families).expect("a suitable device has a compute queue");
        let timestamp_bits = if restrictions.no_timestamps { 0 } else { family.timestamp_valid_bits };

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
        let base = vk::PhysicalDeviceFeatures::default()
            .shader_int64(true)
            .shader_int16(true)
            .shader_float64(info.has(FLOAT64));
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
        let raw = unsafe { instance.raw().create_device(physical, &create, None) }.call("vkCreateDevice")?;
        let statistics =
            tells_statistics.then(|| khr::pipeline_executable_properties::Device::new(instance.raw(), &raw));
        let calibrated = crate::calibration::functions(instance.raw(), &raw, info.has(CALIBRATED));
        // SAFETY: one queue of this family was created.
        let queue = unsafe { raw.get_device_queue(queue_family, 0) };
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw().clone(),
            device: raw.clone(),
            physical_device: physical,
            debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
            buffer_device_address: true,
            allocation_sizes: gpu_allocator::AllocationSizes::new(4 << 20, 4 << 20),
        })
        .map_err(|e| {
            // SAFETY: the device has no objects yet.
            unsafe { raw.destroy_device(None) };
            EngineError::OutOfMemory { name: "allocator".to_owned(), bytes: 0, reason: e.to_string() }
        })?;
        // SAFETY: `physical` comes from this instance.
        let properties = unsafe { instance.raw().get_physical_device_properties(physical) };
        Ok(Arc::new(Device {
            physical,
            allocator: ManuallyDrop::new(Mutex::new(allocator)),
            retired: Retired::default(),
            faults: Faults::default(),
            raw,
            queue: Mutex::new(queue),
            addresses: AtomicU64::new(0),
            one_shots: Mutex::default(),
            pipelines: Pipelines::default(),
            queue_family,
            timestamp_period_ns: f64::from(properties.limits.timestamp_period),
            timestamp_mask: if timestamp_bits >= 64 { u64::MAX } else { (1 << timestamp_bits) - 1 },
            most_groups: match restrictions.most_groups {
                0 => properties.limits.max_compute_work_group_count[0],
                most => most,
            },
            most_storage_bytes: match restrictions.most_storage_bytes {
                // Mesa's software driver names a small limit, and keeps none.
                0 if info.is_software() => u64::from(u32::MAX),
                0 => u64::from(properties.limits.max_storage_buffer_range),
                most => most,
            },
            most_texels: u64::from(properties.limits.max_texel_buffer_elements),
            statistics,
            calibrated,
            info,
            instance: ManuallyDrop::new(instance),
        }))
    }

    /// Whether the validation layer is on, and what it looks at.
    pub(crate) fn validation(&self) -> Validation {
        self.instance.validation()
    }

    /// Functions that read a pipeline's registers and sizes, if the driver has them.
    pub(crate) fn statistics(&self) -> Option<&khr::pipeline_executable_properties::Device> {
        self.statistics.as_ref()
    }

    /// Functions that read both clocks, if the device has them.
    pub(crate) fn calibrated(&self) -> Option<&ext::calibrated_timestamps::Device> {
        self.calibrated.as_ref()
    }

    /// Device address of a buffer.
    ///
    /// # Safety
    /// The buffer is this device's, bound, and made with the device-address usage.
    pub(crate) unsafe fn buffer_address(&self, buffer: vk::Buffer) -> u64 {
        let info = vk::BufferDeviceAddressInfo::default().buffer(buffer);
        // SAFETY: as the caller guarantees.
        let address = unsafe { self.raw.get_buffer_device_address(&info) };
        self.addresses.fetch_add(1, Ordering::Release);
        address
    }

    /// How many addresses of buffers have been asked for so far.
    pub(crate) fn addresses(&self) -> u64 {
        self.addresses.load(Ordering::Acquire)
    }

    /// Name, driver and capabilities.
    #[must_use]
    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    /// Vulkan device, for code that records commands of its own.
    #[must_use]
    pub fn raw(&self) -> &ash::Device {
        &self.raw
    }

    /// Vulkan physical device.
    #[must_use]
    pub fn physical(&self) -> vk::PhysicalDevice {
        self.physical
    }

    /// Vulkan instance, for queries of the physical device and for extensions.
    #[must_use]
    pub fn instance(&self) -> &ash::Instance {
        self.instance.raw()
    }

    /// Family of the queue.
    #[must_use]
    pub fn queue_family(&self) -> u32 {
        self.queue_family
    }

    /// Whether the device is a software driver, which runs on the processor.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.info.is_software()
    }

    /// Most texels that a view of a buffer shows.
    pub(crate) fn most_texels(&self) -> u64 {
        self.most_texels
    }

    /// Most workgroups of a dispatch along x.
    pub(crate) fn most_groups(&self) -> u32 {
        self.most_groups
    }

    /// Most bytes of a storage buffer that kernels see.
    pub(crate) fn most_storage_bytes(&self) -> u64 {
        self.most_storage_bytes
    }

    /// Whether the queue has a clock. Without one, GPU times are absent.
    #[must_use]
    pub fn has_timestamps(&self) -> bool {
        self.timestamp_mask != 0
    }

    pub(crate) fn retired(&self) -> &Retired {
        &self.retired
    }

    pub(crate) fn faults(&self) -> &Faults {
        &self.faults
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

    /// The validation layer's messages so far; empty if it is off.
    #[must_use]
    pub fn validation_messages(&self) -> Vec<String> {
        self.instance.messages()
    }

    pub(crate) fn allocator(&self) -> MutexGuard<'_, Allocator> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Idle command buffers and fences for one-shot submissions.
    pub(crate) fn one_shots(&self) -> MutexGuard<'_, Vec<OneShot>> {
        self.one_shots.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Pipelines compiled on the device.
    pub(crate) fn pipelines(&self) -> &Pipelines {
        &self.pipelines
    }

    /// Allocates a named buffer of at least `bytes` bytes; storage and transfer usage are always included.
    /// [`EngineError::OutOfMemory`] if there is no memory.
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

    /// An error if what is to be used here is of another device.
    pub(crate) fn check_own(&self, of: &Device, what: impl FnOnce() -> String) -> Result<(), EngineError> {
        if std::ptr::eq(self, of) {
            return Ok(());
        }
        let [expected, actual] = [self, of].map(|device| device.info.name.clone());
        Err(EngineError::OtherDevice { what: what(), expected, actual })
    }

    pub(crate) fn submit(
        &self,
        commands: vk::CommandBuffer,
        hooks: &SubmitHooks<'_>,
        fence: vk::Fence,
    ) -> Result<(), EngineError> {
        hooks.check(self)?;
        self.fault(FaultPoint::Submit).call("vkQueueSubmit")?;
        let commands: Vec<_> = hooks
            .before
            .iter()
            .map(|c| c.raw())
            .chain([commands])
            .chain(hooks.after.iter().map(|c| c.raw()))
            .collect();
        let split = |at: &[(&Timeline, u64)]| -> (Vec<vk::Semaphore>, Vec<u64>) {
            at.iter().map(|(timeline, value)| (timeline.raw(), *value)).unzip()
        };
        let ((waits, wait_values), (signals, signal_values)) = (split(hooks.waits), split(hooks.signals));
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
        // SAFETY: the queue is held exclusively; the command buffers are recorded and not pending (the contract of
        // `Commands::record`), the fence is unsignalled and not pending (`wait_for` leaves it so, or abandons it).
        // What the submission uses lives until it has finished: the caller waits, and until it has, `retire` does.
        unsafe { self.raw.queue_submit(*queue, &[submit], fence) }.call("vkQueueSubmit")
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        if !self.settle(CLOSING) {
            eprintln!("esaac: {} still runs what was abandoned; it stays open", self.info.name);
            return;
        }
        for one_shot in self.one_shots().drain(..).collect::<Vec<_>>() {
            one_shot.destroy(&self.raw);
        }
        self.pipelines.destroy(&self.raw);
        // SAFETY: buffers, kernels and rigs hold an Arc, so they are gone, and what they left to `retire` was
        // destroyed above. The allocator goes before the device that its blocks belong to, the device before its
        // instance, and none is used again.
        unsafe {
            ManuallyDrop::drop(&mut self.allocator);
            self.raw.destroy_device(None);
            ManuallyDrop::drop(&mut self.instance);
        }
    }
}
