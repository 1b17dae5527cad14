//! What publishing by the node costs beside the embedded transport, in one run; `--nocapture` shows it.

use crate::{node, world};
use esaac_ros::{RigOptions, Sinks, Summary, Transport};
use std::time::{Duration, Instant};

const INTERVAL: Duration = Duration::from_nanos(33_333_333);
const TICKS: u32 = 60;
/// 9 bytes each.
const EVENTS: u32 = 50_000;

/// Images of 4.1 MB and packets of 0.45 MB at 30 Hz, to one subscriber that gets all of them.
fn publish(open: impl FnOnce(u32) -> Box<dyn Transport>) -> Summary {
    let domain = world::domain();
    let camera = world::camera("large", 1440, 960);
    let sinks = Sinks { transport: Some(open(domain)), bag: None };
    let mut rig = world::rig(std::slice::from_ref(&camera), &RigOptions::default(), sinks);
    let wanted = ["/esaac/large/image_raw", "/esaac/large/events"];
    let topics: Vec<_> =
        world::topics(&rig).into_iter().filter(|(name, _, _)| wanted.contains(&name.as_str())).collect();
    let reader = world::Subscriber { hashes: false, ..world::Subscriber::on(domain) }.start(&topics);
    reader.wait_until_matched(topics.len());
    let mut packet = world::packet(&camera, 0, INTERVAL.as_nanos() as i64, EVENTS, 1);
    let pixels = vec![7; camera.sensor.pixels() * 3];
    let began = Instant::now();
    for number in 0..TICKS {
        std::thread::sleep((began + INTERVAL * number).saturating_duration_since(Instant::now()));
        packet.base_ns = (INTERVAL * number).as_nanos() as i64;
        packet.watermark_ns = (INTERVAL * (number + 1)).as_nanos() as i64;
        let mut tick = rig.tick(packet.watermark_ns);
        tick.events(0, &packet.view()).rgb(0, |out| out.extend_from_slice(&pixels));
        tick.send();
    }
    let (summary, _, _) = rig.finish();
    let taken = world::taken(&reader.finish());
    assert_eq!((summary.lost(), taken.len()), (0, topics.len() * TICKS as usize));
    summary
}

fn tell(name: &str, summary: &Summary) {
    let us = |ns: u64| ns as f64 * 1e-3;
    println!(
        "{name}: {} copies a message; a tick p50 {:.0} us, p99 {:.0} us; publish call p99 {:.0} us",
        summary.copies.wire,
        us(summary.tick_p50_ns),
        us(summary.tick_p99_ns),
        us(summary.publish_p99_ns),
    );
}

#[test]
fn large_messages_arrive_and_cost_what_is_told() {
    tell("rclrs", &publish(|domain| Box::new(node::open(domain, &[]).unwrap())));
    #[cfg(feature = "embedded")]
    tell("embedded", &publish(|domain| Box::new(world::transport(domain))));
}
