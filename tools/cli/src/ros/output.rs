//! Publishes and records what a command simulates.

use super::arguments::{RosArguments, RosMode};
use super::status::camera_status;
use crate::run_record::RunRecord;
use crate::warnings::Warnings;
use crate::{stderr, unread_flags};
use anyhow::{Context, Result, anyhow};
use esaac_engine::Rig;
use esaac_model::SensorModel;
use esaac_ros::{
    BagWriter, CameraPlan, Plan, RigPublisher, SensorParameters, Sinks, Split, Summary, TickMessages,
};
use std::time::{Duration, Instant};

/// Time between two looks at the cameras' states: they are published once a second.
const STATUS: Duration = Duration::from_secs(1);

/// Publishes or records what a command simulates, or does nothing.
#[derive(Default)]
pub struct RosOutput {
    publisher: Option<RigPublisher>,
    parameters: Option<SensorParameters>,
    /// When the cameras' states were shown last.
    shown: Option<Instant>,
}

/// What became of a run's messages.
#[must_use = "a recording may be incomplete"]
pub struct Published {
    /// Counts, if there was a network or a recording.
    pub summary: Option<Summary>,
    /// Whether the recording is complete. To be looked at once the other results are safe.
    pub recorded: Result<()>,
}

impl RosOutput {
    /// Opens what the flags ask for. Bad names and files are errors. A missing network is an error if the
    /// flags ask for one, and a warning in mode `auto`.
    pub fn open(
        arguments: &RosArguments,
        default: RosMode,
        cameras: Vec<CameraPlan>,
        warnings: &mut Warnings,
    ) -> Result<Self> {
        let network = &arguments.network;
        let mode = match arguments.ros.unwrap_or(default) {
            RosMode::Auto if network.is_chosen() => RosMode::On,
            mode => mode,
        };
        for (flag, why) in arguments.unread(mode != RosMode::Off) {
            unread_flags::warn(warnings, flag, why);
        }
        if mode == RosMode::Off && arguments.record.is_none() {
            return Ok(RosOutput::default());
        }
        let options = arguments.options();
        let split = Split { slice_ns: arguments.ros_slice_ns, max_bytes: arguments.ros_max_bytes };
        let cameras: Vec<CameraPlan> =
            cameras.into_iter().map(|camera| CameraPlan { split, ..camera }).collect();
        // Wrong names are errors with and without a network, and before a file is created.
        Plan::new(&cameras, &options)?;
        let bag = arguments.record.as_deref().map(BagWriter::create).transpose()?;
        let joined = match mode {
            RosMode::Off => None,
            RosMode::On => {
                let does_without = |error| anyhow!("{error} (--ros off does without)");
                Some(network.open(&cameras).map_err(does_without)?)
            }
            RosMode::Auto => network
                .open(&cameras)
                .inspect_err(|error| {
                    warnings.tell(format_args!(
                        "not publishing to ROS 2: {error} (--ros off turns this warning off)"
                    ));
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
            stderr::line(arguments.invitation(publisher.plan()));
        }
        Ok(RosOutput { publisher: Some(publisher), parameters, shown: None })
    }

    /// Whether there is a network or a recording.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.publisher.is_some()
    }

    /// Applies the parameters that ROS nodes have set since the last tick to `rig` and `sensors`. Returns
    /// whether any sensor changed.
    pub fn change_sensors(&mut self, rig: &mut Rig, sensors: &mut [SensorModel]) -> bool {
        self.change(sensors, |camera, sensor| {
            rig.set_sensor(camera, sensor.clone()).map_err(|error| error.to_string())
        })
    }

    /// Applies changed parameters with `set`. A sensor that `set` refuses stays as it was everywhere: in the
    /// rig, in `sensors`, on the topic `sensor` and in the parameters that other nodes see.
    fn change(
        &mut self,
        sensors: &mut [SensorModel],
        mut set: impl FnMut(usize, &SensorModel) -> Result<(), String>,
    ) -> bool {
        let (Some(publisher), Some(parameters)) = (&mut self.publisher, &mut self.parameters) else {
            return false;
        };
        let mut changed = false;
        let notices = parameters.apply(|camera, sensor| {
            publisher.check_camera(camera).map_err(|error| error.to_string())?;
            set(camera, sensor)?;
            // From here on nothing can fail.
            publisher.set_sensor(camera, sensor).map_err(|error| error.to_string())?;
            sensors[camera] = sensor.clone();
            changed = true;
            Ok(())
        });
        notices.iter().for_each(stderr::line);
        changed
    }

    /// Publishes a tick; `fill` adds its messages.
    pub fn tick(&mut self, t_ns: i64, fill: impl FnOnce(&mut TickMessages<'_>)) {
        let Some(publisher) = &mut self.publisher else { return };
        let mut tick = publisher.tick(t_ns);
        fill(&mut tick);
        tick.send();
        publisher.notices().iter().for_each(stderr::line);
    }

    /// Shows on `/diagnostics` what a run has counted of its cameras, and what the rig says of their light and poses, once
    /// a second.
    pub fn show_cameras(&mut self, record: &RunRecord, rig: &Rig) -> Result<()> {
        if self.shown.is_some_and(|shown| shown.elapsed() < STATUS) {
            return Ok(());
        }
        self.shown = Some(Instant::now());
        self.show_cameras_now(record, rig)
    }

    /// The same, at the end of a run.
    pub fn show_cameras_now(&mut self, record: &RunRecord, rig: &Rig) -> Result<()> {
        let Some(publisher) = &mut self.publisher else { return Ok(()) };
        for (camera, counted) in record.cameras.iter().enumerate() {
            publisher.set_status(camera, camera_status(counted, rig, camera)?)?;
        }
        Ok(())
    }

    /// Allows a camera's time to go back with the next tick, to its first frame's.
    pub fn begin_camera(&mut self, camera: usize, t_ns: i64) -> Result<()> {
        let Some(publisher) = &mut self.publisher else { return Ok(()) };
        Ok(publisher.begin_camera(camera, t_ns)?)
    }

    /// Notes that a camera has nobody who feeds it: its time holds the others' no longer.
    pub fn end_camera(&mut self, camera: usize) -> Result<()> {
        let Some(publisher) = &mut self.publisher else { return Ok(()) };
        Ok(publisher.end_camera(camera)?)
    }

    /// Sends what waits, and closes the recording.
    pub fn finish(self) -> Published {
        let Some(publisher) = self.publisher else { return Published { summary: None, recorded: Ok(()) } };
        let (summary, notices, recorded) = publisher.finish();
        notices.iter().for_each(stderr::line);
        Published { summary: Some(summary), recorded: recorded.context("the recording is incomplete") }
    }
}

#[cfg(test)]
mod tests {
    use super::super::camera;
    use super::*;
    use esaac_ros::parameters::{ParameterStore, WantedSensors};
    use esaac_ros::{BagReader, Policy, RigOptions};
    use std::path::Path;
    use std::sync::{Arc, Mutex};

    /// Sub-steps that other nodes were shown, in order.
    type Shown = Arc<Mutex<Vec<u32>>>;

    struct Store(Shown);

    impl ParameterStore for Store {
        fn show(&self, _: usize, sensor: &SensorModel) {
            self.0.lock().unwrap().push(sensor.substeps);
        }
    }

    /// A recording of one camera whose parameters can be set.
    fn output(path: &Path, sensor: &SensorModel) -> (RosOutput, WantedSensors, Shown) {
        let cameras = vec![camera("left".to_owned(), sensor, None)];
        let (wanted, shown) = (WantedSensors::new(&cameras), Shown::default());
        let parameters = SensorParameters::new(&cameras, wanted.clone(), Box::new(Store(Arc::clone(&shown))));
        let sinks = Sinks { transport: None, bag: Some(BagWriter::create(path).unwrap()) };
        let options = RigOptions { policy: Policy::Lossless, ..RigOptions::default() };
        let publisher = RigPublisher::start(cameras, options, sinks).unwrap();
        let output = RosOutput { publisher: Some(publisher), parameters: Some(parameters), shown: None };
        (output, wanted, shown)
    }

    fn recorded_sensors(path: &Path) -> usize {
        let mut bag = BagReader::open(path).unwrap();
        let mut count = 0;
        while let Some(message) = bag.next_message().unwrap() {
            count += usize::from(bag.topics()[message.topic].name == "/esaac/left/sensor");
        }
        count
    }

    #[test]
    fn a_sensor_that_the_rig_refuses_stays_as_it_was_everywhere() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let old = SensorModel::default();
        let (mut output, wanted, shown) = output(&path, &old);
        let mut sensors = [old.clone()];
        // A rig that has no memory for so many sub-steps.
        let mut rig = old.clone();
        let mut set = |_: usize, sensor: &SensorModel| match sensor.substeps {
            64 => Err("no memory".to_owned()),
            _ => {
                rig = sensor.clone();
                Ok(())
            }
        };
        output.tick(0, |_| ());
        wanted.set(0, "substeps", "64");
        wanted.set(0, "contrast_on", "0.3");
        assert!(!output.change(&mut sensors, &mut set));
        assert_eq!(sensors[0], old);
        assert_eq!((wanted.sensor(0), &shown.lock().unwrap()[..]), (old.clone(), &[old.substeps][..]));
        output.tick(1, |_| ());
        assert!(!output.change(&mut sensors, &mut set), "a refused change is not tried again");

        wanted.set(0, "substeps", "16");
        assert!(output.change(&mut sensors, &mut set));
        let new = SensorModel { substeps: 16, ..old };
        assert_eq!((&sensors[0], &rig), (&new, &new), "the next change has nothing of the refused one");
        output.tick(2, |_| ());
        let Published { summary, recorded } = output.finish();
        recorded.unwrap();
        assert_eq!(summary.unwrap().lost(), 0);
        assert_eq!(recorded_sensors(&path), 2, "as it was first, and as it became");
    }
}
