//! The device's clock: kept up between ticks, and watched, since a GPU that idles or grows hot lowers it and
//! what is then measured is the clock.

use anyhow::Result;
use esaac_engine::ash::vk;
use esaac_engine::{Buffer, Device, Kernel, MemoryLocation};
use serde::Serialize;
use std::cell::Cell;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Rounds of `heat.comp` between two ticks on a GPU: about a millisecond.
const HEAT_ROUNDS: u32 = 100_000;

/// Rounds of the reference work on a GPU and on a processor.
const REFERENCE_ROUNDS: [u32; 2] = [100_000, 2_000];

/// Workgroups of 256 threads.
const GROUPS: u32 = 1024;

/// The same for a copy: some for every multiprocessor of any device.
const COPY_GROUPS: u32 = 8192;

/// A clock that has not come back by then does not: the device is hot or not ours alone.
const LONGEST_HEAT: Duration = Duration::from_millis(300);

/// A change of the reference work's time that is held for a change of the clock.
const STEADY: f64 = 0.03;

/// What was seen of the clock over a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClockReport {
    /// Time of the same work before each part and at the end, microseconds.
    pub reference_us: Vec<f64>,
    /// Largest over least, less one.
    pub drift: f64,
    /// Whether the drift is below 3%.
    pub steady: bool,
}

/// Keeps the clock up and measures it.
pub struct Clock {
    device: Arc<Device>,
    kernel: Kernel,
    _sink: Buffer,
    heats: bool,
    /// Least time of the work that heats, nanoseconds.
    best_ns: Cell<f64>,
    reference_us: Vec<f64>,
}

impl Clock {
    /// A clock of a device.
    pub fn new(device: &Arc<Device>) -> Result<Self> {
        let words = esaac_kernels::words(include_bytes!(concat!(env!("OUT_DIR"), "/heat.spv")));
        let sink = device.allocate("heat", 16, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly)?;
        let kernel = Kernel::new(device, "heat", &words, 1, 4, &[])?;
        kernel.bind(&[&sink]);
        // A processor has no clock to keep up, and all of its time is wanted.
        let heats = !device.is_software();
        Ok(Clock {
            device: Arc::clone(device),
            kernel,
            _sink: sink,
            heats,
            best_ns: Cell::new(f64::INFINITY),
            reference_us: Vec::new(),
        })
    }

    /// Keeps the device busy until its clock is where it was at its best: a GPU that has waited for the host for
    /// some milliseconds runs at a fraction of it, and needs a while to come back.
    pub fn heat(&self) -> Result<()> {
        if !self.heats {
            return Ok(());
        }
        let started = Instant::now();
        while started.elapsed() < LONGEST_HEAT {
            let ns = self.heat_ns()?;
            let best = self.best_ns.get().min(ns);
            self.best_ns.set(best);
            if ns <= best * (1.0 + STEADY) {
                break;
            }
        }
        Ok(())
    }

    fn heat_ns(&self) -> Result<f64> {
        let ns = self.device.time_once(|commands| {
            self.kernel.record(commands, &HEAT_ROUNDS.to_ne_bytes(), [GROUPS, 1, 1]);
        })?;
        Ok(ns as f64)
    }

    /// Times the reference work: the least of five, since others only ever slow it down.
    pub fn watch(&mut self) -> Result<()> {
        let ns = self.reference_ns()?;
        self.reference_us.push(ns / 1e3);
        Ok(())
    }

    /// Multiplications and additions a second that the device does when it does nothing else.
    pub fn operations_per_s(&self) -> Result<f64> {
        let operations = f64::from(GROUPS) * 256.0 * 2.0 * f64::from(self.rounds());
        Ok(operations / (self.reference_ns()? * 1e-9))
    }

    /// Bytes a second, read and written together, of a copy within the device's memory.
    pub fn bytes_per_s(&self) -> Result<f64> {
        // Beyond any cache of a GPU; a processor's memory is no faster with more.
        let bytes: u64 = if self.heats { 1 << 30 } else { 64 << 20 };
        let buffer =
            |name| self.device.allocate(name, bytes, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly);
        let (from, to) = (buffer("copied from")?, buffer("copied to")?);
        let words = esaac_kernels::words(include_bytes!(concat!(env!("OUT_DIR"), "/copy.spv")));
        let kernel = Kernel::new(&self.device, "copy", &words, 2, 4, &[])?;
        kernel.bind(&[&from, &to]);
        let count = (bytes / 16) as u32;
        let mut best_ns = f64::INFINITY;
        for _ in 0..5 {
            self.heat()?;
            let ns = self.device.time_once(|commands| {
                kernel.record(commands, &count.to_ne_bytes(), [COPY_GROUPS, 1, 1]);
            })?;
            best_ns = best_ns.min(ns as f64);
        }
        Ok(2.0 * bytes as f64 / (best_ns * 1e-9))
    }

    /// What was seen so far.
    #[must_use]
    pub fn report(&self) -> ClockReport {
        let (least, most) = self
            .reference_us
            .iter()
            .fold((f64::INFINITY, 0.0_f64), |(least, most), &us| (least.min(us), most.max(us)));
        let drift = if most > 0.0 { most / least - 1.0 } else { 0.0 };
        ClockReport { reference_us: self.reference_us.clone(), drift, steady: drift < STEADY }
    }

    fn rounds(&self) -> u32 {
        REFERENCE_ROUNDS[usize::from(!self.heats)]
    }

    fn reference_ns(&self) -> Result<f64> {
        self.heat()?;
        let mut best = f64::INFINITY;
        for _ in 0..5 {
            let ns = self.device.time_once(|commands| {
                self.kernel.record(commands, &self.rounds().to_ne_bytes(), [GROUPS, 1, 1]);
            })?;
            best = best.min(ns as f64);
        }
        Ok(best)
    }
}
