//! The device's clock rate. A GPU that idles or grows hot lowers its clock, and then a measurement shows the clock and
//! not the program. So the bench keeps the GPU busy between ticks and times the same work again and again.

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

/// Workgroups of a copy: several for each multiprocessor of any device.
const COPY_GROUPS: u32 = 8192;

/// The longest time to wait for the best clock. A clock that is still lower stays lower: the device is hot or shared.
const LONGEST_HEAT: Duration = Duration::from_millis(300);

/// A larger change of the reference work's time, as a share, counts as a change of the clock.
const STEADY: f64 = 0.03;

/// The clock over a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClockReport {
    /// Time of the same work before each part and at the end, microseconds.
    pub reference_us: Vec<f64>,
    /// Largest time over least time, minus one.
    pub drift: f64,
    /// Whether the drift is small enough (below 3%) to compare the run's figures.
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
    /// Compiles the reference work for a device.
    pub fn new(device: &Arc<Device>) -> Result<Self> {
        let words = esaac_kernels::words(include_bytes!(concat!(env!("OUT_DIR"), "/heat.spv")));
        let sink = device.allocate("heat", 16, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly)?;
        #[expect(unsafe_code, reason = "Vulkan's edge")]
        // SAFETY: the build script has compiled the kernel, which has one buffer and a word of push constants. It was just
        // made, so no commands use it yet. `Clock` owns the kernel and its buffer and drops both together.
        let kernel = unsafe {
            let kernel = Kernel::new(device, "heat", &words, 1, 4, &[])?;
            kernel.bind(&[&sink]);
            kernel
        };
        // A processor's clock does not drop between ticks, and heating it would take time from the measurement.
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

    /// Keeps the device busy until its clock is back at its best. A GPU that has waited for the host for some
    /// milliseconds runs at a fraction of its clock and needs time to recover. Does nothing on a software device.
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
            record(&self.kernel, commands, HEAT_ROUNDS, GROUPS);
        })?;
        Ok(ns as f64)
    }

    /// Times the reference work and notes the least of five times: other programs can only slow it down.
    pub fn watch(&mut self) -> Result<()> {
        let ns = self.reference_ns()?;
        self.reference_us.push(ns / 1e3);
        Ok(())
    }

    /// Most multiplications and additions a second, counted together, that the device does.
    pub fn operations_per_s(&self) -> Result<f64> {
        let operations = f64::from(GROUPS) * 256.0 * 2.0 * f64::from(self.rounds());
        Ok(operations / (self.reference_ns()? * 1e-9))
    }

    /// Bytes a second, read and written together, of a copy within the device's memory.
    pub fn bytes_per_s(&self) -> Result<f64> {
        // A GPU needs more than its caches hold. For a processor the smaller copy is enough, and quicker.
        let bytes: u64 = if self.heats { 1 << 30 } else { 64 << 20 };
        let buffer =
            |name| self.device.allocate(name, bytes, vk::BufferUsageFlags::empty(), MemoryLocation::GpuOnly);
        let (from, to) = (buffer("copied from")?, buffer("copied to")?);
        let words = esaac_kernels::words(include_bytes!(concat!(env!("OUT_DIR"), "/copy.spv")));
        #[expect(unsafe_code, reason = "Vulkan's edge")]
        // SAFETY: the build script has compiled the kernel, which has two buffers and a word of push constants. It was
        // just made, so no commands use it yet. Kernel and buffers live to the end of this function, and `time_once`
        // waits for each submission.
        let kernel = unsafe {
            let kernel = Kernel::new(&self.device, "copy", &words, 2, 4, &[])?;
            kernel.bind(&[&from, &to]);
            kernel
        };
        let count = (bytes / 16) as u32;
        let mut best_ns = f64::INFINITY;
        for _ in 0..5 {
            self.heat()?;
            let ns = self.device.time_once(|commands| {
                record(&kernel, commands, count, COPY_GROUPS);
            })?;
            best_ns = best_ns.min(ns as f64);
        }
        Ok(2.0 * bytes as f64 / (best_ns * 1e-9))
    }

    /// The clock so far.
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
                record(&self.kernel, commands, self.rounds(), GROUPS);
            })?;
            best = best.min(ns as f64);
        }
        Ok(best)
    }
}

/// Records a kernel with one number as push constant.
#[expect(unsafe_code, reason = "Vulkan's edge")]
fn record(kernel: &Kernel, commands: vk::CommandBuffer, number: u32, groups: u32) {
    // SAFETY: the callers own kernel and buffers and wait for the one submission (`time_once`), so both outlive it and
    // nothing else uses them. The kernels write within their buffers.
    unsafe { kernel.record(commands, &number.to_ne_bytes(), [groups, 1, 1]) };
}
