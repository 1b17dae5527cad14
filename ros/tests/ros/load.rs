//! Eight cameras with events, APS frames, depth and IMU, and one whose packets are of a 960th second: what is
//! lost, and what it costs. `ESAAC_ROS_LOAD_SECONDS=60` makes the run as long as it should be to mean
//! something; without it it is short. `--nocapture --test-threads=1` shows the figures.

use crate::world::{self, Subscriber, Taken};
use esaac_model::Packet;
use esaac_ros::histogram::Histogram;
use esaac_ros::{ApsImage, CameraPlan, Imu, RigOptions, Sinks, Split, Transport};
use std::collections::BTreeMap;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

const INTERVAL_NS: i64 = 33_333_333;
const CAMERAS: usize = 8;
/// Events of a packet: 600 000 a second and camera.
const EVENTS: u32 = 20_000;
const IMU_SAMPLES: i64 = 34;

/// Processor time of this process's other threads, and of this one.
fn processor_time() -> (Duration, Duration) {
    let ticks = |text: String| -> u64 {
        let fields: Vec<&str> = text.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
        [11, 12].iter().filter_map(|&field| fields.get(field)?.parse::<u64>().ok()).sum()
    };
    let of = |path: &str| ticks(std::fs::read_to_string(path).unwrap_or_default());
    // A tick is a hundredth of a second on every Linux.
    let [all, own] =
        [of("/proc/self/stat"), of("/proc/thread-self/stat")].map(|t| Duration::from_millis(10 * t));
    (all.saturating_sub(own), own)
}

fn cameras() -> Vec<CameraPlan> {
    let mut cameras: Vec<CameraPlan> = (0..CAMERAS)
        .map(|n| CameraPlan { image: false, ..world::camera(&format!("camera_{n}"), 346, 260) })
        .collect();
    let mut fast = world::camera("fast", 346, 260);
    fast.sensor.aps_exposure_ns = 0;
    let split = Split { slice_ns: 1_041_667, max_bytes: 0 };
    cameras.push(CameraPlan { image: false, depth: false, imu: false, split, ..fast });
    cameras
}

#[test]
fn eight_cameras_and_one_at_960_packets_a_second_lose_nothing() {
    let seconds: i64 = match std::env::var("ESAAC_ROS_LOAD_SECONDS") {
        Ok(text) => text.parse().expect("a number of seconds"),
        Err(_) => 3,
    };
    let domain = world::domain();
    let cameras = cameras();
    let transport: Option<Box<dyn Transport>> = Some(Box::new(world::transport(domain)));
    let options = RigOptions { policy: esaac_ros::Policy::Lossless, ..RigOptions::default() };
    let mut rig = world::rig(&cameras, &options, Sinks { transport, bag: None });
    let topics: Vec<_> = world::topics(&rig)
        .into_iter()
        .filter(|(name, _, _)| name.starts_with("/esaac/") && !name.ends_with("/sensor"))
        .collect();
    let subscriber = Subscriber { hashes: false, ..Subscriber::on(domain) }.start(&topics);
    subscriber.wait_until_matched(topics.len());

    let mut packets: Vec<Packet> =
        (0..).zip(&cameras).map(|(seed, plan)| world::packet(plan, 0, INTERVAL_NS, EVENTS, seed)).collect();
    let aps = vec![100_u16; cameras[0].sensor.pixels()];
    let depth_m = vec![1.5_f32; cameras[0].sensor.pixels()];
    let ticks = seconds * 30;
    let (mut ready_ns, mut encode) = (BTreeMap::new(), Histogram::default());
    let (before, began) = (processor_time(), Instant::now());
    for tick in 0..ticks {
        let due = began + Duration::from_nanos((tick * INTERVAL_NS) as u64);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let (start, end) = (tick * INTERVAL_NS, (tick + 1) * INTERVAL_NS);
        let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970");
        ready_ns.insert(end, now.as_nanos() as i64);
        let encoding = Instant::now();
        let mut messages = rig.tick(end);
        for (camera, packet) in packets.iter_mut().enumerate() {
            (packet.base_ns, packet.watermark_ns) = (start, end);
            messages.events(camera, &packet.view());
            messages.aps(camera, &ApsImage { pixels: &aps, bits: 8, bayer: false, t_ns: end });
            messages.depth(camera, &depth_m);
            let imu: Vec<Imu> = (1..=IMU_SAMPLES)
                .map(|i| Imu { t_ns: start + INTERVAL_NS * i / IMU_SAMPLES, ..Imu::default() })
                .collect();
            messages.imu(camera, &imu);
        }
        messages.send();
        encode.add(encoding.elapsed().as_nanos() as u64);
    }
    let (took, after) = (began.elapsed(), processor_time());
    let (summary, _, _) = rig.finish();
    let taken = world::taken(&subscriber.finish());

    let mut latency = Histogram::default();
    let (mut lost, mut reordered) = (0, 0);
    for (number, (name, _, _)) in topics.iter().enumerate() {
        let of_topic: Vec<&Taken> = taken.iter().filter(|t| t.topic == number).collect();
        let sent = summary.topics.iter().find(|t| t.topic == *name).expect("a topic of the plan").sent;
        lost += sent as i64 - of_topic.len() as i64;
        reordered += of_topic.windows(2).filter(|pair| pair[1].stamp_ns < pair[0].stamp_ns).count();
        for message in &of_topic {
            if let Some(ready) = ready_ns.get(&message.stamp_ns) {
                latency.add((message.at_ns - ready).max(0) as u64);
            }
        }
    }
    let bytes: u64 = summary.topics.iter().map(|t| t.bytes).sum();
    let share = |a: Duration, b: Duration| 100.0 * (a - b).as_secs_f64() / took.as_secs_f64();
    let us = |ns: u64| ns as f64 * 1e-3;
    println!(
        "{seconds} s, {} messages, {:.0} MB/s: {lost} lost, {reordered} reordered\n\
         publish call p50 {:.0} us, p99 {:.0} us; encoding a tick p50 {:.0} us, p99 {:.0} us\n\
         from packet in host memory to subscriber p50 {:.0} us, p99 {:.0} us\n\
         processor: publishing {:.0}% of a core, encoding and making up the tick {:.0}%",
        summary.sent(),
        bytes as f64 * 1e-6 / took.as_secs_f64(),
        us(summary.publish_p50_ns),
        us(summary.publish_p99_ns),
        us(encode.quantile(0.5)),
        us(encode.quantile(0.99)),
        us(latency.quantile(0.5)),
        us(latency.quantile(0.99)),
        share(after.0, before.0),
        share(after.1, before.1),
    );
    assert_eq!((summary.lost(), lost, reordered), (0, 0, 0));
    let fast = summary.topics.iter().find(|t| t.topic == "/esaac/fast/events").expect("a topic of the plan");
    assert_eq!(fast.sent, ticks as u64 * 32);
}
