//! A stand measures the ticks of one rig with one feed.

use crate::amount::Amount;
use crate::floor::{self, Rates};
use crate::laboratory::Laboratory;
use crate::scenes::Feed;
use crate::statistics::Spread;
use anyhow::{Result, ensure};
use esaac_engine::{CameraConfig, KernelStatistics, Rig, RigOptions};
use esaac_model::packet::Event;
use esaac_model::{HdrFormat, MotionFormat, SensorModel, Synthesis};
use serde::Serialize;

/// Cost of a tick.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Timing {
    /// GPU time of a tick, microseconds.
    pub gpu_us: Spread,
    /// Mean GPU time, microseconds. It fits better than the median where a few intervals cost much more than the
    /// others.
    pub gpu_mean_us: f64,
    /// Medians of the first and of the second half of the ticks, microseconds.
    pub gpu_halves_us: [f64; 2],
    /// From submit to packet by the host's clock, microseconds.
    pub packet_us: Spread,
    /// Ticks timed.
    pub ticks: usize,
    /// Events a tick, all cameras.
    pub events: f64,
    /// Events a pixel and interval.
    pub events_per_pixel: f64,
    /// Sub-steps a block of 8x8.
    pub substeps_per_block: f64,
    /// Megabytes that the stages read and write: a count, not a measurement.
    pub moved_mb: f64,
    /// Lower bound on the time, microseconds.
    pub floor_us: f64,
}

/// Result of a run.
pub struct Run {
    /// Cost of its ticks.
    pub timing: Timing,
    /// Events of camera 0 in the intervals that [`Amount::keep`] selects.
    pub events: Vec<Event>,
    /// Median time of each stage, microseconds; empty without time stamps between stages.
    pub stages_us: Vec<(&'static str, f64)>,
}

/// A rig of equal cameras with its feed.
pub struct Stand<'l> {
    laboratory: &'l Laboratory,
    rig: Rig,
    feed: Feed,
    formats: (HdrFormat, MotionFormat),
    rates: Rates,
}

impl<'l> Stand<'l> {
    /// A rig of cameras with the same sensor. If its synthesis is `rigid`, they get depth, ids and poses of the feed.
    pub fn new(
        laboratory: &'l Laboratory,
        sensor: &SensorModel,
        cameras: usize,
        formats: (HdrFormat, MotionFormat),
        feed: Feed,
        options: RigOptions,
    ) -> Result<Self> {
        let geometry = feed.geometry().filter(|_| sensor.synthesis == Synthesis::Rigid);
        let config = |camera| CameraConfig {
            sensor: sensor.clone(),
            camera,
            hdr: formats.0,
            motion: feed.has_motion().then_some(formats.1),
            geometry,
        };
        let configs: Vec<CameraConfig> = (0..cameras as u32).map(config).collect();
        let rig = Rig::with_options(laboratory.device(), &configs, options)?;
        Ok(Stand { rates: laboratory.rates(), laboratory, rig, feed, formats })
    }

    /// Changes the sensor to another one of the same size. Compiled kernels stay.
    pub fn set_sensor(&mut self, sensor: &SensorModel) -> Result<()> {
        for camera in 0..self.rig.len() {
            self.rig.set_sensor(camera, sensor.clone())?;
        }
        Ok(())
    }

    /// Changes the feed to another one of the same size.
    pub fn set_feed(&mut self, feed: Feed) {
        self.feed = feed;
    }

    /// The rig.
    #[must_use]
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The rig, for what else is measured of it.
    pub(crate) fn rig_mut(&mut self) -> &mut Rig {
        &mut self.rig
    }

    /// The driver's statistics on the kernels of the last run.
    pub fn kernel_statistics(&self) -> Result<Vec<(&'static str, KernelStatistics)>> {
        Ok(self.rig.kernel_statistics()?)
    }

    /// Runs `amount` and measures it.
    pub fn run(&mut self, amount: Amount) -> Result<Run> {
        let frames = self.feed.frames().map_or(amount.frames, |there| there.min(amount.frames));
        let mut seen = Seen::default();
        let mut events = Vec::new();
        for pass in 0..amount.passes {
            for camera in 0..self.rig.len() {
                self.rig.reset(camera)?;
            }
            for frame in 0..frames {
                let t_ns = self.feed.put(&mut self.rig, frame)?;
                self.laboratory.clock().heat()?;
                let tick = self.rig.step(&vec![t_ns; self.rig.len()])?;
                if pass == 0 && frame <= amount.keep {
                    events.extend(tick.packets[0].iter());
                }
                if frame > 0 && (pass > 0 || frame > amount.warm_up) {
                    seen.add(&tick);
                }
            }
        }
        ensure!(seen.gpu_us.len() > 1, "{frames} frames leave {} ticks to time", seen.gpu_us.len());
        let stages_us = seen.stages_us();
        Ok(Run { timing: self.timing(&seen)?, events, stages_us })
    }

    fn timing(&self, seen: &Seen) -> Result<Timing> {
        let ticks = seen.gpu_us.len();
        let (first, second) = seen.gpu_us.split_at(ticks / 2);
        let sensor = self.rig.sensor(0)?;
        let cameras = self.rig.len() as f64;
        let (events, substeps) = (seen.events / ticks as f64, seen.substeps / ticks as f64);
        let block_px = f64::from(esaac_model::substeps::BLOCK_PX);
        let blocks =
            (f64::from(sensor.width) / block_px).ceil() * (f64::from(sensor.height) / block_px).ceil();
        let (hdr, motion) = self.formats;
        let compulsory = cameras * floor::compulsory_bytes(sensor, hdr, motion, events / cameras);
        let samples = substeps * block_px * block_px;
        let operations = floor::operations_per_sample(sensor);
        Ok(Timing {
            gpu_us: Spread::of(&seen.gpu_us),
            gpu_mean_us: seen.gpu_us.iter().sum::<f64>() / ticks as f64,
            gpu_halves_us: [crate::statistics::median(first), crate::statistics::median(second)],
            packet_us: Spread::of(&seen.packet_us),
            ticks,
            events,
            events_per_pixel: events / cameras / sensor.pixels() as f64,
            substeps_per_block: substeps / cameras / blocks,
            moved_mb: cameras * floor::moved_bytes(sensor, hdr, motion, events / cameras) / 1e6,
            floor_us: floor::floor_us(self.rates, compulsory, samples, operations),
        })
    }
}

/// Measurements of the timed ticks.
#[derive(Default)]
struct Seen {
    gpu_us: Vec<f64>,
    packet_us: Vec<f64>,
    stages: Vec<(&'static str, Vec<f64>)>,
    events: f64,
    substeps: f64,
}

impl Seen {
    fn add(&mut self, tick: &esaac_engine::Tick<'_>) {
        self.stages.resize_with(tick.stage_ns.len(), || ("", Vec::new()));
        for (stage, &(name, ns)) in self.stages.iter_mut().zip(tick.stage_ns) {
            stage.0 = name;
            stage.1.push(ns as f64 / 1e3);
        }
        let gpu_ns = tick.gpu_ns().expect("a device that is measured tells times");
        self.gpu_us.push(gpu_ns as f64 / 1e3);
        self.packet_us.push(tick.submit_to_packet_ns as f64 / 1e3);
        self.events += tick.events.iter().map(|&events| f64::from(events)).sum::<f64>();
        self.substeps += tick.diagnostics.iter().map(|d| d.substeps as f64).sum::<f64>();
    }

    fn stages_us(&self) -> Vec<(&'static str, f64)> {
        self.stages.iter().map(|(name, us)| (*name, crate::statistics::median(us))).collect()
    }
}
