//! Sensor parameters that other nodes change while a rig runs. A change is checked when a node asks for it,
//! and the rig takes it over between two ticks. A change that the rig refuses is undone.

use crate::plan::CameraPlan;
use esaac_model::SensorModel;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Shows parameters to other nodes.
pub trait ParameterStore: Send {
    /// Shows the parameters of `sensor`, after a change to this camera was refused or has changed others with it.
    fn show(&self, camera: usize, sensor: &SensorModel);
}

/// The sensors that other nodes ask for. Clones share them.
#[derive(Clone, Debug)]
pub struct WantedSensors(Arc<Mutex<Vec<SensorModel>>>);

impl WantedSensors {
    /// Starts with the sensors of `cameras`.
    #[must_use]
    pub fn new(cameras: &[CameraPlan]) -> Self {
        WantedSensors(Arc::new(Mutex::new(cameras.iter().map(|camera| camera.sensor.clone()).collect())))
    }

    fn lock(&self) -> MutexGuard<'_, Vec<SensorModel>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn with(&self, camera: usize, parameter: &str, value: &str) -> Result<SensorModel, String> {
        let old = self.lock()[camera].clone();
        let mut sensor = old.clone();
        sensor.set(parameter, value).and_then(|()| sensor.validate()).map_err(|error| error.to_string())?;
        if (sensor.width, sensor.height) != (old.width, old.height) {
            return Err(format!(
                "`{parameter}` is fixed while the camera runs; it is {}x{} px",
                old.width, old.height
            ));
        }
        if old.aps_exposure_ns == 0 && sensor.aps_exposure_ns > 0 {
            return Err("this camera has no APS topic; start it with an `aps_exposure_ns` above 0".to_owned());
        }
        Ok(sensor)
    }

    /// Checks whether `parameter` of `camera` may become `value` while the others stay. The error is the
    /// model's.
    pub fn check(&self, camera: usize, parameter: &str, value: &str) -> Result<(), String> {
        self.with(camera, parameter, value).map(drop)
    }

    /// Asks for `parameter` of `camera` to be `value` from the next tick on. [`SensorParameters::apply`]
    /// checks it together with the other changes.
    pub fn set(&self, camera: usize, parameter: &str, value: &str) {
        // `check` has accepted it. Together with another change it may be wrong, which `apply` finds.
        let _ = self.lock()[camera].set(parameter, value);
    }

    /// Takes back what `refused` has and `current` has not. What was asked for since then stays. Returns the sensor that
    /// is asked for now.
    fn undo(&self, camera: usize, refused: &SensorModel, current: &SensorModel) -> SensorModel {
        let asked = &mut self.lock()[camera];
        let [mut left, refused, kept] =
            [&*asked, refused, current].map(|sensor| serde_json::to_value(sensor).unwrap_or_default());
        for (name, value) in left.as_object_mut().into_iter().flatten() {
            if refused[name] == *value {
                value.clone_from(&kept[name]);
            }
        }
        // Not a number has no place in JSON.
        *asked = serde_json::from_value(left).unwrap_or_else(|_| current.clone());
        asked.clone()
    }

    /// The sensor that is asked for.
    #[must_use]
    pub fn sensor(&self, camera: usize) -> SensorModel {
        self.lock()[camera].clone()
    }
}

/// The parameters of a rig's sensors: current ones and those that other nodes ask for.
pub struct SensorParameters {
    names: Vec<String>,
    current: Vec<SensorModel>,
    wanted: WantedSensors,
    store: Box<dyn ParameterStore>,
}

impl SensorParameters {
    /// The sensors of `cameras`. Changes come from `wanted`; `store` shows them.
    #[must_use]
    pub fn new(cameras: &[CameraPlan], wanted: WantedSensors, store: Box<dyn ParameterStore>) -> Self {
        SensorParameters {
            names: cameras.iter().map(|camera| camera.name.clone()).collect(),
            current: cameras.iter().map(|camera| camera.sensor.clone()).collect(),
            wanted,
            store,
        }
    }

    /// Hands every changed sensor to `change`; call it between two ticks. `change` must change everything or,
    /// if it returns an error, nothing. Returns a notice for each camera whose changes the model or `change`
    /// refused; these changes are undone.
    pub fn apply(
        &mut self,
        mut change: impl FnMut(usize, &SensorModel) -> Result<(), String>,
    ) -> Vec<String> {
        let mut notices = Vec::new();
        for (camera, current) in self.current.iter_mut().enumerate() {
            let wanted = self.wanted.sensor(camera);
            if wanted == *current {
                continue;
            }
            match wanted.validate().map_err(|error| error.to_string()).and_then(|()| change(camera, &wanted))
            {
                Ok(()) => {
                    // Another pixel brings numbers that nobody has set.
                    if wanted.pixel != current.pixel {
                        self.store.show(camera, &wanted);
                    }
                    *current = wanted;
                }
                Err(reason) => {
                    let asked = self.wanted.undo(camera, &wanted, current);
                    self.store.show(camera, &asked);
                    notices.push(format!(
                        "parameters of camera `{}` stay as they were: {reason}",
                        self.names[camera]
                    ));
                }
            }
        }
        notices
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::events::Split;
    use esaac_model::presets::{preset, preset_with_physical_pixel};

    /// Camera and mismatch of what was shown.
    type ShownList = Arc<Mutex<Vec<(usize, f64)>>>;

    /// Remembers what was shown.
    struct Shown(ShownList);

    impl ParameterStore for Shown {
        fn show(&self, camera: usize, sensor: &SensorModel) {
            self.0.lock().unwrap().push((camera, sensor.contrast_mismatch));
        }
    }

    fn parameters() -> (SensorParameters, WantedSensors, ShownList) {
        let camera = |name: &str| CameraPlan {
            name: name.to_owned(),
            sensor: SensorModel::default(),
            lens: None,
            image: false,
            depth: false,
            imu: false,
            event_ids: false,
            split: Split::default(),
            frame_id: None,
        };
        let cameras = [camera("left"), camera("right")];
        let (wanted, shown) = (WantedSensors::new(&cameras), ShownList::default());
        let store = Box::new(Shown(Arc::clone(&shown)));
        (SensorParameters::new(&cameras, wanted.clone(), store), wanted, shown)
    }

    #[test]
    fn a_change_reaches_its_camera_once() {
        let (mut parameters, wanted, shown) = parameters();
        wanted.check(1, "contrast_on", "0.35").unwrap();
        wanted.set(1, "contrast_on", "0.35");
        let mut changes = Vec::new();
        let mut take = |camera: usize, sensor: &SensorModel| {
            changes.push((camera, sensor.contrast_on));
            Ok(())
        };
        assert_eq!(parameters.apply(&mut take), [""; 0]);
        assert_eq!(parameters.apply(&mut take), [""; 0]);
        assert_eq!(changes, [(1, 0.35)]);
        assert!(shown.lock().unwrap().is_empty());
    }

    #[test]
    fn the_numbers_that_another_pixel_brings_are_shown() {
        let (mut parameters, wanted, shown) = parameters();
        let [log, physical] = [preset("hd"), preset_with_physical_pixel("hd")].map(Option::unwrap);
        wanted.lock()[1] = log.clone();
        assert_eq!(parameters.apply(|_, _| Ok(())), [""; 0]);
        for (pixel, expected) in [("physical", &physical), ("log", &log)] {
            wanted.check(1, "pixel", pixel).unwrap();
            wanted.set(1, "pixel", pixel);
            let take = |_: usize, sensor: &SensorModel| {
                assert_eq!(sensor, expected);
                Ok(())
            };
            assert_eq!(parameters.apply(take), [""; 0]);
        }
        assert_eq!(shown.lock().unwrap()[..], [(1, physical.contrast_mismatch), (1, 0.0)]);
    }

    #[test]
    fn what_cannot_be_is_refused_with_the_models_words() {
        let (_, wanted, _) = parameters();
        let refuse = |parameter: &str, value: &str| wanted.check(0, parameter, value).unwrap_err();
        assert!(refuse("substeps", "65").contains("`substeps` is 65, expected 1 to 64"));
        assert!(refuse("contrast_on", "NaN").contains("`contrast_on` is NaN"));
        assert!(refuse("intensity", "infrared").contains("`intensity` cannot be `infrared`"));
        assert!(refuse("refractory_ns", "-1").contains("`refractory_ns` cannot be `-1`"));
        assert!(refuse("width", "640").contains("fixed while the camera runs; it is 346x260 px"));
        assert!(refuse("aps_exposure_ns", "1000").contains("no APS topic"));
    }

    #[test]
    fn changes_that_are_wrong_only_together_are_undone() {
        let (mut parameters, wanted, shown) = parameters();
        for (parameter, value) in [("contrast_mismatch", "0.1"), ("contrast_on", "0.1")] {
            wanted.check(0, parameter, value).unwrap();
        }
        wanted.set(0, "contrast_mismatch", "0.1");
        wanted.set(0, "contrast_on", "0.1");
        let notices = parameters.apply(|camera, _| panic!("camera {camera} is changed"));
        assert!(notices[0].contains("`left`") && notices[0].contains("contrast_mismatch"), "{notices:?}");
        assert_eq!((wanted.sensor(0).contrast_on, &shown.lock().unwrap()[..]), (0.2, &[(0, 0.0)][..]));
    }

    #[test]
    fn what_is_asked_for_while_a_change_is_refused_stays() {
        let (mut parameters, wanted, shown) = parameters();
        wanted.set(0, "substeps", "8");
        let meanwhile = |_: usize, _: &SensorModel| {
            wanted.set(0, "contrast_mismatch", "0.05");
            Err("no".to_owned())
        };
        assert_eq!(parameters.apply(meanwhile).len(), 1);
        let asked = wanted.sensor(0);
        assert_eq!((asked.substeps, asked.contrast_mismatch), (32, 0.05));
        assert_eq!(shown.lock().unwrap()[..], [(0, 0.05)]);
        let mut taken = None;
        let take = |_: usize, sensor: &SensorModel| {
            taken = Some(sensor.clone());
            Ok(())
        };
        assert_eq!(parameters.apply(take), [""; 0]);
        assert_eq!(taken, Some(asked));
    }

    #[test]
    fn what_the_rig_refuses_is_undone_too() {
        let (mut parameters, wanted, shown) = parameters();
        wanted.set(0, "substeps", "8");
        let notices = parameters.apply(|_, _| Err("no".to_owned()));
        assert_eq!(notices, ["parameters of camera `left` stay as they were: no"]);
        assert_eq!((wanted.sensor(0).substeps, shown.lock().unwrap().len()), (32, 1));
    }
}
