//! Kernels, the buffers they are bound to, and recording.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use crate::memory::Buffer;
use crate::pipeline::{Pipeline, Source};
use ash::vk;
use std::sync::Arc;

/// The engine's kernels, compiled by the build script: stage name and SPIR-V.
pub mod stages {
    macro_rules! stages {
        ($($konst:ident = $name:literal;)*) => {
            $(#[doc = concat!("SPIR-V of `", $name, "`.")]
            pub const $konst: (&str, &[u8]) =
                ($name, include_bytes!(concat!(env!("OUT_DIR"), "/", $name, ".spv")));)*
            /// Every kernel.
            pub const ALL: &[(&str, &[u8])] = &[$($konst,)*];
        };
    }
    stages! {
        INGEST = "ingest";
        ENHANCE = "enhance";
        CARRY = "carry";
        CROSS = "cross";
        SORT = "sort";
        MERGE = "merge";
        GATHER = "gather";
        EVENT_FRAME = "event_frame";
        VOXEL_GRID = "voxel_grid";
    }
}

/// A descriptor set of buffers, set 0, slots from 0 on.
pub struct BindingSet {
    device: Arc<Device>,
    layout: vk::DescriptorSetLayout,
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    kinds: Vec<vk::DescriptorType>,
}

impl BindingSet {
    /// Room for `slots` storage buffers.
    pub fn new(device: &Arc<Device>, slots: u32) -> Result<Arc<Self>, EngineError> {
        BindingSet::with_kinds(device, vec![vk::DescriptorType::STORAGE_BUFFER; slots as usize])
    }

    /// Room for a buffer of each kind.
    pub fn with_kinds(
        device: &Arc<Device>,
        kinds: Vec<vk::DescriptorType>,
    ) -> Result<Arc<Self>, EngineError> {
        let bindings: Vec<_> = (0..)
            .zip(&kinds)
            .map(|(slot, &kind)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(slot)
                    .descriptor_type(kind)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
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
            set: vk::DescriptorSet::null(),
            kinds,
        };
        let sizes: Vec<_> =
            this.kinds.iter().map(|&ty| vk::DescriptorPoolSize { ty, descriptor_count: 1 }).collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: as above.
        this.pool =
            unsafe { device.raw().create_descriptor_pool(&info, None) }.call("vkCreateDescriptorPool")?;
        let layouts = [layout];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(this.pool).set_layouts(&layouts);
        // SAFETY: the pool was made for exactly this set.
        this.set =
            unsafe { device.raw().allocate_descriptor_sets(&info) }.call("vkAllocateDescriptorSets")?[0];
        Ok(Arc::new(this))
    }

    /// Binds `buffers` to the slots from 0 on; to a slot of texels, a buffer's view of them. No recorded command buffer
    /// that uses the set may be submitted again before it is recorded anew.
    pub fn bind<'a>(&self, buffers: impl IntoIterator<Item = &'a Buffer>) {
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
            .map(|(slot, ((buffer, texels), &kind))| {
                let write = vk::WriteDescriptorSet::default()
                    .dst_set(self.set)
                    .dst_binding(slot as u32)
                    .descriptor_type(kind);
                match kind {
                    vk::DescriptorType::UNIFORM_TEXEL_BUFFER => write.texel_buffer_view(texels),
                    _ => write.buffer_info(buffer),
                }
            })
            .collect();
        // SAFETY: set and buffers are alive; the set is not in use by pending work (callers wait).
        unsafe { self.device.raw().update_descriptor_sets(&writes, &[]) };
    }
}

impl Drop for BindingSet {
    fn drop(&mut self) {
        // SAFETY: pipelines that use the set are gone or idle; null handles are ignored.
        unsafe {
            self.device.raw().destroy_descriptor_pool(self.pool, None);
            self.device.raw().destroy_descriptor_set_layout(self.layout, None);
        }
    }
}

/// What a driver tells about compiled code: names and values.
pub type KernelStatistics = Vec<(String, f64)>;

/// A compute pipeline with its bindings. Kernels of the same code, constants and slots share the device's one pipeline.
pub struct Kernel {
    bindings: Arc<BindingSet>,
    pub(crate) pipeline: Pipeline,
}

impl Kernel {
    /// A kernel with bindings of its own.
    pub fn new(
        device: &Arc<Device>,
        name: &str,
        spirv: &[u32],
        storage_bindings: u32,
        push_bytes: u32,
        specialisation: &[u32],
    ) -> Result<Self, EngineError> {
        let bindings = BindingSet::new(device, storage_bindings)?;
        Kernel::with_bindings(&bindings, name, spirv, push_bytes, specialisation)
    }

    /// A kernel on bindings that it shares; `specialisation[i]` is constant id `i`.
    pub fn with_bindings(
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
        let pipeline = bindings.device.pipelines().get(&bindings.device, &source)?;
        Ok(Kernel { bindings: Arc::clone(bindings), pipeline })
    }

    /// Binds buffers to the kernel's slots; see [`BindingSet::bind`].
    pub fn bind(&self, buffers: &[&Buffer]) {
        self.bindings.bind(buffers.iter().copied());
    }

    /// What the driver tells about the compiled code (registers, shared memory, sizes); nothing where it
    /// does not tell.
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

    /// Records a dispatch.
    pub fn record(&self, commands: vk::CommandBuffer, push: &[u8], groups: [u32; 3]) {
        let device = self.bindings.device.raw();
        // SAFETY: `commands` is being recorded on this device; pipeline, layout and set are alive as
        // long as the kernel; `push` has the size the layout was made for (checked by validation).
        unsafe {
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, self.pipeline.raw);
            device.cmd_bind_descriptor_sets(
                commands,
                vk::PipelineBindPoint::COMPUTE,
                self.pipeline.layout,
                0,
                &[self.bindings.set],
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

/// How kernels get at buffers.
const READ_OR_WRITTEN: vk::AccessFlags2 = vk::AccessFlags2::from_raw(
    vk::AccessFlags2::SHADER_STORAGE_READ.as_raw()
        | vk::AccessFlags2::SHADER_SAMPLED_READ.as_raw()
        | vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw(),
);

/// What kernels wrote before is visible to kernels after.
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

/// What was filled or written before is visible to kernels after.
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

/// The last barrier of a tick: what the device wrote is visible to the host.
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
