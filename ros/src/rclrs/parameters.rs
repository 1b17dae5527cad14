//! Declares every sensor parameter as a node parameter, `CAMERA.PARAMETER`. The sensor model checks values,
//! and `ros2 param set` shows its error messages.

use crate::parameters::{ParameterStore, SensorParameters, WantedSensors};
use crate::plan::CameraPlan;
use crate::transport::TransportError;
use ::rclrs::{DeclarationError, MandatoryParameter, Node, ParameterVariant};
use esaac_model::sensor::{PARAMETERS, Parameter};
use esaac_model::{SensorError, SensorModel};
use serde_json::Value;
use std::sync::Arc;

/// A declared parameter of the node.
trait Declared: Send {
    /// Sets it to the value that `sensor` has.
    fn show(&self, sensor: &SensorModel);
}

/// A type that the node has for parameters.
trait Kept: ParameterVariant {
    /// A sensor's value; `None` if it has another type.
    fn of(value: &Value) -> Option<Self>;
    /// The value as text, as on the command line.
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
        // The sensor is valid, so the value is.
        let _ = self.parameter.set(value);
    }
}

fn field(sensor: &SensorModel, name: &str) -> Value {
    let mut fields = serde_json::to_value(sensor).expect("a sensor consists of numbers and texts");
    fields.get_mut(name).map(Value::take).unwrap_or_default()
}

/// The declared parameters, by camera.
struct Store(Vec<Vec<Box<dyn Declared>>>);

impl ParameterStore for Store {
    fn show(&self, camera: usize, sensor: &SensorModel) {
        self.0[camera].iter().for_each(|parameter| parameter.show(sensor));
    }
}

/// Declares the parameters of `cameras` on `node`. Values from the command line or a parameter file apply
/// from the first tick on.
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

/// A parameter to declare.
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
