//! `esaac serve`: the engine as a service that producers in other processes feed.

use crate::arguments::CommonArguments;
use crate::counted::counted;
use crate::gathered::{self, Gathered};
use crate::interrupt::Interrupt;
use crate::link_report::LinkReport;
use crate::outcome::Outcome;
use crate::report::{MemoryReport, Report};
use crate::rig_file::RigPlan;
use crate::ros::{self, RosArguments, RosMode, RosOutput};
use crate::run_record::RunRecord;
use crate::unread_flags::APS_NEEDS;
use crate::warnings::Warnings;
use crate::{device_choice, output_file, report, stderr};
use anyhow::Result;
use esaac_engine::{CameraConfig, EngineError, Rig};
use esaac_formats::event_file::write_npz;
use esaac_interop::{InteropError, LinkCounts, ServerOptions, Service, ServiceTick};
use esaac_model::SensorModel;
use esaac_ros::CameraPlan;
use std::path::PathBuf;
use std::time::Duration;

/// Arguments of `serve`.
#[derive(clap::Args, Clone, Debug)]
pub struct ServeArguments {
    /// Unix socket to make, in a folder of your own
    #[arg(long, value_name = "PATH")]
    pub socket: PathBuf,
    /// Rig file: cameras, formats, rings
    #[arg(long, value_name = "RIG.toml")]
    pub rig: PathBuf,
    /// Folder for camera_N.npz, written at the end; events are held in memory until then. Where a camera's time goes back,
    /// as with a producer that begins again, camera_N_run_2.npz begins, and so on
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// So long after a message it looks for the next one before it sleeps; more is quicker by tens of
    /// microseconds a frame and keeps a processor busy
    #[arg(long, value_name = "MICROSECONDS", default_value_t = 500)]
    pub spin_us: u64,
    /// End once every camera has had a producer and all have gone; else on SIGINT, SIGTERM or SIGHUP
    #[arg(long)]
    pub once: bool,
    /// ROS 2.
    #[command(flatten)]
    pub ros: RosArguments,
}

/// How often it looks whether to end.
const LOOK: Duration = Duration::from_millis(50);

/// Runs the command.
pub fn run(arguments: &ServeArguments, common: &CommonArguments) -> Result<Outcome> {
    let plan = RigPlan::read(&arguments.rig)?;
    check_files(arguments, plan.cameras.len())?;
    let interrupt = Interrupt::watch()?;
    let mut sensors = plan.sensors();
    let mut warnings = Warnings::default();
    warnings.tell_all(&plan.warnings);
    let mut ros = RosOutput::open(&arguments.ros, RosMode::Off, published(&plan), &mut warnings)?;
    warn_of_nowhere(arguments, &sensors, ros.is_open(), &mut warnings);
    let device = device_choice::open(common)?;
    let rig = Rig::with_options(&device, &plan.cameras, report::rig_options())?;
    let options =
        ServerOptions { spin: Duration::from_micros(arguments.spin_us), ..ServerOptions::default() };
    let mut service = Service::open(rig, &arguments.socket, &plan.terms, options)?;
    let cameras = counted(plan.cameras.len() as u64, "camera");
    stderr::line(format_args!("{cameras} at {}", arguments.socket.display()));

    let mut gathered = Gathered::new(plan.cameras.len(), arguments.out.as_deref());
    let mut serve = || -> Result<()> {
        while !(interrupt.came() || arguments.once && is_over(&service)) {
            turn(&mut service, &mut ros, &mut sensors, &mut gathered, &mut warnings)?;
        }
        Ok(())
    };
    // Whatever ends the service, what it has gathered is written.
    let mut outcomes = vec![serve()];
    service.close();
    outcomes.push(ros.show_cameras_now(&gathered.record, service.rig()));
    print_notices(&service);
    let connections = service.server().connections();
    if connections.refused + connections.not_accepted > 0 {
        stderr::line(format_args!(
            "{} of {} connections were refused; {} times one had to wait for descriptors or memory",
            connections.refused, connections.accepted, connections.not_accepted
        ));
    }
    let link = LinkReport::of(&service);
    for (sensor, synthesis) in sensors.iter_mut().zip(service.synthesis()) {
        sensor.synthesis = synthesis;
    }
    let memory = MemoryReport::of(service.rig());
    outcomes.push(gathered.record.take_light(service.rig()));
    take_warnings(&service, &mut gathered.record, &mut warnings);
    warn_of_abandoned(&service, &mut warnings);
    drop(service);
    outcomes.push(device_choice::check_validation(&device));

    let mut written = Vec::new();
    for (camera, sensor) in sensors.iter().enumerate() {
        if let Some(out) = arguments.out.as_ref().filter(|_| !gathered.had_frame(camera)) {
            let file = gathered::file(out, camera, 0);
            let file = file.display();
            stderr::line(format_args!("camera {camera}: no frame was stepped: {file} is not written"));
        }
        for (file, events) in gathered.files(camera) {
            outcomes.push(output_file::write(&file, |out| write_npz(out, events, &sensor.to_toml())));
            written.push(file.display().to_string());
        }
        if let Some(file) = gathered.left_over(camera) {
            warnings.tell(format_args!("{} is of an earlier service, and stays", file.display()));
        }
    }
    let published = ros.finish();
    outcomes.push(published.recorded);
    first_error(outcomes)?;
    let info = device_choice::report(device.info());
    let mut report =
        Report::new(format!("socket {}", arguments.socket.display()), info, &sensors, &gathered.record);
    report.intervals = gathered.intervals;
    report.simulated_ns = gathered.simulated_ns();
    report.warnings = warnings;
    report.cameras.iter_mut().zip(plan.notes).for_each(|(camera, notes)| camera.notes = notes);
    report.set_memory(memory);
    report.link = link;
    report.ros = published.summary;
    report.files = written;
    report.warn_of_losses();
    report.outcome(common.json)
}

/// Steps the cameras whose frames are there, if any.
fn turn(
    service: &mut Service,
    ros: &mut RosOutput,
    sensors: &mut [SensorModel],
    gathered: &mut Gathered,
    warnings: &mut Warnings,
) -> Result<()> {
    ros.change_sensors(service.rig_mut(), sensors);
    end_cameras(ros, service)?;
    let lines = match service.tick(LOOK) {
        Ok(None) => Vec::new(),
        Ok(Some(tick)) => {
            let starts = gathered.add(&tick, warnings)?;
            publish(ros, sensors, &tick)?;
            starts
        }
        // The step is lost, and not the rig: its cameras start anew with their next frames.
        Err(InteropError::Engine(error)) if !matches!(error, EngineError::Lost { .. }) => {
            vec![format!("a step failed and its frames are dropped: {error}")]
        }
        Err(error) => return Err(error.into()),
    };
    ros.show_cameras(&gathered.record, service.rig())?;
    lines.into_iter().for_each(|line| service.server().say(line));
    print_notices(service);
    Ok(())
}

/// The first error of all that was tried. The others are told at once.
fn first_error(outcomes: Vec<Result<()>>) -> Result<()> {
    let mut errors = outcomes.into_iter().filter_map(Result::err);
    let first = errors.next();
    errors.for_each(|error| stderr::line(format_args!("another error: {}", stderr::sentence(&error))));
    first.map_or(Ok(()), Err)
}

fn print_notices(service: &Service) {
    service.server().notices().iter().for_each(stderr::line);
}

/// The published cameras, with the lenses that the rig file tells.
fn published(plan: &RigPlan) -> Vec<CameraPlan> {
    let camera = |(number, camera): (usize, &CameraConfig)| {
        ros::camera(format!("camera_{number}"), &camera.sensor, camera.geometry.map(|geometry| geometry.lens))
    };
    plan.cameras.iter().enumerate().map(camera).collect()
}

/// Packets and APS frames of the cameras that had a frame, those of one time together.
fn publish(ros: &mut RosOutput, sensors: &[SensorModel], tick: &ServiceTick<'_>) -> Result<()> {
    let cameras = || (0..sensors.len()).filter(|&camera| tick.t_ns[camera].is_some());
    for camera in cameras().filter(|&camera| tick.first[camera]) {
        if let Some(t_ns) = tick.t_ns[camera] {
            ros.begin_camera(camera, t_ns)?;
        }
    }
    let mut times_ns: Vec<i64> = tick.t_ns.iter().flatten().copied().collect();
    times_ns.sort_unstable();
    times_ns.dedup();
    for t_ns in times_ns {
        ros.tick(t_ns, |out| {
            for camera in cameras().filter(|&c| tick.t_ns[c] == Some(t_ns) && !tick.first[c]) {
                ros::add_camera(out, camera, &sensors[camera], &tick.tick, None);
            }
        });
    }
    Ok(())
}

/// Tells the publisher which cameras nobody feeds: a producer that is gone keeps no time.
fn end_cameras(ros: &mut RosOutput, service: &Service) -> Result<()> {
    if !ros.is_open() {
        return Ok(());
    }
    let fed = |counts: &LinkCounts| counts.connections > counts.finished + counts.lost;
    let counts = service.counts();
    let mut idle = counts.iter().enumerate().filter(|(_, counts)| !fed(counts));
    idle.try_for_each(|(camera, _)| ros.end_camera(camera))
}

/// Whether every camera has had a producer, and none is there any more.
fn is_over(service: &Service) -> bool {
    let had = |counts: &LinkCounts| counts.connections > 0;
    service.counts().iter().all(had) && service.server().connected() == 0
}

/// Fails before any work is done if a camera's first file could not be written.
fn check_files(arguments: &ServeArguments, cameras: usize) -> Result<()> {
    let Some(out) = &arguments.out else { return Ok(()) };
    output_file::make_folder(out)?;
    (0..cameras).try_for_each(|camera| output_file::check(&gathered::file(out, camera, 0)))
}

/// Warns of what is simulated and goes nowhere.
fn warn_of_nowhere(
    arguments: &ServeArguments,
    sensors: &[SensorModel],
    has_messages: bool,
    warnings: &mut Warnings,
) {
    if has_messages {
        return;
    }
    if arguments.out.is_none() {
        warnings.tell("events are counted and not kept: expected --out, --record or --ros on");
    }
    for (camera, _) in sensors.iter().enumerate().filter(|(_, sensor)| sensor.aps_exposure_ns > 0) {
        warnings.tell(format_args!("camera {camera}: `aps_exposure_ns` does nothing: {APS_NEEDS}"));
    }
}

/// Warns of frames that came and were not stepped.
fn warn_of_abandoned(service: &Service, warnings: &mut Warnings) {
    for (camera, counts) in service.counts().iter().enumerate().filter(|(_, counts)| counts.abandoned > 0) {
        let frames = counted(counts.abandoned, "frame");
        let what = if counts.abandoned == 1 { "was" } else { "were" };
        warnings.tell(format_args!(
            "camera {camera}: {frames} came and {what} not stepped: a producer was lost before that, or the service ended"
        ));
    }
}

/// Takes over what the log has told of the cameras' frames, and tells what is to be told of their light.
fn take_warnings(service: &Service, record: &mut RunRecord, warnings: &mut Warnings) {
    for (camera, told) in service.input_warnings().iter().enumerate() {
        let of_camera = |text: &String| format!("camera {camera}: {text}");
        warnings.keep_all(told.texts().map(of_camera));
        let record = &mut record.cameras[camera];
        (record.frame_warning, record.path_warning) = (told.frame.clone(), told.paths.clone());
        warnings.tell_all(record.light_warnings.iter().map(of_camera));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esaac_engine::ash::vk;
    use esaac_engine::{Device, DeviceChoice, FaultPoint, Validation};
    use esaac_interop::ProducerOptions;
    use esaac_tests::interop::{Place, Uploader, flight, other_device};
    use std::sync::Arc;

    #[test]
    fn a_step_that_fails_does_not_end_the_service_and_a_lost_rig_does() {
        let sensor = SensorModel { width: 12, height: 9, ..SensorModel::default() };
        let sequence = flight(&sensor);
        let config = esaac_tests::run::camera(&sensor, 0, &sequence);
        // Its own, because the faults are the device's.
        let device = Device::open(DeviceChoice::Best, Validation::Off).unwrap();
        let rig = Rig::new(&device, std::slice::from_ref(&config)).unwrap();
        let place = Place::default();
        let terms = [(&config).into()];
        let mut service = Service::open(rig, &place.path(), &terms, ServerOptions::default()).unwrap();
        let producer = ProducerOptions::default();
        let mut producer = Uploader::connect(&other_device(), &place.path(), &producer).unwrap();
        let (mut ros, mut sensors) = (RosOutput::default(), [sensor]);
        let folder = tempfile::tempdir().unwrap();
        let (mut gathered, mut warnings) = (Gathered::new(1, Some(folder.path())), Warnings::default());
        let mut frames = sequence.frames.iter().zip((0..).map(|index| index * 10_000_000));
        let mut one_frame = |fault: Option<(FaultPoint, vk::Result)>| {
            let (frame, t_ns) = frames.next().unwrap();
            producer.send(frame, t_ns).unwrap();
            if let Some((at, result)) = fault {
                device.set_faults(Some(Arc::new(move |point| (point == at).then_some(result))));
            }
            let before = service.counts()[0];
            let done = |counts: LinkCounts| counts.stepped + counts.dropped;
            let mut outcome = Ok(());
            while outcome.is_ok() && done(service.counts()[0]) == done(before) {
                outcome = turn(&mut service, &mut ros, &mut sensors, &mut gathered, &mut warnings);
            }
            device.set_faults(None);
            outcome
        };
        let refused = Some((FaultPoint::Submit, vk::Result::ERROR_OUT_OF_HOST_MEMORY));
        for fault in [None, None, refused, None, None] {
            one_frame(fault).unwrap();
        }
        let lost = one_frame(Some((FaultPoint::Submit, vk::Result::ERROR_DEVICE_LOST)));
        assert!(lost.unwrap_err().to_string().contains("takes no more steps"));
        assert_eq!((gathered.intervals, gathered.simulated_ns()), (2, 20_000_000));
        assert_eq!(gathered.files(0).len(), 1, "time goes on");
        assert!(!gathered.record.cameras[0].events.is_empty());
    }

    #[test]
    fn the_first_error_is_the_one_that_is_returned() {
        let outcome = |text: &'static str| Err(anyhow::anyhow!(text));
        assert!(first_error(vec![Ok(()), Ok(())]).is_ok());
        let error = first_error(vec![Ok(()), outcome("no device"), outcome("no disk")]).unwrap_err();
        assert_eq!(error.to_string(), "no device");
    }
}
