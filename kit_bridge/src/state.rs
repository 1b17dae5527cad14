//! The cameras of one `Engine`, between two calls.

mod given;
mod warnings;

use crate::bank::{Bank, Copies, Format, Frames, Images, shares};
use crate::cuda::{Block, CudaSide};
use crate::error::Fault;
use crate::half_done::HalfDone;
use crate::poses::Moving;
use crate::threads::Threads;
use esaac_engine::{
    ApsFrame, Device, Diagnostics, HeldPackets, MemoryUse, PacketPlace, Representation, Rig, RigOptions,
    Share, Tick,
};
use esaac_model::paths::{Intrinsics, SceneMotion, TrackMemory};
use esaac_model::{Packet, SensorModel, frame};
use std::sync::Arc;
use std::time::Instant;
use warnings::Warnings;

/// Where packets go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packets {
    /// Memory of their own on the host.
    Host,
    /// They stay in the memory that the device writes, of which there are `ring` sets.
    Mapped {
        /// Sets of buffers that are written in turn.
        ring: u32,
    },
    /// Memory of CUDA's.
    Cuda,
}

/// Cameras, their frames' formats, and their last times.
pub struct State {
    banks: Vec<Bank>,
    formats: Vec<Format>,
    /// Whether the step that made the banks is not over: if it fails, they go again.
    first_step: bool,
    /// The step of which some banks are through, while others have failed.
    half_done: HalfDone,
    /// The present sensors.
    pub sensors: Vec<SensorModel>,
    lenses: Vec<Option<Intrinsics>>,
    /// Whether depth and ids of each camera's frames are left out.
    left_out: Vec<bool>,
    warnings: Warnings,
    /// Time of each camera's last frame.
    pub last_ns: Vec<Option<i64>>,
    /// Time of each camera's first frame since its reset; the beginning of time for one that was not reset.
    first_ns: Vec<Option<i64>>,
    packets: Packets,
    /// Whether the packets of all cameras are joined into one, as those of a tiled renderer are.
    together: bool,
    /// Copies so far.
    pub copies: Copies,
    /// Time of the last step: copies, device and packets.
    step_ns: u64,
    /// The part of it until the frames lay where the engine reads them.
    frames_ns: u64,
    /// Memory of tracks of earlier steps.
    spare: Vec<TrackMemory>,
    threads: Threads,
    device: Arc<Device>,
}

/// A step that has begun.
pub struct Begun {
    started: Instant,
    /// Whether frames are being copied on a CUDA device.
    on_device: bool,
}

/// The events of a step.
pub enum Events {
    /// One packet for each camera.
    Host(Vec<Packet>),
    /// Packets where the device wrote them, in order of cameras.
    Mapped(Vec<HeldPackets>),
    /// All events in one block, in the layout of [`Representation::Gathered`], and the packets' headers.
    Cuda { block: Arc<Block>, headers: Vec<Packet>, counts: Vec<u32> },
}

/// Event frames or voxel grids of the last step, of all cameras.
pub enum Form {
    /// For NumPy.
    Host(Vec<u8>),
    /// For tensors.
    Cuda(Arc<Block>),
}

/// What `save` gives and `restore` takes.
pub struct Saved {
    /// One state for each bank.
    pub banks: Vec<Vec<u8>>,
    /// Formats of each camera's frames.
    pub formats: Vec<Format>,
    /// Time of each camera's last frame.
    pub last_ns: Vec<Option<i64>>,
    /// Time of each camera's first frame since its reset.
    pub first_ns: Vec<Option<i64>>,
    /// Whether depth and ids of each camera's frames are left out.
    pub left_out: Vec<bool>,
}

impl State {
    /// Cameras that have seen nothing yet. Their first frames set the formats.
    pub fn new(
        device: &Arc<Device>,
        sensors: Vec<SensorModel>,
        lenses: Vec<Option<Intrinsics>>,
        packets: Packets,
        tiled: bool,
    ) -> Result<Self, Fault> {
        Ok(State {
            threads: Threads::of(shares(&sensors).len(), sensors.len())?,
            together: tiled,
            banks: Vec::new(),
            left_out: Vec::new(),
            warnings: Warnings::default(),
            formats: Vec::new(),
            first_step: false,
            half_done: HalfDone::default(),
            last_ns: vec![None; sensors.len()],
            first_ns: vec![Some(i64::MIN); sensors.len()],
            sensors,
            lenses,
            packets,
            copies: Copies::default(),
            step_ns: 0,
            frames_ns: 0,
            spare: Vec::new(),
            device: Arc::clone(device),
        })
    }

    /// Begins to step the cameras that have a time: checks what is given and has the frames copied. [`State::end`]
    /// must follow, or the frames are lost. A first step that fails leaves the cameras as new.
    pub fn begin(
        &mut self,
        frames: &mut Frames,
        t_ns: &[Option<i64>],
        moving: &Moving<'_>,
        side: Option<&Arc<CudaSide>>,
    ) -> Result<Begun, Fault> {
        // One that was begun and never ended.
        self.undo_first(side)?;
        let begun = self.prepare(frames, t_ns, moving, side);
        if begun.is_err() {
            if let Some(side) = side {
                // The arrays are let go with the error, and CUDA may still copy from them.
                side.link().finish()?;
            }
            self.undo_first(side)?;
        }
        begun
    }

    /// An error if some banks have taken a step that others have refused.
    fn check_whole(&self) -> Result<(), Fault> {
        if self.half_done.is_none() {
            return Ok(());
        }
        let message = "the last step has failed for some of these cameras, and the others have taken it; expected the \
                       same times once more, a reset of all cameras, or restore()";
        Err(Fault::Argument(message.to_owned()))
    }

    /// Forgets what a first step has made, if it is not over.
    fn undo_first(&mut self, side: Option<&Arc<CudaSide>>) -> Result<(), Fault> {
        if !self.first_step {
            return Ok(());
        }
        if let Some(side) = side {
            // CUDA may still copy to the banks.
            side.link().finish()?;
        }
        self.banks.clear();
        self.formats.clear();
        self.first_step = false;
        self.half_done.clear();
        Ok(())
    }

    fn prepare(
        &mut self,
        frames: &mut Frames,
        t_ns: &[Option<i64>],
        moving: &Moving<'_>,
        side: Option<&Arc<CudaSide>>,
    ) -> Result<Begun, Fault> {
        let started = Instant::now();
        if !self.half_done.allows(t_ns) {
            self.check_whole()?;
        }
        for (camera, (last_ns, t_ns)) in self.last_ns.iter().zip(t_ns).enumerate() {
            if let Some(t_ns) = t_ns {
                frame::check_time(camera as u32, *last_ns, *t_ns)?;
            }
        }
        self.leave_out(frames, moving);
        let frames = &*frames;
        // Before the banks are made: depth needs a lens, which is checked here.
        let first_scenes = self.banks.is_empty().then(|| self.scenes(frames, t_ns, moving)).transpose()?;
        self.check_devices(frames, side)?;
        self.check_formats(frames)?;
        let on_device =
            (0..self.sensors.len()).any(|c| frames.of(c).is_some_and(|(images, _)| images.on_device()));
        let side = side.filter(|_| on_device);
        for bank in &mut self.banks {
            bank.bring(frames, t_ns, side.map(|side| side.link()).as_deref(), &mut self.copies)?;
        }
        // Scenes are made while a device copies.
        let scenes = match first_scenes {
            Some(scenes) => Ok(scenes),
            None => self.scenes(frames, t_ns, moving),
        };
        scenes.and_then(|scenes| self.set_scenes(scenes))?;
        let both = |(images, poses): (&Option<Images>, &Option<_>)| {
            images.as_ref().is_some_and(|images| images.motion.is_some()) && poses.is_some()
        };
        self.warnings.compares = frames.images.iter().zip(&moving.poses).any(both);
        Ok(Begun { started, on_device })
    }

    /// Steps the cameras with what [`State::begin`] has been given.
    pub fn end(
        &mut self,
        begun: Begun,
        frames: &Frames,
        t_ns: &[Option<i64>],
        side: Option<&Arc<CudaSide>>,
    ) -> Result<Events, Fault> {
        let started = begun.started;
        if let (true, Some(side)) = (begun.on_device, side) {
            side.link().finish()?;
        }
        self.frames_ns = started.elapsed().as_nanos() as u64;
        let half_done = &self.half_done;
        let results = self.threads.each(self.banks.iter_mut().collect(), |number, bank| {
            Ok(if half_done.has_taken(number) { Ok(()) } else { bank.step(frames, t_ns) })
        })?;
        if let Err(error) = self.half_done.note(t_ns, results) {
            self.undo_first(side)?;
            return Err(error);
        }
        self.first_step = false;
        for ((last_ns, first_ns), t_ns) in self.last_ns.iter_mut().zip(&mut self.first_ns).zip(t_ns) {
            *last_ns = t_ns.or(*last_ns);
            *first_ns = first_ns.or(*t_ns);
        }
        let events = self.events(side);
        self.step_ns = started.elapsed().as_nanos() as u64;
        events
    }

    fn events(&mut self, side: Option<&Arc<CudaSide>>) -> Result<Events, Fault> {
        if self.in_place() {
            let held = |bank: &Bank| bank.rig.last_tick().hold().expect("the rig keeps packets in place");
            return Ok(Events::Mapped(self.banks.iter().map(held).collect()));
        }
        let counts: Vec<u32> =
            self.banks.iter().flat_map(|bank| bank.rig.last_tick().events).copied().collect();
        let packets: Vec<Packet> = self.banks.iter_mut().flat_map(|bank| bank.rig.take_packets()).collect();
        if self.packets == Packets::Host {
            return Ok(Events::Host(packets));
        }
        let side = side.expect("packets on a device come with its side");
        let block = self.form_on_cuda(Representation::Gathered, side)?;
        Ok(Events::Cuda { block, headers: packets, counts })
    }

    /// Whether rigs leave packets where the device wrote them.
    fn in_place(&self) -> bool {
        self.packets != Packets::Cuda && (self.together || self.packets != Packets::Host)
    }

    fn rig_options(&self) -> RigOptions {
        let (packets, packet_ring) = match self.packets {
            Packets::Cuda => (PacketPlace::OnDevice, 1),
            Packets::Mapped { ring } => (PacketPlace::InPlace, ring),
            Packets::Host if self.in_place() => (PacketPlace::InPlace, 1),
            Packets::Host => (PacketPlace::Owned, 1),
        };
        RigOptions { packets, packet_ring, ..RigOptions::default() }
    }

    /// Number of events of each camera in the last step.
    pub fn event_counts(&self) -> Vec<usize> {
        let counts = self.banks.iter().flat_map(|bank| bank.rig.last_tick().events);
        counts.map(|&count| count as usize).collect()
    }

    /// Event frames, voxel grids or ids of the last step, in the same memory as packets.
    pub fn form(&mut self, what: Representation, side: Option<&Arc<CudaSide>>) -> Result<Form, Fault> {
        if self.banks.is_empty() {
            return Err(Fault::Argument("no frame has been stepped yet".to_owned()));
        }
        if what == Representation::EventIds && !self.banks.iter().any(|bank| bank.rig.knows_event_ids()) {
            let why = "the instances that events show are not known: there was no step since all cameras were reset, or \
                       since poses, a sensor or a state were set; expected a step right before";
            return Err(Fault::Argument(why.to_owned()));
        }
        if self.packets == Packets::Cuda {
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
        let target = block.memory()?.0.buffer();
        let mut before = 0;
        let shares: Vec<_> = self
            .banks
            .iter()
            .map(|bank| {
                let share = Share { before, all };
                before += bank.rig.elements(what);
                share
            })
            .collect();
        self.threads.each(self.banks.iter_mut().collect(), |number, bank| {
            Ok(bank.rig.represent(what, target, shares[number])?)
        })?;
        Ok(Arc::new(block))
    }

    /// Something of each camera's rig and its number there.
    fn of_each<T>(&self, of: impl Fn(&Rig, usize) -> Result<T, Fault>) -> Result<Vec<T>, Fault> {
        let cameras = self.banks.iter().flat_map(|bank| (0..bank.rig.len()).map(move |own| (&bank.rig, own)));
        cameras.map(|(rig, own)| of(rig, own)).collect()
    }

    /// The bank of a camera, and its number there.
    fn bank(&mut self, camera: usize) -> Result<Option<(&mut Bank, usize)>, Fault> {
        if camera >= self.sensors.len() {
            return Err(no_camera(camera, self.sensors.len()));
        }
        let bank = self.banks.iter_mut().find(|bank| bank.cameras.contains(&camera));
        Ok(bank.map(|bank| {
            let own = camera - bank.cameras.start;
            (bank, own)
        }))
    }

    /// Lets cameras begin anew.
    pub fn reset(&mut self, cameras: &[usize]) -> Result<(), Fault> {
        let count = self.sensors.len();
        if let Some(camera) = cameras.iter().find(|&&camera| camera >= count) {
            return Err(no_camera(*camera, count));
        }
        if !self.half_done.is_none() && (0..count).all(|camera| cameras.contains(&camera)) {
            self.half_done.clear();
        }
        self.check_whole()?;
        for bank in &mut self.banks {
            let own = cameras.iter().filter(|camera| bank.cameras.contains(camera));
            let own: Vec<usize> = own.map(|camera| camera - bank.cameras.start).collect();
            if !own.is_empty() {
                bank.rig.reset_some(&own)?;
                own.into_iter().for_each(|own| bank.restart_check(own));
            }
        }
        cameras.iter().for_each(|&camera| self.restart(camera));
        Ok(())
    }

    /// Sets the scenes of cameras, which are in ascending order.
    fn set_scenes(&mut self, scenes: Vec<(usize, SceneMotion)>) -> Result<(), Fault> {
        let mut scenes = scenes.into_iter().peekable();
        for bank in &mut self.banks {
            let mut own = Vec::with_capacity(scenes.len().min(bank.cameras.len()));
            while let Some((camera, scene)) = scenes.next_if(|(camera, _)| *camera < bank.cameras.end) {
                own.push((camera - bank.cameras.start, scene));
            }
            let past = bank.rig.set_scenes(own)?;
            self.spare.extend(past.into_iter().flat_map(SceneMotion::into_tracks).map(TrackMemory::from));
        }
        Ok(())
    }

    fn restart(&mut self, camera: usize) {
        if self.last_ns[camera].take().is_some() {
            self.first_ns[camera] = None;
        }
    }

    /// Changes a camera's parameters from its next step on.
    pub fn set_sensor(&mut self, camera: usize, sensor: SensorModel) -> Result<(), Fault> {
        let (format, is_checked) = (self.formats.get(camera).copied(), !self.together || camera == 0);
        self.warnings.look_soon();
        if let Some((bank, own)) = self.bank(camera)? {
            let before = bank.rig.sensor(own)?.synthesis;
            bank.rig.set_sensor(own, sensor.clone())?;
            if let Some(format) = format.filter(|_| is_checked)
                && bank.rig.sensor(own)?.synthesis != before
            {
                bank.check_input(own, format)?;
            }
            if bank.rig.is_at_start(own)? {
                self.restart(camera);
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

    /// Counts of the last step for each camera.
    pub fn diagnostics(&self) -> Vec<Diagnostics> {
        self.banks.iter().flat_map(|bank| bank.rig.last_tick().diagnostics).copied().collect()
    }

    /// APS frames of the last step, one for each camera.
    pub fn aps(&self) -> Vec<Option<ApsFrame>> {
        let of = |tick: &Tick<'_>, camera: usize| {
            let frame = tick.aps[camera].clone()?;
            Some(ApsFrame { pixels: tick.aps_pixels(camera).to_vec(), ..frame })
        };
        let of_bank = |bank: &Bank| {
            let tick = bank.rig.last_tick();
            (0..bank.rig.len()).map(|camera| of(&tick, camera)).collect::<Vec<_>>()
        };
        self.banks.iter().flat_map(of_bank).collect()
    }

    /// Times of the last step: the GPU's, from submit to packet, the whole, and of that the frames' way to the engine.
    /// Of several banks, which run at once, the longest counts.
    pub fn times_ns(&self) -> [u64; 4] {
        let longest = |of: fn(&Bank) -> u64| self.banks.iter().map(of).max().unwrap_or(0);
        // 0 where the device tells no times.
        let gpu_ns = longest(|bank| bank.rig.last_tick().gpu_ns().unwrap_or(0));
        let rigs = [gpu_ns, longest(|bank| bank.rig.last_tick().submit_to_packet_ns)];
        [rigs[0], rigs[1], self.step_ns, self.frames_ns]
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
        self.check_whole()?;
        let banks = self.banks.iter().map(|bank| Ok(bank.rig.save()?)).collect::<Result<_, Fault>>()?;
        Ok(Saved {
            banks,
            formats: self.formats.clone(),
            last_ns: self.last_ns.clone(),
            first_ns: self.first_ns.clone(),
            left_out: self.left_out.clone(),
        })
    }

    /// Takes up a saved state, of cameras with the same sensors.
    pub fn restore(&mut self, saved: Saved) -> Result<(), Fault> {
        let (expected, actual) = (self.sensors.len(), saved.formats.len());
        let others = [saved.last_ns.len(), saved.first_ns.len(), saved.left_out.len()];
        if actual != expected || others != [expected; 3] {
            return Err(Fault::Argument(format!("saved state of {actual} cameras, expected {expected}")));
        }
        let read = given::read_formats(&saved.formats, &saved.left_out);
        if (0..expected).any(|camera| read[camera].depth.is_some() && self.lenses[camera].is_none()) {
            let message = "saved state of cameras with depth, expected cameras made with intrinsics=";
            return Err(Fault::Argument(message.to_owned()));
        }
        let mut banks = self.new_banks(&read)?;
        if banks.len() != saved.banks.len() {
            let message = format!("saved state of {} rigs, expected {}", saved.banks.len(), banks.len());
            return Err(Fault::Argument(message));
        }
        for (bank, saved) in banks.iter_mut().zip(&saved.banks) {
            bank.rig.restore(saved)?;
        }
        (self.banks, self.formats, self.first_step) = (banks, saved.formats, false);
        self.half_done.clear();
        (self.last_ns, self.first_ns, self.left_out) = (saved.last_ns, saved.first_ns, saved.left_out);
        Ok(())
    }
}

fn no_camera(camera: usize, count: usize) -> Fault {
    Fault::Argument(format!("there are {count} cameras and no camera {camera}"))
}
