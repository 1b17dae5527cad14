//! The body of POSES: where the camera and the moving instances were.
//!
//! Many tracks fit into one message, and a frame may have many messages. A track is whole in one message.

use super::{Header, MAX_BYTES, WireError};
use bytemuck::{Pod, Zeroable};

/// The camera in place of an instance: 0 is the static world, which has no poses.
const CAMERA: u32 = 0;

/// A pose at a time.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Sample {
    /// Time, nanoseconds.
    pub t_ns: i64,
    /// World from body: `x y z` in metres, then a unit quaternion `qx qy qz qw`.
    pub xyz_qxyzw: [f64; 7],
}

/// The poses of one body.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// An instance's id; `None` for the camera.
    pub instance: Option<u32>,
    /// Its poses at ascending times.
    pub samples: Vec<Sample>,
}

/// Before the tracks of a message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
struct PosesHead {
    header: Header,
    /// Tracks that follow.
    tracks: u32,
    /// Zero.
    reserved: u32,
}

/// Before the samples of a track.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
struct TrackHead {
    /// [`CAMERA`], or an instance's id.
    instance: u32,
    /// Samples that follow.
    samples: u32,
}

impl Track {
    /// Its bytes in a message.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of::<TrackHead>() + size_of_val(self.samples.as_slice())
    }
}

/// Tracks in messages that are no longer than they may be. No track is longer than a message by itself.
pub(crate) fn in_messages(tracks: Vec<Track>) -> Vec<Vec<Track>> {
    let mut messages: Vec<Vec<Track>> = Vec::new();
    let mut bytes = MAX_BYTES;
    for track in tracks {
        bytes += track.bytes();
        if bytes > MAX_BYTES {
            bytes = size_of::<PosesHead>() + track.bytes();
            messages.push(Vec::new());
        }
        messages.last_mut().expect("a message was begun").push(track);
    }
    messages
}

/// The message without its header.
pub(super) fn to_bytes(tracks: &[Track]) -> Vec<u8> {
    let head = PosesHead { tracks: tracks.len() as u32, ..PosesHead::default() };
    let mut bytes = bytemuck::bytes_of(&head).to_vec();
    for track in tracks {
        let instance = track.instance.unwrap_or(CAMERA);
        let samples = track.samples.len() as u32;
        bytes.extend_from_slice(bytemuck::bytes_of(&TrackHead { instance, samples }));
        bytes.extend_from_slice(bytemuck::cast_slice(&track.samples));
    }
    bytes
}

/// The tracks in a message. Its length must be what the tracks say.
pub(super) fn parse(message: &[u8]) -> Result<Vec<Track>, WireError> {
    let size = |expected| WireError::Size { kind: "POSES", expected, actual: message.len() };
    let mut at = 0;
    let mut take = |bytes: usize| {
        let end = at + bytes;
        let taken = message.get(at..end).ok_or_else(|| size(end))?;
        at = end;
        Ok::<&[u8], WireError>(taken)
    };
    let head: PosesHead = bytemuck::pod_read_unaligned(take(size_of::<PosesHead>())?);
    let mut tracks = Vec::new();
    for _ in 0..head.tracks {
        let head: TrackHead = bytemuck::pod_read_unaligned(take(size_of::<TrackHead>())?);
        let bytes = take(head.samples as usize * size_of::<Sample>())?;
        let samples = bytes.chunks_exact(size_of::<Sample>()).map(bytemuck::pod_read_unaligned).collect();
        tracks.push(Track { instance: (head.instance != CAMERA).then_some(head.instance), samples });
    }
    if at == message.len() { Ok(tracks) } else { Err(size(at)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(instance: Option<u32>, samples: usize) -> Track {
        let sample = |k: usize| Sample { t_ns: k as i64, xyz_qxyzw: [k as f64; 7] };
        Track { instance, samples: (0..samples).map(sample).collect() }
    }

    #[test]
    fn a_message_that_is_cut_or_lies_about_its_tracks_is_refused_with_its_length() {
        let tracks = vec![track(None, 3), track(Some(7), 1)];
        let bytes = to_bytes(&tracks);
        assert_eq!((bytes.len(), parse(&bytes).unwrap()), (24 + 2 * 8 + 4 * 64, tracks));
        for end in 0..bytes.len() {
            assert!(matches!(parse(&bytes[..end]), Err(WireError::Size { kind: "POSES", .. })), "{end}");
        }
        assert!(parse(&[&bytes[..], &[0]].concat()).is_err());
        let mut lying = bytes.clone();
        // The number of samples of the first track.
        lying[28..32].copy_from_slice(&u32::MAX.to_ne_bytes());
        assert!(matches!(parse(&lying), Err(WireError::Size { expected, .. }) if expected > 1 << 30));
        let mut lying = bytes;
        lying[16] = 1;
        assert_eq!(
            parse(&lying),
            Err(WireError::Size { kind: "POSES", expected: 24 + 8 + 3 * 64, actual: 296 })
        );
    }

    #[test]
    fn tracks_are_packed_into_as_few_messages_as_hold_them() {
        assert!(in_messages(Vec::new()).is_empty());
        let many = |tracks: usize, samples| (1..=tracks as u32).map(|id| track(Some(id), samples)).collect();
        for (tracks, samples, expected) in [(1, 1000, 1), (2, 1000, 2), (31, 33, 2), (30, 33, 1), (900, 1, 1)]
        {
            let messages = in_messages(many(tracks, samples));
            assert_eq!(messages.len(), expected, "{tracks} of {samples}");
            assert!(messages.iter().all(|tracks| to_bytes(tracks).len() <= MAX_BYTES));
            assert_eq!(messages.concat(), many(tracks, samples));
        }
    }
}
