//! The cameras of one `Engine`, between two calls.

use crate::bank::{Bank, Copies, Format, Frames};
use crate::cuda::{Block, CudaSide};
use crate::error::Fault;
use crate::image::{Place, elsewhere};
use esaac_engine::{ApsFrame, Device, Diagnostics, MemoryUse, Representation, Share};
use esaac_model::{Packet, SensorModel, frame};
use std::sync::Arc;
use std::time::Instant;

/// Everything that a step needs.
pub struct State {
    banks: Vec<Bank>,
    formats: Vec<Format>,
    /// Sensors as they are now.
    pub sensors: Vec<SensorModel>,
    last_ns: Vec<Option<i64>>,
    packets_on_cuda: bool,
    /// Copies so far.
    pub copies: Copies,
    /// Time that the last step took here: copies, the device, the packets.
    step_ns: u64,
    device: Arc<Device>,
}

/// Where a step's events are.
pub enum Events {
    /// A packet a camera.
    Host(Vec<Packet>),
    /// All of them in one block, in the layout of [`Representation::Gathered`], and the packets' headers.
    Cuda { block: Arc<Block>, headers: Vec<Packet>, counts: Vec<u32> },
}

/// A form of the last step's events, of all cameras.
pub enum Form {
    /// For NumPy.
    Host(Vec<u8>),
    /// For tensors.
    Cuda(Arc<Block>),
}

/// What `save` gives and `restore` takes.
pub struct Saved {
    /// A state a bank.
    pub banks: Vec<Vec<u8>>,
    /// What each camera's frames are.
    pub formats: Vec<Format>,
    /// Time of each camera's last frame.
    pub last_ns: Vec<Option<i64>>,
}

impl State {
    /// Cameras that have seen nothing yet; what their frames are, their first ones tell.
    pub fn new(device: &Arc<Device>, sensors: Vec<SensorModel>, packets_on_cuda: bool) -> Self {
        State {
            banks: Vec::new(),
            formats: Vec::new(),
            last_ns: vec![None; sensors.len()],
            sensors,
            packets_on_cuda,
            copies: Copies::default(),
            step_ns: 0,
            device: Arc::clone(device),
        }
    }

    /// Steps the cameras that have a time.
    pub fn step(
        &mut self,
        frames: &Frames,
        t_ns: &[Option<i64>],
        side: Option<&Arc<CudaSide>>,
    ) -> Result<Events, Fault> {
        let started = Instant::now();
        for (camera, (last_ns, t_ns)) in self.last_ns.iter().zip(t_ns).enumerate() {
            if let Some(t_ns) = t_ns {
                frame::check_time(camera as u32, *last_ns, *t_ns)?;
            }
        }
        self.check_formats(frames)?;
        self.check_devices(frames, side)?;
        let on_device = (0..self.sensors.len())
            .any(|c| frames.of(c).is_some_and(|(hdr, ..)| matches!(hdr.place(), Place::Cuda { .. })));
        if on_device {
            let side = side.expect("frames on a device come with its side");
            let link = side.link();
            for bank in &mut self.banks {
                bank.bring(frames, Some(&link), &mut self.copies)?;
            }
            link.finish()?;
        } else {
            for bank in &mut self.banks {
                bank.bring(frames, None, &mut self.copies)?;
            }
        }
        step_all(&mut self.banks, frames, t_ns)?;
        for (last_ns, t_ns) in self.last_ns.iter_mut().zip(t_ns) {
            *last_ns = t_ns.or(*last_ns);
        }
        let events = self.events(side);
        self.step_ns = started.elapsed().as_nanos() as u64;
        events
    }

    fn events(&mut self, side: Option<&Arc<CudaSide>>) -> Result<Events, Fault> {
        let counts: Vec<u32> = self.banks.iter().flat_map(|bank| bank.rig.events()).copied().collect();
        let packets: Vec<Packet> = self.banks.iter_mut().flat_map(|bank| bank.rig.take_packets()).collect();
        if !self.packets_on_cuda {
            return Ok(Events::Host(packets));
        }
        let side = side.expect("packets on a device come with its side");
        let block = self.form_on_cuda(Representation::Gathered, side)?;
        Ok(Events::Cuda { block, headers: packets, counts })
    }

    /// A form of the last step's events, where packets are.
    pub fn form(&mut self, what: Representation, side: Option<&Arc<CudaSide>>) -> Result<Form, Fault> {
        if self.banks.is_empty() {
            return Err(Fault::Argument("no frame has been stepped yet".to_owned()));
        }
        if self.packets_on_cuda {
            let side = side.expect("packets on a device come with its side");
            return Ok(Form::Cuda(self.form_on_cuda(what, side)?));
        }
        let mut bytes = Vec::new();
        for bank in &mut self.banks {
            bytes.append(&mut bank.rig.represent_to_host(what)?);
        }
        Ok(Form::Host(bytes))
    }

    fn form_on_cuda(&mut self, what: Representation, side: &Arc<CudaSide>) -> Result<Arc<Block>, Fault> {
        let all: u64 = self.banks.iter().map(|bank| bank.rig.elements(what)).sum();
        let block = side.block((all * what.element_bytes()).max(16))?;
        let mut before = 0;
        for bank in &mut self.banks {
            bank.rig.represent(what, block.memory()?.0.buffer(), Share { before, all })?;
            before += bank.rig.elements(what);
        }
        Ok(Arc::new(block))
    }

    /// The first frames say what each camera's are; the others are held against that.
    fn check_formats(&mut self, frames: &Frames) -> Result<(), Fault> {
        let given = |camera: usize| {
            frames.of(camera).map(|(hdr, motion, _)| (hdr.texel(), motion.map(|m| m.texel())))
        };
        if self.banks.is_empty() {
            let formats: Option<Vec<Format>> = (0..self.sensors.len()).map(given).collect();
            let formats = formats.ok_or_else(|| {
                Fault::Frame("the first step needs a frame of every camera: they tell the formats".to_owned())
            })?;
            self.banks = Bank::all(&self.device, &self.sensors, &formats, self.packets_on_cuda)?;
            self.formats = formats;
            return Ok(());
        }
        for (camera, expected) in self.formats.iter().enumerate() {
            let Some(actual) = given(camera) else { continue };
            if actual != *expected {
                return Err(Fault::Frame(format!(
                    "camera {camera}: {}, expected {} as in its first frame",
                    describe(actual),
                    describe(*expected)
                )));
            }
        }
        Ok(())
    }

    /// Frames on a device are on the engine's.
    fn check_devices(&self, frames: &Frames, side: Option<&Arc<CudaSide>>) -> Result<(), Fault> {
        for (hdr, motion) in frames.images.iter().flatten() {
            for tiles in [Some(hdr), motion.as_ref()].into_iter().flatten() {
                // A texture has no address to ask for; its context is asked when it is copied.
                let addressed = tiles.texture().is_none();
                if let (Place::Cuda { .. }, Some(side), true) = (tiles.place(), side, addressed) {
                    let actual = side.link().device_of(tiles.pointer())?;
                    if actual != side.ordinal {
                        let device = &self.device.info().name;
                        return Err(elsewhere(tiles.name(), actual, side.ordinal, device));
                    }
                }
                if tiles.place() == Place::Host && hdr.place() != Place::Host {
                    let message = "hdr lies on a CUDA device and motion on the host, expected both on one";
                    return Err(Fault::Frame(message.to_owned()));
                }
                if tiles.place() != Place::Host && hdr.place() == Place::Host {
                    let message = "hdr lies on the host and motion on a CUDA device, expected both on one";
                    return Err(Fault::Frame(message.to_owned()));
                }
            }
        }
        Ok(())
    }

    /// The bank of a camera, and its number there.
    fn bank(&mut self, camera: usize) -> Result<Option<(&mut Bank, usize)>, Fault> {
        if camera >= self.sensors.len() {
            let count = self.sensors.len();
            return Err(Fault::Argument(format!("there are {count} cameras and no camera {camera}")));
        }
        let bank = self.banks.iter_mut().find(|bank| bank.cameras.contains(&camera));
        Ok(bank.map(|bank| {
            let own = camera - bank.cameras.start;
            (bank, own)
        }))
    }

    /// Forgets what cameras saw.
    pub fn reset(&mut self, cameras: &[usize]) -> Result<(), Fault> {
        for &camera in cameras {
            if let Some((bank, own)) = self.bank(camera)? {
                bank.rig.reset(own)?;
            }
            self.last_ns[camera] = None;
        }
        Ok(())
    }

    /// Changes a camera's parameters from its next step on.
    pub fn set_sensor(&mut self, camera: usize, sensor: SensorModel) -> Result<(), Fault> {
        if let Some((bank, own)) = self.bank(camera)? {
            bank.rig.set_sensor(own, sensor.clone())?;
            if bank.rig.is_at_start(own)? {
                self.last_ns[camera] = None;
            }
        } else {
            let (old, new) = (&self.sensors[camera], &sensor);
            if (old.width, old.height) != (new.width, new.height) {
                return Err(Fault::Argument(format!(
                    "camera {camera} is {}x{} px and cannot become {}x{} px",
                    old.width, old.height, new.width, new.height
                )));
            }
        }
        self.sensors[camera] = sensor;
        Ok(())
    }

    /// What the last step counted, a camera.
    pub fn diagnostics(&self) -> Vec<Diagnostics> {
        self.banks.iter().flat_map(|bank| bank.rig.diagnostics()).copied().collect()
    }

    /// APS frames of the last step, a camera.
    pub fn aps(&self) -> Vec<Option<ApsFrame>> {
        self.banks.iter().flat_map(|bank| bank.rig.aps()).cloned().collect()
    }

    /// GPU time of the last step, the longest where several banks ran at once; the time from submit to packet,
    /// likewise; and that of the whole step.
    pub fn times_ns(&self) -> [u64; 3] {
        let longest = |of: fn(&Bank) -> u64| self.banks.iter().map(of).max().unwrap_or(0);
        let rigs = [longest(|bank| bank.rig.gpu_ns()), longest(|bank| bank.rig.submit_to_packet_ns())];
        [rigs[0], rigs[1], self.step_ns]
    }

    /// Memory, by camera and purpose.
    pub fn memory(&self) -> Vec<MemoryUse> {
        let of_bank = |bank: &Bank| {
            let first = bank.cameras.start;
            bank.rig
                .memory()
                .into_iter()
                .map(move |entry| MemoryUse { camera: entry.camera.map(|own| own + first), ..entry })
                .collect::<Vec<_>>()
        };
        self.banks.iter().flat_map(of_bank).collect()
    }

    /// The states of all banks, and what restoring them needs.
    pub fn save(&self) -> Result<Saved, Fault> {
        if self.banks.is_empty() {
            return Err(Fault::Argument("nothing to save: no frame has been stepped yet".to_owned()));
        }
        let banks = self.banks.iter().map(|bank| Ok(bank.rig.save()?)).collect::<Result<_, Fault>>()?;
        Ok(Saved { banks, formats: self.formats.clone(), last_ns: self.last_ns.clone() })
    }

    /// Takes up a saved state, of cameras with the same sensors.
    pub fn restore(&mut self, saved: Saved) -> Result<(), Fault> {
        let (expected, actual) = (self.sensors.len(), saved.formats.len());
        if expected != actual || expected != saved.last_ns.len() {
            return Err(Fault::Argument(format!("saved state of {actual} cameras, expected {expected}")));
        }
        let mut banks = Bank::all(&self.device, &self.sensors, &saved.formats, self.packets_on_cuda)?;
        if banks.len() != saved.banks.len() {
            let message = format!("saved state of {} rigs, expected {}", saved.banks.len(), banks.len());
            return Err(Fault::Argument(message));
        }
        for (bank, saved) in banks.iter_mut().zip(&saved.banks) {
            bank.rig.restore(saved)?;
        }
        (self.banks, self.formats, self.last_ns) = (banks, saved.formats, saved.last_ns);
        Ok(())
    }
}

fn describe((hdr, motion): Format) -> String {
    let hdr = format!("{:?} colour", hdr.element).to_lowercase();
    match motion {
        Some(motion) => format!("{hdr} with {} channels of {:?} motion", motion.channels, motion.element),
        None => format!("{hdr} without motion"),
    }
}

/// Steps all banks, each on a thread of its own: they wait for the device most of the time.
fn step_all(banks: &mut [Bank], frames: &Frames, t_ns: &[Option<i64>]) -> Result<(), Fault> {
    if let [bank] = banks {
        return bank.step(frames, t_ns);
    }
    std::thread::scope(|scope| {
        let threads: Vec<_> =
            banks.iter_mut().map(|bank| scope.spawn(move || bank.step(frames, t_ns))).collect();
        threads.into_iter().try_for_each(|thread| thread.join().expect("a bank's thread does not panic"))
    })
}
