//! The ROS 2 flags of commands that simulate.

use super::network::{NODE, NetworkArguments};
use super::rviz;
use clap::ValueEnum;
use clap::builder::{PathBufValueParser, TypedValueParser};
use esaac_ros::qos::QosError;
use esaac_ros::{EventFormat, Plan, Policy, QosChange, RigOptions, Split};
use std::path::PathBuf;

/// Whether to publish.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RosMode {
    /// Publish if there is a network; warn if there is none
    Auto,
    /// Publish; fail if there is no network
    On,
    /// Do not publish
    Off,
}

/// What happens to a tick while earlier ones wait to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum PolicyName {
    /// Drop and count the oldest tick
    Latest,
    /// Let the simulation wait
    Lossless,
}

/// The clock of the stamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum TimeName {
    /// Simulated time, published on /clock (use_sim_time)
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
    #[arg(long, value_name = "FILE.mcap", value_parser = PathBufValueParser::new().try_map(recording))]
    pub record: Option<PathBuf>,
    /// Namespace of all cameras
    #[arg(long, value_name = "NAME", default_value = NAMESPACE)]
    ros_namespace: String,
    /// Event messages: packed, plain (esaac_msgs), evt3, mono (event_camera_msgs)
    #[arg(long, value_name = "FORMAT", default_value = "packed")]
    ros_events: EventFormat,
    /// Length of time that one event message covers, from 1000; 0: one message per interval
    #[arg(long, value_name = "ns", default_value_t = 0, value_parser = slice_ns, allow_negative_numbers = true)]
    pub ros_slice_ns: u32,
    /// Largest size of a message's events; 0: no limit
    #[arg(long, value_name = "BYTES", default_value_t = 0)]
    pub ros_max_bytes: u32,
    /// Quality of service of a topic, for example events=best_effort,depth:10; `all` means every topic. May
    /// be given several times
    #[arg(long, value_name = "TOPIC=QOS", value_parser = qos)]
    ros_qos: Vec<(String, QosChange)>,
    /// What to do while messages wait to be sent [default: latest; lossless with --record]
    #[arg(long, value_name = "POLICY")]
    ros_policy: Option<PolicyName>,
    /// Clock of the stamps
    #[arg(long, value_name = "CLOCK", default_value = "sim")]
    ros_time: TimeName,
    /// Network.
    #[command(flatten)]
    pub network: NetworkArguments,
}

/// Namespace, if no other is given.
const NAMESPACE: &str = "/esaac";

/// Another ending could be that of a file of events.
fn recording(path: PathBuf) -> Result<PathBuf, String> {
    match path.extension().is_some_and(|ending| ending == "mcap") {
        true => Ok(path),
        false => Err("expected a name that ends in .mcap".to_owned()),
    }
}

fn slice_ns(text: &str) -> Result<u32, String> {
    let ns = text.parse().ok().filter(|&slice_ns| Split { slice_ns, max_bytes: 0 }.has_valid_slice());
    ns.ok_or_else(|| format!("expected 0, or {} to {}", Split::LEAST_SLICE_NS, u32::MAX))
}

fn qos(text: &str) -> Result<(String, QosChange), String> {
    let (topic, words) = text.split_once('=').ok_or("expected TOPIC=QOS")?;
    Ok((topic.trim_matches('/').to_owned(), words.parse().map_err(|error: QosError| error.to_string())?))
}

impl RosArguments {
    /// The publisher's options.
    #[must_use]
    pub fn options(&self) -> RigOptions {
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

    /// Flags that were given and do nothing, and why. `published`: there is to be a network.
    #[must_use]
    pub fn unread(&self, published: bool) -> Vec<(&'static str, &'static str)> {
        let mut unread = Vec::new();
        if !published {
            let why = "without --ros on nothing is published";
            unread.extend(self.network.given().map(|flag| (flag, why)));
        }
        if !published && self.record.is_none() {
            let flags = [
                ("ros-node", self.network.ros_node != NODE),
                ("ros-namespace", self.ros_namespace != NAMESPACE),
                ("ros-events", self.ros_events != EventFormat::Packed),
                ("ros-slice-ns", self.ros_slice_ns != 0),
                ("ros-max-bytes", self.ros_max_bytes != 0),
                ("ros-qos", !self.ros_qos.is_empty()),
                ("ros-policy", self.ros_policy.is_some()),
                ("ros-time", self.ros_time != TimeName::Sim),
            ];
            let why = "without --ros on or --record nothing is published or recorded";
            let given = flags.into_iter().filter(|(_, is_given)| *is_given);
            unread.extend(given.map(|(flag, _)| (flag, why)));
        }
        unread
    }

    /// Shell commands that show what is published.
    #[must_use]
    pub fn invitation(&self, plan: &Plan) -> String {
        let prefix = self.network.prefix();
        let names = || plan.topics.iter().map(|topic| topic.name.as_str());
        let events = names().find(|name| name.ends_with("/events")).unwrap_or_default();
        let time = if self.ros_time == TimeName::Sim { " --ros-args -p use_sim_time:=true" } else { "" };
        let namespace = self.ros_namespace.trim_end_matches('/');
        let rviz = rviz::configuration(&std::env::temp_dir(), namespace);
        let mut lines = vec![
            format!("publishing {} ROS 2 topics; in a shell with ROS 2:", plan.topics.len()),
            format!("  {prefix}ros2 topic echo {events} --no-arr"),
            format!("  {prefix}rviz2 -d {}{time}", rviz.display()),
            format!("  {prefix}ros2 bag record -s mcap -e '^({namespace}/.*|/clock|/tf_static)$'"),
        ];
        if matches!(self.ros_events, EventFormat::Evt3 | EventFormat::Mono) {
            lines.push(format!(
                "  {prefix}ros2 run event_camera_renderer renderer_node --ros-args -r '~/events:={events}'"
            ));
        }
        lines.join("\n")
    }
}
