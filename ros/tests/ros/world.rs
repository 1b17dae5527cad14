//! A rig of random packets and images; subscribers to it are in [`peer`].

#[path = "peer.rs"]
mod peer;

pub use peer::*;

use esaac_model::packet::Event;
use esaac_model::paths::Intrinsics;
use esaac_model::{Packet, Polarity, SensorModel, random};
use esaac_ros::{ApsImage, BagWriter, CameraPlan, Imu, Payload, RigOptions, RigPublisher, Sinks};
#[cfg(feature = "embedded")]
use esaac_ros::{CycloneTransport, NetworkOptions};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Deadline of everything that should take less than a second.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// Waits until `is_so`, and fails with what `state` says if that takes too long.
pub fn wait_until(mut is_so: impl FnMut() -> bool, state: impl FnOnce() -> String) {
    let until = Instant::now() + PATIENCE;
    while !is_so() {
        if Instant::now() >= until {
            panic!("waited in vain: {}", state());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Waits until the rig has found so many subscribers of each topic. One that has found the rig may not have been found by it,
/// and would miss what is sent.
pub fn wait_for_subscribers(rig: &RigPublisher, topics: &[(String, String, &str)], count: u64) {
    let found = |topic: &esaac_ros::TopicSummary| {
        topic.subscribers >= count || topics.iter().all(|(name, _, _)| *name != topic.topic)
    };
    wait_until(|| rig.summary().topics.iter().all(found), || format!("{:?}", rig.summary()));
}

/// A domain that no other test has, and with some luck no other program.
pub fn domain() -> u32 {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    1 + (std::process::id() % 5) * 20 + NEXT.fetch_add(1, Ordering::Relaxed) % 20
}

/// Loopback on `domain`.
#[cfg(feature = "embedded")]
pub fn network(domain: u32) -> NetworkOptions {
    let options = NetworkOptions::from_environment(|_| None).expect("an empty environment");
    NetworkOptions { domain, localhost_only: true, ..options }
}

/// The embedded transport on loopback.
#[cfg(feature = "embedded")]
pub fn transport(domain: u32) -> CycloneTransport {
    CycloneTransport::open(network(domain)).expect("loopback is there")
}

/// A camera with all outputs but ids.
pub fn camera(name: &str, width: u32, height: u32) -> CameraPlan {
    let sensor = SensorModel { width, height, aps_exposure_ns: 1, aps_bits: 8, ..SensorModel::default() };
    let lens = Some(Intrinsics::pinhole(300.0, 301.0, 172.5, 129.5).unwrap());
    CameraPlan {
        name: name.to_owned(),
        sensor,
        lens,
        image: true,
        depth: true,
        imu: true,
        event_ids: false,
        split: esaac_ros::Split::default(),
        frame_id: None,
    }
}

/// Publishes `cameras` to `sinks`.
pub fn rig(cameras: &[CameraPlan], options: &RigOptions, sinks: Sinks) -> RigPublisher {
    RigPublisher::start(cameras.to_vec(), options.clone(), sinks).expect("a good plan")
}

/// A recording at `path`.
pub fn bag(path: &Path) -> BagWriter {
    BagWriter::create(path).expect("a file in a temporary folder")
}

fn number(seed: u32, index: u32, stream: u32) -> u32 {
    random::philox4x32_10([index, stream, 0, 0], [seed, 0])[0]
}

/// A packet of `events` random events in (`start_ns`, `end_ns`], in order.
pub fn packet(plan: &CameraPlan, start_ns: i64, end_ns: i64, events: u32, seed: u32) -> Packet {
    let sensor = &plan.sensor;
    let span = (end_ns - start_ns) as u32;
    let mut list: Vec<Event> = (0..events)
        .map(|i| Event {
            t_ns: start_ns + 1 + i64::from(number(seed, i, 0) % span),
            y: (number(seed, i, 1) % sensor.height) as u16,
            x: (number(seed, i, 2) % sensor.width) as u16,
            polarity: if number(seed, i, 3) & 1 == 1 { Polarity::On } else { Polarity::Off },
        })
        .collect();
    list.sort_unstable();
    let (width_px, height_px) = (sensor.width, sensor.height);
    let mut packet = Packet {
        width_px,
        height_px,
        base_ns: start_ns,
        watermark_ns: end_ns,
        dropped: u64::from(seed % 3),
        ..Packet::default()
    };
    list.into_iter().for_each(|event| packet.push(event));
    packet
}

/// Ids for the events of a packet: unknown ones, the static world's, and some that take more than 32 bits.
pub fn ids(packet: &Packet) -> Vec<i64> {
    (0..packet.len() as i64).map(|i| [-1, 0, 7, 5_000_000_000 + i][i as usize % 4]).collect()
}

/// One tick of every camera with everything that it has: events of `packets`, random images, IMU samples.
pub fn publish(rig: &mut RigPublisher, cameras: &[CameraPlan], packets: &[Packet], imu_samples: i64) {
    let (start_ns, end_ns) = (packets[0].base_ns, packets[0].watermark_ns);
    let mut tick = rig.tick(end_ns);
    for (number, (plan, packet)) in cameras.iter().zip(packets).enumerate() {
        let pixels = plan.sensor.pixels();
        let levels: Vec<u16> = (0..pixels).map(|i| (i as u16).wrapping_mul(31) & 0xff).collect();
        let depth: Vec<f32> =
            (0..pixels).map(|i| if i % 7 == 0 { f32::INFINITY } else { i as f32 }).collect();
        let samples: Vec<Imu> = (1..=imu_samples)
            .map(|i| Imu {
                t_ns: start_ns + (end_ns - start_ns) * i / imu_samples,
                angular_rate_rad_s: [0.1, -0.2, i as f64],
                specific_force_m_s2: [0.0, 0.5, 9.81],
            })
            .collect();
        if plan.event_ids {
            tick.events_with_ids(number, &packet.view(), &ids(packet));
        } else {
            tick.events(number, &packet.view());
        }
        let bits = plan.sensor.aps_bits;
        tick.aps(number, &ApsImage { pixels: &levels, bits, bayer: number % 2 == 1, t_ns: end_ns });
        tick.rgb(number, |out| out.extend((0..pixels * 3).map(|i| (i * 7) as u8)));
        tick.depth(number, &depth).imu(number, &samples);
    }
    tick.send();
}

/// FNV-1a, as the receiver computes it.
pub fn hash(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

/// Hash of a message as it is on the wire: with its padding.
pub fn wire_hash(message: &Payload) -> u64 {
    hash(message.padded())
}

/// Topics of a plan as subscribers name them, in its order.
pub fn topics(rig: &RigPublisher) -> Vec<(String, String, &'static str)> {
    let kind = |topic: &esaac_ros::Topic| match topic.qos.durability {
        esaac_ros::qos::Durability::TransientLocal => "reliable,transient_local",
        esaac_ros::qos::Durability::Volatile => "reliable",
    };
    rig.plan().topics.iter().map(|topic| (topic.name.clone(), topic.type_name.clone(), kind(topic))).collect()
}
