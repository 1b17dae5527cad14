//! The network that ROS 2 topics are published on, and the transport.

use clap::ValueEnum;
use esaac_ros::{CameraPlan, CycloneTransport, NetworkOptions, SensorParameters, Transport, TransportError};

/// What carries the messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum TransportName {
    /// Built-in Cyclone DDS; needs no ROS 2
    #[default]
    Embedded,
    /// Zenoh, for subscribers on rmw_zenoh (needs a build with the feature `zenoh`)
    Zenoh,
    /// A node of the sourced ROS 2 that has every sensor parameter (needs a build with the feature `rclrs`)
    Rclrs,
}

/// Name of the node, if no other is given.
pub(super) const NODE: &str = "esaac";

/// Flags that choose network, node and transport.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "ROS 2")]
pub struct NetworkArguments {
    /// Domain id [default: ROS_DOMAIN_ID, else 0]
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u32).range(0..=232))]
    ros_domain: Option<u32>,
    /// Network interface [default: from CYCLONEDDS_URI, else Cyclone DDS chooses]
    #[arg(long, value_name = "NAME")]
    ros_interface: Option<String>,
    /// Name of the node
    #[arg(long, value_name = "NAME", default_value = NODE)]
    pub ros_node: String,
    /// What carries the messages
    #[arg(long, value_name = "NAME", default_value = "embedded")]
    ros_transport: TransportName,
    /// Remappings and parameters for the node of `--ros-transport rclrs`, for example `--ros-args -p
    /// gray.contrast_on:=0.3 -r /clock:=/sim_clock --`
    #[arg(long, value_name = "ARGUMENTS", num_args = 0.., allow_hyphen_values = true, value_terminator = "--")]
    ros_args: Vec<String>,
}

/// A network that was joined.
pub struct Joined {
    /// Carries the messages.
    pub transport: Box<dyn Transport>,
    /// Parameters that other nodes set, if the transport has any.
    pub parameters: Option<SensorParameters>,
}

impl Joined {
    fn without_parameters(transport: Box<dyn Transport>) -> Self {
        Joined { transport, parameters: None }
    }
}

fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok()
}

impl NetworkArguments {
    /// The flags of a command line without any, for a node of this name.
    #[must_use]
    pub fn of_node(name: &str) -> Self {
        NetworkArguments {
            ros_domain: None,
            ros_interface: None,
            ros_node: name.to_owned(),
            ros_transport: TransportName::default(),
            ros_args: Vec::new(),
        }
    }

    /// Whether a flag chooses the network or the transport, which means that the user wants one.
    #[must_use]
    pub fn is_chosen(&self) -> bool {
        self.given().next().is_some()
    }

    /// Flags that were given and that only a network reads.
    pub(super) fn given(&self) -> impl Iterator<Item = &'static str> {
        let flags = [
            ("ros-domain", self.ros_domain.is_some()),
            ("ros-interface", self.ros_interface.is_some()),
            ("ros-transport", self.ros_transport != TransportName::default()),
            ("ros-args", !self.ros_args.is_empty()),
        ];
        flags.into_iter().filter_map(|(flag, is_given)| is_given.then_some(flag))
    }

    /// Joins the network. The transport `rclrs` lets other nodes change the sensors of `cameras`.
    pub fn open(&self, cameras: &[CameraPlan]) -> Result<Joined, TransportError> {
        if self.ros_transport != TransportName::Rclrs && !self.ros_args.is_empty() {
            return Err(TransportError::Unsupported("--ros-args needs --ros-transport rclrs".to_owned()));
        }
        match self.ros_transport {
            TransportName::Rclrs => self.open_node(cameras),
            TransportName::Embedded => {
                Ok(Joined::without_parameters(Box::new(CycloneTransport::open(self.options()?)?)))
            }
            TransportName::Zenoh => self.open_zenoh().map(Joined::without_parameters),
        }
    }

    #[cfg(feature = "zenoh")]
    fn open_zenoh(&self) -> Result<Box<dyn Transport>, TransportError> {
        Ok(Box::new(esaac_ros::ZenohTransport::open(self.options()?, variable)?))
    }

    #[cfg(not(feature = "zenoh"))]
    fn open_zenoh(&self) -> Result<Box<dyn Transport>, TransportError> {
        let reason = "this program was built without the feature `zenoh`: cargo build --release -p esaac-cli \
                      --features zenoh";
        Err(TransportError::Unsupported(reason.to_owned()))
    }

    #[cfg(feature = "rclrs")]
    fn open_node(&self, cameras: &[CameraPlan]) -> Result<Joined, TransportError> {
        if self.ros_interface.is_some() {
            let reason = "--ros-interface is for the embedded transport; the sourced middleware has settings \
                          of its own";
            return Err(TransportError::Unsupported(reason.to_owned()));
        }
        let mut arguments = vec!["--ros-args".to_owned()];
        arguments.extend_from_slice(&self.ros_args);
        let (domain, node) = (self.ros_domain, self.ros_node.clone());
        let node = esaac_ros::RclrsTransport::open(&esaac_ros::NodeOptions { domain, node, arguments })?;
        let parameters = Some(node.declare_sensors(cameras)?);
        Ok(Joined { transport: Box::new(node), parameters })
    }

    #[cfg(not(feature = "rclrs"))]
    fn open_node(&self, _: &[CameraPlan]) -> Result<Joined, TransportError> {
        let reason = "this program was built without the feature `rclrs`; where ROS 2 is sourced: cargo build \
                      --release -p esaac-cli --features rclrs";
        Err(TransportError::Unsupported(reason.to_owned()))
    }

    fn options(&self) -> Result<NetworkOptions, TransportError> {
        let from = NetworkOptions::from_environment(variable)?;
        Ok(NetworkOptions {
            domain: self.ros_domain.unwrap_or(from.domain),
            interface: self.ros_interface.clone(),
            node: self.ros_node.clone(),
            ..from
        })
    }

    /// Environment variables that a shell command of ROS needs to find the topics.
    #[must_use]
    pub fn prefix(&self) -> String {
        let domain = self.ros_domain.map_or_else(String::new, |domain| format!("ROS_DOMAIN_ID={domain} "));
        match self.ros_transport {
            TransportName::Embedded | TransportName::Rclrs => domain,
            TransportName::Zenoh => format!("{domain}RMW_IMPLEMENTATION=rmw_zenoh_cpp "),
        }
    }
}
