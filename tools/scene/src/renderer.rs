//! Renders scenes on the GPU: one dispatch per frame writes colour, motion, depth and instance ids to the engine's input
//! buffers.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::layout::{MAX_LAYERS, MAX_OBJECTS, ViewData, WRITES_DEPTH, WRITES_IDS, WRITES_MOTION};
use crate::scene::{Scene, seconds};
use bytemuck::Zeroable;
use esaac_engine::ash::vk;
use esaac_engine::{Buffer, Commands, Device, EngineError, Kernel, MemoryLocation, SubmitHooks};
use esaac_model::{DepthFormat, HdrFormat, MotionFormat};
use std::sync::Arc;
use thiserror::Error;

/// SPIR-V of `glsl/render.comp`.
pub const RENDER_SPIRV: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/render.spv"));

/// Side of the shader's square workgroup, pixels.
pub const WORKGROUP_PX: u32 = 8;

/// Storage buffers that the shader binds: the view, colour, motion, depth, instance ids.
pub const BINDINGS: u32 = 5;

/// Why a frame was not rendered.
#[derive(Debug, Error)]
pub enum RenderError {
    /// The device reported an error.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A format that the renderer does not write.
    #[error("the scene renderer writes f16x4 or f32x4 colour, not {actual:?}")]
    Format {
        /// What was asked for.
        actual: HdrFormat,
    },
    /// A scene with more objects or layers than the shader's buffer holds.
    #[error("the scene has {actual} {what}, the renderer takes at most {expected}")]
    TooLarge {
        /// Which: objects or layers.
        what: &'static str,
        /// Largest number.
        expected: usize,
        /// Number in the scene.
        actual: usize,
    },
    /// A buffer that a frame does not fit into.
    #[error("the {image} buffer has {actual} bytes, a frame needs {expected}")]
    Size {
        /// Which image.
        image: &'static str,
        /// Bytes of a frame.
        expected: u64,
        /// Bytes of the buffer.
        actual: u64,
    },
}

/// Buffers that a frame is written to. Rows are tightly packed, as in the engine's input buffers.
#[derive(Clone, Copy)]
pub struct Targets<'a> {
    /// Colour.
    pub hdr: &'a Buffer,
    /// Motion, if wanted.
    pub motion: Option<&'a Buffer>,
    /// Depth, if wanted.
    pub depth: Option<&'a Buffer>,
    /// Instance ids, one u32 a pixel, if wanted.
    pub ids: Option<&'a Buffer>,
}

/// Renders one scene in one pair of formats.
pub struct Renderer {
    device: Arc<Device>,
    scene: Scene,
    hdr: HdrFormat,
    motion: MotionFormat,
    kernel: Kernel,
    commands: Commands,
    data: Box<ViewData>,
    view: Buffer,
}

impl Renderer {
    /// A renderer of `scene` at its size.
    pub fn new(
        device: &Arc<Device>,
        scene: Scene,
        hdr: HdrFormat,
        motion: MotionFormat,
    ) -> Result<Renderer, RenderError> {
        if hdr == HdrFormat::Srgb8x4 {
            return Err(RenderError::Format { actual: hdr });
        }
        check(&scene)?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(RENDER_SPIRV);
        // SAFETY: the build script has compiled it; it has these bindings and no push constants.
        let kernel = unsafe { Kernel::new(device, "render", &words, BINDINGS, 0, &[]) }?;
        let view = device.allocate(
            "scene view",
            size_of::<ViewData>() as u64,
            vk::BufferUsageFlags::STORAGE_BUFFER,
            MemoryLocation::CpuToGpu,
        )?;
        let data = bytemuck::zeroed_box();
        let commands = Commands::new(device)?;
        Ok(Renderer { device: Arc::clone(device), scene, hdr, motion, kernel, commands, data, view })
    }

    /// Changes the scene, which may have another size. The pipeline stays the same.
    pub fn set_scene(&mut self, scene: Scene) -> Result<(), RenderError> {
        check(&scene)?;
        self.scene = scene;
        Ok(())
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Renders the frame at `t_ns` and waits for the device. Motion is towards `previous_t_ns`, or zero without it.
    /// Later submissions to the device's queue and the host see the written frame.
    pub fn render(
        &mut self,
        t_ns: i64,
        previous_t_ns: Option<i64>,
        targets: Targets<'_>,
    ) -> Result<(), RenderError> {
        self.render_with_hooks(t_ns, previous_t_ns, targets, &SubmitHooks::default())
    }

    /// As [`Renderer::render`], with commands and timelines around the submission, for targets that another process
    /// reads.
    pub fn render_with_hooks(
        &mut self,
        t_ns: i64,
        previous_t_ns: Option<i64>,
        targets: Targets<'_>,
        hooks: &SubmitHooks<'_>,
    ) -> Result<(), RenderError> {
        let pixels = u64::from(self.scene.width_px) * u64::from(self.scene.height_px);
        holds("colour", targets.hdr, pixels * self.hdr.texel_bytes() as u64)?;
        let mut writes = 0;
        if let Some(motion) = targets.motion {
            holds("motion", motion, pixels * self.motion.texel_bytes() as u64)?;
            writes |= WRITES_MOTION;
        }
        if let Some(depth) = targets.depth {
            holds("depth", depth, pixels * DepthFormat::F32.texel_bytes() as u64)?;
            writes |= WRITES_DEPTH;
        }
        if let Some(ids) = targets.ids {
            holds("instance id", ids, pixels * size_of::<u32>() as u64)?;
            writes |= WRITES_IDS;
        }
        let view = self.scene.view(seconds(t_ns));
        let previous = previous_t_ns.map(|t_ns| self.scene.view(seconds(t_ns)));
        *self.data = ViewData::zeroed();
        self.data.fill(&view, previous.as_ref(), [self.hdr as u32, self.motion as u32, writes]);
        self.view.write(0, &[*self.data]);
        // A binding needs a buffer even if the shader does not write to it.
        let motion = targets.motion.unwrap_or(targets.hdr);
        let depth = targets.depth.unwrap_or(targets.hdr);
        let ids = targets.ids.unwrap_or(targets.hdr);
        self.commands.check()?;
        // SAFETY: the last submission was waited for, as was just checked, and the commands are recorded again below.
        unsafe { self.kernel.bind(&[&self.view, targets.hdr, motion, depth, ids]) };
        let groups =
            [self.scene.width_px.div_ceil(WORKGROUP_PX), self.scene.height_px.div_ceil(WORKGROUP_PX), 1];
        let (device, kernel) = (&self.device, &self.kernel);
        let record = |commands| {
            record_barrier(device, commands, READS_AND_WRITES, vk::AccessFlags2::SHADER_STORAGE_WRITE);
            // SAFETY: as for the commands, below; each buffer holds its image, as was checked above.
            unsafe { kernel.record(commands, &[], groups) };
            record_barrier(
                device,
                commands,
                vk::AccessFlags2::SHADER_STORAGE_WRITE,
                READS_AND_WRITES | vk::AccessFlags2::HOST_READ,
            );
        };
        // SAFETY: the last submission was waited for; all that the commands use lives until the wait below is over.
        unsafe { self.commands.record(record) }?;
        Ok(device.run_with_hooks(&self.commands, hooks)?)
    }
}

const READS_AND_WRITES: vk::AccessFlags2 = vk::AccessFlags2::from_raw(
    vk::AccessFlags2::SHADER_STORAGE_READ.as_raw()
        | vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw()
        | vk::AccessFlags2::TRANSFER_READ.as_raw()
        | vk::AccessFlags2::TRANSFER_WRITE.as_raw(),
);

/// Records a barrier between accesses of shaders and copies in earlier commands and those in later ones.
fn record_barrier(
    device: &Device,
    commands: vk::CommandBuffer,
    before: vk::AccessFlags2,
    after: vk::AccessFlags2,
) {
    let stages = vk::PipelineStageFlags2::COMPUTE_SHADER | vk::PipelineStageFlags2::TRANSFER;
    let host = if after.contains(vk::AccessFlags2::HOST_READ) {
        vk::PipelineStageFlags2::HOST
    } else {
        vk::PipelineStageFlags2::empty()
    };
    let barriers = [vk::MemoryBarrier2::default()
        .src_stage_mask(stages)
        .src_access_mask(before)
        .dst_stage_mask(stages | host)
        .dst_access_mask(after)];
    let info = vk::DependencyInfo::default().memory_barriers(&barriers);
    // SAFETY: `commands` is being recorded on this device; `barriers` outlives the call.
    unsafe { device.raw().cmd_pipeline_barrier2(commands, &info) };
}

fn check(scene: &Scene) -> Result<(), RenderError> {
    let layers = scene.objects.iter().map(|object| object.layers.len()).sum();
    fits("objects", MAX_OBJECTS, scene.objects.len())?;
    fits("texture layers", MAX_LAYERS, layers)
}

fn fits(what: &'static str, expected: usize, actual: usize) -> Result<(), RenderError> {
    if actual <= expected { Ok(()) } else { Err(RenderError::TooLarge { what, expected, actual }) }
}

fn holds(image: &'static str, buffer: &Buffer, expected: u64) -> Result<(), RenderError> {
    let actual = buffer.bytes();
    if actual >= expected { Ok(()) } else { Err(RenderError::Size { image, expected, actual }) }
}
