//! Runs the demo. Its frames are rendered in this process or in a second one.

use super::collected::Collected;
use super::{DemoArguments, HDR, MOTION, RATE_HZ, Simulated};
use crate::arguments::CommonArguments;
use crate::interrupt::Interrupt;
use crate::kernel_source::KernelSource;
use crate::link_report::LinkReport;
use crate::pace::Pace;
use crate::progress;
use crate::render_process::{RenderJob, RenderProcess};
use crate::report::{self, MemoryReport};
use crate::rig_file::RigPlan;
use crate::ros::{self, RosOutput};
use anyhow::{Context, Result, ensure};
use esaac_engine::{CameraConfig, Device, GeometryConfig, InputBuffers, Rig};
use esaac_formats::frame_time::frame_time_ns;
use esaac_formats::scene_file::pose_times_ns;
use esaac_interop::{DEFAULT_SLOTS, ServerOptions, Service};
use esaac_model::{DepthFormat, IdFormat, Intensity, SensorModel, Synthesis};
use esaac_ros::CameraPlan;
use esaac_scene::Scene;
use esaac_scene::renderer::{Renderer, Targets};
use std::sync::Arc;
use std::time::Duration;

/// Poses a second for synthesis `rigid`: steps of a simulator.
const POSE_RATE_HZ: f64 = 960.0;

/// Rows of the overview.
const INSTANTS: usize = 4;

/// Two cameras that see the same scene.
pub(super) struct Run<'a> {
    pub scene: Scene,
    pub sensors: &'a [SensorModel; 2],
    pub times_ns: Vec<i64>,
    /// Frames that the overview shows.
    pub shown: Vec<usize>,
}

impl<'a> Run<'a> {
    pub fn new(arguments: &DemoArguments, sensors: &'a [SensorModel; 2]) -> Self {
        let frames = arguments.frames as usize;
        let mut shown: Vec<usize> = (1..=INSTANTS).map(|i| ((frames - 1) * i / INSTANTS).max(1)).collect();
        shown.dedup();
        Run {
            scene: arguments.scene.scene(sensors[0].width, sensors[0].height),
            sensors,
            times_ns: (0..frames).map(|k| frame_time_ns(k, RATE_HZ)).collect(),
            shown,
        }
    }

    /// On a GPU the renderer works ahead of the engine. On a software driver both would share the processor's
    /// cores, and the engine's times would include the renderer's. So there the renderer has one slot only,
    /// and waits.
    fn plan(&self, device: &Device) -> RigPlan {
        let slots = if device.is_software() { 1 } else { DEFAULT_SLOTS };
        let mut plan = RigPlan::default();
        for (camera, sensor) in (0..).zip(self.sensors) {
            let exact = GeometryConfig {
                depth: DepthFormat::F32,
                ids: Some(IdFormat::U32),
                lens: self.scene.intrinsics(),
            };
            let config = CameraConfig {
                sensor: sensor.clone(),
                camera,
                hdr: HDR,
                motion: Some(MOTION),
                geometry: (sensor.synthesis == Synthesis::Rigid).then_some(exact),
            };
            plan.push(config, slots, false);
        }
        plan
    }

    /// The published cameras, with everything that the scene provides.
    pub fn ros_cameras(&self) -> Vec<CameraPlan> {
        let (scene, sensors) = (&self.scene, self.sensors);
        let plan = |sensor: &SensorModel| {
            let name = if sensor.intensity == Intensity::BayerRggb { "bayer" } else { "gray" };
            CameraPlan {
                image: true,
                depth: true,
                imu: true,
                ..ros::camera(name.to_owned(), sensor, Some(scene.intrinsics()))
            }
        };
        sensors.iter().map(plan).collect()
    }

    /// Renders in this process, into the rig's own buffers.
    pub fn in_process(
        &self,
        device: &Arc<Device>,
        kernels: &mut KernelSource,
        arguments: &DemoArguments,
        ros: RosOutput,
    ) -> Result<Simulated> {
        let mut rig = Rig::with_options(device, &self.plan(device).cameras, report::rig_options())?;
        kernels.load(&mut rig)?;
        let mut renderer = Renderer::new(device, self.scene.clone(), HDR, MOTION)?;
        let mut collected = Collected::new(self, device, ros)?;
        let mut pace = Pace::new(arguments.real_time);
        for camera in (0..rig.len()).filter(|&camera| self.sensors[camera].synthesis == Synthesis::Rigid) {
            let poses_ns = pose_times_ns(self.times_ns.len(), RATE_HZ, POSE_RATE_HZ);
            rig.set_scene(camera, self.scene.scene_motion(&poses_ns))?;
        }
        let interrupt = Interrupt::watch()?;
        let progress = progress::bar(self.times_ns.len());
        for (index, &t_ns) in self.times_ns.iter().enumerate().take_while(|_| !interrupt.came()) {
            pace.wait(t_ns);
            let previous_ns = index.checked_sub(1).map(|before| self.times_ns[before]);
            for camera in 0..rig.len() {
                let InputBuffers { hdr, motion, depth, ids } = rig.inputs(camera)?;
                renderer.render(t_ns, previous_ns, Targets { hdr, motion, depth, ids })?;
            }
            kernels.refresh(&mut rig, &progress);
            collected.change_sensors(&mut rig);
            collected.add(self, index, &rig.step(&[t_ns; 2])?)?;
            collected.show_cameras(&rig)?;
            progress.inc(1);
        }
        progress.finish_and_clear();
        let frames = (self.times_ns.len() * rig.len()) as u64;
        collected.take_light(&rig)?;
        collected.finish(LinkReport::in_process(frames), MemoryReport::of(&rig), interrupt)
    }

    /// Lets a second process render into shared memory, as `esaac serve` and `esaac render` do.
    pub fn over_the_link(
        &self,
        device: &Arc<Device>,
        kernels: &mut KernelSource,
        arguments: &DemoArguments,
        common: &CommonArguments,
        ros: RosOutput,
    ) -> Result<Simulated> {
        let plan = self.plan(device);
        let mut rig = Rig::with_options(device, &plan.cameras, report::rig_options())?;
        kernels.load(&mut rig)?;
        let folder = tempfile::tempdir().context("no folder for the socket")?;
        let socket = folder.path().join("engine.sock");
        // Both cameras have frames at the same times.
        let options = ServerOptions { gather: PATIENCE, ..ServerOptions::default() };
        let mut service = Service::open(rig, &socket, &plan.terms, options)
            .context("two processes cannot share this device's memory; --in-process needs none")?;
        let job = RenderJob { scene: arguments.scene, frames: arguments.frames, rate_hz: RATE_HZ };
        let mut renderer = RenderProcess::start(&socket, job, device, common)?;
        let mut collected = Collected::new(self, device, ros)?;
        let mut pace = Pace::new(arguments.real_time);
        let interrupt = Interrupt::watch()?;
        let progress = progress::bar(self.times_ns.len());
        'frames: for (index, &t_ns) in self.times_ns.iter().enumerate() {
            if interrupt.came() {
                break;
            }
            pace.wait(t_ns);
            kernels.refresh(service.rig_mut(), &progress);
            collected.change_sensors(service.rig_mut());
            loop {
                if let Some(tick) = service.tick(LOOK)? {
                    ensure!(
                        tick.t_ns == [Some(t_ns); 2],
                        "frame {index} came at {:?} ns, expected {t_ns} for both cameras",
                        tick.t_ns
                    );
                    collected.add(self, index, &tick.tick)?;
                    collected.show_cameras(service.rig())?;
                    break;
                }
                let alive = renderer.check_alive(&service.server().notices());
                // Ctrl-C ends the renderer too.
                if interrupt.came() {
                    break 'frames;
                }
                alive?;
            }
            progress.inc(1);
        }
        progress.finish_and_clear();
        match interrupt.came() {
            true => drop(renderer),
            false => renderer.finish()?,
        }
        collected.take_light(service.rig())?;
        collected.finish(LinkReport::of(&service), MemoryReport::of(service.rig()), interrupt)
    }
}

/// Time between two checks whether the renderer still runs.
const LOOK: Duration = Duration::from_millis(100);

/// How long one camera's frame waits for the other's.
const PATIENCE: Duration = Duration::from_secs(60);
