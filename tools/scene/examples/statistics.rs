//! Prints motion, events and radiance of a scene over time: `statistics NAME WIDTH HEIGHT`.

use esaac_model::SensorModel;
use esaac_scene::{SceneKind, all_pixels, exact_events};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, width, height] = arguments.as_slice() else {
        return Err("usage: statistics NAME WIDTH HEIGHT".into());
    };
    let scene = name.parse::<SceneKind>()?.scene(width.parse()?, height.parse()?);
    let sensor = SensorModel::default();
    println!("time_s  motion_px(median, p99)  events/px  radiance(min, max)  ns/px");
    for second in 0..20 {
        let t0_ns = i64::from(second) * 1_000_000_000;
        let t1_ns = t0_ns + 33_333_333;
        let (previous, view) = (scene.view(t0_ns as f64 * 1e-9), scene.view(t1_ns as f64 * 1e-9));
        let pixels: Vec<(u32, u32)> = all_pixels(&scene).step_by(37).collect();
        let mut motion_px = Vec::new();
        let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
        for &(x, y) in &pixels {
            let sample = view.sample(f64::from(x), f64::from(y));
            let [dx, dy] = view.motion(&sample, &previous);
            motion_px.push(dx.hypot(dy));
            low = low.min(sample.radiance.min_element());
            high = high.max(sample.radiance.max_element());
        }
        motion_px.sort_by(f64::total_cmp);
        let start = std::time::Instant::now();
        let events: usize = exact_events(&scene, &sensor, &pixels, t0_ns, t1_ns).iter().map(Vec::len).sum();
        println!(
            "{second:6}  {:6.2} {:6.2}  {:9.3}  {low:9.4} {high:9.1}  {:7}",
            motion_px[motion_px.len() / 2],
            motion_px[motion_px.len() * 99 / 100],
            events as f64 / pixels.len() as f64,
            start.elapsed().as_nanos() / pixels.len() as u128,
        );
    }
    Ok(())
}
