//! Collects the results of the demo, tick by tick, and publishes them.

use super::picture::{Picture, colours};
use super::run::Run;
use super::{HDR, MOTION, Simulated};
use crate::colour;
use crate::interrupt::Interrupt;
use crate::link_report::LinkReport;
use crate::overview::Instant;
use crate::report::MemoryReport;
use crate::ros::{self, RosOutput};
use crate::run_record::RunRecord;
use anyhow::Result;
use esaac_engine::{Device, Rig, Tick};
use esaac_model::{Intensity, SensorModel};
use esaac_scene::renderer::Renderer;
use std::sync::Arc;

/// The results of the ticks so far.
pub(super) struct Collected {
    renderer: Renderer,
    picture: Picture,
    record: RunRecord,
    /// The current ones.
    sensors: [SensorModel; 2],
    sensors_changed: bool,
    ros: RosOutput,
    exposure: Option<f32>,
    instants: Vec<Instant>,
}

impl Collected {
    pub fn new(run: &Run<'_>, device: &Arc<Device>, ros: RosOutput) -> Result<Self> {
        Ok(Collected {
            renderer: Renderer::new(device, run.scene.clone(), HDR, MOTION)?,
            picture: Picture::new(device, &run.scene)?,
            record: RunRecord::new(run.sensors.len()),
            sensors: run.sensors.clone(),
            sensors_changed: false,
            ros,
            exposure: None,
            instants: Vec::new(),
        })
    }

    /// Applies the ROS parameters that other nodes have set since the last tick.
    pub fn change_sensors(&mut self, rig: &mut Rig) {
        self.sensors_changed |= self.ros.change_sensors(rig, &mut self.sensors);
    }

    pub fn add(&mut self, run: &Run<'_>, index: usize, tick: &Tick<'_>) -> Result<()> {
        if index > 0 {
            self.record.add_tick(tick)?;
        }
        let t_ns = run.times_ns[index];
        if run.shown.contains(&index) || self.ros.is_open() {
            self.picture.render(&mut self.renderer, t_ns)?;
        }
        self.publish(run, index, tick);
        if run.shown.contains(&index) {
            self.instants.push(self.instant(run, t_ns, tick));
        }
        Ok(())
    }

    /// The images that the overview shows of a frame.
    fn instant(&self, run: &Run<'_>, t_ns: i64, tick: &Tick<'_>) -> Instant {
        let Picture { pixels, hdr, depth } = &self.picture;
        let bayer = run.sensors.iter().position(|s| s.intensity == Intensity::BayerRggb).expect("one of two");
        let gray = 1 - bayer;
        let aps = tick.aps[gray].as_ref().map(|frame| {
            let full = ((1_u32 << frame.bits) - 1) as f32;
            tick.aps_pixels(gray).iter().map(|&level| f32::from(level) / full).collect()
        });
        Instant {
            t_ns,
            rgb: colours(hdr.read(0, pixels * HDR.texel_bytes())).collect(),
            aps,
            gray: tick.view(gray).to_packet(),
            bayer: tick.view(bayer).to_packet(),
            depth_m: depth.read(0, *pixels).to_vec(),
        }
    }

    /// Publishes everything of a frame to ROS 2. The first frame has no packet yet.
    fn publish(&mut self, run: &Run<'_>, index: usize, tick: &Tick<'_>) {
        if !self.ros.is_open() {
            return;
        }
        let Picture { pixels, hdr, depth } = &self.picture;
        let hdr = hdr.read(0, pixels * HDR.texel_bytes());
        let exposure =
            *self.exposure.get_or_insert_with(|| colour::exposure(colours(hdr).map(colour::luminance)));
        let rgb: Vec<u8> = colours(hdr).flat_map(|c| colour::tone_map(c, exposure)).collect();
        let t_ns = run.times_ns[index];
        let imu = |t_ns: i64| {
            let sample = run.scene.camera_state(esaac_scene::scene::seconds(t_ns)).imu();
            [sample.angular_rate_rad_s.to_array(), sample.specific_force_m_s2.to_array()]
        };
        let samples = index.checked_sub(1).map(|i| ros::imu_samples(run.times_ns[i], t_ns, imu));
        self.ros.tick(t_ns, |out| {
            for (camera, sensor) in self.sensors.iter().enumerate() {
                if let Some(samples) = &samples {
                    ros::add_camera(out, camera, sensor, tick, None);
                    out.imu(camera, samples);
                }
                out.rgb(camera, |pixels| pixels.extend_from_slice(&rgb));
                out.depth(camera, depth.read(0, *pixels));
            }
        });
    }

    /// Shows on `/diagnostics` what is known of the cameras, once a second.
    pub fn show_cameras(&mut self, rig: &Rig) -> Result<()> {
        self.ros.show_cameras(&self.record, rig)
    }

    /// Takes what the rig has seen of the cameras' light, at the end.
    pub fn take_light(&mut self, rig: &Rig) -> Result<()> {
        self.ros.show_cameras_now(&self.record, rig)?;
        self.record.take_light(rig)
    }

    pub fn finish(
        self,
        link: LinkReport,
        memory: Vec<MemoryReport>,
        interrupt: Interrupt,
    ) -> Result<Simulated> {
        let ros = self.ros.finish();
        Ok(Simulated {
            record: self.record,
            sensors_changed: self.sensors_changed,
            link,
            ros,
            memory,
            instants: self.instants,
            interrupt,
        })
    }
}
