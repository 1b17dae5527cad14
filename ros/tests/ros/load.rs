//! Cost, losses and latency of publishing: one camera, eight cameras, and eight cameras with all outputs plus
//! one with 960 packets per second. The runs are short; `ESAAC_ROS_LOAD_SECONDS=60` makes them long enough for
//! reliable figures, and `--nocapture --test-threads=1` shows these.

use crate::world::{self, Subscriber, Taken};
use esaac_model::Packet;
use esaac_ros::histogram::Histogram;
use esaac_ros::{ApsImage, CameraPlan, Imu, Policy, RigOptions, Sinks, Split, Transport, host};
use std::collections::BTreeMap;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

const INTERVAL_NS: i64 = 33_333_333;
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

/// Memory of this process, MB.
fn memory_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or_default();
    let kib = line.split_whitespace().next().and_then(|kib| kib.parse::<f64>().ok());
    kib.unwrap_or_default() * 1.024e-3
}

fn camera(name: &str) -> CameraPlan {
    CameraPlan { image: false, ..world::camera(name, 346, 260) }
}

/// The same camera without APS frames, depth and IMU.
fn events_only(mut camera: CameraPlan) -> CameraPlan {
    camera.sensor.aps_exposure_ns = 0;
    CameraPlan { depth: false, imu: false, ..camera }
}

fn eight() -> Vec<CameraPlan> {
    (0..8).map(|n| camera(&format!("camera_{n}"))).collect()
}

/// One tick of all cameras at `end_ns`, with what each of them has.
fn publish(rig: &mut esaac_ros::RigPublisher, cameras: &[CameraPlan], packets: &mut [Packet], end_ns: i64) {
    let start_ns = end_ns - INTERVAL_NS;
    let mut messages = rig.tick(end_ns);
    for (camera, (plan, packet)) in cameras.iter().zip(packets).enumerate() {
        let (aps, depth_m) = (vec![100_u16; plan.sensor.pixels()], vec![1.5_f32; plan.sensor.pixels()]);
        let imu: Vec<Imu> = (1..=IMU_SAMPLES)
            .map(|i| Imu { t_ns: start_ns + INTERVAL_NS * i / IMU_SAMPLES, ..Imu::default() })
            .collect();
        (packet.base_ns, packet.watermark_ns) = (start_ns, end_ns);
        messages.events(camera, &packet.view());
        messages.aps(camera, &ApsImage { pixels: &aps, bits: 8, bayer: false, t_ns: end_ns });
        messages.depth(camera, &depth_m).imu(camera, &imu);
    }
    messages.send();
}

/// The kind of a topic, for the table of latencies.
fn kind(topic: &str) -> &'static str {
    let kinds = [("/events", "events"), ("/image_raw", "images"), ("/camera_info", "info"), ("/imu", "imu")];
    kinds.iter().find(|(end, _)| topic.ends_with(end)).expect("a topic of a camera").1
}

/// Publishes `cameras` at 30 Hz; returns messages sent by topic.
fn run(cameras: &[CameraPlan], policy: Policy) -> BTreeMap<String, u64> {
    let seconds: i64 = match std::env::var("ESAAC_ROS_LOAD_SECONDS") {
        Ok(text) => text.parse().expect("a number of seconds"),
        Err(_) => 3,
    };
    let domain = world::domain();
    let transport: Option<Box<dyn Transport>> = Some(Box::new(world::transport(domain)));
    let options = RigOptions { policy, ..RigOptions::default() };
    let mut rig = world::rig(cameras, &options, Sinks { transport, bag: None });
    let topics: Vec<_> = world::topics(&rig)
        .into_iter()
        .filter(|(name, _, _)| name.starts_with("/esaac/") && !name.ends_with("/sensor"))
        .collect();
    let subscriber = Subscriber { hashes: false, ..Subscriber::on(domain) }.start(&topics);
    subscriber.wait_until_matched(topics.len());
    world::wait_for_subscribers(&rig, &topics, 1);

    let mut packets: Vec<Packet> =
        (0..).zip(cameras).map(|(seed, plan)| world::packet(plan, 0, INTERVAL_NS, EVENTS, seed)).collect();
    let (mut ready_ns, mut encode) = (BTreeMap::new(), Histogram::default());
    let datagrams_lost = host::datagrams_lost();
    let (before, began) = (processor_time(), Instant::now());
    for tick in 0..seconds * 30 {
        let due = began + Duration::from_nanos((tick * INTERVAL_NS) as u64);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("after 1970");
        let end_ns = (tick + 1) * INTERVAL_NS;
        ready_ns.insert(end_ns, now.as_nanos() as i64);
        let encoding = Instant::now();
        publish(&mut rig, cameras, &mut packets, end_ns);
        encode.add(encoding.elapsed().as_nanos() as u64);
    }
    let (took, after, memory_mb) = (began.elapsed(), processor_time(), memory_mb());
    let (summary, _, _) = rig.finish();
    let taken = world::taken(&subscriber.finish());

    let mut latencies: BTreeMap<&str, Histogram> = BTreeMap::new();
    let (mut lost, mut reordered) = (0, 0);
    for (number, (name, _, _)) in topics.iter().enumerate() {
        let of_topic: Vec<&Taken> = taken.iter().filter(|t| t.topic == number).collect();
        let sent = summary.topics.iter().find(|t| t.topic == *name).expect("a topic of the plan").sent;
        lost += sent as i64 - of_topic.len() as i64;
        reordered += of_topic.windows(2).filter(|pair| pair[1].stamp_ns < pair[0].stamp_ns).count();
        for message in &of_topic {
            if let Some(ready) = ready_ns.get(&message.stamp_ns) {
                latencies.entry(kind(name)).or_default().add((message.at_ns - ready).max(0) as u64);
            }
        }
    }
    let bytes: u64 = summary.topics.iter().map(|t| t.bytes).sum();
    let share = |a: Duration, b: Duration| 100.0 * (a - b).as_secs_f64() / took.as_secs_f64();
    let datagrams =
        host::datagrams_lost().zip(datagrams_lost).map_or(0, |(after, before)| after.saturating_sub(before));
    let ms = |ns: u64| ns as f64 * 1e-6;
    println!(
        "\n{seconds} s, {} messages, {:.0} MB/s: {lost} lost, {reordered} reordered, {datagrams} datagrams sent \
         again\npublish call p50 {:.0} us, p99 {:.0} us; making up and encoding a tick p50 {:.2} ms, p99 {:.2} \
         ms\nprocessor: publishing {:.0}% of a core, making up and encoding {:.0}%; memory {memory_mb:.0} MB",
        summary.sent(),
        bytes as f64 * 1e-6 / took.as_secs_f64(),
        summary.publish_p50_ns as f64 * 1e-3,
        summary.publish_p99_ns as f64 * 1e-3,
        ms(encode.quantile(0.5)),
        ms(encode.quantile(0.99)),
        share(after.0, before.0),
        share(after.1, before.1),
    );
    for (kind, latency) in latencies {
        let [p50, p99, most] = [0.5, 0.99, 1.0].map(|share| ms(latency.quantile(share)));
        println!(
            "from host memory to subscriber: {kind:6} p50 {p50:6.2} ms, p99 {p99:6.2} ms, max {most:6.2} ms"
        );
    }
    assert_eq!((summary.lost(), lost, reordered), (0, 0, 0));
    summary.topics.into_iter().map(|topic| (topic.topic, topic.sent)).collect()
}

#[test]
fn one_camera_loses_nothing() {
    run(&[events_only(camera("camera_0"))], Policy::Lossless);
}

#[test]
fn eight_cameras_lose_nothing() {
    let cameras: Vec<CameraPlan> = eight().into_iter().map(events_only).collect();
    run(&cameras, Policy::Lossless);
}

#[test]
fn eight_cameras_with_all_and_one_at_960_packets_a_second_lose_nothing() {
    let split = Split { slice_ns: 1_041_667, max_bytes: 0 };
    let mut cameras = eight();
    cameras.push(CameraPlan { split, ..events_only(camera("fast")) });
    let sent = run(&cameras, Policy::Lossless);
    assert_eq!(sent["/esaac/fast/events"], sent["/esaac/camera_0/events"] * 32);
}
