//! What the events of a rig show: ids with each packet, and for each camera a table of instances that is sent when it
//! changes.

use super::{PublishError, RigPublisher, TickMessages};
use crate::encode::Header;
use crate::labels::{self, Instance};
use std::sync::Arc;

/// A camera's labels.
#[derive(Default)]
pub(super) struct Labels {
    /// Sorted by id.
    instances: Vec<Instance>,
    instances_are_stale: bool,
    /// Whether the user knows that ids of it are missing or cannot be sent.
    is_told: bool,
}

impl RigPublisher {
    /// Fails if a packet of `events` events cannot be sent with so many ids: the camera was announced without ids, or there
    /// is not one for each event. `None`, a packet without ids, is no error; for a camera with ids
    /// [`TickMessages::events`] gives a notice.
    pub fn check_ids(&self, camera: usize, events: usize, ids: Option<usize>) -> Result<(), PublishError> {
        self.check_camera(camera)?;
        let Some(actual) = ids else { return Ok(()) };
        self.check_labelled(camera)?;
        if actual != events {
            let camera = self.cameras[camera].plan.name.clone();
            return Err(PublishError::IdCount { camera, expected: events, actual });
        }
        Ok(())
    }

    /// Publishes with the next tick which instances a camera's ids are, if that has changed. It is sent again whenever
    /// it changes, and the last one is kept for subscribers that come later. Fails if the camera was announced without
    /// ids.
    pub fn set_instances(&mut self, camera: usize, mut instances: Vec<Instance>) -> Result<(), PublishError> {
        self.check_camera(camera)?;
        self.check_labelled(camera)?;
        instances.sort_by_key(|instance| instance.id);
        let labels = &mut self.cameras[camera].labels;
        if labels.instances != instances {
            *labels = Labels { instances, instances_are_stale: true, ..*labels };
        }
        Ok(())
    }

    fn check_labelled(&self, camera: usize) -> Result<(), PublishError> {
        let plan = &self.cameras[camera].plan;
        if plan.event_ids { Ok(()) } else { Err(PublishError::NoEventIds { camera: plan.name.clone() }) }
    }

    /// The ids of a packet that are sent, and their topic. Tells the user once if a camera's are missing or wrong.
    pub(super) fn admitted_ids<'a>(
        &mut self,
        camera: usize,
        events: usize,
        ids: Option<&'a [i64]>,
    ) -> Option<(usize, &'a [i64])> {
        let topic = self.plan.cameras[camera].event_ids;
        let wrong = match (topic, ids) {
            (None, None) => return None,
            (Some(_), None) => {
                let name = &self.cameras[camera].plan.name;
                format!("a packet of camera `{name}` came without ids, expected one for each event")
            }
            (_, Some(given)) => match self.check_ids(camera, events, Some(given.len())) {
                Ok(()) => return topic.map(|topic| (topic, given)),
                Err(error) => error.to_string(),
            },
        };
        if let Some(topic) = topic {
            self.statistics.count_failed(topic);
        }
        if !std::mem::replace(&mut self.cameras[camera].labels.is_told, true) {
            let _ = self.notify.send(format!("{wrong}; its events are sent without ids"));
        }
        None
    }
}

impl TickMessages<'_> {
    /// Tables of the cameras whose tables have changed.
    pub(super) fn instances(&mut self) {
        let plan = Arc::clone(&self.publisher.plan);
        for (camera, topics) in plan.cameras.iter().enumerate() {
            let Some(topic) = topics.instances else { continue };
            let labels = &mut self.publisher.cameras[camera].labels;
            if std::mem::replace(&mut labels.instances_are_stale, false) {
                // Lent to the encoder, which borrows the publisher.
                let table = std::mem::take(&mut labels.instances);
                let header = Header { stamp_ns: self.stamp_ns, frame_id: &topics.optical_frame };
                self.add_state(topic, |out| labels::instances(out, header, &table));
                self.publisher.cameras[camera].labels.instances = table;
            }
        }
    }
}
