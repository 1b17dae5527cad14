//! `SensorModel`: the parameters of the model's list as attributes.

use crate::error::Fault;
use esaac_model::presets::preset;
use esaac_model::{PARAMETERS, PRESETS, Profile, SensorError, SensorModel};
use pyo3::exceptions::PyAttributeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};

/// Parameters of an event camera: see `esaac/__init__.pyi`.
#[pyclass(name = "SensorModel", module = "esaac", frozen)]
#[derive(Clone)]
pub struct PySensor(pub SensorModel);

impl PySensor {
    /// The sensor that a caller names: a `SensorModel`, a preset's name, or None for the default.
    pub fn named(given: Option<&Bound<'_, PyAny>>) -> PyResult<SensorModel> {
        let Some(given) = given else { return Ok(SensorModel::default()) };
        if let Ok(sensor) = given.cast::<PySensor>() {
            return Ok(sensor.get().0.clone());
        }
        let Ok(name) = given.cast::<PyString>() else {
            let kind = given.get_type();
            let message = format!("sensor is a {}, expected a SensorModel or a preset's name", kind.name()?);
            return Err(Fault::Argument(message).into());
        };
        let name = name.to_cow()?;
        preset(&name).ok_or_else(|| {
            let names: Vec<&str> = PRESETS.iter().map(|p| p.name).collect();
            Fault::Sensor(SensorError::Value {
                parameter: "preset".to_owned(),
                value: name.into_owned(),
                reason: format!("expected one of {}", names.join(", ")),
            })
            .into()
        })
    }

    /// The sensor with a profile, then parameters, replacing its own ([`SensorModel::with_changes`]); validated.
    pub fn with(
        sensor: SensorModel,
        profile: Option<&str>,
        parameters: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<SensorModel> {
        let profile = profile.map(profile_named).transpose()?;
        let mut texts: Vec<(String, String)> = Vec::new();
        for (key, value) in parameters.into_iter().flatten() {
            let key: String = key.extract()?;
            let value = text(&key, &value)?;
            texts.push((key, value));
        }
        let sensor = sensor.with_changes(profile, &texts).map_err(Fault::from)?;
        sensor.validate().map_err(Fault::from)?;
        Ok(sensor)
    }
}

fn profile_named(name: &str) -> Result<Profile, Fault> {
    match name {
        "clean" => Ok(Profile::Clean),
        "noisy" => Ok(Profile::Noisy),
        "paper" => Ok(Profile::Paper),
        _ => Err(Fault::Sensor(SensorError::Value {
            parameter: "profile".to_owned(),
            value: name.to_owned(),
            reason: "expected clean, noisy or paper".to_owned(),
        })),
    }
}

/// A value as text for the model's parser.
fn text(parameter: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
    let wrong = || {
        let kind = value.get_type().name().map_or_else(|_| "?".to_owned(), |n| n.to_string());
        Fault::Sensor(SensorError::Value {
            parameter: parameter.to_owned(),
            value: value.str().map_or_else(|_| "?".to_owned(), |s| s.to_string()),
            reason: format!("it is a {kind}, expected a number or a string"),
        })
    };
    if value.is_instance_of::<PyBool>() {
        return Err(wrong().into());
    }
    if value.is_instance_of::<PyString>() || value.is_instance_of::<PyInt>() {
        return Ok(value.str()?.to_cow()?.into_owned());
    }
    // By its value: `numpy.float64` is a float whose text is not a number.
    if let Ok(float) = value.cast::<PyFloat>() {
        return Ok(format!("{:?}", float.value()));
    }
    // NumPy's other scalars, for example.
    match value.call_method0("item") {
        Ok(item) if !item.get_type().is(value.get_type()) => text(parameter, &item),
        _ => Err(wrong().into()),
    }
}

#[pymethods]
impl PySensor {
    #[new]
    #[pyo3(signature = (sensor=None, /, *, profile=None, **parameters))]
    fn new(
        sensor: Option<&Bound<'_, PyAny>>,
        profile: Option<&str>,
        parameters: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        Ok(PySensor(PySensor::with(PySensor::named(sensor)?, profile, parameters)?))
    }

    #[staticmethod]
    fn from_toml(text: &str) -> PyResult<Self> {
        Ok(PySensor(SensorModel::from_toml(text).map_err(Fault::from)?))
    }

    fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    #[pyo3(signature = (*, profile=None, **parameters))]
    fn replace(&self, profile: Option<&str>, parameters: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        Ok(PySensor(PySensor::with(self.0.clone(), profile, parameters)?))
    }

    #[staticmethod]
    fn presets() -> Vec<(&'static str, u32, u32, &'static str)> {
        PRESETS.iter().map(|p| (p.name, p.width_px, p.height_px, p.about)).collect()
    }

    #[staticmethod]
    fn parameters() -> Vec<(&'static str, &'static str, &'static str)> {
        PARAMETERS.iter().map(|p| (p.name, p.unit, p.about)).collect()
    }

    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let values = PyDict::new(py);
        for parameter in PARAMETERS {
            values.set_item(parameter.name, self.__getattr__(py, parameter.name)?)?;
        }
        Ok(values)
    }

    fn __getattr__(&self, py: Python<'_>, name: &str) -> PyResult<Py<PyAny>> {
        let table = toml::Table::try_from(&self.0).expect("a sensor is a table");
        match table.get(name) {
            Some(toml::Value::Integer(value)) => Ok(value.into_pyobject(py)?.into_any().unbind()),
            Some(toml::Value::Float(value)) => Ok(value.into_pyobject(py)?.into_any().unbind()),
            Some(toml::Value::String(value)) => Ok(value.into_pyobject(py)?.into_any().unbind()),
            _ => Err(PyAttributeError::new_err(format!("a sensor has no parameter `{name}`"))),
        }
    }

    fn __dir__(&self) -> Vec<&'static str> {
        let methods = ["from_toml", "parameters", "presets", "replace", "to_dict", "to_toml"];
        methods.into_iter().chain(PARAMETERS.iter().map(|p| p.name)).collect()
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<PySensor>().is_ok_and(|other| other.get().0 == self.0)
    }

    fn __repr__(&self) -> String {
        let name = &self.0.name;
        let base =
            preset(name).unwrap_or_else(|| SensorModel { name: name.clone(), ..SensorModel::default() });
        let has_pixel = base.pixel == self.0.pixel;
        let [own, base] = [&self.0, &base.with_pixel(self.0.pixel)]
            .map(|sensor| toml::Table::try_from(sensor).expect("a sensor is a table"));
        let changed: String = PARAMETERS
            .iter()
            .filter(|p| own[p.name] != base[p.name] || p.name == "pixel" && !has_pixel)
            .map(|p| format!(", {}={}", p.name, own[p.name]))
            .collect();
        format!("SensorModel(\"{name}\"{changed})")
    }

    fn __reduce__(&self, py: Python<'_>) -> PyResult<(Py<PyAny>, (String,))> {
        let from_toml = py.get_type::<PySensor>().getattr("from_toml")?;
        Ok((from_toml.unbind(), (self.0.to_toml(),)))
    }
}
