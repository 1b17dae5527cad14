//! Parameters of sensors, set by others while the rig runs.

use crate::node::{self, Observer};
use crate::world;
use esaac_model::SensorModel;
use esaac_model::sensor::PARAMETERS;
use esaac_ros::{CameraPlan, RigOptions, RigPublisher, SensorParameters, Sinks};
use rclrs::Promise;
use ros_env::rcl_interfaces::msg::rmw::{Parameter, ParameterType, ParameterValue};
use ros_env::rcl_interfaces::srv::rmw::{
    GetParameters, GetParameters_Request, GetParameters_Response, ListParameters, ListParameters_Request,
    ListParameters_Response, SetParameters, SetParameters_Request, SetParameters_Response,
};
use std::sync::Arc;

fn cameras() -> [CameraPlan; 2] {
    [world::camera("left", 32, 24), world::camera("right", 32, 24)]
}

/// A published rig whose parameters can be set.
struct Live {
    rig: RigPublisher,
    parameters: SensorParameters,
    observer: Observer,
    domain: u32,
}

impl Live {
    fn start(arguments: &[&str]) -> Result<Self, String> {
        let domain = world::domain();
        let transport = node::open(domain, arguments)?;
        let parameters = transport.declare_sensors(&cameras()).map_err(|error| error.to_string())?;
        let sinks = Sinks { transport: Some(Box::new(transport)), bag: None };
        let rig = world::rig(&cameras(), &RigOptions::default(), sinks);
        Ok(Live { rig, parameters, observer: Observer::on(domain), domain })
    }

    fn set(&mut self, values: &[(&str, ParameterValue)]) -> Vec<Result<(), String>> {
        let parameter =
            |(name, value): &(&str, ParameterValue)| Parameter { name: (*name).into(), value: value.clone() };
        let request = SetParameters_Request { parameters: values.iter().map(parameter).collect() };
        let client = self.observer.node.create_client::<SetParameters>("/esaac/set_parameters").unwrap();
        let asking = Arc::clone(&client);
        self.observer.wait_until(move || asking.service_is_ready().unwrap_or(false));
        let promise: Promise<SetParameters_Response> = client.call(&request).unwrap();
        let response = self.observer.wait(promise);
        let result = |successful: bool, reason: String| if successful { Ok(()) } else { Err(reason) };
        response.results.iter().map(|r| result(r.successful, r.reason.to_string())).collect()
    }

    fn get(&mut self, name: &str) -> ParameterValue {
        let client = self.observer.node.create_client::<GetParameters>("/esaac/get_parameters").unwrap();
        let asking = Arc::clone(&client);
        self.observer.wait_until(move || asking.service_is_ready().unwrap_or(false));
        let request = GetParameters_Request { names: [name].into_iter().map(Into::into).collect() };
        let promise: Promise<GetParameters_Response> = client.call(&request).unwrap();
        self.observer.wait(promise).values[0].clone()
    }

    /// The changes that the rig is given before a tick, and what is told.
    fn changes(&mut self) -> (Vec<(usize, SensorModel)>, Vec<String>) {
        let mut changes = Vec::new();
        let rig = &mut self.rig;
        let notices = self.parameters.apply(|camera, sensor| {
            changes.push((camera, sensor.clone()));
            rig.set_sensor(camera, sensor).map_err(|error| error.to_string())
        });
        (changes, notices)
    }
}

fn double(value: f64) -> ParameterValue {
    ParameterValue {
        type_: ParameterType::PARAMETER_DOUBLE,
        double_value: value,
        ..ParameterValue::default()
    }
}

fn integer(value: i64) -> ParameterValue {
    ParameterValue {
        type_: ParameterType::PARAMETER_INTEGER,
        integer_value: value,
        ..ParameterValue::default()
    }
}

fn text(value: &str) -> ParameterValue {
    ParameterValue {
        type_: ParameterType::PARAMETER_STRING,
        string_value: value.into(),
        ..ParameterValue::default()
    }
}

#[test]
fn a_parameter_that_is_set_reaches_the_rig_and_its_subscribers() {
    let mut live = Live::start(&[]).unwrap();
    let topics = [(
        "/esaac/right/sensor".to_owned(),
        "esaac_msgs/msg/SensorModel".to_owned(),
        "reliable,transient_local",
    )];
    let reader = world::Subscriber::on(live.domain).start(&topics);
    reader.wait_until_matched(1);
    assert_eq!(live.changes(), (vec![], vec![]));
    live.rig.tick(1_000).send();
    let set = [
        ("right.contrast_on", double(0.35)),
        ("right.substeps", integer(8)),
        ("right.intensity", text("gray")),
    ];
    assert_eq!(live.set(&set), [Ok(()), Ok(()), Ok(())]);
    let (changes, notices) = live.changes();
    let expected = SensorModel {
        contrast_on: 0.35,
        substeps: 8,
        intensity: esaac_model::Intensity::Gray,
        ..cameras()[1].sensor.clone()
    };
    assert_eq!((changes, notices), (vec![(1, expected)], vec![]));
    live.rig.tick(2_000).send();
    assert_eq!(live.changes(), (vec![], vec![]), "it is changed once");
    assert_eq!(live.get("right.contrast_on").double_value, 0.35);
    live.rig.finish().2.unwrap();
    // The subscriber got the sensor as it was and as it became.
    reader.wait_until_taken(2);
    let taken = world::taken(&reader.finish());
    let stamps: Vec<i64> = taken.iter().map(|taken| taken.stamp_ns).collect();
    assert_eq!(stamps, [1_000, 2_000]);
    assert_ne!(taken[0].hash, taken[1].hash);
}

#[test]
fn a_bad_value_is_refused_with_the_models_words() {
    let mut live = Live::start(&[]).unwrap();
    let mut refuse = |name: &str, value| live.set(&[(name, value)]).remove(0).unwrap_err();
    let reason = refuse("left.substeps", integer(65));
    assert_eq!(reason, "sensor parameter `substeps` is 65, expected 1 to 64");
    assert!(refuse("left.contrast_on", double(f64::NAN)).contains("`contrast_on` is NaN"));
    assert!(refuse("left.intensity", text("infrared")).contains("`intensity` cannot be `infrared`"));
    assert!(refuse("left.width", integer(64)).contains("fixed while the camera runs"));
    assert!(refuse("left.contrast_on", text("0.2")).contains("type"));
    assert!(refuse("middle.contrast_on", double(0.2)).contains("not declared"));
    assert_eq!(live.get("left.substeps").integer_value, 32);
    assert_eq!(live.changes(), (vec![], vec![]));
}

#[test]
fn what_is_wrong_only_together_is_undone_and_shown_so() {
    let mut live = Live::start(&[]).unwrap();
    let set = [("left.contrast_mismatch", double(0.1)), ("left.contrast_on", double(0.1))];
    assert_eq!(live.set(&set), [Ok(()), Ok(())]);
    let (changes, notices) = live.changes();
    assert!(changes.is_empty() && notices[0].contains("contrast_mismatch"), "{notices:?}");
    assert_eq!(live.get("left.contrast_on").double_value, 0.2);
    assert_eq!(live.get("left.contrast_mismatch").double_value, 0.0);
}

#[test]
fn every_parameter_of_every_camera_is_listed() {
    let mut live = Live::start(&[]).unwrap();
    let client = live.observer.node.create_client::<ListParameters>("/esaac/list_parameters").unwrap();
    let asking = Arc::clone(&client);
    live.observer.wait_until(move || asking.service_is_ready().unwrap_or(false));
    let promise: Promise<ListParameters_Response> = client.call(ListParameters_Request::default()).unwrap();
    let names: Vec<String> =
        live.observer.wait(promise).result.names.iter().map(ToString::to_string).collect();
    for camera in ["left", "right"] {
        for parameter in PARAMETERS {
            let name = format!("{camera}.{}", parameter.name);
            assert!(names.contains(&name), "{name}");
        }
    }
}

#[test]
fn the_command_line_sets_parameters_from_the_first_tick_on() {
    let mut live =
        Live::start(&["--ros-args", "-p", "left.contrast_off:=0.15", "-p", "left.seed:=7"]).unwrap();
    let (changes, _) = live.changes();
    let expected = SensorModel { contrast_off: 0.15, seed: 7, ..cameras()[0].sensor.clone() };
    assert_eq!(changes, [(0, expected)]);
    let error = Live::start(&["--ros-args", "-p", "left.substeps:=65"]).err().unwrap();
    assert!(error.contains("`left.substeps`") && error.contains("expected 1 to 64"), "{error}");
    let error = Live::start(&["--ros-args", "-p", "right.contrast_on:=big"]).err().unwrap();
    assert!(error.contains("`right.contrast_on`") && error.contains("type"), "{error}");
}
