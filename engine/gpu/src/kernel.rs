//! Kernels, the buffers that they are bound to, and recording.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use crate::faults::FaultPoint;
use crate::memory::Buffer;
use crate::pipeline::{Pipeline, Source};
use ash::vk;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The engine's kernels, compiled by the build script: name and SPIR-V.
pub mod stages {
    include!(concat!(env!("OUT_DIR"), "/kernels.rs"));
}

/// Descriptor sets of one layout, each bound as set 0 with slots from 0 on. One of them is selected: kernels are bound
/// to it and recorded with it.
pub(crate) struct BindingSet {
    device: Arc<Device>,
    layout: vk::DescriptorSetLayout,
    pool: vk::DescriptorPool,
    sets: Vec<vk::DescriptorSet>,
    selected: AtomicUsize,
    kinds: Vec<SlotKind>,
}

/// Kind of the descriptor of a slot; `None` for a slot that is left out, which no kernel of the set may have.
pub(crate) type SlotKind = Option<vk::DescriptorType>;

impl BindingSet {
    /// One set of `slots` storage buffers.
    fn new(device: &Arc<Device>, slots: u32) -> Result<Arc<Self>, EngineError> {
        BindingSet::with_sets(device, vec![Some(vk::DescriptorType::STORAGE_BUFFER); slots as usize], 1)
    }

    /// `count` sets with a buffer of each kind, slot by slot.
    pub(crate) fn with_sets(
        device: &Arc<Device>,
        kinds: Vec<SlotKind>,
        count: u32,
    ) -> Result<Arc<Self>, EngineError> {
        device.fault(FaultPoint::Descriptors).call("vkAllocateDescriptorSets")?;
        let bindings: Vec<_> = (0..)
            .zip(&kinds)
            .filter_map(|(slot, kind)| {
                let binding = vk::DescriptorSetLayoutBinding::default()
                    .binding(slot)
                    .descriptor_type((*kind)?)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE);
                Some(binding)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is alive; `bindings` outlives the call.
        let layout = unsafe { device.raw().create_descriptor_set_layout(&info, None) }
            .call("vkCreateDescriptorSetLayout")?;
        let mut this = BindingSet {
            device: Arc::clone(device),
            layout,
            pool: vk::DescriptorPool::null(),
            sets: Vec::new(),
            selected: AtomicUsize::new(0),
            kinds,
        };
        let sizes: Vec<_> = this
            .kinds
            .iter()
            .flatten()
            .map(|&ty| vk::DescriptorPoolSize { ty, descriptor_count: count })
            .collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(count).pool_sizes(&sizes);
        // SAFETY: as above.
        this.pool =
            unsafe { device.raw().create_descriptor_pool(&info, None) }.call("vkCreateDescriptorPool")?;
        let layouts = vec![layout; count as usize];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(this.pool).set_layouts(&layouts);
        // SAFETY: the pool was made for exactly these sets.
        this.sets =
            unsafe { device.raw().allocate_descriptor_sets(&info) }.call("vkAllocateDescriptorSets")?;
        Ok(Arc::new(this))
    }

    /// Selects the set that kernels are bound to and recorded with from then on.
    pub(crate) fn select(&self, set: usize) {
        assert!(set < self.sets.len(), "set {set} of {}", self.sets.len());
        self.selected.store(set, Ordering::Relaxed);
    }

    fn set(&self) -> vk::DescriptorSet {
        self.sets[self.selected.load(Ordering::Relaxed)]
    }

    /// Binds `buffers` to the slots from 0 on; a slot of texels gets the buffer's texel view, and one that is left out
    /// nothing.
    ///
    /// # Safety
    /// As of [`Kernel::bind`].
    pub(crate) unsafe fn bind<'a>(&self, buffers: impl IntoIterator<Item = &'a Buffer>) {
        let infos: Vec<_> = buffers
            .into_iter()
            .map(|b| {
                let whole = vk::DescriptorBufferInfo { buffer: b.raw(), offset: 0, range: vk::WHOLE_SIZE };
                ([whole], [b.texels()])
            })
            .collect();
        let writes: Vec<_> = infos
            .iter()
            .zip(&self.kinds)
            .enumerate()
            .filter_map(|(slot, ((buffer, texels), kind))| {
                let kind = (*kind)?;
                let write = vk::WriteDescriptorSet::default()
                    .dst_set(self.set())
                    .dst_binding(slot as u32)
                    .descriptor_type(kind);
                Some(match kind {
                    vk::DescriptorType::UNIFORM_TEXEL_BUFFER => write.texel_buffer_view(texels),
                    _ => write.buffer_info(buffer),
                })
            })
            .collect();
        // SAFETY: set and buffers are alive; nothing pending uses the set, as the caller guarantees.
        unsafe { self.device.raw().update_descriptor_sets(&writes, &[]) };
    }
}

impl Drop for BindingSet {
    fn drop(&mut self) {
        let (pool, layout) = (self.pool, self.layout);
        // SAFETY: nothing pending uses the sets: their owner has waited, or `retire` does. A null handle is ignored.
        self.device.retire(move |device| unsafe {
            device.raw().destroy_descriptor_pool(pool, None);
            device.raw().destroy_descriptor_set_layout(layout, None);
        });
    }
}

/// A driver's statistics of compiled code: names and values.
pub type KernelStatistics = Vec<(String, f64)>;

/// A compute pipeline with its bindings. Kernels of the same code, constants and slots share the device's one pipeline.
pub struct Kernel {
    bindings: Arc<BindingSet>,
    pub(crate) pipeline: Pipeline,
    push_bytes: u32,
}

impl Kernel {
    /// A kernel with `storage_bindings` storage buffers of its own; `specialisation[i]` is constant id `i`.
    ///
    /// # Safety
    /// `spirv` is valid for a compute pipeline: spirv-val accepts it, its entry point is `main`, and its bindings, push
    /// constants and specialisation constants are those given here.
    pub unsafe fn new(
        device: &Arc<Device>,
        name: &str,
        spirv: &[u32],
        storage_bindings: u32,
        push_bytes: u32,
        specialisation: &[u32],
    ) -> Result<Self, EngineError> {
        let bindings = BindingSet::new(device, storage_bindings)?;
        // SAFETY: the caller's contract is the same.
        unsafe { Kernel::with_bindings(&bindings, name, spirv, push_bytes, specialisation) }
    }

    /// A kernel on bindings that it shares; `specialisation[i]` is constant id `i`.
    ///
    /// # Safety
    /// As of [`Kernel::new`].
    pub(crate) unsafe fn with_bindings(
        bindings: &Arc<BindingSet>,
        stage: &str,
        spirv: &[u32],
        push_bytes: u32,
        specialisation: &[u32],
    ) -> Result<Self, EngineError> {
        let source = Source {
            stage,
            spirv,
            slots: &bindings.kinds,
            set_layout: bindings.layout,
            push_bytes,
            specialisation,
        };
        // SAFETY: the caller's contract is the same; the layout is that of the slots.
        let pipeline = unsafe { bindings.device.pipelines().get(&bindings.device, &source) }?;
        Ok(Kernel { bindings: Arc::clone(bindings), pipeline, push_bytes })
    }

    /// Binds buffers to the kernel's slots.
    ///
    /// # Safety
    /// No submission that uses the slots is pending, and no command buffer recorded with them is submitted before it is
    /// recorded anew. The buffers live until the last submission that uses the slots has finished.
    pub unsafe fn bind(&self, buffers: &[&Buffer]) {
        // SAFETY: the caller's contract is the same.
        unsafe { self.bindings.bind(buffers.iter().copied()) };
    }

    /// The driver's statistics of the compiled code (registers, shared memory, sizes); empty if the driver has none.
    pub fn statistics(&self) -> Result<KernelStatistics, EngineError> {
        let Some(pipelines) = self.bindings.device.statistics() else {
            return Ok(Vec::new());
        };
        let info = vk::PipelineExecutableInfoKHR::default().pipeline(self.pipeline.raw).executable_index(0);
        // SAFETY: the pipeline is alive, was made with CAPTURE_STATISTICS, and compute has one executable.
        let told = unsafe { pipelines.get_pipeline_executable_statistics(&info) }
            .call("vkGetPipelineExecutableStatisticsKHR")?;
        Ok(told
            .iter()
            .map(|s| {
                let name = s.name_as_c_str().unwrap_or_default().to_string_lossy().into_owned();
                // SAFETY: `format` tells which member the driver has written.
                let value = unsafe {
                    match s.format {
                        vk::PipelineExecutableStatisticFormatKHR::BOOL32 => f64::from(s.value.b32),
                        vk::PipelineExecutableStatisticFormatKHR::INT64 => s.value.i64 as f64,
                        vk::PipelineExecutableStatisticFormatKHR::UINT64 => s.value.u64 as f64,
                        _ => s.value.f64,
                    }
                };
                (name, value)
            })
            .collect())
    }

    /// Records a dispatch of `groups` workgroups. Panics if `push` does not have the size that the kernel was made for.
    ///
    /// # Safety
    /// `commands` is being recorded on the kernel's device. Kernel and bound buffers live, and stay bound, until the
    /// last submission of the commands has finished. Meanwhile nothing else uses the buffers, unless barriers or waits
    /// order it. The kernel's code stays within the buffers, whatever they hold.
    pub unsafe fn record(&self, commands: vk::CommandBuffer, push: &[u8], groups: [u32; 3]) {
        assert_eq!(push.len(), self.push_bytes as usize, "bytes of push constants");
        let device = self.bindings.device.raw();
        // SAFETY: `commands` is being recorded on this device, as the caller guarantees; pipeline, layout and set
        // are alive as long as the kernel; `push` has the size that the layout was made for.
        unsafe {
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, self.pipeline.raw);
            device.cmd_bind_descriptor_sets(
                commands,
                vk::PipelineBindPoint::COMPUTE,
                self.pipeline.layout,
                0,
                &[self.bindings.set()],
                &[],
            );
            if !push.is_empty() {
                device.cmd_push_constants(
                    commands,
                    self.pipeline.layout,
                    vk::ShaderStageFlags::COMPUTE,
                    0,
                    push,
                );
            }
            device.cmd_dispatch(commands, groups[0], groups[1], groups[2]);
        }
    }
}

/// Every way in which kernels access buffers.
const READ_OR_WRITTEN: vk::AccessFlags2 = vk::AccessFlags2::from_raw(
    vk::AccessFlags2::SHADER_STORAGE_READ.as_raw()
        | vk::AccessFlags2::SHADER_SAMPLED_READ.as_raw()
        | vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw(),
);

/// Makes what kernels before the barrier write visible to kernels after it.
pub(crate) fn record_barrier(device: &Device, commands: vk::CommandBuffer) {
    let barriers = [vk::MemoryBarrier2::default()
        .src_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
        .src_access_mask(vk::AccessFlags2::SHADER_STORAGE_WRITE)
        .dst_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
        .dst_access_mask(READ_OR_WRITTEN)];
    let info = vk::DependencyInfo::default().memory_barriers(&barriers);
    // SAFETY: `commands` is being recorded on this device.
    unsafe { device.raw().cmd_pipeline_barrier2(commands, &info) };
}

/// Makes what transfers and kernels before the barrier write visible to kernels after it.
pub(crate) fn record_barrier_from_transfer(device: &Device, commands: vk::CommandBuffer) {
    let written = vk::AccessFlags2::TRANSFER_WRITE | vk::AccessFlags2::SHADER_STORAGE_WRITE;
    let barriers = [vk::MemoryBarrier2::default()
        .src_stage_mask(vk::PipelineStageFlags2::ALL_TRANSFER | vk::PipelineStageFlags2::COMPUTE_SHADER)
        .src_access_mask(written)
        .dst_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER)
        .dst_access_mask(READ_OR_WRITTEN)];
    let info = vk::DependencyInfo::default().memory_barriers(&barriers);
    // SAFETY: `commands` is being recorded on this device.
    unsafe { device.raw().cmd_pipeline_barrier2(commands, &info) };
}

/// The last barrier of a tick: makes what the device writes visible to the host.
pub(crate) fn record_host_barrier(device: &Device, commands: vk::CommandBuffer) {
    let barriers = [vk::MemoryBarrier2::default()
        .src_stage_mask(vk::PipelineStageFlags2::COMPUTE_SHADER | vk::PipelineStageFlags2::TRANSFER)
        .src_access_mask(vk::AccessFlags2::SHADER_STORAGE_WRITE | vk::AccessFlags2::TRANSFER_WRITE)
        .dst_stage_mask(vk::PipelineStageFlags2::HOST)
        .dst_access_mask(vk::AccessFlags2::HOST_READ)];
    let info = vk::DependencyInfo::default().memory_barriers(&barriers);
    // SAFETY: `commands` is being recorded on this device.
    unsafe { device.raw().cmd_pipeline_barrier2(commands, &info) };
}
