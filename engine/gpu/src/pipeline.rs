//! Compute pipelines. Each is compiled once per device, shared by all its rigs, and lives as long as the device.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::device::Device;
use crate::error::{Call, EngineError};
use crate::kernel::SlotKind;
use ash::vk;
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A pipeline and its layout, alive as long as the device.
#[derive(Clone, Copy)]
pub(crate) struct Pipeline {
    pub raw: vk::Pipeline,
    pub layout: vk::PipelineLayout,
}

/// Everything that a pipeline is compiled from.
pub(crate) struct Source<'a> {
    pub stage: &'a str,
    pub spirv: &'a [u32],
    /// Kinds of the descriptors of set 0, slot by slot.
    pub slots: &'a [SlotKind],
    /// A layout of those slots. Any of several equal layouts will do, so it is not part of the key.
    pub set_layout: vk::DescriptorSetLayout,
    pub push_bytes: u32,
    /// Constant id `i` is `specialisation[i]`.
    pub specialisation: &'a [u32],
}

/// Identifies a pipeline: equal keys share one.
#[derive(PartialEq, Eq, Hash)]
struct Key {
    stage: String,
    spirv_hash: u64,
    slots: Vec<SlotKind>,
    push_bytes: u32,
    specialisation: Vec<u32>,
}

impl Key {
    fn of(source: &Source<'_>) -> Self {
        let mut hasher = DefaultHasher::new();
        source.spirv.hash(&mut hasher);
        Key {
            stage: source.stage.to_owned(),
            spirv_hash: hasher.finish(),
            slots: source.slots.to_vec(),
            push_bytes: source.push_bytes,
            specialisation: source.specialisation.to_vec(),
        }
    }
}

/// Every pipeline of a device.
#[derive(Default)]
pub(crate) struct Pipelines(Mutex<HashMap<Key, Pipeline>>);

impl Pipelines {
    /// The pipeline of `source`, compiled at its first use.
    ///
    /// # Safety
    /// The code of `source` is valid for a compute pipeline of its layout, push constants and specialisation constants.
    pub(crate) unsafe fn get(&self, device: &Device, source: &Source<'_>) -> Result<Pipeline, EngineError> {
        let key = Key::of(source);
        if let Some(&pipeline) = self.all().get(&key) {
            return Ok(pipeline);
        }
        // Compiled without the lock, so that two threads can compile different pipelines at once.
        // SAFETY: the caller's contract is the same.
        let compiled = unsafe { compile(device, source) }?;
        let kept = *self.all().entry(key).or_insert(compiled);
        if kept.raw != compiled.raw {
            compiled.destroy(device.raw());
        }
        Ok(kept)
    }

    /// Destroys all pipelines. The caller makes sure that no commands that use them run.
    pub(crate) fn destroy(&self, device: &ash::Device) {
        self.all().drain().for_each(|(_, pipeline)| pipeline.destroy(device));
    }

    fn all(&self) -> MutexGuard<'_, HashMap<Key, Pipeline>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Pipeline {
    fn destroy(self, device: &ash::Device) {
        // SAFETY: nothing pending uses the handles, as the caller guarantees; a null handle is ignored.
        unsafe {
            device.destroy_pipeline(self.raw, None);
            device.destroy_pipeline_layout(self.layout, None);
        }
    }
}

/// # Safety
/// As of [`Pipelines::get`].
unsafe fn compile(device: &Device, source: &Source<'_>) -> Result<Pipeline, EngineError> {
    let raw = device.raw();
    let layouts = [source.set_layout];
    let ranges = [vk::PushConstantRange {
        stage_flags: vk::ShaderStageFlags::COMPUTE,
        offset: 0,
        size: source.push_bytes,
    }];
    let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&layouts);
    let info = if source.push_bytes == 0 { info } else { info.push_constant_ranges(&ranges) };
    // SAFETY: the set layout is alive.
    let layout = unsafe { raw.create_pipeline_layout(&info, None) }.call("vkCreatePipelineLayout")?;
    // SAFETY: the caller's contract is the same; the layout was made for it.
    let compiled = unsafe { compile_for(device, source, layout) };
    compiled.map(|raw| Pipeline { raw, layout }).inspect_err(|_| {
        Pipeline { raw: vk::Pipeline::null(), layout }.destroy(raw);
    })
}

/// # Safety
/// As of [`Pipelines::get`]; `layout` is alive and of `source`.
unsafe fn compile_for(
    device: &Device,
    source: &Source<'_>,
    layout: vk::PipelineLayout,
) -> Result<vk::Pipeline, EngineError> {
    let raw = device.raw();
    let info = vk::ShaderModuleCreateInfo::default().code(source.spirv);
    // SAFETY: the code is valid, as the caller guarantees.
    let module = unsafe { raw.create_shader_module(&info, None) }.call("vkCreateShaderModule")?;
    let entries: Vec<_> = (0..source.specialisation.len() as u32)
        .map(|id| vk::SpecializationMapEntry { constant_id: id, offset: 4 * id, size: 4 })
        .collect();
    let constants = vk::SpecializationInfo::default()
        .map_entries(&entries)
        .data(bytemuck::cast_slice(source.specialisation));
    let stage = vk::PipelineShaderStageCreateInfo::default()
        .stage(vk::ShaderStageFlags::COMPUTE)
        .module(module)
        .name(c"main")
        .specialization_info(&constants);
    let flags = if device.statistics().is_some() {
        vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR
    } else {
        vk::PipelineCreateFlags::empty()
    };
    let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout).flags(flags)];
    // SAFETY: layout and module are alive and suit each other, as the caller guarantees; the specialisation data outlives
    // the call.
    let created = unsafe { raw.create_compute_pipelines(vk::PipelineCache::null(), &info, None) };
    // SAFETY: a module is not needed once its pipeline exists.
    unsafe { raw.destroy_shader_module(module, None) };
    Ok(created.map_err(|(_, result)| result).call("vkCreateComputePipelines")?[0])
}
