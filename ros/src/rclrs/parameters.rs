//! Every parameter of every sensor as a parameter of the node, `CAMERA.PARAMETER`. The model decides what a
//! parameter may be, and `ros2 param set` gets its words where it may not.

use crate::parameters::{ParameterStore, SensorParameters, WantedSensors};
use crate::plan::CameraPlan;
use crate::transport::TransportError;
use ::rclrs::{DeclarationError, MandatoryParameter, Node, ParameterVariant};
use esaac_model::sensor::{PARAMETERS, Parameter};
use esaac_model::{SensorError, SensorModel};
use serde_json::Value;
use std::sync::Arc;

/// A parameter of the node, for the store.
trait Declared: Send {
    /// Shows what `sensor` has.
    fn show(&self, sensor: &SensorModel);
}

/// A value of a parameter as the node keeps it.
trait Kept: ParameterVariant {
    /// What the sensor has; `None` where it is of another kind.
    fn of(value: &Value) -> Option<Self>;
    /// As a flag would have it.
    fn text(&self) -> String;
}

impl Kept for i64 {
    fn of(value: &Value) -> Option<Self> {
        value.as_i64()
    }

    fn text(&self) -> String {
        self.to_string()
    }
}

impl Kept for f64 {
    fn of(value: &Value) -> Option<Self> {
        value.as_f64().filter(|_| value.is_f64())
    }

    fn text(&self) -> String {
        format!("{self:?}")
    }
}

impl Kept for Arc<str> {
    fn of(value: &Value) -> Option<Self> {
        value.as_str().map(Arc::from)
    }

    fn text(&self) -> String {
        self.as_ref().to_owned()
    }
}

struct One<T: ParameterVariant> {
    name: &'static str,
    parameter: MandatoryParameter<T>,
}

impl<T: Kept + Send + Sync> Declared for One<T> {
    fn show(&self, sensor: &SensorModel) {
        let Some(value) = T::of(&field(sensor, self.name)) else { return };
        // It was this before, and is allowed therefore.
        let _ = self.parameter.set(value);
    }
}

fn field(sensor: &SensorModel, name: &str) -> Value {
    let mut fields = serde_json::to_value(sensor).expect("a sensor is numbers and texts");
    fields.get_mut(name).map(Value::take).unwrap_or_default()
}

/// The node's parameters, by camera.
struct Store(Vec<Vec<Box<dyn Declared>>>);

impl ParameterStore for Store {
    fn put_back(&self, camera: usize, sensor: &SensorModel) {
        self.0[camera].iter().for_each(|parameter| parameter.show(sensor));
    }
}

/// Declares the parameters of `cameras` on `node`. Values that the command line or a parameter file gives are
/// wanted from the first tick on.
pub fn declare(node: &Node, cameras: &[CameraPlan]) -> Result<SensorParameters, TransportError> {
    let wanted = WantedSensors::new(cameras);
    let mut store = Vec::new();
    for (number, camera) in cameras.iter().enumerate() {
        let declare = |parameter| declare_one(node, &wanted, number, &camera.name, parameter);
        store.push(PARAMETERS.iter().map(declare).collect::<Result<Vec<_>, _>>()?);
    }
    Ok(SensorParameters::new(cameras, wanted, Box::new(Store(store))))
}

fn declare_one(
    node: &Node,
    wanted: &WantedSensors,
    camera: usize,
    camera_name: &str,
    parameter: &Parameter,
) -> Result<Box<dyn Declared>, TransportError> {
    let name = format!("{camera_name}.{}", parameter.name);
    let target = Target { node, wanted, camera, parameter, name: &name };
    let value = field(&wanted.sensor(camera), parameter.name);
    let declared = if let Some(value) = f64::of(&value) {
        target.declare(value)
    } else if let Some(value) = i64::of(&value) {
        target.declare(value)
    } else if let Some(value) = Arc::<str>::of(&value) {
        target.declare(value)
    } else {
        let (parameter, value, reason) =
            (parameter.name.to_owned(), value.to_string(), "ROS 2 has signed 64-bit integers".to_owned());
        return Err(unavailable(SensorError::Value { parameter, value, reason }));
    };
    declared.map_err(|error| match error {
        DeclarationError::InitialValueRejected(reason) => {
            TransportError::Unavailable(format!("parameter `{name}`: {reason}"))
        }
        error => TransportError::Unavailable(format!("parameter `{name}`: {error}")),
    })
}

fn unavailable(error: SensorError) -> TransportError {
    TransportError::Unavailable(error.to_string())
}

/// A parameter that is to be declared.
struct Target<'a> {
    node: &'a Node,
    wanted: &'a WantedSensors,
    camera: usize,
    parameter: &'a Parameter,
    name: &'a str,
}

impl Target<'_> {
    fn declare<T: Kept + Send + Sync + 'static>(
        &self,
        value: T,
    ) -> Result<Box<dyn Declared>, DeclarationError> {
        let Parameter { name, unit, about } = *self.parameter;
        let camera = self.camera;
        let check = {
            let wanted = self.wanted.clone();
            move |value: &T| wanted.check(camera, name, &value.text())
        };
        let description = if unit.is_empty() { about.to_owned() } else { format!("{about} [{unit}]") };
        let parameter = self
            .node
            .declare_parameter::<T>(self.name)
            .default(value)
            .description(description)
            .validate(check)
            .mandatory()?;
        let wanted = self.wanted.clone();
        wanted.set(camera, name, &parameter.get().text());
        parameter.on_change(move |value| wanted.set(camera, name, &value.text()));
        Ok(Box::new(One { name, parameter }))
    }
}
