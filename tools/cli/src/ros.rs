//! ROS 2 flags, and publishing and recording what a command simulates.

use crate::ros_network::{NetworkArguments, TransportName};
use anyhow::{Context, Result};
use clap::ValueEnum;
use esaac_engine::{Rig, Tick};
use esaac_model::{Intensity, SensorModel};
use esaac_ros::qos::QosError;
use esaac_ros::{
    ApsImage, BagWriter, CameraPlan, EventFormat, Imu, Intrinsics, Plan, Policy, QosChange, RigOptions,
    RigPublisher, SensorParameters, Sinks, Split, Summary, TickMessages,
};
use std::path::PathBuf;

/// Whether to publish.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RosMode {
    /// Where there is a network; else with a warning and without ROS
    Auto,
    /// It is an error if there is no network
    On,
    /// No
    Off,
}

/// What gives way while messages wait to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PolicyName {
    /// The oldest tick, which is counted
    Latest,
    /// The simulation
    Lossless,
}

/// What stamps count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TimeName {
    /// Simulated time, told on /clock (use_sim_time)
    Sim,
    /// Wall-clock time
    Wall,
}

/// Flags of commands that simulate.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "ROS 2")]
pub struct RosArguments {
    /// Publish ROS 2 topics [demo: auto, others: off]
    #[arg(long, value_name = "WHEN")]
    pub ros: Option<RosMode>,
    /// Record all topics as a rosbag2 MCAP file, published or not
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Namespace of all cameras
    #[arg(long, value_name = "NAME", default_value = "/esaac")]
    pub ros_namespace: String,
    /// Event messages: packed, plain (esaac_msgs), evt3, mono (event_camera_msgs)
    #[arg(long, value_name = "FORMAT", default_value = "packed")]
    pub ros_events: EventFormat,
    /// A packet for each so many nanoseconds; 0 for one an interval
    #[arg(long, value_name = "ns", default_value_t = 0)]
    pub ros_slice_ns: u32,
    /// Most bytes of events in a message; 0 for any number
    #[arg(long, value_name = "BYTES", default_value_t = 0)]
    pub ros_max_bytes: u32,
    /// Quality of service, as in events=best_effort,depth:10; `all` is every topic
    #[arg(long, value_name = "TOPIC=QOS", value_parser = qos)]
    pub ros_qos: Vec<(String, QosChange)>,
    /// What gives way while messages wait [latest; lossless with --record]
    #[arg(long, value_name = "POLICY")]
    pub ros_policy: Option<PolicyName>,
    /// Stamps
    #[arg(long, value_name = "CLOCK", default_value = "sim")]
    pub ros_time: TimeName,
    /// Network.
    #[command(flatten)]
    pub network: NetworkArguments,
}

fn qos(text: &str) -> Result<(String, QosChange), String> {
    let (topic, words) = text.split_once('=').ok_or("expected TOPIC=QOS")?;
    Ok((topic.trim_matches('/').to_owned(), words.parse().map_err(|error: QosError| error.to_string())?))
}

/// Samples a second of an IMU, at the least.
const IMU_RATE_HZ: f64 = 1000.0;

/// RViz2's configuration for the demo's topics.
const RVIZ: &str = include_str!("../../../ros/esaac.rviz");

/// A camera of a command that simulates `sensor`, with events and APS frames alone.
#[must_use]
pub fn camera(name: String, sensor: &SensorModel) -> CameraPlan {
    let (sensor, split) = (sensor.clone(), Split::default());
    CameraPlan {
        name,
        sensor,
        intrinsics: None,
        image: false,
        depth: false,
        imu: false,
        split,
        frame_id: None,
    }
}

/// Intrinsics of a camera whose view axis meets the middle of the image.
#[must_use]
pub fn centred(focal_px: f64, width_px: u32, height_px: u32) -> Intrinsics {
    let centre_px = [width_px, height_px].map(|side| 0.5 * (f64::from(side) - 1.0));
    Intrinsics { focal_px: [focal_px; 2], centre_px }
}

/// Publishes or records what a command simulates, or does nothing.
#[derive(Default)]
pub struct RosOutput {
    publisher: Option<RigPublisher>,
    parameters: Option<SensorParameters>,
}

impl RosOutput {
    /// Opens what the flags ask for. Bad names and files are errors, and so is a network that was asked for;
    /// one that is merely not there is a warning in mode `auto`.
    pub fn open(arguments: &RosArguments, default: RosMode, cameras: Vec<CameraPlan>) -> Result<Self> {
        let network = &arguments.network;
        let named = network.ros_domain.is_some()
            || network.ros_interface.is_some()
            || network.ros_transport != TransportName::default()
            || !network.ros_args.is_empty();
        let mode = match arguments.ros.unwrap_or(default) {
            RosMode::Auto if named => RosMode::On,
            mode => mode,
        };
        if mode == RosMode::Off && arguments.record.is_none() {
            return Ok(RosOutput::default());
        }
        let options = arguments.options();
        let split = Split { slice_ns: arguments.ros_slice_ns, max_bytes: arguments.ros_max_bytes };
        let cameras: Vec<CameraPlan> =
            cameras.into_iter().map(|camera| CameraPlan { split, ..camera }).collect();
        // Names are wrong with a network or without, and before a file is made.
        Plan::new(&cameras, &options)?;
        let bag = arguments.record.as_deref().map(BagWriter::create).transpose()?;
        let joined = match mode {
            RosMode::Off => None,
            RosMode::On => Some(network.open(&cameras).context("--ros off does without")?),
            RosMode::Auto => network
                .open(&cameras)
                .inspect_err(|error| {
                    eprintln!("warning: not publishing to ROS 2: {error} (--ros off: not asked for)")
                })
                .ok(),
        };
        if joined.is_none() && bag.is_none() {
            return Ok(RosOutput::default());
        }
        let (transport, parameters) = joined.map(|j| (Some(j.transport), j.parameters)).unwrap_or_default();
        let published = transport.is_some();
        let sinks = Sinks { transport, bag };
        let publisher = RigPublisher::start(cameras, options, sinks)?;
        if published {
            eprintln!("{}", arguments.invitation(publisher.plan()));
        }
        Ok(RosOutput { publisher: Some(publisher), parameters })
    }

    /// Whether someone takes what is given.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.publisher.is_some()
    }

    /// Gives `rig` the parameters that others have set since the last tick, and `sensors` likewise; says whether
    /// there were any.
    pub fn change_sensors(&mut self, rig: &mut Rig, sensors: &mut [SensorModel]) -> bool {
        let (Some(publisher), Some(parameters)) = (&mut self.publisher, &mut self.parameters) else {
            return false;
        };
        let mut changed = false;
        let notices = parameters.apply(|camera, sensor| {
            rig.set_sensor(camera, sensor.clone()).map_err(|error| error.to_string())?;
            publisher.set_sensor(camera, sensor).map_err(|error| error.to_string())?;
            sensors[camera] = sensor.clone();
            changed = true;
            Ok(())
        });
        notices.iter().for_each(|notice| eprintln!("{notice}"));
        changed
    }

    /// Gives a tick: `fill` adds what there is.
    pub fn tick(&mut self, t_ns: i64, fill: impl FnOnce(&mut TickMessages<'_>)) {
        let Some(publisher) = &mut self.publisher else { return };
        let mut tick = publisher.tick(t_ns);
        fill(&mut tick);
        tick.send();
        publisher.notices().iter().for_each(|notice| eprintln!("{notice}"));
    }

    /// The simulation's time may go back with the next tick.
    pub fn restart(&mut self) {
        if let Some(publisher) = &mut self.publisher {
            publisher.restart();
        }
    }

    /// Ends it and says what became of the messages.
    pub fn finish(self) -> Result<Option<Summary>> {
        let Some(publisher) = self.publisher else { return Ok(None) };
        let (summary, notices, recorded) = publisher.finish();
        notices.iter().for_each(|notice| eprintln!("{notice}"));
        recorded.context("the recording is not whole")?;
        Ok(Some(summary))
    }
}

/// Adds a camera's packet and APS frame to a tick's messages.
pub fn add_camera(out: &mut TickMessages<'_>, camera: usize, sensor: &SensorModel, tick: &Tick<'_>) {
    out.events(camera, &tick.view(camera));
    if let Some(aps) = &tick.aps[camera] {
        let bayer = sensor.intensity == Intensity::BayerRggb;
        let pixels = tick.aps_pixels(camera);
        out.aps(camera, &ApsImage { pixels, bits: aps.bits, bayer, t_ns: aps.t_ns });
    }
}

/// Samples of an IMU between two frames, evenly, of which the last has the second frame's time. `sample`
/// gives angular rate and specific force in optical axes (x right, y down, z forward).
#[must_use]
pub fn imu_samples(from_ns: i64, to_ns: i64, sample: impl Fn(i64) -> [[f64; 3]; 2]) -> Vec<Imu> {
    let span_ns = to_ns - from_ns;
    let count = (span_ns as f64 * 1e-9 * IMU_RATE_HZ).ceil() as i64;
    // To x forward, y left, z up.
    let body = |[right, down, forward]: [f64; 3]| [forward, -right, -down];
    (1..=count)
        .map(|i| {
            let t_ns = from_ns + span_ns * i / count;
            let [rate, force] = sample(t_ns).map(body);
            Imu { t_ns, angular_rate_rad_s: rate, specific_force_m_s2: force }
        })
        .collect()
}

impl RosArguments {
    fn options(&self) -> RigOptions {
        let policy = match self.ros_policy {
            Some(PolicyName::Latest) => Policy::Latest,
            Some(PolicyName::Lossless) => Policy::Lossless,
            None if self.record.is_some() => Policy::Lossless,
            None => Policy::Latest,
        };
        RigOptions {
            namespace: self.ros_namespace.clone(),
            node: self.network.ros_node.clone(),
            events: self.ros_events,
            policy,
            sim_time: self.ros_time == TimeName::Sim,
            qos: self.ros_qos.clone(),
            ..RigOptions::default()
        }
    }

    /// The commands that show what is published.
    fn invitation(&self, plan: &Plan) -> String {
        let prefix = self.network.prefix();
        let names = || plan.topics.iter().map(|topic| topic.name.as_str());
        let events = names().find(|name| name.ends_with("/events")).unwrap_or_default();
        let time = if self.ros_time == TimeName::Sim { " --ros-args -p use_sim_time:=true" } else { "" };
        let namespace = self.ros_namespace.trim_end_matches('/');
        let mut lines = vec![
            format!("publishing {} ROS 2 topics; in a shell with ROS 2:", plan.topics.len()),
            format!("  {prefix}ros2 topic echo {events} --no-arr"),
            format!("  {prefix}rviz2 -d {}{time}", self.rviz()),
            format!("  {prefix}ros2 bag record -s mcap -e '^({namespace}/.*|/clock|/tf_static)$'"),
        ];
        if matches!(self.ros_events, EventFormat::Evt3 | EventFormat::Mono) {
            lines.push(format!(
                "  {prefix}ros2 run event_camera_renderer renderer_node --ros-args -r '~/events:={events}'"
            ));
        }
        lines.join("\n")
    }

    /// Path of RViz's configuration with this namespace, written where temporary files are.
    fn rviz(&self) -> String {
        let namespace = self.ros_namespace.trim_end_matches('/');
        let text = RVIZ.replace("/esaac/", &format!("{namespace}/"));
        let path = std::env::temp_dir().join(format!("esaac{}.rviz", namespace.replace('/', "_")));
        match std::fs::write(&path, text) {
            Ok(()) => path.display().to_string(),
            // It may be another user's; the one of the sources differs in the namespace alone.
            Err(_) => "ros/esaac.rviz".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imu_samples_are_at_least_at_their_rate_and_end_with_the_frame() {
        let samples = imu_samples(33_333_333, 66_666_666, |_| [[1.0, 2.0, 3.0], [0.0, -9.81, 0.0]]);
        assert_eq!((samples.len(), samples[33].t_ns), (34, 66_666_666));
        assert_eq!(samples[0].angular_rate_rad_s, [3.0, -1.0, -2.0]);
        assert_eq!(samples[0].specific_force_m_s2, [0.0, 0.0, 9.81], "at rest, upwards");
        assert!(samples.windows(2).all(|pair| pair[0].t_ns < pair[1].t_ns));
    }

    #[test]
    fn rviz_shows_topics_of_the_demo() {
        for topic in ["gray/image_raw", "gray/aps/image_raw", "bayer/aps/image_raw", "gray/depth/image_raw"] {
            assert!(RVIZ.contains(&format!("Value: /esaac/{topic}\n")), "{topic}");
        }
    }
}
