//! The report's part about how frames reached the engine.

use esaac_interop::session::Agreement;
use esaac_interop::wire::{self, Version};
use esaac_interop::{LinkCounts, Service};
use serde::Serialize;

/// How a run's frames reached the engine.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LinkReport {
    /// Processes: this one, and those whose producers were given memory to share.
    pub processes: usize,
    /// Who provided the shared memory. `None` in one process.
    pub memory: Option<String>,
    /// How the processes synchronise. `None` in one process.
    pub timeline: Option<String>,
    /// The protocol's version, or versions. `None` in one process.
    pub protocol: Option<String>,
    /// Synthesis of each camera by what its producer gives. Empty in one process.
    pub synthesis: Vec<String>,
    /// For each camera what is wrong with its depth and poses, if they do not predict its motion vectors. Empty in one
    /// process.
    pub pose_warnings: Vec<Option<String>>,
    /// Frames simulated, all cameras.
    pub frames: u64,
    /// Frames that newer ones replaced, or whose step failed.
    pub dropped_frames: u64,
    /// Frames that came and were not stepped, because their producer was lost or the service ended.
    pub abandoned_frames: u64,
    /// How often a camera started anew: for another producer, or after a gap that dropped frames had left.
    pub resets: u64,
    /// Connections that were refused before they had memory to share.
    pub refused_connections: u64,
    /// Copies through host memory per frame, between the renderer's image and the engine's.
    pub host_copies: f64,
    /// Copies on the device per frame.
    pub device_copies: f64,
}

impl LinkReport {
    /// Frames that this process rendered into the engine's own buffers, without a copy.
    #[must_use]
    pub fn in_process(frames: u64) -> Self {
        LinkReport { processes: 1, frames, ..LinkReport::default() }
    }

    /// Frames that reached a service.
    #[must_use]
    pub fn of(service: &Service) -> Self {
        let server = service.server();
        let synthesis = service.synthesis().into_iter().map(|synthesis| synthesis.name().to_owned());
        LinkReport {
            refused_connections: server.connections().refused,
            synthesis: synthesis.collect(),
            pose_warnings: service.pose_warnings().to_vec(),
            processes: server.processes(),
            resets: service.resets(),
            ..LinkReport::counted(&server.counts(), &server.all_agreements())
        }
    }

    fn counted(counts: &[LinkCounts], agreements: &[Agreement]) -> Self {
        let sum = |of: fn(&LinkCounts) -> u64| counts.iter().map(of).sum::<u64>();
        let frames = sum(|c| c.stepped);
        let per_frame = |copies: u64| if frames == 0 { 0.0 } else { copies as f64 / frames as f64 };
        let names = |name: fn(&Agreement) -> &'static str| {
            let mut names: Vec<&str> = agreements.iter().map(name).collect();
            names.sort_unstable();
            names.dedup();
            (!names.is_empty()).then(|| names.join(", "))
        };
        LinkReport {
            processes: 1,
            memory: names(|agreement| memory_name(agreement.memory)),
            timeline: names(|agreement| timeline_name(agreement.timeline)),
            protocol: names(|agreement| if agreement.version == Version::One { "1" } else { "2" }),
            synthesis: Vec::new(),
            pose_warnings: Vec::new(),
            frames,
            dropped_frames: sum(|c| c.dropped),
            abandoned_frames: sum(|c| c.abandoned),
            resets: 0,
            refused_connections: 0,
            host_copies: per_frame(sum(|c| c.host_copies)),
            device_copies: per_frame(sum(|c| c.device_copies)),
        }
    }

    /// One line of text.
    #[must_use]
    pub fn to_text(&self) -> String {
        let processes = match self.processes {
            1 => "1 process".to_owned(),
            several => format!("{several} processes"),
        };
        let way = match (&self.memory, &self.timeline, &self.protocol) {
            (Some(memory), Some(timeline), Some(protocol)) => {
                format!("{processes}, protocol {protocol}, memory {memory}, timelines {timeline}")
            }
            _ => processes,
        };
        let synthesis = match self.synthesis.as_slice() {
            [] => String::new(),
            of_cameras => format!("; synthesis {}", of_cameras.join(", ")),
        };
        let abandoned = match self.abandoned_frames {
            0 => String::new(),
            frames => format!(", {frames} not stepped"),
        };
        format!(
            "{way}{synthesis}; {} frames, {} dropped{abandoned}; {} host copies and {} device copies per frame",
            self.frames, self.dropped_frames, self.host_copies, self.device_copies
        )
    }
}

/// The name of a memory flag.
#[must_use]
pub fn memory_name(memory: u32) -> &'static str {
    match memory {
        wire::MEMORY_EXPORTED => "exported by the engine",
        wire::MEMORY_HOST => "of the host",
        wire::MEMORY_BROUGHT => "brought by the producer",
        wire::MEMORY_IMAGES => "images brought by the producer",
        _ => "unknown",
    }
}

/// The name of a timeline flag.
#[must_use]
pub fn timeline_name(timeline: u32) -> &'static str {
    match timeline {
        wire::TIMELINE_EXPORTED => "exported",
        wire::TIMELINE_CARRIED => "carried over the socket",
        _ => "unknown",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_are_a_frame() {
        let counts = LinkCounts { stepped: 4, device_copies: 6, host_copies: 0, ..LinkCounts::default() };
        let agreement = Agreement {
            version: Version::Two,
            memory: wire::MEMORY_HOST,
            timeline: wire::TIMELINE_CARRIED,
            geometry: true,
        };
        let report = LinkReport::counted(&[counts, LinkCounts::default()], &[agreement]);
        assert_eq!((report.device_copies, report.host_copies, report.frames), (1.5, 0.0, 4));
        assert_eq!(report.memory.as_deref(), Some("of the host"));
        let report =
            LinkReport { processes: 3, synthesis: vec!["rigid".to_owned(), "motion".to_owned()], ..report };
        assert!(
            report.to_text().contains("3 processes, protocol 2, memory of the host"),
            "{}",
            report.to_text()
        );
        assert!(report.to_text().contains("; synthesis rigid, motion; 4 frames"), "{}", report.to_text());
        assert!(report.to_text().contains("0 host copies and 1.5 device copies"), "{}", report.to_text());
        let of_first = Agreement { version: Version::One, ..agreement };
        let counts = LinkCounts { abandoned: 2, ..counts };
        let report = LinkReport::counted(&[counts, counts], &[agreement, of_first]);
        assert_eq!((report.protocol.as_deref(), report.abandoned_frames), (Some("1, 2"), 4));
        assert!(report.to_text().contains("8 frames, 0 dropped, 4 not stepped;"), "{}", report.to_text());
        assert!(LinkReport::in_process(3).to_text().starts_with("1 process; 3 frames"));
    }
}
