//! `esaac serve`: the engine as a service that producers in other processes feed.

use crate::arguments::CommonArguments;
use crate::counted::counted;
use crate::interrupt::Interrupt;
use crate::link_report::LinkReport;
use crate::outcome::Outcome;
use crate::report::{MemoryReport, Report};
use crate::rig_file::RigPlan;
use crate::ros::{self, RosArguments, RosMode, RosOutput};
use crate::run_record::RunRecord;
use crate::{device_choice, output_file, report, stderr};
use anyhow::Result;
use esaac_engine::{CameraConfig, Rig};
use esaac_formats::event_file::write_npz;
use esaac_interop::{LinkCounts, ServerOptions, Service, ServiceTick};
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
    /// Folder for camera_N.npz, written at the end; events are held in memory until then
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// So long after a message it looks for the next one before it sleeps; more is quicker by tens of
    /// microseconds a frame and keeps a processor busy
    #[arg(long, value_name = "MICROSECONDS", default_value_t = 500)]
    pub spin_us: u64,
    /// End once every camera has had a producer and all have gone; else on SIGINT or SIGTERM
    #[arg(long)]
    pub once: bool,
    /// ROS 2.
    #[command(flatten)]
    pub ros: RosArguments,
}

/// The report's timings are of so many intervals at least, the last ones.
const TIMINGS: usize = 50_000;

/// How often it looks whether to end.
const LOOK: Duration = Duration::from_millis(50);

/// Runs the command.
pub fn run(arguments: &ServeArguments, common: &CommonArguments) -> Result<Outcome> {
    let plan = RigPlan::read(&arguments.rig)?;
    let files = output_files(arguments, plan.cameras.len())?;
    let interrupt = Interrupt::watch()?;
    let mut sensors = plan.sensors();
    let mut ros = RosOutput::open(&arguments.ros, RosMode::Off, published(&plan))?;
    let device = device_choice::open(common)?;
    let rig = Rig::with_options(&device, &plan.cameras, report::rig_options())?;
    let options =
        ServerOptions { spin: Duration::from_micros(arguments.spin_us), ..ServerOptions::default() };
    let mut service = Service::open(rig, &arguments.socket, &plan.terms, options)?;
    let cameras = counted(plan.cameras.len() as u64, "camera");
    stderr::line(format_args!("{cameras} at {}", arguments.socket.display()));

    let mut record = RunRecord::new(plan.cameras.len());
    let mut had_frame = vec![false; plan.cameras.len()];
    let (mut first_ns, mut last_ns, mut intervals) = (None, 0, 0);
    while !(interrupt.came() || arguments.once && is_over(&service)) {
        ros.change_sensors(service.rig_mut(), &mut sensors);
        end_cameras(&mut ros, &service)?;
        let mut starts = Vec::new();
        if let Some(tick) = service.tick(LOOK)? {
            let mut is_interval = false;
            for (camera, t_ns) in tick.t_ns.iter().enumerate() {
                had_frame[camera] |= t_ns.is_some();
                if let (Some(t_ns), false) = (t_ns, tick.first[camera]) {
                    is_interval = true;
                    record.add_camera(camera, &tick.tick, arguments.out.is_some())?;
                    last_ns = last_ns.max(*t_ns);
                } else if let Some(t_ns) = t_ns {
                    record.begin_anew(camera);
                    starts.push(format!("camera {camera}: first frame, of {t_ns} ns"));
                    first_ns = Some(first_ns.map_or(*t_ns, |first: i64| first.min(*t_ns)));
                }
            }
            publish(&mut ros, &sensors, &tick)?;
            // A first frame ends no interval.
            if is_interval {
                record.add_timing(tick.tick.stage_ns, tick.tick.submit_to_packet_ns);
                record.forget_old_timings(TIMINGS);
                intervals += 1;
            }
        }
        ros.show_cameras(&record, service.rig())?;
        starts.into_iter().for_each(|line| service.server().say(line));
        print_notices(&service);
    }
    ros.show_cameras_now(&record, service.rig())?;
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
    record.take_light(service.rig())?;
    drop(service);
    device_choice::check_validation(&device)?;

    let (files, unfed): (Vec<_>, Vec<_>) =
        files.iter().enumerate().partition(|&(camera, _)| had_frame[camera]);
    for (camera, file) in unfed {
        stderr::line(format_args!("camera {camera} had no frame: {} is not written", file.display()));
    }
    for &(camera, file) in &files {
        let (events, sensor) = (&record.cameras[camera].events, sensors[camera].to_toml());
        output_file::write(file, |out| write_npz(out, events, &sensor))?;
    }
    let info = device_choice::report(device.info());
    let mut report = Report::new(format!("socket {}", arguments.socket.display()), info, &sensors, &record);
    report.intervals = intervals;
    report.simulated_ns = first_ns.map_or(0, |first| (last_ns - first).max(0));
    report.set_memory(memory);
    report.link = link;
    let published = ros.finish();
    published.recorded?;
    report.ros = published.summary;
    report.files = files.iter().map(|(_, file)| file.display().to_string()).collect();
    report.warn_of_waiting();
    report.outcome(common.json)
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

fn output_files(arguments: &ServeArguments, cameras: usize) -> Result<Vec<PathBuf>> {
    let Some(out) = &arguments.out else { return Ok(Vec::new()) };
    output_file::make_folder(out)?;
    let files: Vec<PathBuf> = (0..cameras).map(|camera| out.join(format!("camera_{camera}.npz"))).collect();
    files.iter().try_for_each(|file| output_file::check(file))?;
    Ok(files)
}
