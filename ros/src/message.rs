//! The message types that are published, and their definitions.

use crate::definition::{self, Texts};
use crate::type_hash;
use std::sync::OnceLock;

macro_rules! texts {
    ($($package:literal: $($message:literal)*, in $folder:literal;)*) => {
        &[$($((concat!($package, "/msg/", $message),
            include_str!(concat!("../", $folder, "/msg/", $message, ".msg")))),*),*]
    };
}

/// Every definition: ours, and those of ROS that they contain.
const TEXTS: &[(&str, &str)] = texts! {
    "builtin_interfaces": "Time", in "definitions/builtin_interfaces";
    "diagnostic_msgs": "DiagnosticArray" "DiagnosticStatus" "KeyValue", in "definitions/diagnostic_msgs";
    "esaac_msgs": "Event" "EventIds" "EventPacket" "Instance" "Instances" "PackedEventPacket" "SensorModel",
        in "esaac_msgs";
    "event_camera_msgs": "EventPacket", in "definitions/event_camera_msgs";
    "geometry_msgs": "Quaternion" "Transform" "TransformStamped" "Vector3", in "definitions/geometry_msgs";
    "rmw_dds_common": "Gid" "NodeEntitiesInfo" "ParticipantEntitiesInfo", in "definitions/rmw_dds_common";
    "rosgraph_msgs": "Clock", in "definitions/rosgraph_msgs";
    "sensor_msgs": "CameraInfo" "Image" "Imu" "RegionOfInterest", in "definitions/sensor_msgs";
    "std_msgs": "Header", in "definitions/std_msgs";
    "tf2_msgs": "TFMessage", in "definitions/tf2_msgs";
};

/// The definitions, by message name.
#[must_use]
pub fn texts() -> &'static Texts {
    static TABLE: OnceLock<Texts> = OnceLock::new();
    TABLE.get_or_init(|| TEXTS.iter().map(|&(name, text)| (name.to_owned(), text.to_owned())).collect())
}

/// A message type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MessageType {
    /// `esaac_msgs/msg/PackedEventPacket`.
    PackedEventPacket,
    /// `esaac_msgs/msg/EventPacket`.
    EventPacket,
    /// `event_camera_msgs/msg/EventPacket`.
    EventCameraPacket,
    /// `esaac_msgs/msg/EventIds`.
    EventIds,
    /// `esaac_msgs/msg/Instances`.
    Instances,
    /// `esaac_msgs/msg/SensorModel`.
    SensorModel,
    /// `sensor_msgs/msg/Image`.
    Image,
    /// `sensor_msgs/msg/CameraInfo`.
    CameraInfo,
    /// `sensor_msgs/msg/Imu`.
    Imu,
    /// `rosgraph_msgs/msg/Clock`.
    Clock,
    /// `diagnostic_msgs/msg/DiagnosticArray`.
    DiagnosticArray,
    /// `tf2_msgs/msg/TFMessage`.
    Transforms,
}

impl MessageType {
    /// All types.
    pub const ALL: [MessageType; 12] = [
        MessageType::PackedEventPacket,
        MessageType::EventPacket,
        MessageType::EventCameraPacket,
        MessageType::EventIds,
        MessageType::Instances,
        MessageType::SensorModel,
        MessageType::Image,
        MessageType::CameraInfo,
        MessageType::Imu,
        MessageType::Clock,
        MessageType::DiagnosticArray,
        MessageType::Transforms,
    ];

    /// `pkg/msg/Name`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            MessageType::PackedEventPacket => "esaac_msgs/msg/PackedEventPacket",
            MessageType::EventPacket => "esaac_msgs/msg/EventPacket",
            MessageType::EventCameraPacket => "event_camera_msgs/msg/EventPacket",
            MessageType::EventIds => "esaac_msgs/msg/EventIds",
            MessageType::Instances => "esaac_msgs/msg/Instances",
            MessageType::SensorModel => "esaac_msgs/msg/SensorModel",
            MessageType::Image => "sensor_msgs/msg/Image",
            MessageType::CameraInfo => "sensor_msgs/msg/CameraInfo",
            MessageType::Imu => "sensor_msgs/msg/Imu",
            MessageType::Clock => "rosgraph_msgs/msg/Clock",
            MessageType::DiagnosticArray => "diagnostic_msgs/msg/DiagnosticArray",
            MessageType::Transforms => "tf2_msgs/msg/TFMessage",
        }
    }

    /// Type hash, `RIHS01_...`.
    #[must_use]
    pub fn type_hash(self) -> String {
        type_hash::type_hash(self.name(), texts()).expect("the built-in definitions are complete")
    }

    /// The definition with those of all types that it contains, as recordings store it.
    #[must_use]
    pub fn schema(self) -> String {
        definition::schema(self.name(), texts()).expect("the built-in definitions are complete")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_is_defined_with_all_that_it_holds() {
        for message in MessageType::ALL {
            assert!(message.type_hash().starts_with("RIHS01_"), "{}", message.name());
            assert!(!message.schema().is_empty());
        }
        assert!(MessageType::Image.schema().contains("MSG: builtin_interfaces/Time\nint32 sec\n"));
    }
}
