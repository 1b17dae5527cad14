//! What a camera's status on `/diagnostics` says.

use crate::run_record::CameraRecord;
use esaac_engine::{EngineError, Rig};
use esaac_ros::CameraStatus;

/// The status of a camera: how its brightness is made, its light, what the engine has counted above zero, and what a
/// user should look into.
pub fn camera_status(counted: &CameraRecord, rig: &Rig, camera: usize) -> Result<CameraStatus, EngineError> {
    let mut values = vec![("synthesis".to_owned(), rig.synthesis(camera)?.name().to_owned())];
    if let Some(light) = rig.light(camera)? {
        values.push(("light".to_owned(), light.to_string()));
    }
    let counters = counted.diagnostics.iter().map(|(name, &count)| (name.as_str(), count));
    let counters =
        counters.chain([("dropped", counted.dropped), ("deferred_events", counted.waiting_at_end())]);
    values.extend(
        counters.filter(|(_, count)| *count > 0).map(|(name, count)| (name.to_owned(), count.to_string())),
    );
    let poses = rig.convention_warning(camera)?;
    let warnings = poses.into_iter().chain(rig.light_warnings(camera)?).collect();
    Ok(CameraStatus { values, warnings })
}
