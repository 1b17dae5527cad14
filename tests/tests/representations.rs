//! Representations of packets computed on the device, compared with the packets themselves and with the oracle.

use esaac_engine::ash::vk;
use esaac_engine::{
    FrameBytes, InputBuffers, MOST_BINS, MemoryLocation, PacketPlace, Representation, Rig, RigOptions, Share,
    SubmitHooks, Tick,
};
use esaac_model::{HdrFormat, MotionFormat, Packet, SensorModel, Synthesis};
use esaac_oracle::represent::{event_frame, voxel_grid};
use esaac_scene::SceneKind;
use esaac_tests::device::{DEVICE, assert_silent};
use esaac_tests::frames::{Sequence, scene, times};
use esaac_tests::run::camera;

const SIZES: [(u32, u32); 3] = [(37, 23), (24, 16), (8, 8)];

/// A first frame and two intervals.
const FRAMES: usize = 3;

fn sensor((width, height): (u32, u32)) -> SensorModel {
    // The content of the packets does not matter here, so the fastest kernels will do.
    let synthesis = Synthesis::Linear;
    SensorModel {
        width,
        height,
        synthesis,
        contrast_on: 0.1,
        latency_ns: 3_000_000,
        aps_exposure_ns: 1_000_000,
        ..SensorModel::default()
    }
}

fn sequence((width, height): (u32, u32)) -> Sequence {
    let times_ns = times(5_000_000_000, FRAMES);
    scene(SceneKind::Flight, (width, height), &times_ns, HdrFormat::F16x4, MotionFormat::F32x2)
}

/// A rig of cameras of three sizes.
fn rig_of_three(options: RigOptions) -> (Rig, Vec<Sequence>) {
    let sequences: Vec<Sequence> = SIZES.into_iter().map(sequence).collect();
    let configs: Vec<_> = (0..)
        .zip(SIZES.into_iter().zip(&sequences))
        .map(|(number, (size, frames))| camera(&sensor(size), number, frames))
        .collect();
    (Rig::with_options(&DEVICE, &configs, options).expect("a rig"), sequences)
}

/// Steps all cameras to frame `index`.
fn tick<'a>(rig: &'a mut Rig, sequences: &[Sequence], index: usize) -> Tick<'a> {
    for (number, sequence) in sequences.iter().enumerate() {
        let frame = &sequence.frames[index];
        rig.upload(
            number,
            &FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref(), ..FrameBytes::default() },
        )
        .expect("a frame");
    }
    let times_ns: Vec<i64> = sequences.iter().map(|s| s.frames[index].t_ns).collect();
    rig.step(&times_ns).expect("a tick")
}

/// Steps all cameras to frame `index`, and returns the packets.
fn step(rig: &mut Rig, sequences: &[Sequence], index: usize) -> (Vec<Packet>, Vec<u32>) {
    let tick = tick(rig, sequences, index);
    (tick.packets.to_vec(), tick.events.to_vec())
}

fn cast<T: bytemuck::Pod>(bytes: &[u8]) -> Vec<T> {
    bytemuck::pod_collect_to_vec(bytes)
}

/// The packets of all cameras in the layout in which the device writes them.
fn gathered(packets: &[Packet]) -> Vec<u8> {
    let all = || packets.iter().flat_map(Packet::iter);
    let mut bytes: Vec<u8> = all().flat_map(|e| e.t_ns.to_le_bytes()).collect();
    bytes.extend(all().flat_map(|e| e.x.to_le_bytes()));
    bytes.extend(all().flat_map(|e| e.y.to_le_bytes()));
    bytes.extend(all().map(|e| e.polarity as u8));
    bytes
}

#[test]
fn packets_of_all_cameras_are_gathered_one_after_the_other_in_full() {
    let (mut rig, sequences) = rig_of_three(RigOptions::default());
    let mut events = 0;
    for index in 0..FRAMES {
        let (packets, counts) = step(&mut rig, &sequences, index);
        assert_eq!(counts, packets.iter().map(|p| p.len() as u32).collect::<Vec<_>>());
        let actual = rig.represent_to_host(Representation::Gathered).expect("the tick's events");
        assert_eq!(actual, gathered(&packets), "frame {index}");
        events += packets.iter().map(Packet::len).sum::<usize>();
    }
    assert!(events > 300, "{events}");
    drop(rig);
    assert_silent();
}

#[test]
fn a_reset_leaves_those_of_the_last_tick() {
    let sequences: Vec<Sequence> = SIZES.into_iter().map(sequence).collect();
    let configs: Vec<_> = (0..)
        .zip(SIZES.into_iter().zip(&sequences))
        .map(|(number, (size, frames))| {
            // The packet's base is the start of the interval in whole quanta, so before it.
            camera(&SensorModel { timestamp_quantum_ns: 7_000_000, ..sensor(size) }, number, frames)
        })
        .collect();
    let mut rig = Rig::new(&DEVICE, &configs).expect("a rig");
    for index in 0..FRAMES {
        step(&mut rig, &sequences, index);
    }
    let kinds = [Representation::Gathered, Representation::EventFrame, Representation::VoxelGrid { bins: 5 }];
    let all = |rig: &mut Rig| kinds.map(|what| rig.represent_to_host(what).expect("its bytes"));
    let before = all(&mut rig);
    assert!(rig.elements(Representation::Gathered) > 100);
    rig.reset_some(&[0, 2]).expect("a reset");
    assert_eq!(all(&mut rig), before);
    drop(rig);
    assert_silent();
}

#[test]
fn packets_kept_on_the_device_are_those_that_the_host_would_have() {
    let (mut host, sequences) = rig_of_three(RigOptions::default());
    // Buffers that are too small at first, so that they grow on the device.
    let options = RigOptions { packets: PacketPlace::OnDevice, initial_events: 64, ..RigOptions::default() };
    let (mut on_device, _) = rig_of_three(options);
    for index in 0..FRAMES {
        let (expected, counts) = step(&mut host, &sequences, index);
        let (headers, on_device_counts) = step(&mut on_device, &sequences, index);
        assert_eq!(counts, on_device_counts);
        assert!(headers.iter().all(Packet::is_empty));
        assert_eq!(headers[0].base_ns, expected[0].base_ns);
        let actual = on_device.represent_to_host(Representation::Gathered).expect("the tick's events");
        assert_eq!(actual, gathered(&expected), "frame {index}");
    }
    drop((host, on_device));
    assert_silent();
}

#[test]
fn packets_and_aps_frames_seen_in_place_are_those_that_are_copied() {
    let (mut owning, sequences) = rig_of_three(RigOptions::default());
    // Buffers that are too small at first: those of one camera grow while another camera's packet lies there already.
    let options = RigOptions { packets: PacketPlace::InPlace, initial_events: 64, ..RigOptions::default() };
    let (mut in_place, _) = rig_of_three(options);
    let mut grown = 0;
    for index in 0..FRAMES {
        let expected = tick(&mut owning, &sequences, index);
        let actual = tick(&mut in_place, &sequences, index);
        for camera in 0..SIZES.len() {
            let (copied, seen) = (expected.view(camera), actual.view(camera));
            assert_eq!(seen.to_packet(), expected.packets[camera], "frame {index}, camera {camera}");
            assert_eq!((copied.host_copies, seen.host_copies), (1, 0));
            assert_eq!(actual.aps_pixels(camera), expected.aps_pixels(camera));
            assert!(actual.packets[camera].is_empty());
            assert!(actual.aps[camera].as_ref().is_none_or(|frame| frame.pixels.is_empty()));
            assert_eq!(actual.aps_pixels(camera).is_empty(), index == 0);
            grown += actual.diagnostics[camera].regrown;
        }
    }
    assert!(grown > 0);
    drop((owning, in_place));
    assert_silent();
}

#[test]
fn event_frames_and_voxel_grids_are_the_oracles() {
    let (mut rig, sequences) = rig_of_three(RigOptions::default());
    let mut before_ns = None;
    for index in 0..FRAMES {
        let (packets, _) = step(&mut rig, &sequences, index);
        let t_ns = sequences[0].frames[index].t_ns;
        let frames: Vec<i32> = cast(&rig.represent_to_host(Representation::EventFrame).expect("frames"));
        assert_eq!(frames, packets.iter().flat_map(event_frame).collect::<Vec<_>>(), "frame {index}");
        for bins in [1, 2, 5] {
            let what = Representation::VoxelGrid { bins };
            let grid: Vec<f32> = cast(&rig.represent_to_host(what).expect("a grid"));
            let start_ns = before_ns.unwrap_or(t_ns - 1);
            let expected: Vec<f32> =
                packets.iter().flat_map(|p| voxel_grid(p, bins as usize, start_ns, t_ns)).collect();
            assert_eq!(grid, expected, "frame {index}, {bins} bins");
        }
        before_ns = Some(t_ns);
    }
    drop(rig);
    assert_silent();
}

#[test]
fn voxel_grids_of_no_bins_or_too_many_are_refused() {
    let (mut rig, sequences) = rig_of_three(RigOptions::default());
    step(&mut rig, &sequences, 0);
    for bins in [0, MOST_BINS + 1, 1 << 18, u32::MAX] {
        let error = rig.represent_to_host(Representation::VoxelGrid { bins }).expect_err("a number of bins");
        assert_eq!(error.to_string(), format!("{bins} bins, expected 1 to 256"));
    }
    let pixels: u64 = SIZES.iter().map(|(width, height)| u64::from(width * height)).sum();
    let most = rig.represent_to_host(Representation::VoxelGrid { bins: MOST_BINS }).expect("a grid");
    assert_eq!(most.len() as u64, 4 * u64::from(MOST_BINS) * pixels);
    drop(rig);
    assert_silent();
}

#[test]
fn two_rigs_share_a_target() {
    let (mut a, sequences) = rig_of_three(RigOptions::default());
    let (mut b, _) = rig_of_three(RigOptions::default());
    let mut both = (Vec::new(), Vec::new());
    for index in 0..FRAMES {
        both = (step(&mut a, &sequences, index).0, step(&mut b, &sequences, index).0);
    }
    let events = a.elements(Representation::Gathered);
    let all = events + b.elements(Representation::Gathered);
    let target = DEVICE
        .allocate("target", 13 * all, vk::BufferUsageFlags::empty(), MemoryLocation::GpuToCpu)
        .expect("a target");
    a.represent(Representation::Gathered, &target, Share { before: 0, all }).expect("the first half");
    b.represent(Representation::Gathered, &target, Share { before: events, all }).expect("the second");
    let expected = gathered(&[both.0, both.1].concat());
    assert_eq!(target.read::<u8>(0, expected.len()), expected);
    let error = a.represent(Representation::EventFrame, &target, Share { before: all * 13, all: 0 });
    assert!(error.unwrap_err().to_string().contains("target"));
    drop((a, b, target));
    assert_silent();
}

#[test]
fn tiles_in_one_buffer_are_the_cameras_frames() {
    let (size, count) = (SIZES[0], 3_usize);
    let frames = sequence(size);
    let configs: Vec<_> = (0..count as u32).map(|number| camera(&sensor(size), number, &frames)).collect();
    let mut apart = Rig::new(&DEVICE, &configs).expect("a rig");
    let mut tiled = Rig::new(&DEVICE, &configs).expect("a rig");
    // Each camera gets other frames of the sequence, so that mixed-up cameras are found.
    for index in 0..2 {
        let of_camera = |number: usize| &frames.frames[(index + number) % FRAMES];
        let tiles = |image: fn(&esaac_tests::frames::Frame) -> &[u8]| {
            let bytes: Vec<u8> = (0..count).flat_map(|number| image(of_camera(number)).to_vec()).collect();
            let mut buffer = DEVICE
                .allocate("tiles", bytes.len() as u64, Default::default(), MemoryLocation::CpuToGpu)
                .expect("a buffer");
            buffer.write(0, &bytes);
            buffer
        };
        for number in 0..count {
            let frame = of_camera(number);
            apart
                .upload(
                    number,
                    &FrameBytes { hdr: &frame.hdr, motion: frame.motion.as_deref(), ..FrameBytes::default() },
                )
                .expect("a frame");
        }
        let times_ns = vec![frames.frames[index].t_ns; count];
        let expected = apart.step(&times_ns).expect("a tick").packets.to_vec();
        let (hdr, motion) = (tiles(|f| &f.hdr), tiles(|f| f.motion.as_deref().expect("motion")));
        let inputs = InputBuffers { hdr: &hdr, motion: Some(&motion), depth: None, ids: None };
        let times_ns: Vec<_> = times_ns.into_iter().map(Some).collect();
        tiled.step_tiles(&times_ns, inputs, &SubmitHooks::default()).expect("a tick");
        assert_eq!(tiled.take_packets(), expected, "frame {index}");
        // One camera alone goes on.
        let later_ns = [None, times_ns[1].map(|t_ns| t_ns + 1_000_000), None];
        let expected = apart.step_some(&later_ns).expect("a tick").packets.to_vec();
        tiled.step_tiles(&later_ns, inputs, &SubmitHooks::default()).expect("a tick");
        assert_eq!(tiled.take_packets(), expected, "frame {index}, one camera");
        let error =
            tiled.step_tiles(&times_ns[1..], inputs, &SubmitHooks::default()).map(|_| ()).unwrap_err();
        assert!(error.to_string().contains("2 frames for 3 cameras"), "{error}");
    }
    drop((apart, tiled));
    assert_silent();
}
